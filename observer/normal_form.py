"""The observability normal form of 1.2.3 and the adaptive high-gain EKF of A.4.2 on it.

Phi and its inverse are those of seed 004 with the signs of `vehicle_model.car` and a physical accelerometer (z_15 is
dv/dt + g sin(theta) + b_i). The print of 1.20 has drag accelerate the car; here it is 1.16 (ERRATA). Valid for v above
`SLOWEST`: the form divides by the speed.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from observer import model
from observer.system import runge_kutta
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]
SLOWEST = 1.0
"""m/s."""
BLOCKS = ((0, 1, 2), (3, 4), (5,), (6,), (7, 8, 9), (10, 11), (12, 13), (14,), (15,), (16,))
"""States of each block of A in 1.22; the first of a block is its output."""
OUTPUTS = tuple(block[0] for block in BLOCKS)
"""Where in z each output of 1.23 (10 of them: ERRATA) stands."""
KINDS = {
    model.DISTANCE: 0,
    model.MAP_HEADING: 3,
    model.GPS_NORTH: 5,
    model.GPS_EAST: 6,
    model.GPS_ALTITUDE: 7,
    model.MAP_ALTITUDE: 7,
    model.INJECTED_ENERGY: 10,
    model.ENGINE_ANGLE: 12,
    model.ACCELERATION_X: 14,
    model.ACCELERATION_Y: 15,
    model.ACCELERATION_Z: 16,
}
"""Measurement kinds that are outputs of the normal form, and their place in z: y = z[place]."""


def to_normal(x, car: Car, m=np):
    """Phi(x): the 17 states of 1.16 as z (list of 17), for v > 0."""
    v, theta = x[model.V], x[model.THETA]
    sin, cos = m.sin(theta), m.cos(theta)
    rolling = car.mass * car.rolling_resistance * (car.gravity * cos + x[model.SK] * v * v)
    z3 = x[model.F] - car.mass * car.gravity * sin - rolling
    forward = (z3 - 0.5 * car.air_density * car.drag_area * v * v) / car.accelerated_mass
    return [
        x[model.X],
        v,
        z3,
        x[model.PSI],
        x[model.SJ] * v,
        x[model.N],
        x[model.E],
        -x[model.D],
        v * sin,
        v * v * x[model.SK] * cos + sin * forward,
        x[model.EIN],
        x[model.PIN],
        x[model.ANGLE],
        x[model.OMEGA],
        forward + car.gravity * sin + x[model.BX],
        -x[model.SJ] * v * v + x[model.BY],
        car.gravity * cos + x[model.SK] * v * v + x[model.BZ],
    ]


def from_normal(z, car: Car, m=np):
    """Phi^-1(z): back to the 17 states (list), for z_2 > 0 and |z_9| < z_2."""
    v = z[1]
    sin = z[8] / v
    cos = m.sqrt(1.0 - sin * sin)
    forward = (z[2] - 0.5 * car.air_density * car.drag_area * v * v) / car.accelerated_mass
    sk = (z[9] - sin * forward) / (v * v * cos)
    rolling = car.mass * car.rolling_resistance * (car.gravity * cos + sk * v * v)
    return [
        z[0],
        v,
        z[2] + rolling + car.mass * car.gravity * sin,
        z[3],
        m.arcsin(sin) if m is np else m.asin(sin),
        z[5],
        z[6],
        -z[7],
        z[4] / v,
        sk,
        z[10],
        z[11],
        z[12],
        z[13],
        z[14] - forward - car.gravity * sin,
        z[15] + z[4] * v,
        z[16] - car.gravity * cos - sk * v * v,
    ]


def structure(car: Car) -> Array:
    """A of 1.22, (17, 17): ones above the diagonal inside the blocks, 1/M_a from z_3 to z_2."""
    a = np.zeros((17, 17))
    for block in BLOCKS:
        for row, column in pairwise(block):
            a[row, column] = 1.0
    a[1, 2] = 1.0 / car.accelerated_mass
    return a


def normal_system(car: Car) -> tuple[Callable[[Array], Array], Callable[[Array], Array], Callable[[Array], Array]]:
    """Return dz/dt = A z + b(z), its Jacobian A + b*(z), and d(Phi)/dx, as functions of z (17,).

    The smooth sign of the drag is 1 here: the form holds for a car that moves forward. Derivatives by CasADi.
    """
    z, x = ca.SX.sym("z", 17), ca.SX.sym("x", 17)
    phi = ca.vertcat(*to_normal(x, car, ca))
    gradient = ca.jacobian(phi, x)
    rate = ca.vertcat(*model.dynamics(x, car, ca))
    # d(dv/dt) of the model with its smooth sign: replaced by the forward one
    rate[model.V] = (
        x[model.F]
        - 0.5 * car.air_density * car.drag_area * x[model.V] ** 2
        - car.mass * car.rolling_resistance * (car.gravity * ca.cos(x[model.THETA]) + x[model.SK] * x[model.V] ** 2)
        - car.mass * car.gravity * ca.sin(x[model.THETA])
    ) / car.accelerated_mass
    back = ca.vertcat(*from_normal(z, car, ca))
    flow = ca.substitute(ca.mtimes(gradient, rate), x, back)
    slope = ca.Function("slope", [z], [flow])
    jacobian = ca.Function("jacobian", [z], [ca.jacobian(flow, z)])
    push = ca.Function("push", [z], [ca.substitute(gradient, x, back)])
    return (
        lambda value: np.array(slope(value))[:, 0],
        lambda value: np.array(jacobian(value)),
        lambda value: np.array(push(value)),
    )


def gain_matrices(gain: float) -> tuple[Array, Array]:
    """Return the diagonals of Delta_G (17,) of A.36 and delta_G (10,) of A.37 at the high gain `gain` >= 1."""
    widest = max(len(block) for block in BLOCKS)
    states = np.empty(17)
    for block in BLOCKS:
        for k, place in enumerate(block):
            states[place] = gain ** (widest - len(block) + k)
    return states, states[list(OUTPUTS)]


@dataclass
class AdaptiveHighGain:
    """The continuous-discrete AEKF (A.33 to A.42): an EKF in z whose gain rises while its own prediction fails.

    `noise` (17,) are densities of the 17 states x, `window` d in s, `threshold` (lower, upper) of the innovation J_d,
    `highest` G_max. Asynchronous outputs each bring their own row of R_G (A.5.2).
    """

    car: Car
    x: Array
    P: Array
    noise: Array
    window: float = 0.5
    threshold: tuple[float, float] = (3.0, 8.0)
    highest: float = 3.0
    gain: float = 1.0
    z: Array = field(init=False)
    covariance: Array = field(init=False)
    innovation: float = field(init=False, default=0.0)
    """J_d of the last correction."""

    def __post_init__(self) -> None:
        self._flow, self._slope, self._push = normal_system(self.car)
        self.z = np.array(to_normal(self.x, self.car), dtype=np.float64)
        push = self._push(self.z)
        self.covariance = push @ self.P @ push.T
        self._time = 0.0
        self._past: list[tuple[float, Array, int, float, float]] = []

    def state(self) -> Array:
        """The 17 states x."""
        return np.array(from_normal(self.z, self.car), dtype=np.float64)

    def predict(self, dt: float) -> None:
        """A.34 over `dt` (s), Runge-Kutta, with Q_G = G Delta Q Delta (A.36)."""
        push = self._push(self.z)
        delta, _ = gain_matrices(self.gain)
        q = self.gain * delta[:, None] * (push * self.noise) @ push.T * delta

        def rate(y: Array) -> Array:
            a = self._slope(y[:, 0])
            return np.column_stack([self._flow(y[:, 0]), a @ y[:, 1:] + y[:, 1:] @ a.T + q])

        y = runge_kutta(rate, np.column_stack([self.z, self.covariance]), dt)
        self.z, self.covariance = y[:, 0], 0.5 * (y[:, 1:] + y[:, 1:].T)
        self.z[1] = max(self.z[1], SLOWEST)
        self._time += dt

    def correct(self, kind: int, value: float, variance: float) -> None:
        """A.35 with one output (`KINDS`), R_G = delta R delta / G (A.37); then innovation and adaptation."""
        place = KINDS[kind]
        _, delta = gain_matrices(self.gain)
        r = variance * delta[OUTPUTS.index(place)] ** 2 / self.gain
        column = self.covariance[:, place].copy()
        s = column[place] + r
        nu = value - self.z[place]
        before = self.z.copy()
        self.z = self.z + column / s * nu
        self.covariance = self.covariance - np.outer(column, column) / s
        self._remember(before, place, value, variance)
        low, high = self.threshold
        if self.innovation > high and self.gain < self.highest:
            self.gain = min(self.gain + 1.0, self.highest)
        elif self.innovation < low and self.gain > 1.0:
            self.gain = max(self.gain - 1.0, 1.0)

    def _remember(self, before: Array, place: int, value: float, variance: float) -> None:
        """J_d of A.38: the mean normalised misfit of a prediction that runs free from the window's beginning (A.42)."""
        self._past.append((self._time, before, place, value, variance))
        while len(self._past) > 2 and self._past[1][0] <= self._time - self.window:
            self._past.pop(0)
        time, free = self._past[0][0], self._past[0][1]
        total = 0.0
        for moment, _, where, told, var in self._past:
            if moment > time:
                free = runge_kutta(self._flow, free, moment - time)
                total += (moment - time) * (told - free[where]) ** 2 / var
                time = moment
        span = self._past[-1][0] - self._past[0][0]
        self.innovation = total / span if span > 0.0 else 0.0
