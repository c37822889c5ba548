"""Alternator and compressor run while braking and rest while driving, inside what battery and cabin bear."""

import numpy as np
import pytest

from sim.accessories import ALTERNATOR_MOST, BATTERY_SWING, CABIN_SWING, AccessorySchedule
from sim.envs.highway_eco import level_road
from vehicle_model.car.parameters import Car
from vehicle_model.plant import kernel as k
from vehicle_model.plant.session import Plant

COOLING = {"ac_cycling.power": 1_500.0}


def test_braking_charges_and_driving_rests_until_the_stores_say_no(car: Car) -> None:
    """Ten minutes at a steady 20 m/s, then braking in gear."""
    plant = Plant(car, level_road(30.0), COOLING, 20.0, 5)
    schedule = AccessorySchedule(plant, car, COOLING)
    load, electrical, batteries, cabins = float(plant.parameters[k.P_ELECTRICAL]), [], [], []
    for _ in range(6_000):
        force = plant.road_load + 200.0 * (20.0 - plant.speed)
        schedule.switch(0.1, force)
        plant.advance(force, 5, 0.1)
        electrical.append(float(plant.parameters[k.P_ELECTRICAL]))
        batteries.append(schedule.battery)
        cabins.append(schedule.cabin)
    assert set(electrical) == {0.0, load}, "never more than is used while it costs fuel"
    assert electrical[:1_000] == [0.0] * 1_000
    assert min(batteries) >= -BATTERY_SWING - load and max(batteries) <= load
    assert min(cabins) >= -CABIN_SWING * 1_500.0 and schedule.owed_fuel() > 0.0
    before = schedule.battery
    for _ in range(30):
        schedule.switch(0.1, -1_500.0)
        plant.advance(-1_500.0, 5, 0.1)
    assert float(plant.parameters[k.P_ELECTRICAL]) == ALTERNATOR_MOST and schedule.battery > before


def test_what_is_not_scheduled_away_costs_what_the_plant_says(car: Car) -> None:
    """A schedule that never runs anything else than the usual load owes nothing."""
    plant = Plant(car, level_road(30.0), {}, 0.0, 0)
    schedule = AccessorySchedule(plant, car, {})
    usual = plant.parameters.copy()
    for _ in range(100):
        schedule.switch(0.1, 0.0)
        plant.advance(0.0, 0, 0.1)
    assert np.array_equal(plant.parameters, usual)
    assert schedule.battery == pytest.approx(0.0) and schedule.owed_fuel() == pytest.approx(0.0)
