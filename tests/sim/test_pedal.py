"""Pedal to the floor (seed 004, 5.1.3): the driver presses, the car carries the optimal acceleration out."""

from dataclasses import replace

from scenarios import files
from sensors.roadmap import from_route
from sim import advisors
from sim.advisor import Context
from sim.drive import drive
from sim.drive_record import Drive
from sim.network import Network
from sim.road_ahead import road_ahead
from sim.truth import true_fuel_map
from vehicle_model.car.parameters import Car


def _departure(drive: Drive, baseline: Drive) -> int:
    """First step whose traffic is no longer the baseline's."""
    pairs = zip(drive.step_hashes, baseline.step_hashes, strict=False)
    return next(step for step, (here, there) in enumerate(pairs) if here != there)


def test_what_the_car_carries_out_itself_comes_at_once_and_is_looked_at_less(
    baseline: Drive, car: Car, mixed: Network
) -> None:
    scenario = files.load("mixed")
    known = Context(road_ahead(baseline.route, from_route(baseline.route, 3)), true_fuel_map(car), car)
    done = []
    for floor in (False, True):
        advisor = advisors.make("acceleration", replace(known, pedal_to_the_floor=floor))
        done.append(drive(scenario, car, 3, advisor=advisor, network=mixed))
    by_foot, by_car = done
    assert by_foot.first_advice_step is not None and by_foot.first_advice_step == by_car.first_advice_step
    delay = round(scenario.driver.advice_delay / 0.1)
    assert _departure(by_foot, baseline) - _departure(by_car, baseline) >= delay
    assert by_car.compliance.changes_per_minute < 0.8 * by_foot.compliance.changes_per_minute
    assert by_car.compliance.eyes_off_road_share < by_foot.compliance.eyes_off_road_share
    assert by_car.collisions == 0 and by_car.red_lights_run == 0 and by_car.limit_violations == 0
