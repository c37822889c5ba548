"""Road roughness from the vertical accelerometer (seed 004, 2.3.2, note 6): where the road is bad, tyres cost more."""

import numpy as np
from numpy.typing import NDArray

from sensors.accelerometer import rotation
from sensors.log import SensorLog
from vehicle_model.car.parameters import Car

ROUGHNESS = np.dtype([("distance", "f8"), ("rms", "f8"), ("relative", "f8"), ("samples", "i8")])
"""m driven at the stretch's middle; m/s2; over what that speed usually gives (1: as smooth as this trip's usual)."""
STILL = 2.0
"""m/s, below which the road is not felt."""


def road_roughness(log: SensorLog, car: Car, stretch: float = 100.0) -> NDArray:
    """Return rows (n,) of ROUGHNESS, one for each `stretch` m that was driven with at least 10 samples.

    The vertical force's second differences hold the road and not the hills; what they usually are at a speed is a
    straight line fitted robustly over the trip, and `relative` is the stretch's level over that.
    """
    rows = log["accelerometer"]
    ticks = np.sort(log["wheel"]["t"])
    if rows.size < 100 or ticks.size < 50:
        return np.empty(0, dtype=ROUGHNESS)
    m = car.mounting
    upward = np.column_stack([rows[axis] for axis in "xyz"]) @ (m.scale * rotation(m.roll, m.pitch, m.yaw))[2]
    # Of white noise a second difference has 6 times the variance.
    rough = np.abs(np.diff(upward, 2)) / np.sqrt(6.0)
    t = rows["t"][1:-1]
    distance = np.interp(t, ticks, car.metres_per_tick * np.arange(ticks.size))
    speed = np.gradient(np.interp(t, ticks, car.metres_per_tick * np.arange(ticks.size)), t)
    moving = speed > STILL
    if moving.sum() < 100:
        return np.empty(0, dtype=ROUGHNESS)
    rough, distance, speed = rough[moving], distance[moving], speed[moving]
    usual = _usual(speed, rough)
    number = (distance / stretch).astype(np.int64)
    stretches, count = np.unique(number, return_counts=True)
    level = np.bincount(np.searchsorted(stretches, number), weights=rough**2) / count
    expected = np.bincount(np.searchsorted(stretches, number), weights=usual**2) / count
    out = np.zeros(stretches.size, dtype=ROUGHNESS)
    out["distance"], out["rms"] = (stretches + 0.5) * stretch, np.sqrt(level)
    out["relative"], out["samples"] = np.sqrt(level / expected), count
    return out[count >= 10]


def _usual(speed: NDArray[np.float64], rough: NDArray[np.float64]) -> NDArray[np.float64]:
    """Deviation that the trip usually has at `speed`: a line through the medians of speed classes."""
    edges = np.unique(np.quantile(speed, np.linspace(0.0, 1.0, 9)))
    place = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, max(edges.size - 2, 0))
    middle = np.array([speed[place == k].mean() for k in np.unique(place)])
    # The median of |noise| is 0.6745 deviations.
    level = np.array([np.median(rough[place == k]) for k in np.unique(place)]) / 0.6745
    if middle.size < 2:
        return np.full(speed.size, level.mean())
    slope, base = np.polyfit(middle, level, 1)
    return np.maximum(base + slope * speed, 0.3 * level.min())
