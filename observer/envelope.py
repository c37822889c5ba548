"""The engine's limits: full load from full-throttle stretches, drag with the fuel cut, idle; what a file declares."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from observer.efficiency_map import SPEED_STEP, Limits
from observer.estimate import Estimate
from observer.fit_form import Fit
from observer.operating_points import OperatingPoints
from vehicle_model.car.parameters import Car

WHEEL_SHARE = 0.95
"""Of the crankshaft's torque that the file declares: what passes the gearbox and the tyres."""
FULL_THROTTLE_SHARE = 0.88
"""Of the declared torque: a stretch below it is no full throttle."""
STRETCH = 0.5
"""s that a stretch at full throttle must last."""
FLATNESS = 0.06
"""Relative change of fuel per revolution over a stretch: at full throttle the foot changes nothing any more."""
NEIGHBOURS = 3
"""Columns on both sides that are looked at together (150 rpm)."""
CEILING = 0.03
"""A ceiling shows as a pile: at least two stretches, together a second, within this of the highest torque."""
LEAST_OVERRUN = 3.0
"""s with the fuel cut that weigh as much as the default."""
DRAGGED_SHARE = 0.8
"""Of the torque at which the Willans lines of the map say that no fuel would be left: what the engine drags with the
fuel cut. A fired engine at no load rubs harder and loses more heat than a dragged one (Willans' line against motoring,
Heywood 1988, 13.2). Set on development seeds of the Smart."""
WILLANS_SECONDS = 150.0
"""s with the fuel cut that weigh as much as the Willans lines: samples under braking look like drag."""
LEAST_CELLS = 30
"""Valid cells from which the Willans lines are worth more than the default."""


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

    T = - p V_d / (4 pi), with p = 2.4 bar + 0.9 bar (omega / 419 rad/s)^2: closed throttle, accessories and gearbox
    dragged along (Heywood 1988, 13.5, for the engine alone).
    """
    pressure = 2.4e5 + 0.9e5 * (engine_speed / 418.9) ** 2
    return -pressure * car.engine.displacement / (4.0 * np.pi)


def observed_limits(
    trips: Sequence[OperatingPoints], estimates: Sequence[Estimate], car: Car, columns: int, *, smoothed: bool
) -> Limits:
    """What the trips show of full load, drag and idle on `columns` engine-speed cells; NaN where nothing was seen."""
    omega, torque = _joined(trips, lambda trip: trip.engine_speed), _joined(trips, lambda trip: trip.torque)
    column = np.clip(np.nan_to_num(omega) / SPEED_STEP, 0, columns - 1).astype(np.int64)
    throttle = np.concatenate([np.empty(0, bool)] + [full_throttle(trip, car) for trip in trips])
    cut = np.concatenate([np.empty(0, bool)] + [trip.cut for trip in trips])
    step = trips[0].step if trips else 0.1
    full = np.full(columns, np.nan)
    relative = torque / declared_torque(omega, car)
    stretch = np.cumsum(np.diff(throttle, prepend=False) & throttle)
    for number in range(columns):
        here = throttle & (np.abs(column - number) <= NEIGHBOURS)
        if not here.any():
            continue
        top = float(np.quantile(relative[here], 0.9))
        pile = here & (np.abs(relative / top - 1.0) < CEILING)
        if pile.sum() * step >= 2.0 * STRETCH and len(np.unique(stretch[pile])) >= 2:
            full[number] = top * declared_torque(np.array([(number + 0.5) * SPEED_STEP]), car)[0]
    power, speed = _idle(estimates, car, smoothed=smoothed)
    return Limits(full, _drag(omega[cut], torque[cut], car, columns, step), power, speed)


def _joined(trips: Sequence[OperatingPoints], values: Callable[[OperatingPoints], NDArray]) -> NDArray[np.float64]:
    return np.concatenate([np.empty(0)] + [values(trip) for trip in trips])


def _drag(omega: NDArray, torque: NDArray, car: Car, columns: int, step: float) -> NDArray[np.float64]:
    """Drag torque of every column, N m: the default's shape, scaled by what was seen; NaN if nothing was.

    Brakes only ever add to the drag, and most of the time with the fuel cut is spent braking: the lowest fifth of
    what was seen is the engine's own.
    """
    if not len(omega):
        return np.full(columns, np.nan)
    return _shown(omega, torque, car, columns, step, 1.0, LEAST_OVERRUN)


def _shown(
    omega: NDArray, torque: NDArray, car: Car, columns: int, step: float, size: float, weight: float
) -> NDArray[np.float64]:
    """Drag torque of every column, N m: `size` times the default's, believed for `weight` s against the samples."""
    seconds = len(omega) * step
    ratio = max(float(np.quantile(torque / (size * default_overrun(omega, car)), 0.2)), 0.3) if len(omega) else 1.0
    scale = size * (seconds * ratio + weight) / (seconds + weight)
    return scale * default_overrun((np.arange(columns) + 0.5) * SPEED_STEP, car)


