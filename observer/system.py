"""What a filter needs to know of any system: dynamics, noise, measurements. The readable filters take this form.

`kalman`, `square_root`, `unscented` and `particle` hold the family of seed 004, appendix A, as plain functions on
(state, covariance); `car_system` and `car_reading` give them the 17-state car of `observer.model`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer import model
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]


@dataclass(frozen=True)
class System:
    """dx = f(x) dt + noise of density `noise`; n states."""

    dynamics: Callable[[Array], Array]
    """f: (n,) to (n,), and column by column (n, k) to (n, k)."""
    jacobian: Callable[[Array], Array]
    """A_c = df/dx: (n,) to (n, n)."""
    noise: Array
    """Q_c, (n, n), per second."""


@dataclass(frozen=True)
class Reading:
    """What was measured at one instant: y = h(x) + noise of covariance `noise`; m values."""

    value: Array
    """y, (m,)."""
    expected: Callable[[Array], Array]
    """h: (n,) to (m,), and column by column (n, k) to (m, k)."""
    jacobian: Callable[[Array], Array]
    """H_c: (n,) to (m, n)."""
    noise: Array
    """R_k, (m, m)."""
    angles: tuple[bool, ...] = ()
    """Which values are angles, whose innovation is wrapped to [-pi, pi); empty: none."""

    def innovation(self, told: Array) -> Array:
        """y - told, (m,), wrapped where it is an angle."""
        nu = self.value - told
        if self.angles:
            wrapped = (nu + np.pi) % (2.0 * np.pi) - np.pi
            nu = np.where(self.angles, wrapped, nu)
        return nu


def car_system(car: Car, noise: Array) -> System:
    """The 17-state model with noise densities `noise` (17,), units of the states squared per second."""

    def dynamics(x: Array) -> Array:
        if x.ndim == 1:
            return np.array(model.dynamics(x, car))
        return np.array(np.broadcast_arrays(*model.dynamics(x, car, np)))  # type: ignore[arg-type]

    return System(dynamics, lambda x: model.dynamics_jacobian(x, car), np.diag(noise))


def car_reading(car: Car, kinds: Sequence[int], value: Array, variance: Array, aux: float | Array = 0.0) -> Reading:
    """Measurements `kinds` (codes of `observer.model`) with `value` (m,) and `variance` (m,), SI; `aux` one or (m,)."""
    pairs = tuple(zip(kinds, np.broadcast_to(aux, len(kinds)).tolist(), strict=True))

    def expected(x: Array) -> Array:
        if x.ndim == 1:
            return np.array([model.measurement(kind, x, car, each) for kind, each in pairs])
        told = [model.measurement(kind, x, car, each, np) for kind, each in pairs]  # type: ignore[arg-type]
        return np.array(told).reshape(len(pairs), -1)

    return Reading(
        np.asarray(value, dtype=np.float64),
        expected,
        lambda x: np.array([model.measurement_jacobian(kind, x, car, each) for kind, each in pairs]).reshape(-1, 17),
        np.diag(variance),
        tuple(kind in model.HEADINGS for kind in kinds),
    )


def runge_kutta(rate: Callable[[Array], Array], y: Array, dt: float) -> Array:
    """One classical Runge-Kutta step of fourth order of dy/dt = rate(y); `y` of any shape."""
    k1 = rate(y)
    k2 = rate(y + 0.5 * dt * k1)
    k3 = rate(y + 0.5 * dt * k2)
    k4 = rate(y + dt * k3)
    return y + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
