"""A digital compass: not in the thesis' box, but its observer can use one (2.3 note 5, 2.4.2)."""

import numpy as np
from numpy.typing import NDArray

from sensors.clock import Clock
from sensors.settings import BoxSettings
from vehicle_model.car.randomness import generator
from vehicle_model.car.trip import Trip

READING = np.dtype([("t", "f8"), ("delay", "f8"), ("heading", "f8")])


def measure(trip: Trip, settings: BoxSettings, clock: Clock, seed: int) -> NDArray:
    """Headings (n,), rad in [0, 2 pi), clockwise from north, with the deviation that the car's own iron causes."""
    count = int(np.floor(trip.duration * settings.compass_rate)) + 1
    t = trip.time[0] + np.arange(count) / settings.compass_rate / (1.0 + clock.rate)
    phase = generator(settings.device_seed, "box.compass").uniform(0.0, 2.0 * np.pi)
    heading = np.interp(t, trip.time, trip.heading)
    heading = heading + settings.compass_deviation * np.sin(heading + phase)
    heading = heading + settings.compass_noise * generator(seed, "sensors.compass").standard_normal(count)
    out = np.zeros(count, dtype=READING)
    out["t"], out["heading"] = t, heading % (2.0 * np.pi)
    return out
