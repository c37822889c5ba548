"""Near full load a petrol engine is fed more than it burns; the planner that knows it keeps away from there."""

from dataclasses import replace

import numpy as np
import pytest

from sim.full_load import BEGINS, RICH, enriched
from sim.truth import true_fuel_map
from vehicle_model.car.parameters import Car


def test_a_map_gets_dearer_near_full_load_only(car: Car) -> None:
    """Given a map without enrichment (so much fuel per torque), then lambda says what full load adds."""
    grid = true_fuel_map(car)
    torque_max = np.full(len(grid.engine_speed), 80.0)
    torque = np.arange(0.0, 101.0, 2.0)
    straight = replace(
        grid, torque=torque, torque_max=torque_max, fuel_power=4_000.0 + 900.0 * np.tile(torque, (len(torque_max), 1))
    )
    rich = enriched(straight)
    below = torque <= BEGINS * 80.0
    assert np.array_equal(rich.fuel_power[:, below], straight.fuel_power[:, below])
    assert rich.fuel_power[:, 40] == pytest.approx(straight.fuel_power[:, 40] / RICH)
    assert np.all(np.diff(rich.fuel_power, n=2, axis=1)[:, torque[1:-1] < 80.0] > -1e-6), "it stays convex up to there"


def test_a_line_continued_to_full_load_comes_nearer_to_the_truth(car: Car) -> None:
    """Given the true map at 30 and 80 % of full load and the line through both, as a smooth fit would draw it."""
    truth = true_fuel_map(car)
    for row in range(10, 60, 10):
        full = truth.torque_max[row]
        at = np.interp([0.3 * full, 0.8 * full], truth.torque, truth.fuel_power[row])
        line = at[0] + (truth.torque - 0.3 * full) / (0.5 * full) * (at[1] - at[0])
        fit = replace(truth, fuel_power=np.tile(line, (len(truth.engine_speed), 1)))
        actual = np.interp(full, truth.torque, truth.fuel_power[row])
        misses = [abs(np.interp(full, truth.torque, m.fuel_power[row]) / actual - 1.0) for m in (fit, enriched(fit))]
        assert misses[1] < 0.6 * misses[0]
