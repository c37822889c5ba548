"""The planner's plans, driven by the plant alone, against the trace that they replace: same way, same time."""

import numpy as np
import pytest

from sensors.roadmap import from_route
from sim.drive_record import Drive
from sim.open_loop import cycle_check, road_check
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car
from vehicle_model.plant.cycle import Cycle, read_cycle


def trapezia(grade: float = 0.0) -> Cycle:
    """Three moves to 50 km/h with a wobble while cruising, and one of 30 m that is too short to plan."""
    move = np.concatenate(
        [np.linspace(0.0, 14.0, 15), 14.0 + 2.0 * np.sin(np.arange(60) / 3.0), np.linspace(14.0, 0.0, 12)]
    )
    short = np.array([0.0, 2.0, 4.0, 4.0, 4.0, 4.0, 4.0, 2.0, 0.0])
    still = np.zeros(15)
    speed = np.concatenate([still, move, still, move, still, short, still, move, still])
    return Cycle("trapezia", np.arange(len(speed), dtype=float), speed, np.full(len(speed), grade))


def test_a_wobbling_cycle_is_driven_on_less_at_the_same_time_and_distance(car: Car) -> None:
    found = cycle_check(trapezia(), car)
    assert found.kept == 1, "the short move"
    assert abs(found.distance_difference) < 0.003
    assert 1.0 < found.by_speed_percent < 25.0
    assert 1.0 < found.saving_percent < 40.0


def test_the_highway_cycle_holds_nearly_steady_speeds_and_little_is_to_be_had(car: Car) -> None:
    found = cycle_check(read_cycle("hwfet"), car)
    assert found.kept == 0 and abs(found.distance_difference) < 0.002
    assert 0.0 < found.saving_percent < 15.0


def test_a_real_road_with_hills_is_driven_on_less_than_by_its_limits(baseline: Drive, car: Car) -> None:
    found = road_check("mixed", baseline.route, from_route(baseline.route, 3), car)
    assert abs(found.distance_difference) < 0.01 and found.distance > 12_000.0, (
        "a weak car falls behind its trace uphill"
    )
    assert 2.0 < found.saving_percent < 30.0


def test_a_cycle_with_grades_is_refused(car: Car) -> None:
    with pytest.raises(BadInput, match="flat"):
        cycle_check(trapezia(0.02), car)
