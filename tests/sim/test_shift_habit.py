"""Gears are told to those only whose own drive says that they have something to gain."""

import numpy as np
import pytest

from controller.drive_table import DriveTable, drive_table
from observer.estimate import STATES, Estimate
from sim.shift_habit import FULL, WORTH, gears_are_worth_telling, wasted_by_gears
from sim.truth import true_fuel_map
from vehicle_model.car.parameters import Car


@pytest.fixture(scope="module")
def table(car: Car) -> DriveTable:
    return drive_table(true_fuel_map(car), car, speed_top=35.0, nodes=400)


def estimate(speed: np.ndarray, thrust: np.ndarray, turning: np.ndarray) -> Estimate:
    state = np.zeros((len(speed), len(STATES)))
    for name, values in (("speed", speed), ("thrust", thrust), ("engine_speed", turning)):
        state[:, STATES.index(name)] = values
    return Estimate(np.arange(len(speed)) / 10.0, state, 0 * state, state, 0 * state, np.empty(0), (0.0, 0.0, 0.0), {})


def test_who_holds_50_in_second_gear_wastes_what_the_table_says_and_who_holds_it_in_the_best_wastes_nothing(
    table: DriveTable,
) -> None:
    """Oracle: fuel per metre of each gear, by hand from the table's row."""
    row = 200
    speed = float(np.sqrt(row * table.energy_step))
    force = 250.0
    with np.errstate(invalid="ignore"):
        share = (force - table.force_low[:, row]) / (table.force_high[:, row] - table.force_low[:, row])
    at = np.array([
        table.fuel[g, row, round(float(share[g]) * (table.fuel.shape[2] - 1))] if 0.0 <= share[g] <= FULL else np.inf
        for g in range(len(table.ratio))
    ])  # fmt: skip
    best, second = int(np.argmin(at)), 1
    assert best > second
    steady = np.full(50, speed)
    held = [estimate(steady, np.full(50, force), table.ratio[g] * steady) for g in (best, second)]
    assert wasted_by_gears(held[0], table) == pytest.approx(0.0, abs=1e-12)
    assert wasted_by_gears(held[1], table) == pytest.approx(1.0 - at[best] / at[second], rel=1e-9)
    assert wasted_by_gears(held[1], table) > WORTH


def test_a_clutch_that_slips_a_standing_car_and_a_rolling_one_say_nothing_of_his_gears(table: DriveTable) -> None:
    speed = np.array([10.0, 0.0, 15.0])
    found = wasted_by_gears(estimate(speed, np.array([300.0, 300.0, -200.0]), np.array([999.0, 90.0, 300.0])), table)
    assert found == 0.0


def test_gears_are_told_to_who_wastes_by_them_and_not_to_who_does_not(car: Car) -> None:
    """Given 50 km/h held in second and in sixth gear, then the first is told gears."""
    found, speed = true_fuel_map(car), 13.9
    ratio = drive_table(found, car, speed_top=35.0, nodes=400).ratio
    steady, pull = np.full(50, speed), np.full(50, 250.0)
    assert gears_are_worth_telling(estimate(steady, pull, ratio[1] * steady), found, car)
    assert not gears_are_worth_telling(estimate(steady, pull, ratio[-1] * steady), found, car)
