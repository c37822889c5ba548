"""The car on a bench: drive cycles, and the virtual dynamometer of seed 004, 3.5."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car
from vehicle_model.plant import steady
from vehicle_model.plant.cycle import read_cycle, run_cycle
from vehicle_model.plant.parameters import plant_parameters

RPM = 2.0 * np.pi / 60.0
SPEEDS = np.arange(2500.0, 6001.0, 100.0)
"""rpm, as in 3.5."""
TORQUES = np.arange(25.0, 81.0, 5.0)
"""N m, at wheel level."""


def cycle_account(name: str, car: str, settings: Mapping[str, float]) -> dict[str, Any]:
    """Drive `car` over the cycle `name` (shipped, or a file); fuel, distance and where the energy went, J."""
    declared = read_car(car)
    cycle = read_cycle(name)
    trip, account = run_cycle(declared, cycle, settings)
    c = trip.channels
    distance = float(c["distance"][-1] - c["distance"][0])
    litre = 1e-3 * declared.fuel.density * declared.fuel.heating_value
    parts = asdict(account)
    fuel, work = parts.pop("fuel"), parts.pop("wheel_work")
    missed = float(np.max(np.abs(np.interp(c["time"], cycle.time, cycle.speed) - c["speed"])))
    return {
        "cycle": cycle.name,
        "car": declared.name,
        "settings": dict(settings),
        "time_s": trip.duration,
        "distance_m": distance,
        "fuel_J": fuel,
        "fuel_l_per_100km": fuel / litre / distance * 1e5,
        "wheel_work_J": work,
        "account_J": parts,
        "account_error": (fuel - sum(parts.values())) / fuel,
        "largest_speed_error_m_s": missed,
    }


def dynamometer(car: str, gear: int | None = None) -> dict[str, Any]:
    """The steady map of 3.5: efficiency, fuel to wheel, 2,500 to 6,000 rpm by 100, 25 to 80 Nm; None beyond full load.

    `gear`: the one engaged on the rollers (the second highest where None: nearest to direct drive).
    """
    declared = read_car(car)
    gear = max(len(declared.gear_ratios) - 1, 1) if gear is None else gear
    if not 1 <= gear <= len(declared.gear_ratios):
        raise BadInput("gear", str(gear), f"expected 1 to {len(declared.gear_ratios)}")
    parameters = plant_parameters(declared, {})
    omega = SPEEDS * RPM
    efficiency = steady.true_efficiency(parameters, gear, omega[:, None], TORQUES[None, :])
    full = steady.full_load(parameters, gear, omega)
    reached = TORQUES[None, :] <= full[:, None]
    best = np.unravel_index(np.argmax(np.where(reached, efficiency, -1.0)), efficiency.shape)
    return {
        "car": declared.name,
        "gear": gear,
        "rpm": SPEEDS.tolist(),
        "torque_N_m": TORQUES.tolist(),
        "efficiency": [
            [float(value) if there else None for value, there in zip(row, mask, strict=True)]
            for row, mask in zip(efficiency, reached, strict=True)
        ],
        "full_load_N_m": full.tolist(),
        "peak": {
            "efficiency": float(efficiency[best]),
            "rpm": float(SPEEDS[best[0]]),
            "torque_N_m": float(TORQUES[best[1]]),
        },
    }
