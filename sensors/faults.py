"""Faults on a timeline: what each does to the readings of the sensor that it names, and to no other.

| kind | value sensors (accelerometer, gps, gyroscope, compass, injector) | pulses (wheel) | `strength`, default |
|---|---|---|---|
| ok | nothing | nothing | |
| off | no readings | no pulses | |
| stuck | the last values before it, again and again | the last pulse interval, again and again | |
| garbage | anything within the sensor's range | as many pulses, at random times | |
| wrong | values x (1 + strength) (a position: 1 km x strength away) | pulses x (1 + strength) | 0.1 |
| slow | one reading in `strength` | one pulse in `strength` | 5 |
| delayed | everything `strength` seconds late | the same | 0.5 s |
| intermittent | off and on, `strength` seconds each on average | the same | 2 s |
| noisy | noise of `strength` times the sensor's usual | pulse times jitter by `strength` ms | 5 |
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from sensors.settings import Fault
from vehicle_model.car.errors import BadInput
from vehicle_model.car.randomness import generator

KINDS = ("ok", "off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent", "noisy")
SENSORS = ("accelerometer", "gps", "wheel", "injector", "skew", "gyroscope", "compass")
STRENGTH = {"wrong": 0.1, "slow": 5.0, "delayed": 0.5, "intermittent": 2.0, "noisy": 5.0}

# For each value column: its usual noise, and the range of anything it could say.
_SPREAD = {
    "x": (0.15, (-20.0, 20.0)), "y": (0.15, (-20.0, 20.0)), "z": (0.5, (-20.0, 20.0)),
    "width": (3e-5, (0.0, 0.016)), "gained": (1e-3, (-127.0, 127.0)), "heading": (0.03, (0.0, 2.0 * np.pi)),
    "latitude": (1.6e-5, (-0.02, 0.02)), "longitude": (2.4e-5, (-0.03, 0.03)), "altitude": (3.5, (-500.0, 3000.0)),
    "speed": (0.08, (0.0, 70.0)), "course": (0.01, (0.0, 2.0 * np.pi)), "hdop": (0.0, (0.5, 20.0)),
}  # fmt: skip
_RELATIVE_TO_ITSELF = ("latitude", "longitude")
_METRE = {"latitude": 9.0e-6, "longitude": 1.35e-5}
"""Degrees in a metre, roughly: how far a receiver goes astray needs no more."""


def check(faults: Iterable[Fault]) -> None:
    """Raise BadInput for a fault of an unknown sensor or kind, or one that ends before it starts."""
    for number, fault in enumerate(faults):
        place = f"faults[{number}]"
        if fault.sensor not in SENSORS:
            raise BadInput("sensor box", place, f"sensor one of {', '.join(SENSORS)}, not {fault.sensor!r}")
        if fault.kind not in KINDS:
            raise BadInput("sensor box", place, f"kind one of {', '.join(KINDS)}, not {fault.kind!r}")
        if not fault.end > fault.start:
            raise BadInput("sensor box", place, f"end after start, not {fault.start} to {fault.end}")
        if fault.strength is not None and fault.kind in ("slow", "intermittent") and fault.strength <= 0:
            raise BadInput("sensor box", place, f"strength above 0 for {fault.kind}, not {fault.strength}")


def apply(sensor: str, readings: NDArray, faults: Iterable[Fault], seed: int) -> NDArray:
    """Return the `readings` of `sensor` (structured, with `t` in trip time and `delay`) with its faults applied."""
    for number, fault in enumerate(faults):
        if fault.sensor == sensor and fault.kind != "ok" and readings.size:
            rng = generator(seed, f"sensors.fault.{sensor}.{number}")
            inside = (readings["t"] >= fault.start) & (readings["t"] < fault.end)
            strength = STRENGTH.get(fault.kind, 1.0) if fault.strength is None else fault.strength
            readings = _one(readings, inside, fault.kind, strength, rng)
    return readings


def _one(readings: NDArray, inside: NDArray[np.bool_], kind: str, strength: float, rng) -> NDArray:
    if kind == "off":
        return readings[~inside]
    if kind == "slow":
        keep = ~inside
        keep[np.flatnonzero(inside)[:: max(1, round(strength))]] = True
        return readings[keep]
    if kind == "intermittent":
        return readings[~(inside & _off_and_on(readings["t"], strength, rng))]
    readings = readings.copy()
    if not inside.any():
        return readings
    if kind == "delayed":
        readings["delay"][inside] += strength
        return readings
    if set(readings.dtype.names or ()) == {"t", "delay"}:
        return _pulses(readings, inside, kind, strength, rng)
    return _values(readings, inside, kind, strength, rng)


def _off_and_on(t: NDArray[np.float64], mean: float, rng) -> NDArray[np.bool_]:
    """True while off: exponential times of `mean` seconds, off and on in turn, from the first of `t`."""
    count = int(4 * (t[-1] - t[0]) / mean) + 16
    edges = t[0] + np.cumsum(rng.exponential(mean, count))
    return np.searchsorted(edges, t) % 2 == 0


def _values(readings: NDArray, inside: NDArray[np.bool_], kind: str, strength: float, rng) -> NDArray:
    rows = np.flatnonzero(inside)
    for name in readings.dtype.names or ():
        if name not in _SPREAD:
            continue
        column = readings[name]
        usual, (low, high) = _SPREAD[name]
        if kind == "stuck":
            column[rows] = column[max(rows[0] - 1, 0)]
        elif kind == "garbage":
            start = column[rows] if name in _RELATIVE_TO_ITSELF else 0.0
            column[rows] = start + rng.uniform(low, high, rows.size)
        elif kind == "wrong":
            if name in _METRE:
                column[rows] += 1000.0 * strength * _METRE[name]
            elif name not in ("hdop", "course"):
                column[rows] *= 1.0 + strength
        elif kind == "noisy":
            column[rows] += strength * usual * rng.standard_normal(rows.size)
            if low == 0.0:
                np.maximum(column, 0.0, out=column)
    return readings


def _pulses(readings: NDArray, inside: NDArray[np.bool_], kind: str, strength: float, rng) -> NDArray:
    rows = np.flatnonzero(inside)
    t = readings["t"][rows]
    if kind == "stuck":
        before = readings["t"][max(rows[0] - 2, 0) : rows[0] + 1]
        interval = max(float(np.diff(before).mean()) if before.size > 1 else 0.1, 1e-3)
        t = np.arange(t[0], t[-1], interval)
    elif kind == "garbage":
        t = np.sort(rng.uniform(t[0], t[-1], t.size))
    elif kind == "wrong":
        t = np.interp(np.arange(0.0, t.size - 1, 1.0 / (1.0 + strength)), np.arange(t.size), t)
    elif kind == "noisy":
        t = np.sort(np.clip(t + strength * 1e-3 * rng.standard_normal(t.size), t[0], t[-1]))
    new = np.zeros(t.size, dtype=readings.dtype)
    new["t"] = t
    return np.concatenate((readings[: rows[0]], new, readings[rows[-1] + 1 :]))
