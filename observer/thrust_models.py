"""Local polynomial models of the thrust (seed 004, note 12): dF/dt = xi_1, dxi_1/dt = xi_2, ..., noise on the last.

The model of chapter 3 has dF/dt = 0 and noise: a random walk. A polynomial of order k follows a thrust that swings for
a while, at the price of a filter that overshoots where it steps. States 17, 18, ... are xi_1 (N/s), xi_2 (N/s2), ...
"""

import numpy as np

from observer import model
from observer.system import Array, Reading, System, car_system
from vehicle_model.car.parameters import Car


def thrust_system(car: Car, noise: Array, order: int, wandering: float) -> System:
    """The car with a thrust of polynomial `order`: 17 + `order` states; order 0 is `car_system`.

    `noise` (17,) are densities of the car's states; `wandering` that of xi_order, (N/s^order)^2/s (unused at order 0).
    """
    plain = car_system(car, noise)
    if order == 0:
        return plain
    n = 17 + order

    def dynamics(x: Array) -> Array:
        rate = np.concatenate([plain.dynamics(x[:17]), x[18:], np.zeros_like(x[:1])])
        rate[model.F] = x[17]
        return rate

    def jacobian(x: Array) -> Array:
        a = np.zeros((n, n))
        a[:17, :17] = plain.jacobian(x[:17])
        a[model.F, 17] = 1.0
        a[range(17, n - 1), range(18, n)] = 1.0
        return a

    return System(dynamics, jacobian, np.diag(np.concatenate([noise, np.zeros(order - 1), [wandering]])))


def widened(reading: Reading, order: int) -> Reading:
    """`reading` of the 17 states, for a state with `order` more that no sensor sees."""
    if order == 0:
        return reading
    return Reading(
        reading.value,
        lambda x: reading.expected(x[:17]),
        lambda x: np.pad(reading.jacobian(x[:17]), ((0, 0), (0, order))),
        reading.noise,
        reading.angles,
    )
