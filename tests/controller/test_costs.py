"""A plan's cost is told by components, and emissions can be priced into it."""

import numpy as np
import pytest

from controller.advice import RoadAhead
from controller.costs import blended_map, trip_costs
from controller.route import plan_route
from vehicle_model.car.errors import BadInput


def test_pricing_an_emission_lowers_it_and_costs_fuel(smart, willans):
    """NOx that rises steeply with torque: pricing it moves the engine to lighter load, at the expense of fuel."""
    s = np.arange(0.0, 4001.0, 10.0)
    road = RoadAhead(s, 0.02 * np.sin(2 * np.pi * s / 1500), np.full_like(s, 25.0), np.zeros_like(s))
    nox = 1e-6 * willans.engine_speed[:, None] / 300.0 * (willans.torque[None, :] / 60.0) ** 4
    ratios = tuple(r / smart.wheel_radius for r in smart.gear_ratios)
    settings = dict(start_speed=10.0, end_speed=20.0, time_value=15e3)
    plain = plan_route(road, willans, smart, **settings)
    clean = plan_route(road, blended_map(willans, {"nox": nox}, {"nox": 5e9}), smart, **settings)
    dirty_costs = trip_costs(plain, willans, ratios, {"nox": nox})
    clean_costs = trip_costs(clean, willans, ratios, {"nox": nox})
    assert clean_costs.emissions["nox"] < 0.8 * dirty_costs.emissions["nox"]
    assert dirty_costs.fuel == plain.trip_fuel
    assert dirty_costs.shifts >= 1
    assert dirty_costs.discomfort > 0.0


def test_a_map_of_another_shape_is_refused(willans):
    with pytest.raises(BadInput, match="shape"):
        blended_map(willans, {"nox": np.ones((2, 2))}, {"nox": 1.0})
    with pytest.raises(BadInput, match="one of nox"):
        blended_map(willans, {"nox": willans.fuel_power}, {"co": 1.0})
