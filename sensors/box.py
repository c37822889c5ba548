"""The sensor box: what a cheap logger in the car would write on its card during a trip."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sensors import accelerometer, compass, faults, gps, gyroscope, injector, wheel
from sensors import packets as card
from sensors.clock import Clock, clock, skew_readings, stamp
from sensors.effects import with_effects
from sensors.packets import write_log
from sensors.settings import BoxSettings, Fault
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator
from vehicle_model.car.trip import Trip

__all__ = ["BoxSettings", "Fault", "box_settings", "measure", "record", "write_log"]

CAPTURED = ("wheel", "injector")
"""Sensors whose stamps are captured in hardware; the main loop stamps the others."""


class Declared(Protocol):
    """What a scenario says of the box: departures by field name, and a timeline of faults."""

    @property
    def box(self) -> Mapping[str, Any]: ...
    @property
    def faults(self) -> Sequence[Mapping[str, Any]]: ...


def box_settings(declared: Declared | None = None, effects: Mapping[str, float] | None = None) -> BoxSettings:
    """Return the default box with what a scenario declares and the effects ({"effect.parameter": value}) set.

    Effect keys of other rooms are left alone. Raises BadInput for an unknown field, a value of another type or a
    bad fault.
    """
    default = BoxSettings()
    chosen: dict[str, Any] = {}
    known = {part.name for part in fields(BoxSettings)} - {"faults"}
    for name, value in (declared.box if declared else {}).items():
        place = f"sensors.box.{name}"
        if name not in known:
            raise BadInput("scenario", place, f"a field of the box: {', '.join(sorted(known))}")
        kind = type(getattr(default, name))
        if not isinstance(value, (float, int)) or isinstance(value, bool) != (kind is bool) or value != value:
            raise BadInput("scenario", place, f"a {kind.__name__}, not {value!r}")
        chosen[name] = kind(value)
    timeline = []
    for number, row in enumerate(declared.faults if declared else ()):
        try:
            timeline.append(Fault(**row))
        except TypeError as error:
            allowed = ", ".join(part.name for part in fields(Fault))
            raise BadInput(
                "scenario", f"sensors.faults[{number}]", f"sensor and kind, of the keys {allowed}"
            ) from error
    faults.check(timeline)
    return with_effects(default.changed(**chosen, faults=tuple(timeline)), effects or {})


def measure(trip: Trip, car: Car, settings: BoxSettings, seed: int) -> dict[str, NDArray]:
    """What each sensor of the box says during `trip`, faults included, before the logger's stamps and packets.

    Structured arrays with `t` (trip time, s), `delay` (s) and the sensor's values. Every sensor draws from its own
    generator, so one sensor's settings and faults change no other's readings. Raises BadInput for a bad fault.
    """
    faults.check(settings.faults)
    time = clock(settings)
    readings = {
        "accelerometer": accelerometer.measure(trip, car, settings, time, seed),
        "gps": gps.measure(trip, settings, seed),
        "wheel": wheel.measure(trip, car, settings, seed),
        "injector": injector.measure(trip, car, settings, seed),
    }
    rng = generator(seed, "sensors.skew")
    readings["skew"] = skew_readings(trip.duration, time, settings, readings["gps"][["t", "quality"]], rng)
    if settings.gyroscope:
        readings["gyroscope"] = gyroscope.measure(trip, settings, time, seed)
    if settings.compass:
        readings["compass"] = compass.measure(trip, settings, time, seed)
    return {name: faults.apply(name, rows, settings.faults, seed) for name, rows in readings.items()}


def record(trip: Trip, car: Car, settings: BoxSettings | None = None, seed: int = 0) -> bytes:
    """Return the bytes that the logger writes on its card during `trip`: packets in the order in which they came.

    Parameters: `trip` (the truth), `car` (whose calibrations the sensors' mounting inverts), `settings` (the default
    box where None), `seed` of the trip's noise. `sensors.packets.write_log` makes the file of them.
    Raises BadInput for a bad fault or injection pattern.
    """
    settings = settings or BoxSettings()
    readings = measure(trip, car, settings, seed)
    time = clock(settings)
    groups = [_text_packets(readings["gps"], settings, seed)]
    for kind, name in card.STREAM_OF.items():
        if name in readings and readings[name].size:
            groups.append(_packets(kind, name, readings[name], time, settings, seed))
    return card.encode(groups)


def _text_packets(fixes: NDArray, settings: BoxSettings, seed: int) -> card.Packets:
    text, lengths, arrival = gps.text_pieces(fixes, settings, seed)
    return card.Packets(card.GPS, arrival, text, lengths)


def _packets(kind: int, name: str, readings: NDArray, time: Clock, settings: BoxSettings, seed: int) -> card.Packets:
    """Stamp and quantize the readings of one sensor."""
    rng = generator(seed, f"sensors.{name}.stamp")
    when = readings["t"] + readings["delay"]
    jitter = settings.clock_capture_jitter if name in CAPTURED else settings.clock_jitter
    resolution = card.WHEEL_TICK if kind == card.WHEEL else 1e-3
    stamps = stamp(time, when, jitter, rng, resolution)
    rows = np.zeros(readings.size, dtype=card.LAYOUT[kind])
    key = when
    if kind == card.WHEEL:
        rows["ms"], rows["sub"] = stamps // 8, stamps % 8
    else:
        rows["ms"] = stamps
    if kind in (card.ACCELEROMETER, card.GYROSCOPE):
        unit = 1e-3 * card.STANDARD_GRAVITY if kind == card.ACCELEROMETER else np.radians(0.01)
        for axis in "xyz":
            rows[axis] = np.clip(np.round(readings[axis] / unit), -32768, 32767)
    elif kind == card.INJECTOR:
        rows["width"] = np.clip(np.round(readings["width"] / card.INJECTOR_TICK), 0, card.SATURATED)
        key = when + np.clip(readings["width"], 0.0, card.SATURATED * card.INJECTOR_TICK)
    elif kind == card.SKEW:
        rows["gained"] = np.clip(readings["gained"], -128, 127)
    elif kind == card.COMPASS:
        rows["heading"] = np.round(np.degrees(readings["heading"] % (2.0 * np.pi)) * 100.0) % 36_000
    return card.Packets(kind, key, rows.view(np.uint8).reshape(-1), np.full(rows.size, rows.itemsize, dtype=np.int64))
