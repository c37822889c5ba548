"""From an estimate to the samples that say something about the engine: gear locked, fuel on, steady enough.

T = (F_thrust v + J_e omega d(omega)/dt) / omega. Seed 004, 1.13 takes the torque from the thrust alone; the thrust is
downstream of the engine's inertia (ERRATA 1.13), about 4 N m in second gear at 2 m/s2, so the term is added here and
the sample stands for the steady operating point that burns the same fuel.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from observer.estimate import STATES, Estimate
from vehicle_model.car.parameters import Car

RATIO_TOLERANCE = 0.03
"""Engine speed over speed against the nearest gear: what still counts as locked (LESSONS, "Choices that paid")."""
LOCKED_MARGIN = 0.4
"""s, on both sides of a sample."""
TORQUE_FLOOR = 4.0
"""N m: below it the engine hardly drives and efficiency says little."""
SPEED_FLOOR = 3.0
"""m/s: wheel pulses are silent below 3 to 4 km/h, and the clutch slips there."""
FUEL_FLOOR = 0.25
"""Share of the idle's fuel power below which the fuel counts as cut."""
TRANSIENT_LIMIT = 0.35
"""Relative change of fuel power over 0.4 s above which a sample counts as a hard transient."""


@dataclass(frozen=True)
class OperatingPoints:
    """One trip on the estimate's grid. All arrays (n,), SI units; `mapped` marks the samples to map."""

    time: NDArray[np.float64]
    engine_speed: NDArray[np.float64]
    torque: NDArray[np.float64]
    """N m, engine's inertia included."""
    fuel_power: NDArray[np.float64]
    power: NDArray[np.float64]
    """W, P_out = torque x engine speed."""
    variance: NDArray[np.float64]
    """Of the momentary efficiency P_out / P_in, from the observer's covariance."""
    locked: NDArray[np.bool_]
    """Clutch closed in one gear, `LOCKED_MARGIN` on both sides."""
    cut: NDArray[np.bool_]
    """Fuel cut off for `LOCKED_MARGIN` on both sides."""
    firing: NDArray[np.bool_]
    """Locked, fuel on, no hard transient; whatever the torque."""
    mapped: NDArray[np.bool_]
    """Firing, and the engine drives."""
    step: float
    """s between samples."""


def gear_ratios(car: Car) -> NDArray[np.float64]:
    """N_spd of each gear: engine speed over speed, rad/m (ERRATA 1.1.2: gear ratio / wheel radius)."""
    return np.asarray(car.gear_ratios) / car.wheel_radius


def locked_gear(engine_speed: NDArray, speed: NDArray, car: Car) -> NDArray[np.int64]:
    """Return the gear (1 ...) whose ratio the sample shows within `RATIO_TOLERANCE`, 0 where none. Shapes (n,)."""
    ratios = gear_ratios(car)
    shown = engine_speed / np.maximum(speed, 0.1)
    nearest = np.abs(np.log(np.maximum(shown, 1e-6))[:, None] - np.log(ratios)).argmin(axis=1)
    near = (np.abs(shown / ratios[nearest] - 1.0) < RATIO_TOLERANCE) & (speed > SPEED_FLOOR)
    return np.where(near, nearest + 1, 0)


def operating_points(estimate: Estimate, car: Car, *, smoothed: bool = True) -> OperatingPoints:
    """Return torque, fuel power and efficiency variance of each sample of `estimate`, and which of them to map.

    `smoothed` takes the smoother's states (mapping and diagnosis), else the causal filter's.
    """
    speed, thrust = estimate.column("speed", smoothed=smoothed), estimate.column("thrust", smoothed=smoothed)
    omega, fuel = estimate.column("engine_speed", smoothed=smoothed), estimate.column("fuel_power", smoothed=smoothed)
    variances = estimate.smoothed_variance if smoothed else estimate.variance
    var_thrust, var_fuel = (np.maximum(variances[:, STATES.index(name)], 0.0) for name in ("thrust", "fuel_power"))
    step = float(np.median(np.diff(estimate.time))) if len(estimate.time) > 1 else 0.1
    side = max(1, round(LOCKED_MARGIN / step))

    gear = locked_gear(omega, speed, car)
    window = 2 * side + 1
    locked = (minimum_filter1d(gear, window) == maximum_filter1d(gear, window)) & (gear > 0)

    power = speed * thrust + car.engine.inertia * omega * rate(omega, step)
    torque = power / np.maximum(omega, 1.0)
    idle_guess = car.engine.idle_speed * car.engine.displacement * 2.0e5  # W: 1.2 bar of friction at a poor efficiency
    cutoff = FUEL_FLOOR * idle_guess
    fuel_on = minimum_filter1d(fuel, window) > cutoff
    cut = (maximum_filter1d(fuel, window) < cutoff) & locked
    half = max(1, side // 2)
    change = maximum_filter1d(fuel, 2 * half + 1) - minimum_filter1d(fuel, 2 * half + 1)
    steady = change < TRANSIENT_LIMIT * np.maximum(fuel, 1.0)
    burnt = np.maximum(fuel, 1.0)
    variance = (speed / burnt) ** 2 * var_thrust + (power / burnt**2) ** 2 * var_fuel
    whole = np.isfinite(torque) & np.isfinite(fuel) & np.isfinite(variance)
    firing = locked & fuel_on & steady & (power < 0.6 * burnt) & whole
    mapped = firing & (torque > TORQUE_FLOOR) & (thrust > 0.0)
    return OperatingPoints(estimate.time, omega, torque, fuel, power, variance, locked, cut, firing, mapped, step)


def rate(values: NDArray, step: float) -> NDArray[np.float64]:
    """Derivative by a straight line through five samples (central), per s. Shape (n,)."""
    if len(values) < 5:
        return np.zeros(len(values))
    padded = np.pad(np.asarray(values, dtype=float), 2, mode="edge")
    slope = (2.0 * (padded[4:] - padded[:-4]) + padded[3:-1] - padded[1:-3]) / (10.0 * step)
    return slope
