"""Does a trip look like this car's, in these units? What does not is told by name; it never becomes a cause."""

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.reconstruct import Trace
from sensors.log import SensorLog
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

FASTEST = 75.0
"""m/s: 270 km/h."""
LOCKED = 0.35
"""Of the samples that move with a steady engine, the least share that some gear of the file must explain."""


def check(log: SensorLog, trace: Trace, car: Car) -> list[str]:
    """Return what has to be told of the trip. Raises BadInput where it cannot be this car's or is in a wrong unit."""
    notes = []
    v = trace.speed
    if not (v > 1.0).any():
        return [
            f"{log.name}: no speed: it never moves, or the wheel sensor is silent; a working wheel sensor would help"
        ]
    if np.nanmax(v) > FASTEST:
        raise BadInput(log.name, "speed", f"m/s below {FASTEST:g}, found up to {np.nanmax(v):.0f} (km/h or mph?)")
    moving = v > 4.0
    if moving.sum() > 100 and np.ptp(v[moving]) < 1e-6:
        notes.append(f"{log.name}: speed is constant ({v[moving][0]:.2f} m/s): stuck; nothing is concluded from it")
    if trace.gps:
        both = np.interp(trace.gps["t"] - trace.time[0], trace.time - trace.time[0], v)
        ok = (both > 5.0) & np.isfinite(trace.gps["speed"])
        if ok.sum() > 100:
            ratio = float(np.median(trace.gps["speed"][ok] / both[ok]))
            if not 0.85 < ratio < 1.15:
                raise BadInput(
                    log.name, "wheel",
                    f"wheel speed near the receiver's (metersPerTick {car.metres_per_tick:.4f}), found "
                    f"receiver / wheel = {ratio:.2f}: another car, or another unit",
                )  # fmt: skip
    force = np.stack([trace.force, trace.lateral, trace.vertical])
    if np.isfinite(force).all(axis=0).sum() > 100:
        size = float(np.median(np.linalg.norm(force[:, np.isfinite(force).all(axis=0)], axis=0)))
        if not 8.0 < size < 12.0:
            raise BadInput(log.name, "accelerometer", f"some 9.8 m/s2 at rest, found {size:.2f} (mg or g?)")
        if np.nanstd(force[0]) < 1e-3:
            notes.append(
                f"{log.name}: the accelerometer is constant; a working one would show grades and its own mounting"
            )
    known = np.isfinite(trace.fuel)
    if known.any():
        mean = float(np.mean(trace.fuel[known]))
        if mean > 1.5 * car.engine.max_power / 0.25 or (mean < 300.0 and mean > 0.0):
            raise BadInput(log.name, "fuel",
                f"a mean fuel power between 0.3 kW and {6e-3 * car.engine.max_power:.0f} kW, "
                           f"found {mean / 1e3:.3g} kW: a wrong unit or flow")  # fmt: skip
        if np.nanstd(trace.fuel) < 1e-6:
            notes.append(f"{log.name}: fuel is constant; nothing is concluded from it")
    else:
        notes.append(f"{log.name}: no fuel; injector pulses or a flow meter would show the engine")
    _check_gears(log, trace, car, moving)
    return notes


def _check_gears(log: SensorLog, trace: Trace, car: Car, moving: NDArray[np.bool_]) -> None:
    omega = trace.engine_speed
    live = moving & np.isfinite(omega)
    if live.sum() < 300:
        return
    shown = omega[live] / trace.speed[live] * car.wheel_radius
    calm = np.abs(np.gradient(np.log(shown))) < 0.01
    if calm.sum() < 200:
        return
    ratios = np.asarray(car.gear_ratios)
    near = np.abs(np.log(shown[calm][:, None] / ratios)).min(axis=1) < 0.035
    if near.mean() < LOCKED:
        typical = ", ".join(f"{x:.2f}" for x in np.percentile(shown[calm], [10, 50, 90]))
        raise BadInput(
            log.name, "engine speed / wheel speed",
            f"one of the car's gears ({', '.join(f'{r:g}' for r in ratios)}), found "
            f"{typical} (10, 50, 90 %): another car than {car.name}",
        )  # fmt: skip
