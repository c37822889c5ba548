"""The ball and wheel of appendix G: time-optimal control, synthesised in closed form.

After linearisation by feedback (G.5 to G.8): dx1/dt = x2, dx2/dt = gamma u, u_min <= u <= u_max, u_min < 0 < u_max.
H = lambda1 x2 + lambda2 gamma u - 1 = 0; u is at a bound, by the sign of lambda2, which is a line in time: at most one
switch. At the end lambda2 = 1/(gamma u) (ERRATA on G.18). Every optimal arc ends on the switching locus (G.19)
    x1 = x2^2 / (2 gamma u),  u = u_max where x2 < 0 and u_min where x2 > 0.
In time to go s, beyond the switch at s_0, with u_max last:
    x1 = gamma (u_min s^2 / 2 - (u_min - u_max) s_0 s + (u_min - u_max) s_0^2 / 2)          (G.21 with ERRATA's signs)
    x2 = gamma (-u_min s + (u_min - u_max) s_0)
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from controller.ball_and_wheel_kernel import lattice_time
from vehicle_model.car.errors import BadInput


@dataclass(frozen=True)
class BallAndWheel:
    """Geometry and inertia (G.4), SI units."""

    wheel_radius: float = 0.15
    """R, m."""
    ball_radius: float = 0.02
    """r, m."""
    ball_mass: float = 0.1
    """kg."""
    ball_inertia: float = 0.4 * 0.1 * 0.02**2
    """I_b, kg m2."""
    wheel_inertia: float = 0.01
    """I_w, kg m2."""
    torque_low: float = -0.6
    """N m, below zero."""
    torque_high: float = 0.6
    """N m, above zero."""
    gravity: float = 9.81

    @property
    def gamma(self) -> float:
        """gamma of (G.6)."""
        ib, iw, m, r, big = self.ball_inertia, self.wheel_inertia, self.ball_mass, self.ball_radius, self.wheel_radius
        return 1.0 / ((big + r) * (ib * iw + iw * m * r**2 + ib * m * big**2))

    def linearised(self, torque: float, angle: float) -> float:
        """u_f of (G.5)."""
        return self.ball_inertia * self.wheel_radius * torque + self._weight() * np.sin(angle)

    def torque(self, u: float, angle: float) -> float:
        """tau_w that gives u_f = `u` (G.8)."""
        return (u - self._weight() * np.sin(angle)) / (self.ball_inertia * self.wheel_radius)

    def _weight(self) -> float:
        m, r, big = self.ball_mass, self.ball_radius, self.wheel_radius
        return m * self.gravity * (self.wheel_inertia * r**2 + self.ball_inertia * big**2)

    def bounds(self) -> tuple[float, float]:
        """gamma u_min and gamma u_max at the top (the thesis' note 33), rad/s2. Raises BadInput if not controllable."""
        if not self.torque_low < 0.0 < self.torque_high:
            raise BadInput("ball and wheel", "torque bounds", "one below and one above zero, else not controllable")
        return self.gamma * self.linearised(self.torque_low, 0.0), self.gamma * self.linearised(self.torque_high, 0.0)


def switching_locus(rate: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """x1 of the locus at x2 = `rate`: one bound leads from there to the origin (G.19). low < 0 < high: gamma u."""
    return np.where(rate < 0.0, rate**2 / (2.0 * high), rate**2 / (2.0 * low))


def optimal_control(angle: float, rate: float, low: float, high: float) -> float:
    """The synthesis, as feedback (G.3): gamma u at the state, 0 at the origin. Above the locus the low bound."""
    above = angle - float(switching_locus(np.asarray(rate), low, high))
    if above > 0.0:
        return low
    if above < 0.0:
        return high
    if rate == 0.0:
        return 0.0
    return high if rate < 0.0 else low


@dataclass(frozen=True)
class TimeOptimal:
    """The way to the origin from one state."""

    duration: float
    """s."""
    switch: float
    """s, when the control changes; 0 on the locus."""
    first: float
    """gamma u until the switch, rad/s2."""
    last: float
    """gamma u after it."""
    costate: tuple[float, float]
    """lambda1 (constant) and lambda2(0): lambda = -dV/dx, s per unit of state."""


def time_optimal(angle: float, rate: float, low: float, high: float) -> TimeOptimal:
    """Shortest way to the origin under low <= gamma u <= high, in closed form, with its costate."""
    first = optimal_control(angle, rate, low, high)
    if first == 0.0:
        return TimeOptimal(0.0, 0.0, 0.0, 0.0, (0.0, 0.0))
    last = high if first == low else low
    on_locus = abs(angle - float(switching_locus(np.asarray(rate), low, high))) <= 1e-14 * max(abs(angle), 1e-300)
    if on_locus:
        duration = -rate / first
        return TimeOptimal(duration, 0.0, first, first, (0.0, 1.0 / first))
    # x2 at the switch: x1 + (w^2 - x2^2)/(2 first) = w^2/(2 last)
    square = (rate**2 / (2.0 * first) - angle) / (1.0 / (2.0 * first) - 1.0 / (2.0 * last))
    at_switch = -np.sign(last) * np.sqrt(max(square, 0.0))
    switch, rest = (at_switch - rate) / first, -at_switch / last
    # lambda2 is a line: 0 at the switch, 1/last at the end
    slope = 1.0 / (last * rest)
    return TimeOptimal(float(switch + rest), float(switch), first, last, (float(-slope), float(-slope * switch)))


def backward_arc(
    s: NDArray[np.float64], s_0: float, low: float, high: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """State at time to go `s` on the arc that ends with `high`, switched at `s_0` (G.21, corrected)."""
    early = s <= s_0
    x1 = np.where(early, 0.5 * high * s**2, 0.5 * low * s**2 - (low - high) * s_0 * s + 0.5 * (low - high) * s_0**2)
    x2 = np.where(early, -high * s, -low * s + (low - high) * s_0)
    return x1, x2


def lattice_minimum_time(
    angle: float, rate: float, low: float, high: float, *, half_rates: int = 90, sweeps: int = 400
) -> float:
    """Minimum time, s, from (angle, rate) by dynamic programming over the lattice of bang-bang arcs.

    `half_rates` is the number of rate steps from 0 to the edge of the lattice. The start is rounded to the lattice: the
    rate to the nearest point, the angle to the best one within 0.05 % (neighbours differ in parity: from some of them
    the origin is reached only by one more pair of moves). Raises BadInput when -low/high is no ratio of small integers.
    """
    ratio = Fraction(-low / high).limit_denominator(12)
    if abs(float(ratio) + low / high) > 1e-9:
        raise BadInput("ball and wheel", "bounds", "a ratio of small integers for the lattice, such as 1 or 3/4")
    # |low| = base * numerator, high = base * denominator; strides are base * lcm / bound
    common = ratio.numerator * ratio.denominator
    scale = -low / ratio.numerator * common
    reach = 1.25 * (abs(rate) + np.sqrt(2.0 * max(-low, high) * abs(angle) + rate**2))
    h = reach / half_rates
    unit = h**2 / (2.0 * scale)
    half_angles = int(1.3 * max(abs(angle) + rate**2 / (2.0 * min(-low, high)), unit) / unit) + 10
    value = lattice_time(half_angles, half_rates, -round(scale / low), round(scale / high), h / -low, h / high, sweeps)
    place, reach_near = half_angles + round(angle / unit), max(6, round(0.0005 * abs(angle) / unit))
    return float(value[half_rates + round(rate / h), place - reach_near : place + reach_near + 1].min())
