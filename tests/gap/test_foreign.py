"""Logs of a car and a box that are not ours, as packets: no gap is no gap, and an effect has its name."""

import numpy as np
import pytest
from foreign import CAR, World, card, drive, radius_of

from rollingroad.gap.diagnose import weigh
from rollingroad.gap.result import as_json
from sensors.log import SensorLog
from sensors.packets import decode
from vehicle_model.car.files import read_car

TICK = 2.0 * np.pi * radius_of() / 7.0
MINUTES = 8.0


@pytest.fixture(scope="module")
def understood(tmp_path_factory: pytest.TempPathFactory):
    """The foreign car's file, and three reference trips."""
    path = tmp_path_factory.mktemp("foreign") / "car.xml"
    path.write_text(CAR.format(tick=TICK))
    return read_car(path), [_log(2000 + n, World()) for n in (1, 2, 3)]


def _log(seed: int, world: World) -> SensorLog:
    return decode(card(drive(seed, world, MINUTES), world, seed, TICK), f"trip_{seed}")


def _answer(understood, world: World) -> dict:
    car, reference = understood
    return as_json(weigh(car, [_log(seed, world) for seed in (2100, 2101)], reference, None))


def test_another_engine_box_and_driver_are_no_gap(understood) -> None:
    """Given other trips of a car whose engine, driver and box are nobody's model, then there is no gap."""
    assert _answer(understood, World())["verdict"] == "no_gap"


def test_a_jam_is_not_booked_to_the_car(understood) -> None:
    """Given the same car in a jam, with creeping, light brakes and cut-offs that come late, then there is no gap."""
    assert _answer(understood, World(jam=True))["verdict"] == "no_gap"


def test_a_failed_accelerometer_is_no_gap(understood) -> None:
    """Given references with an accelerometer, and logs with neither that nor a road map, then hills that nothing tells
    and a less punctual speed are no gap."""
    car, reference = understood
    found = weigh(car, [_log(seed, World(accelerometer=False)) for seed in (2100, 2101)], reference, None)
    assert as_json(found)["verdict"] == "no_gap"


def test_its_wind_is_named_and_measured(understood) -> None:
    """Given a wind of 5 m/s from the north, then it is named and within a fifth."""
    first = _answer(understood, World(wind_north=5.0))["causes"][0]
    assert first["effects"] == ["head_wind"]
    assert first["parameters"]["head_wind.speed"]["value"] == pytest.approx(5.0, rel=0.2)


def test_one_fix_a_second_shows_lag_and_wheels(understood) -> None:
    """Given a receiver of one fix a second that is late, or tyres 1.5 % smaller, then either is named and measured."""
    late = _answer(understood, World(late_fix=0.7))["causes"][0]
    assert late["effects"] == ["gps_lag"]
    assert late["parameters"]["gps_lag.seconds"]["value"] == pytest.approx(0.7, abs=0.05)
    small = _answer(understood, World(radius=0.985 * radius_of()))["causes"][0]
    assert small["effects"] == ["wheel_radius"]
    assert small["parameters"]["wheel_radius.change"]["value"] == pytest.approx(-0.015, abs=0.003)
