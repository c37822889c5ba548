"""The extended Kalman filter in the three time domains of A.2, the linear Kalman filter, the Luenberger observer."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import place_poles

from observer.system import Reading, System, runge_kutta

Array = NDArray[np.float64]


def predict_continuous(system: System, x: Array, P: Array, dt: float) -> tuple[Array, Array]:
    """CD-EKF: integrate A.16 and A.17 over `dt` (s), state and covariance in one Runge-Kutta step."""
    n = len(x)

    def rate(y: Array) -> Array:
        a = system.jacobian(y[:, 0])
        return np.column_stack([system.dynamics(y[:, 0]), a @ y[:, 1:] + y[:, 1:] @ a.T + system.noise])

    y = runge_kutta(rate, np.column_stack([x, P]), dt)
    return y[:, 0], 0.5 * (y[:, 1 : n + 1] + y[:, 1 : n + 1].T)


def predict_discrete(system: System, x: Array, P: Array, dt: float) -> tuple[Array, Array]:
    """DD-EKF: A.14 with the exponential of the *Jacobian* at the start (ERRATA on A.21) and Q_d = Q_c dt (A.43)."""
    phi = expm(system.jacobian(x) * dt)
    return runge_kutta(system.dynamics, x, dt), phi @ P @ phi.T + system.noise * dt


def correct(x: Array, P: Array, reading: Reading) -> tuple[Array, Array]:
    """A.18 (and A.15), in Joseph's form, which keeps P positive whatever the rounding."""
    h = reading.jacobian(x)
    s = h @ P @ h.T + reading.noise
    gain = np.linalg.solve(s, h @ P).T
    keep = np.eye(len(x)) - gain @ h
    P = keep @ P @ keep.T + gain @ reading.noise @ gain.T
    return x + gain @ reading.innovation(reading.expected(x)), 0.5 * (P + P.T)


def integrate_continuous(
    system: System, x: Array, P: Array, measured: Callable[[float], Reading], begin: float, end: float, step: float
) -> tuple[Array, Array]:
    """CC-EKF: integrate A.12 from `begin` to `end` (s) with Runge-Kutta steps of `step` (s).

    `measured` gives the reading at a time; its noise is R_c, a density (value squared times s). The gain is
    P H' R^-1 (A.13 lacks the transpose: ERRATA).
    """
    n, t = len(x), begin
    while t < end - 1e-12:
        dt = min(step, end - t)

        def rate(y: Array, reading: Reading) -> Array:
            state, cov = y[:, 0], y[:, 1 : n + 1]
            a, h = system.jacobian(state), reading.jacobian(state)
            gain = np.linalg.solve(reading.noise, h @ cov).T
            slope = system.dynamics(state) + gain @ reading.innovation(reading.expected(state))
            return np.column_stack([slope, a @ cov + cov @ a.T + system.noise - gain @ reading.noise @ gain.T])

        # the reading at the middle of the step stands for the step
        reading = measured(t + 0.5 * dt)
        y = runge_kutta(partial(rate, reading=reading), np.column_stack([x, P]), dt)
        x, P = y[:, 0], 0.5 * (y[:, 1:] + y[:, 1:].T)
        t += dt
    return x, P


def linear_system(a: Array, noise: Array) -> System:
    """dx/dt = a x: on it the extended filters above are the linear Kalman filter."""
    return System(lambda x: a @ x, lambda x: a, noise)


def linear_reading(c: Array, value: Array, noise: Array) -> Reading:
    """y = c x."""
    return Reading(value, lambda x: c @ x, lambda x: c, noise)


def luenberger_gain(a: Array, c: Array, poles: Array) -> Array:
    """Return L (n, m) that gives A - L C the eigenvalues `poles` (A.1). Raises ValueError where (A, C) forbids it."""
    return place_poles(a.T, c.T, poles).gain_matrix.T  # pyright: ignore[reportAttributeAccessIssue]


def observe_luenberger(a: Array, c: Array, gain: Array, x: Array, y: Array, dt: float) -> Array:
    """Return the states (k, n) of dx/dt = a x + L (y - c x) over measurements `y` (k, m), held for `dt` (s) each."""
    out = np.empty((len(y), len(x)))
    closed = a - gain @ c
    n = len(x)
    # exact over a held input: the exponential of the closed loop with its input as a further state
    block = expm(np.block([[closed, gain], [np.zeros((c.shape[0], n + c.shape[0]))]]) * dt)
    for k in range(len(y)):
        x = block[:n, :n] @ x + block[:n, n:] @ y[k]
        out[k] = x
    return out
