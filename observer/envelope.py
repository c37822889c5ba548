"""The engine's limits: full load from full-throttle stretches, drag with the fuel cut, idle; what a file declares."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from observer.efficiency_map import SPEED_STEP, Limits
from observer.estimate import Estimate
from observer.operating_points import OperatingPoints
from vehicle_model.car.parameters import Car

FULL_THROTTLE_SHARE = 0.85
"""Of the declared torque: a stretch below it is no full throttle."""
STRETCH = 0.5
"""s that a stretch at full throttle, or with the fuel cut, must last."""
FLATNESS = 0.06
"""Relative change of fuel per revolution over a stretch: at full throttle the foot changes nothing any more."""


def declared_torque(engine_speed: NDArray, car: Car) -> NDArray[np.float64]:
    """Full-load torque, N m, at `engine_speed` (n,), from the file's maximum torque and maximum power alone.

    A monotone interpolation through (idle, share), (maximum torque), (maximum power); beyond it the power stays.
    A turbocharged engine has little at idle.
    """
    engine = car.engine
    at_power = engine.max_power / engine.max_power_speed
    share = 0.55 if engine.turbocharged else 0.75
    points = [(0.0, 0.5 * share * engine.max_torque), (engine.idle_speed, share * engine.max_torque)]
    points += [(engine.max_torque_speed, engine.max_torque)]
    if engine.max_power_speed > engine.max_torque_speed:
        points += [(engine.max_power_speed, min(at_power, engine.max_torque))]
    speeds, torques = np.array(points).T
    inside = np.clip(engine_speed, 0.0, speeds[-1])
    curve = PchipInterpolator(speeds, torques)(inside)
    return np.where(engine_speed > speeds[-1], torques[-1] * speeds[-1] / np.maximum(engine_speed, 1.0), curve)


def default_overrun(engine_speed: NDArray, car: Car) -> NDArray[np.float64]:
    """Torque with the fuel cut, N m, negative: friction and pumping, growing with the square of speed.

    T = - p V_d / (4 pi), with p = 1.1 bar + 0.6 bar (omega / 419 rad/s)^2: ordinary figures (Heywood 1988, 13.5).
    """
    pressure = 1.1e5 + 0.6e5 * (engine_speed / 418.9) ** 2
    return -pressure * car.engine.displacement / (4.0 * np.pi)


def observed_limits(
    trips: Sequence[OperatingPoints], estimates: Sequence[Estimate], car: Car, columns: int, *, smoothed: bool
) -> Limits:
    """What the trips show of full load, drag and idle on `columns` engine-speed cells; NaN where nothing was seen."""
    full, drag = np.full(columns, np.nan), np.full(columns, np.nan)
    omega = np.concatenate([np.empty(0)] + [trip.engine_speed for trip in trips])
    column = np.clip(np.floor(omega / SPEED_STEP), 0, columns - 1).astype(np.int64)
    torque = np.concatenate([np.empty(0)] + [trip.torque for trip in trips])
    throttle = np.concatenate([np.empty(0, bool)] + [full_throttle(trip, car) for trip in trips])
    overrun = np.concatenate([np.empty(0, bool)] + [trip.cut for trip in trips])
    step = trips[0].step if trips else 0.1
    for number in range(columns):
        here = column == number
        pulls, drags = torque[here & throttle], torque[here & overrun]
        if len(pulls) * step >= STRETCH:
            # the foot may rest a little below full load, never above it: the upper end, less one sample in ten of noise
            full[number] = np.quantile(pulls, 0.9)
        if len(drags) * step >= STRETCH:
            # brakes pull one way only: the upper quartile is the engine's drag as long as a quarter rolls unbraked
            drag[number] = min(float(np.quantile(drags, 0.75)), -0.5)
    power, speed = _idle(estimates, car, smoothed=smoothed)
    return Limits(full, drag, power, speed)


def full_throttle(trip: OperatingPoints, car: Car) -> NDArray[np.bool_]:
    """Samples (n,) of stretches at full throttle: locked, near the declared torque or above, fuel per turn flat."""
    side = max(1, round(0.5 * STRETCH / trip.step))
    window = 2 * side + 1
    per_turn = trip.fuel_power / np.maximum(trip.engine_speed, 1.0)
    change = maximum_filter1d(per_turn, window) - minimum_filter1d(per_turn, window)
    flat = change < FLATNESS * np.maximum(per_turn, 1e-3)
    high = trip.torque > FULL_THROTTLE_SHARE * declared_torque(trip.engine_speed, car)
    return trip.mapped & flat & minimum_filter1d(high, window)


def _idle(estimates: Sequence[Estimate], car: Car, *, smoothed: bool) -> tuple[float, float]:
    """Median fuel power (W) and engine speed (rad/s) at standstill, NaN if there was less than a second of it."""
    power, omega, seconds = [], [], 0.0
    for estimate in estimates:
        speed = estimate.column("speed", smoothed=smoothed)
        turning = estimate.column("engine_speed", smoothed=smoothed)
        still = (np.abs(speed) < 0.5) & (np.abs(turning / car.engine.idle_speed - 1.0) < 0.35)
        still = minimum_filter1d(still, 11)
        power.append(estimate.column("fuel_power", smoothed=smoothed)[still])
        omega.append(turning[still])
        seconds += 0.1 * float(still.sum())
    if seconds < 1.0:
        return float("nan"), float("nan")
    idle_power = float(np.median(np.concatenate(power)))
    return (idle_power if idle_power > 0 else float("nan")), float(np.median(np.concatenate(omega)))
