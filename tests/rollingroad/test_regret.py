"""The benchmark's regret: nothing for the truth, nothing to be won by any other map, more for a worse one."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.regret import regret
from controller.advice import RoadAhead
from sim.truth import true_fuel_map
from vehicle_model.car.files import read_car

CAR = read_car("smart")
PRICE = 2800.0


@pytest.fixture(scope="module")
def road():
    s = np.arange(0.0, 4000.0, 20.0)
    limit = np.where((s > 1500.0) & (s < 2500.0), 14.0, 25.0)
    return RoadAhead(s, 0.015 * np.sin(s / 300.0), limit, np.zeros_like(s))


@pytest.fixture(scope="module")
def truth():
    return true_fuel_map(CAR)


def test_the_true_map_has_no_regret(road, truth):
    assert regret(truth, truth, road, CAR, PRICE) == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_won_by_another_map(road, truth, seed):
    """Waves in the fuel, and a drag that is wrong: the policy of the truth stays the best on the truth."""
    rng = np.random.default_rng(seed)
    wave = 1.0 + 0.05 * np.sin(truth.engine_speed[:, None] / 30.0 + rng.uniform(0, 6) + truth.torque / 9.0)
    other = replace(
        truth, fuel_power=truth.fuel_power * wave, overrun_torque=truth.overrun_torque * rng.uniform(0.7, 1.3)
    )
    assert regret(other, truth, road, CAR, PRICE) > -1e-4


def test_a_map_that_hides_the_cost_of_idling_along_costs_fuel(road, truth):
    """Printed forms give zero fuel at zero torque (ERRATA, table 4.1) and reward what should be avoided."""
    lost = truth.fuel_power[:, :1] * np.clip(1.0 - truth.torque / 30.0, 0.0, 1.0)
    flattered = replace(truth, fuel_power=np.maximum(truth.fuel_power - 0.9 * lost, 10.0))
    assert regret(flattered, truth, road, CAR, PRICE) > 0.01
