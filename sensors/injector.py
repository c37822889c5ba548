"""The injector timer (seed 004, 2.3.4): when the injector was opened, and for how long."""

import numpy as np
from numpy.typing import NDArray

from sensors.settings import BoxSettings
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator
from vehicle_model.car.trip import Trip

READING = np.dtype([("t", "f8"), ("delay", "f8"), ("width", "f8")])
"""t: rising edge, trip time; width: electrical, s, before the counter saturates."""
NOMINAL_VOLTAGE = 14.0
CYCLE = 4.0 * np.pi


def pulses_per_cycle(pattern: str, cylinders: int) -> int:
    """Pulses of the logged injector in a cycle of 4 pi: sequential 1, grouped:N its N groups, simultaneous all.

    Raises BadInput for another pattern. (2.3.4.1; 4 pi / cylinders for simultaneous, as printed.)
    """
    kind, _, groups = pattern.partition(":")
    if kind == "sequential":
        return 1
    if kind == "simultaneous":
        return cylinders
    if kind == "grouped" and groups.isdigit() and int(groups) > 0:
        return int(groups)
    raise BadInput("inj timing pattern", pattern, "sequential, grouped:N or simultaneous")


def measure(trip: Trip, car: Car, settings: BoxSettings, seed: int) -> NDArray:
    """Pulses (n,) of READING: one each 4 pi / pulses_per_cycle of the engine's turning, none where no fuel follows.

    A pulse delivers the energy that is burnt until the next one is due:
    opening = energy / (all injectors' power), width = opening - lag (the car file's, negative) + dead time.
    """
    rng = generator(seed, "sensors.injector")
    per_cycle = pulses_per_cycle(car.injector.pattern, car.engine.cylinders)
    angle = np.maximum.accumulate(trip.engine_angle)
    edges = np.arange(angle[0] + rng.uniform(0.0, CYCLE / per_cycle), angle[-1], CYCLE / per_cycle)
    if settings.injector_simultaneous_above > 0.0 and edges.size:
        edges = _switched(edges, per_cycle, car.engine.cylinders, angle, trip, settings.injector_simultaneous_above)
    if edges.size < 2:
        return np.zeros(0, dtype=READING)
    t = np.interp(edges, angle, trip.time)
    energy = np.diff(np.interp(edges, angle, trip.fuel_energy))
    t = t[:-1]
    opening = energy / (car.injector_power * (1.0 - settings.injector_fouling))
    fired = opening > 1e-6
    t, opening = t[fired], opening[fired]
    opening = opening * (1.0 + settings.injector_noise * rng.standard_normal(opening.size))
    voltage = np.interp(t, trip.time, trip.battery_voltage)
    dead = settings.injector_dead_time + settings.injector_dead_time_per_volt * (voltage - NOMINAL_VOLTAGE)
    out = np.zeros(t.size, dtype=READING)
    out["t"] = t
    out["width"] = np.maximum(opening - car.injector.lag + dead, 0.0)
    return out


def _switched(edges, per_cycle: int, cylinders: int, angle, trip: Trip, above: float) -> NDArray[np.float64]:
    """Pulses of an engine that fires all injectors together above a speed: more of them, each for less turning."""
    fast = np.interp(np.interp(edges, angle, trip.time), trip.time, trip.engine_speed) > above
    interval, finer = CYCLE / per_cycle, CYCLE / cylinders
    extra = (edges[fast][:, None] + finer * np.arange(1, round(interval / finer))[None, :]).reshape(-1)
    return np.sort(np.concatenate((edges, extra[extra < angle[-1]])))
