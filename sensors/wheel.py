"""The odometer (Vss; seed 004, 2.3.3): one pulse per tooth of the driven wheels, silent at a walk."""

import numpy as np
from numpy.typing import NDArray

from sensors.settings import BoxSettings
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator
from vehicle_model.car.trip import Trip

READING = np.dtype([("t", "f8"), ("delay", "f8")])
GROWTH_SPEED = 100.0 / 3.6


def radius_error(settings: BoxSettings) -> float:
    """Relative error of the rolling radius against the car file: the box's car has its own, within the limit."""
    return settings.wheel_radius_error * float(generator(settings.device_seed, "box.wheel.radius").uniform(-1.0, 1.0))


def tooth_pattern(car: Car, settings: BoxSettings) -> NDArray[np.float64]:
    """Where the teeth of one turn stand, in pitches from their even places; zero mean."""
    teeth = max(2, round(2.0 * np.pi * car.wheel_radius / car.metres_per_tick))
    pattern = settings.wheel_tooth_error * generator(settings.device_seed, "box.wheel.teeth").standard_normal(teeth)
    return (pattern - pattern.mean()) * np.sqrt(teeth / (teeth - 1))


def measure(trip: Trip, car: Car, settings: BoxSettings, seed: int) -> NDArray:
    """Pulses (n,) of READING, in order of time.

    The wheel's true rolling, slip included, turned into teeth: a tooth is `metres_per_tick` only for a wheel of the
    car file's radius. Edges fall where the turned angle passes a tooth.
    """
    growth = settings.wheel_radius_growth * (trip.speed / GROWTH_SPEED) ** 2
    relative = 1.0 + radius_error(settings) + settings.wheel_radius_change + growth
    turned = np.concatenate(([0.0], np.cumsum(np.diff(trip.wheel_angle) / (0.5 * (relative[1:] + relative[:-1])))))
    pitches = np.maximum.accumulate(turned) * (car.wheel_radius / car.metres_per_tick)
    start = generator(seed, "sensors.wheel").uniform(0.0, 1.0)
    number = np.arange(1, int(pitches[-1] + start) + 1)
    pattern = tooth_pattern(car, settings)
    edges = number - start + pattern[number % pattern.size]
    edges = edges[(edges > 0.0) & (edges < pitches[-1])]
    t = np.interp(edges, pitches, trip.time)
    speaks = _hysteresis(np.interp(t, trip.time, trip.speed), settings.wheel_silent_below, settings.wheel_speaks_above)
    out = np.zeros(int(speaks.sum()), dtype=READING)
    out["t"] = t[speaks]
    return out


def _hysteresis(speed: NDArray[np.float64], low: float, high: float) -> NDArray[np.bool_]:
    """True from where `speed` passes `high` until it falls below `low`; False at first."""
    decided = (speed < low) | (speed >= high)
    place = np.maximum.accumulate(np.where(decided, np.arange(speed.size), -1))
    return (place >= 0) & (speed[np.maximum(place, 0)] >= high)
