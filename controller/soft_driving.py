"""The thesis' road test (4.4.3, table 4.2) in its own model: a soft driver against Pontryagin, unfairly and fairly.

The printed comparison stops each drive at the speed: the soft driver is by then much further down the road.
The fair one lets both go the same distance to the same final speed. The table's kilojoules do not fit its own model
(ERRATA on table 4.2): both comparisons are computed here, none is copied.
"""

import time as clock
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from controller.acceleration import shifts_of, shoot
from controller.controller_model import RPM, ControllerModel
from controller.solution import Solution


def soft_drive(
    model: ControllerModel, start: float, target: float, *, acceleration: float = 0.6, shift_at: float = 2500.0 * RPM
) -> NDArray[np.float64]:
    """Constant gentle acceleration, gears changed at `shift_at` rad/s: rows (t, v, w, T, gear, J, x), 50 ms apart."""
    rows, t, v, cost, x, gear, dt = [], 0.0, start, 0.0, 0.0, 1, 0.05
    while True:
        while gear < len(model.ratios) and model.ratios[gear - 1] * v > shift_at:
            gear += 1
        force = model.accelerated_mass * acceleration + model.road_load(v)
        while gear > 1 and force / model.ratios[gear - 1] > model.torque[1]:
            gear -= 1
        w = model.ratios[gear - 1] * v
        torque = float(np.clip(force / model.ratios[gear - 1], *model.torque))
        rows.append((t, v, w, torque, gear, cost, x))
        if v >= target:
            return np.array(rows)
        rate = float(model.acceleration(v, w, torque))
        size = min(dt, max((target - v) / rate, 1e-9))
        cost += size * float(model.fuel_power(w, torque))
        x += size * (v + 0.5 * size * rate)
        t, v = t + size, v + size * rate


def cruise_power(model: ControllerModel, speed: float) -> tuple[float, int]:
    """Least fuel power that holds `speed`, W, and its gear."""
    best = (np.inf, 0)
    for g, n in enumerate(model.ratios, start=1):
        torque, w = model.road_load(speed) / n, n * speed
        if model.engine_speed[0] <= w <= model.engine_speed[1] and model.torque[0] <= torque <= model.torque[1]:
            best = min(best, (float(model.fuel_power(w, torque)), g))
    return best


def compare(model: ControllerModel, *, start: float | None = None, target: float = 90.0 / 3.6) -> list[Solution]:
    """Rows: Pontryagin to the speed; the soft driver to the speed; Pontryagin then cruising to the soft driver's place.

    Notes carry `printed_percent` (equal speed only) and `fair_percent` (equal speed and distance).
    """
    lowest = max(7.0 / 3.6, model.engine_speed[0] / model.ratios[0] * (1.0 + 1e-9))
    begin = lowest if start is None else start
    optimal = replace(shoot(model, begin, target, None, case="soft-vs-pontryagin"), method="indirect")
    began = clock.perf_counter()
    soft = soft_drive(model, begin, target)
    power, _ = cruise_power(model, target)
    rest = (soft[-1, 6] - optimal.distance) / target
    fair_cost = optimal.cost + power * rest
    printed = 100.0 * (1.0 - optimal.cost / soft[-1, 5])
    fair = 100.0 * (1.0 - fair_cost / soft[-1, 5])
    gear = soft[:, 4].astype(np.int64)
    driver = Solution(
        case="soft-vs-pontryagin",
        method="soft",
        cost=float(soft[-1, 5]),
        duration=float(soft[-1, 0]),
        distance=float(soft[-1, 6]),
        time=soft[:, 0],
        state=soft[:, 1:2],
        control=soft[:, 3:4],
        costate=np.full((len(soft), 1), np.nan),
        gear=gear,
        shifts=shifts_of(model, soft[:, 0], soft[:, 1], gear),
        wall=clock.perf_counter() - began,
        notes={"printed_percent": printed, "fair_percent": fair},
    )
    fairly = replace(
        optimal,
        method="indirect-then-cruise",
        cost=fair_cost,
        duration=optimal.duration + rest,
        distance=float(soft[-1, 6]),
        notes={"printed_percent": printed, "fair_percent": fair},
    )
    return [replace(optimal, notes={"printed_percent": printed}), driver, fairly]
