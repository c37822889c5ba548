"""The square-root CD-EKF of A.3.3.1: the covariance as its lower factor S, P = S S', which cannot turn negative."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from observer.system import Reading, System, runge_kutta

Array = NDArray[np.float64]


def lower_factor(wide: Array) -> Array:
    """Return L (n, n), lower, with L L' = `wide` `wide`': the *L* factor of an LQ factorisation (ERRATA on A.22)."""
    return np.asarray(np.linalg.qr(wide.T, mode="r")).T


def predict(system: System, x: Array, S: Array, noise_factor: Array, dt: float) -> tuple[Array, Array]:
    """A.21 to A.23 over `dt` (s). `noise_factor` (n, n) is the lower factor of Q_c.

    The transition is the exponential of the Jacobian at the middle of the interval (A.21 prints that of the dynamics),
    the noise Q_c dt.
    """
    middle = runge_kutta(system.dynamics, x, 0.5 * dt)
    phi = expm(system.jacobian(middle) * dt)
    return runge_kutta(system.dynamics, x, dt), lower_factor(np.hstack([phi @ S, np.sqrt(dt) * noise_factor]))


def correct(x: Array, S: Array, reading: Reading) -> tuple[Array, Array]:
    """A.24 to A.28: one factorisation gives the gain and the new factor. In M_2 the blocks are n_y, then n_x wide."""
    h, m = reading.jacobian(x), len(reading.value)
    pre = np.block([[np.linalg.cholesky(reading.noise), h @ S], [np.zeros((len(x), m)), S]])
    post = lower_factor(pre)
    w, k = post[:m, :m], post[m:, :m]
    nu = reading.innovation(reading.expected(x))
    return x + k @ np.linalg.solve(w, nu), post[m:, m:]