def drag_of_lines(trips: Sequence[OperatingPoints], lines: Fit, car: Car, columns: int) -> NDArray[np.float64]:
    """Drag torque of every column, N m: the default's form, and mostly the size that the map's Willans `lines` have.

    T = -DRAGGED_SHARE P_in(omega, 0) / (dP_in/dT), the slope up to a third of the largest torque, is taken at the
    speeds at which the car ran (beyond them the lines are extrapolated, and steep); scaled by what the samples with
    the fuel cut show as in `_drag`.
    """
    reach = car.engine.max_torque / 3.0
    driven = _joined(trips, lambda trip: trip.engine_speed[trip.firing])
    if not len(driven):
        driven = np.linspace(car.engine.idle_speed, 0.5 * car.engine.redline_speed)
    omega = np.quantile(driven, np.linspace(0.1, 0.9, 33))
    nothing = lines.fuel_power(omega, np.zeros(len(omega)))
    slope = (lines.fuel_power(omega, np.full(len(omega), reach)) - nothing) / reach
    size = float(np.mean(-DRAGGED_SHARE * nothing / np.maximum(slope, omega) / default_overrun(omega, car)))
    turning, torque = (
        _joined(trips, lambda trip: trip.engine_speed[trip.cut]),
        _joined(trips, lambda trip: trip.torque[trip.cut]),
    )
    return _shown(turning, torque, car, columns, trips[0].step if trips else 0.1, size, WILLANS_SECONDS)


def full_throttle(trip: OperatingPoints, car: Car) -> NDArray[np.bool_]:
    """Samples (n,) of stretches at full throttle: locked, near the declared torque or above, fuel per turn flat."""
    side = max(1, round(0.5 * STRETCH / trip.step))
    window = 2 * side + 1
    per_turn = trip.fuel_power / np.maximum(trip.engine_speed, 1.0)
    change = maximum_filter1d(per_turn, window) - minimum_filter1d(per_turn, window)
    flat = change < FLATNESS * np.maximum(per_turn, 1e-3)
    high = trip.torque > FULL_THROTTLE_SHARE * declared_torque(trip.engine_speed, car)
    return trip.firing & flat & np.asarray(minimum_filter1d(high, window), bool)


def _idle(estimates: Sequence[Estimate], car: Car, *, smoothed: bool) -> tuple[float, float]:
    """Median fuel power (W) and engine speed (rad/s) at standstill, NaN if there was less than a second of it."""
    power, omega, seconds = [], [], 0.0
    for estimate in estimates:
        speed = estimate.column("speed", smoothed=smoothed)
        turning = estimate.column("engine_speed", smoothed=smoothed)
        still = (np.abs(speed) < 0.5) & (np.abs(turning / car.engine.idle_speed - 1.0) < 0.35)
        still = np.asarray(minimum_filter1d(still, 11), bool)
        power.append(estimate.column("fuel_power", smoothed=smoothed)[still])
        omega.append(turning[still])
        seconds += 0.1 * float(still.sum())
    if seconds < 1.0:
        return float("nan"), float("nan")
    idle_power = float(np.median(np.concatenate(power)))
    return (idle_power if idle_power > 0 else float("nan")), float(np.median(np.concatenate(omega)))
