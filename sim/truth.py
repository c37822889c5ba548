"""The true engine, for the oracle and for judging: never shown to an observer or an advisor."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from observer.efficiency_map import FuelMap
from vehicle_model.car.parameters import Car
from vehicle_model.plant import steady
from vehicle_model.plant.parameters import plant_parameters

SPEEDS, TORQUES = 60, 45
"""Nodes of the true map."""


def true_fuel_map(
    car: Car, settings: Mapping[str, float] | None = None, gear_weights: Sequence[float] | None = None
) -> FuelMap:
    """Return the plant's steady fuel map at wheel level, averaged over the gears: what an oracle plans with.

    `settings` are the plant's effects; `gear_weights` (gears,) weigh the gears (alike by default): each has its own
    losses, and a map over engine speed and torque alone cannot hold them all.
    """
    p = plant_parameters(car, settings)
    count = len(car.gear_ratios)
    weights = np.ones(count) if gear_weights is None else np.asarray(gear_weights, float)
    weights = weights / weights.sum()
    idle_speed, idle_power = steady.idle(p)
    speed = np.linspace(0.9 * idle_speed, car.engine.redline_speed, SPEEDS)
    full = np.zeros(SPEEDS)
    overrun = np.zeros(SPEEDS)
    for gear, weight in enumerate(weights, start=1):
        full += weight * steady.full_load(p, gear, speed)
        overrun += weight * steady.overrun(p, gear, speed)
    torque = np.linspace(0.0, 1.05 * float(full.max()), TORQUES)
    power: NDArray[np.float64] = np.zeros((SPEEDS, TORQUES))
    for gear, weight in enumerate(weights, start=1):
        power += weight * steady.fuel_power(p, gear, speed[:, None], torque[None, :])
    return FuelMap(
        engine_speed=speed,
        torque=torque,
        fuel_power=power,
        torque_max=np.maximum(full, 1.0),
        overrun_torque=np.minimum(overrun, 0.0),
        idle_power=idle_power,
        idle_speed=idle_speed,
    )
