"""The price list confirmed: taking sensors away costs accuracy of thrust, and what cannot be told is not."""

import pytest

from rollingroad.price_list import confirmed, drive_along, learnt_before, winding_road
from sensors.box import BoxSettings, record
from sensors.packets import decode
from sensors.roadmap import from_route
from vehicle_model.car.files import read_car

CAR = read_car("smart")


@pytest.fixture(scope="module")
def drive():
    route = winding_road(2000.0)
    trip, box = drive_along(CAR, route), BoxSettings(gyroscope=True, compass=True)
    road_map = from_route(route, 0, box)
    learnt = learnt_before(CAR, road_map, box, trip, 1)
    return decode(record(trip, CAR, box, seed=0)), trip, road_map, learnt


def test_an_accelerometer_with_the_wheel_beats_the_receiver_alone_and_nothing(drive):
    log, trip, road_map, learnt = drive

    def error(*names: str) -> float:
        found = confirmed(log, trip, CAR, road_map, names, learnt)
        assert found is not None
        return found

    assert error("accelerometer_x", "wheel") < 0.3 * min(error("gps"), error())


def test_sets_that_the_box_cannot_show_have_no_figure(drive):
    log, trip, road_map, learnt = drive
    for names in (("accelerometer_x", "wheel", "barometer"), ("accelerometer_y", "wheel")):
        assert confirmed(log, trip, CAR, road_map, names, learnt) is None


def test_the_drive_rises_and_falls_and_shifts(drive):
    trip = drive[1]
    assert trip.speed.min() > 3.0 and trip.speed.max() > 15.0
    assert len(set(trip.gear.astype(int))) >= 3 and trip.pitch.max() > 0.04
