"""The true engine as a planner's table: what the oracle is handed."""

from collections.abc import Mapping

import numpy as np

from observer.efficiency_map import SPEED_STEP, TORQUE_STEP, FuelMap
from vehicle_model.car.parameters import Car
from vehicle_model.plant import steady
from vehicle_model.plant.parameters import plant_parameters


def true_fuel_map(car: Car, settings: Mapping[str, float], gear_weights: Mapping[int, float] | None = None) -> FuelMap:
    """Return the true steady fuel power at wheel level over the engine's whole range, gears weighted.

    `settings`: the plant's effects by key. `gear_weights`: shares of the forward gears (evenly where None); the gears differ
    by their gearbox losses only.
    """
    parameters = plant_parameters(car, settings)
    weights = gear_weights or {gear: 1.0 for gear in range(1, len(car.gear_ratios) + 1)}
    total = sum(weights.values())
    first, last = np.floor(car.engine.idle_speed / SPEED_STEP), np.ceil(car.engine.redline_speed / SPEED_STEP)
    omega = np.arange(first, last + 1) * SPEED_STEP

    def mean(values):
        return sum(weight * values(gear) for gear, weight in weights.items()) / total

    torque_max = mean(lambda gear: steady.full_load(parameters, gear, omega))
    torque = np.arange(0.0, torque_max.max() + 2.0 * TORQUE_STEP, TORQUE_STEP)
    power = mean(lambda gear: steady.fuel_power(parameters, gear, omega[:, None], torque[None, :]))
    idle_speed, idle_power = steady.idle(parameters)
    overrun = mean(lambda gear: steady.overrun(parameters, gear, omega))
    return FuelMap(omega, torque, power, torque_max, np.minimum(overrun, -0.5), idle_power, idle_speed)
