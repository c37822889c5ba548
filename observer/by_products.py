"""What a known engine map tells of the car (seed 004, 3.6): mass, rolling resistance and drag from trip to trip.

The map turns fuel into thrust, whatever the road does: F_map = (T omega - J_e omega d(omega)/dt) / v with T from P_in.
The observer's thrust is what the *declared* car needs for the motion it saw. Their difference over a trip is
    F_map - F = dM (dv/dt + g (sin(theta) + C_rr)) + dC_rr M g + 1/2 rho d(C_d A) v^2,
a regression whose coefficients, trip after trip, are trends. The wheel radius shows in the engine's speed (exact: it
counts injections) over the car's (which the satellites fix in the long run), in a known gear.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from observer.estimate import Estimate
from observer.fit_form import Fit
from observer.operating_points import OperatingPoints, gear_ratios, locked_gear, operating_points, rate
from vehicle_model.car.parameters import Car

QUANTITIES = ("mass", "rolling_resistance", "drag_area")
BLOCK = 2.0
"""s of contiguous driving that make one datum."""
FORCE_ERROR = 25.0
"""N, standard deviation of a datum beyond the observer's own."""
PRIOR = (150.0, 0.006, 0.25)
"""kg, -, m2: how far the three may reasonably move."""


@dataclass(frozen=True)
class TripCar:
    """How the car of one trip differs from its file: QUANTITIES, in kg, -, m2."""

    change: NDArray[np.float64]
    """(3,)."""
    covariance: NDArray[np.float64]
    """(3, 3)."""
    radius: float
    """Relative change of the wheel radius against the car file; NaN if too little was driven in gear."""
    distance: float
    """m driven."""


def fuel_table(fit: Fit, car: Car) -> RectBivariateSpline:
    """Splines through the fuel power of `fit` (W) over rad/s and N m: cheap to ask, trip after trip.

    From half the idle speed to a fifth beyond the red line, a tenth of the largest torque below zero to half above it.
    """
    omega = np.linspace(0.5 * car.engine.idle_speed, 1.2 * car.engine.redline_speed, 90)
    load = np.linspace(-0.1, 1.5, 60) * car.engine.max_torque
    return RectBivariateSpline(omega, load, fit.fuel_power(*np.meshgrid(omega, load, indexing="ij")))


def torque_of_fuel(
    table: RectBivariateSpline, engine_speed: NDArray, fuel_power: NDArray, torque: NDArray
) -> NDArray[np.float64]:
    """The torque at which the engine of `table` burns `fuel_power`, (n,): Newton's method from `torque`.

    Inside the table's borders.
    """
    omega, load = table.get_knots()
    turning = np.clip(engine_speed, omega[0], omega[-1])
    found = np.clip(torque, 1.0, load[-1]).astype(float)
    for _ in range(8):
        slope = np.maximum(table.ev(turning, found, dy=1), engine_speed)
        step = (fuel_power - table.ev(turning, found)) / slope
        found = np.clip(found + np.clip(step, -20.0, 20.0), load[0], load[-1])
    return found


