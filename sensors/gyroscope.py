"""A three-axis rate gyroscope: not in the thesis' box, but its observer can use one (2.3 note 5, 2.4.1)."""

import numpy as np
from numpy.typing import NDArray

from sensors.clock import Clock
from sensors.settings import BoxSettings
from vehicle_model.car.randomness import generator
from vehicle_model.car.trip import Trip

READING = np.dtype([("t", "f8"), ("delay", "f8"), ("x", "f8"), ("y", "f8"), ("z", "f8")])
RESOLUTION = float(np.radians(0.01))


def measure(trip: Trip, settings: BoxSettings, clock: Clock, seed: int) -> NDArray:
    """Rates about the body's axes (n,), rad/s, right-handed: z positive turning left, y positive nose down."""
    count = int(np.floor(trip.duration * settings.gyroscope_rate)) + 1
    t = trip.time[0] + np.arange(count) / settings.gyroscope_rate / (1.0 + clock.rate)
    rng = generator(seed, "sensors.gyroscope")
    own = settings.gyroscope_bias * generator(settings.device_seed, "box.gyroscope").standard_normal(3)
    speed = np.interp(t, trip.time, trip.speed)
    turn = np.interp(t, trip.time, trip.straightness) * speed
    nose = np.interp(t, trip.time, trip.vertical_straightness) * speed
    pitch = np.interp(t, trip.time, trip.pitch)
    # Heading grows clockwise: a turn of +psi is about the downward axis, which pitch tilts out of the body's z.
    rates = np.column_stack((-turn * np.sin(pitch), -nose, -turn * np.cos(pitch)))
    rates = rates + own + settings.gyroscope_noise * rng.standard_normal((count, 3))
    out = np.zeros(count, dtype=READING)
    out["t"] = t
    for axis, name in enumerate("xyz"):
        out[name] = np.round(rates[:, axis] / RESOLUTION) * RESOLUTION
    return out
