"""The readable CD-EKF of A.3.1.3 on the 17 states: RK4 of state and covariance, dense matrices, one measurement vector.

Slow on purpose. It is what the compiled filters are held against, and what algorithm 1 of seed 004 says line by line.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer import model
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]


def rates(x: Array, P: Array, q: Array, car: Car) -> tuple[Array, Array]:
    """Return dx/dt (17,) and dP/dt (17, 17) of A.17; `q` (17, 17) is the noise density Q_c."""
    a = model.dynamics_jacobian(x, car)
    return np.array(model.dynamics(x, car)), a @ P + P @ a.T + q


def predict_runge_kutta(x: Array, P: Array, q: Array, dt: float, car: Car) -> tuple[Array, Array]:
    """Integrate A.16 and A.17 over `dt` (s) by one classical Runge-Kutta step of fourth order."""
    k1, c1 = rates(x, P, q, car)
    k2, c2 = rates(x + 0.5 * dt * k1, P + 0.5 * dt * c1, q, car)
    k3, c3 = rates(x + 0.5 * dt * k2, P + 0.5 * dt * c2, q, car)
    k4, c4 = rates(x + dt * k3, P + dt * c3, q, car)
    return x + dt / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4), P + dt / 6.0 * (c1 + 2 * c2 + 2 * c3 + c4)


def predict_transition(x: Array, P: Array, q: Array, dt: float, car: Car) -> tuple[Array, Array]:
    """Integrate by the second-order transition at the interval's midpoint: Phi = I + A dt + (A dt)^2 / 2."""
    middle = x + 0.5 * dt * np.array(model.dynamics(x, car))
    a = dt * model.dynamics_jacobian(middle, car)
    phi = np.eye(17) + a + 0.5 * a @ a
    return x + dt * np.array(model.dynamics(middle, car)), phi @ P @ phi.T + dt * q


def correct(
    x: Array, P: Array, kinds: Sequence[int], y: Array, r: Array, car: Car, aux: float = 0.0
) -> tuple[Array, Array, Array, Array]:
    """Correct by A.18 with the measurements `kinds` (m,), values `y` (m,), variances `r` (m,).

    Returns state, covariance, innovation (m,) and its covariance (m, m). Angles are wrapped.
    """
    h = np.array([model.measurement_jacobian(kind, x, car, aux) for kind in kinds])
    innovation = y - np.array([model.measurement(kind, x, car, aux) for kind in kinds])
    for i, kind in enumerate(kinds):
        if kind in model.HEADINGS:
            innovation[i] = (innovation[i] + np.pi) % (2.0 * np.pi) - np.pi
    s = h @ P @ h.T + np.diag(r)
    gain = np.linalg.solve(s, h @ P).T
    P = P - gain @ s @ gain.T
    return x + gain @ innovation, 0.5 * (P + P.T), innovation, s