def trip_car(estimate: Estimate, car: Car, engine: Fit | RectBivariateSpline, *, smoothed: bool = True) -> TripCar:
    """Return the change of mass, rolling resistance and drag area that a trip shows against `car`, given the engine.

    `engine`: its map's fit, or the `fuel_table` of that (the same, where many trips are asked).
    """
    table = fuel_table(engine, car) if isinstance(engine, Fit) else engine
    points = operating_points(estimate, car, smoothed=smoothed)
    speed, pitch = (estimate.column(name, smoothed=smoothed) for name in ("speed", "pitch"))
    side = max(1, round(BLOCK / points.step))
    index = np.flatnonzero(points.mapped)
    blocks = [piece[k : k + side] for piece in np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)
              for k in range(0, len(piece) - side // 2, side)] if len(index) else []  # fmt: skip
    information, right = np.diag(np.array(PRIOR) ** -2.0), np.zeros(3)
    acceleration = rate(speed, points.step)
    mapped = points.mapped
    torque = np.zeros(len(speed))
    torque[mapped] = torque_of_fuel(
        table, points.engine_speed[mapped], points.fuel_power[mapped], points.torque[mapped]
    )
    for block in blocks:
        omega, v = points.engine_speed[block], speed[block]
        difference = float(np.mean((torque[block] - points.torque[block]) * omega / v))
        row = np.array(
            [
                np.mean(acceleration[block] + car.gravity * (np.sin(pitch[block]) + car.rolling_resistance)),
                car.mass * car.gravity,
                0.5 * car.air_density * np.mean(v**2),
            ]
        )
        variance = FORCE_ERROR**2 + float(np.mean(points.variance[block] * (points.fuel_power[block] / v) ** 2))
        information += np.outer(row, row) / variance
        right += row * difference / variance
    covariance = np.asarray(np.linalg.inv(information), float)
    distance = float(np.sum(np.maximum(speed, 0.0)) * points.step)
    return TripCar(covariance @ right, covariance, wheel_radius_change(points, speed, car), distance)


def wheel_radius_change(points: OperatingPoints, speed: NDArray, car: Car) -> float:
    """Relative change of the wheel radius: median of declared / shown ratio of engine speed to speed, gear-locked.

    Away from hard driving, whose slip would count as a smaller wheel; NaN from less than a minute of it.
    """
    gear = locked_gear(points.engine_speed, speed, car)
    gentle = points.locked & (speed > 8.0) & (np.abs(points.torque) < 0.5 * car.engine.max_torque)
    if gentle.sum() * points.step < 60.0:
        return float("nan")
    declared = gear_ratios(car)[gear[gentle] - 1]
    return float(np.median(declared * speed[gentle] / points.engine_speed[gentle])) - 1.0


@dataclass(frozen=True)
class Trend:
    """One quantity over the trips: what is usual, and two cumulative sums that watch for a step up or down."""

    usual: float = 0.0
    spread: float = 0.0
    """Standard deviation of the trips' values about the usual one, learnt from the first ones."""
    trips: int = 0
    above: float = 0.0
    """Cumulative sum of (value - usual) / spread - `SLACK`, never below zero."""
    below: float = 0.0
    alarm: int = 0
    """+1 or -1 once the sum has passed its threshold, 0 before."""


SLACK, THRESHOLD = 0.75, 8.0
"""Of the cumulative sum, in deviations of a trip: a step of 1.5 is best found, and what the first trips got wrong
of the usual value (a quarter of one) is forgiven."""
LEARNING = 20
"""Trips from which the usual value and its spread are learnt before anything is called."""


def watch(trend: Trend, value: float, *, least_spread: float) -> Trend:
    """Return the trend after one more trip's `value`. `least_spread` keeps a quiet start from making it nervous.

    An alarm stays until a new Trend is begun (the tyre was pumped up).
    """
    n = trend.trips + 1
    if n <= LEARNING:
        usual = trend.usual + (value - trend.usual) / n
        # Welford's update of the variance
        square = trend.spread**2 * max(trend.trips - 1, 0) + (value - trend.usual) * (value - usual)
        return Trend(usual, float(np.sqrt(square / max(n - 1, 1))), n)
    spread = max(trend.spread, least_spread)
    score = (value - trend.usual) / spread
    above, below = max(0.0, trend.above + score - SLACK), max(0.0, trend.below - score - SLACK)
    alarm = trend.alarm or (1 if above > THRESHOLD else -1 if below > THRESHOLD else 0)
    return Trend(trend.usual, trend.spread, n, above, below, alarm)


SOFT_RADIUS, SOFT_ROLLING = -0.0025, 0.043
"""What 0.6 bar less in one driven tyre does, relative: half of -0.5 % of radius (the differential takes the mean of
both wheels), a quarter of the (2.0 / 1.4)^0.45 = 17 % of rolling resistance."""
USUAL_RADIUS, USUAL_ROLLING = 0.0004, 0.06
"""How far a sound car's trips differ, relative: temperature and the satellites; rain, wind and warmth."""


def tyre_score(trip: TripCar, car: Car) -> float:
    """One number that a soft tyre moves most: both its signs weighed by their usual scatter (a matched filter).

    In standard deviations of a sound car's trips. Rain moves rolling resistance, not the wheel's radius: that is why.
    """
    weights = np.array([SOFT_RADIUS / USUAL_RADIUS**2, SOFT_ROLLING / USUAL_ROLLING**2])
    seen = np.array([trip.radius, trip.change[1] / car.rolling_resistance])
    return float(weights @ seen / np.hypot(SOFT_RADIUS / USUAL_RADIUS, SOFT_ROLLING / USUAL_ROLLING))
