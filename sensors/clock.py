"""The logger's own clock: rate error, jitter, 32-bit milliseconds, and the skew packets that tell of it (C.1.5.6)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.settings import BoxSettings
from vehicle_model.car.randomness import generator


@dataclass(frozen=True)
class Clock:
    """logger time = (1 + rate) x trip time."""

    rate: float

    def time(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Logger time (s) at trip time `t` (s)."""
        return t * (1.0 + self.rate)


def clock(settings: BoxSettings) -> Clock:
    """The box's clock: its rate is a property of the box, plus the effect `clock_skew`."""
    own = settings.clock_rate_error * generator(settings.device_seed, "box.clock").standard_normal()
    return Clock(float(own) + settings.clock_skew)


def stamp(
    clock: Clock, t: NDArray[np.float64], jitter: float, rng: np.random.Generator, resolution: float
) -> NDArray[np.int64]:
    """Stamps (whole counts of `resolution` seconds, cut off as a counter does) of events at trip time `t`."""
    time = clock.time(t) + jitter * rng.standard_normal(t.size)
    return np.maximum(np.floor(time / resolution + 1e-9), 0.0).astype(np.int64)


def skew_readings(duration: float, clock: Clock, settings: BoxSettings, has_fix: NDArray, rng) -> NDArray:
    """Skew events: t (trip time) and `gained` (whole ms since the last one), where the receiver gives its pulse.

    `has_fix`: rows of (t, quality); without a fix there is no pulse, and the next packet covers the longer time.
    """
    t = np.arange(settings.skew_interval, duration, settings.skew_interval)
    if t.size and has_fix.size:
        place = np.clip(np.searchsorted(has_fix["t"], t, side="right") - 1, 0, None)
        t = t[has_fix["quality"][place] > 0]
    ms = np.floor(clock.time(t) * 1e3 + 1e-6)
    nominal = np.round(t * 1e3)
    gained = np.diff(ms - nominal, prepend=0.0)
    out = np.zeros(t.size, dtype=[("t", "f8"), ("delay", "f8"), ("gained", "f8")])
    out["t"], out["gained"] = t, gained
    return out
