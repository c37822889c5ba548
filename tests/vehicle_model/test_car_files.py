"""Car files: the thesis' sample read value for value, written and read back, and every fault named."""

import re
from dataclasses import replace
from importlib import resources
from itertools import pairwise
from math import pi
from pathlib import Path

import pytest

from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car, shipped_cars, write_car
from vehicle_model.car.nominal import epa_road_load, gear_ladder, nominal_car

SMART = (resources.files("vehicle_model") / "cars" / "smart.xml").read_text()


def changed(tmp_path: Path, old: str, new: str) -> Path:
    assert old in SMART
    path = tmp_path / "car.xml"
    path.write_text(SMART.replace(old, new))
    return path


def test_the_smart_is_the_thesis_sample():
    car = read_car("smart")
    assert car.mass == pytest.approx(920.0)
    assert car.accelerated_mass == pytest.approx(948.0, abs=0.5)
    assert car.wheel_radius == pytest.approx(0.2954, abs=1e-4)
    assert car.gear_ratios == (13.25, 9.604, 7.37, 5.796, 4.208, 3.23)
    assert (car.drag_coefficient, car.frontal_area, car.rolling_resistance) == (0.39, 1.93, 0.0125)
    assert car.engine.displacement == pytest.approx(698e-6)
    assert car.engine.max_power == 60e3 and car.engine.max_power_speed == pytest.approx(5250 * 2 * pi / 60)
    assert car.engine.max_torque == 110.0 and car.engine.compression == 9.0 and car.engine.inertia == 0.061
    assert car.engine.cylinders == 3 and car.engine.turbocharged
    assert car.injector.lag == -0.0004 and car.injector.flow == pytest.approx(8e-6)
    assert car.mounting.roll == 2.58287237237842 and car.mounting.scale == 0.989656407165839
    assert car.metres_per_tick == 0.270183975491887
    assert car.logs == ("2009-10-27.dat", "2009-10-28.dat", "2009-10-30.dat", "2009-11-01.dat")
    # 8 ml/s of petrol, 745 g/l, 43.0 MJ/kg
    assert car.injector_power == pytest.approx(0.008 * 0.745 * 43.0e6)


def test_the_sample_without_our_element_is_enough(tmp_path):
    plain = tmp_path / "plain.xml"
    plain.write_text(re.sub(r"<rollingroad.*</rollingroad>", "", SMART, flags=re.DOTALL))
    car = read_car(plain)
    assert car.tolerances == read_car("smart").tolerances
    assert car.engine.redline_speed == pytest.approx(1.15 * car.engine.max_power_speed)


@pytest.mark.parametrize("name", shipped_cars())
def test_a_car_written_and_read_is_the_same_car(name, tmp_path):
    car = read_car(name)
    write_car(car, tmp_path / "copy.xml")
    assert read_car(tmp_path / "copy.xml") == car
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["copy.xml"]


def test_toml_says_the_same(tmp_path):
    path = tmp_path / "smart.toml"
    path.write_text(
        """
        file = ["2009-10-27.dat"]
        mass = 844
        [engine]
        type = "698cc Inline 3 Turbo Suprex"
        displacement = "698cc"
        power = "60kW @5250rpm"
        torque = "110Nm @4500rpm"
        compression = "9:1"
        idle = 850
        inertia = 0.061
        [wheels]
        tire = "205/45 R16"
        inertia = 0.62
        [transmission]
        first = 13.25
        second = 9.604
        [drag]
        aero = 0.39
        rolling = 0.0125
        [area]
        frontal = 1.93
        [inj]
        calibration = { fuelPerSecond = 0.008, lag = -0.0004 }
        [vss]
        calibration = 0.27
        """
    )
    car, smart = read_car(path), read_car("smart")
    assert car.engine == replace(smart.engine, redline_speed=car.engine.redline_speed)
    assert (car.mass, car.drag_area, car.wheel_radius) == (smart.mass, smart.drag_area, smart.wheel_radius)
    assert car.gear_ratios == (13.25, 9.604) and car.logs == ("2009-10-27.dat",)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<mass wet", "<ballast kg='3' /><mass wet", ("ballast", "no element")),
        ('wet="844"', 'wet="844" dry="800"', ("mass", "dry")),
        ('wet="844"', 'wet="8.44"', ("mass wet", "8.44", "200 to 4500")),
        ('wet="844"', 'wet="heavy"', ("mass wet", "number", "heavy")),
        ('Crr="0.0125"', 'Crr="0.125"', ("Crr", "0.125", "0.003 to 0.04")),
        ('gear="7.37"', 'gear="9.9"', ("gear 3", "9.9", "descend")),
        ('<third gear="7.37" />', "", ("third", "missing")),
        ("205/45 R16", "big", ("tire", "205/45 R16", "big")),
        ("60kW @5250rpm", "60 at 5250", ("power", "kW", "60 at 5250")),
        ("60kW @5250rpm", "90kW @5250rpm", ("90 kW", "more than the 110 Nm")),
        ('torque="110Nm', 'torque="410Nm', ("mean pressure", "30 bar")),
        ('rpm="850"', 'rpm="5000"', ("idle",)),
        ('comp="9:1"', 'comp="90:1"', ("comp", "90", "6 to 16")),
        ('pattern="sequential"', 'pattern="random"', ("timing", "grouped:N", "random")),
        ("</ponthy_config>", "", ("well-formed",)),
        ("<ponthy_config>", "<car_config>", ("well-formed",)),
        ('<aero Cd="0.39" />', "", ("drag/aero", "missing")),
    ],
)
def test_a_wrong_file_is_refused_by_name(old, new, words, tmp_path):
    path = changed(tmp_path, old, new)
    with pytest.raises(BadInput) as error:
        read_car(path)
    message = str(error.value)
    assert message.startswith(str(path)) and "\n" not in message
    for word in words:
        assert word in message


def test_an_entity_bomb_is_refused(tmp_path):
    path = tmp_path / "bomb.xml"
    path.write_text('<!DOCTYPE c [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><ponthy_config>&b;</ponthy_config>')
    with pytest.raises(BadInput, match="entities"):
        read_car(path)


def test_an_unknown_car_names_the_known_ones():
    with pytest.raises(BadInput, match="peugeot, rav4_2018, smart"):
        read_car("trabant")


def test_a_nominal_car_has_the_road_load_it_was_given():
    """Given a car of known C_rr and drag area, when its A, B, C are made from them, then they come back."""
    mass, rolling, drag_area = 1500.0, 0.009, 0.65
    gearbox = 3.0 / 0.32  # what the plant's gearbox drags in neutral, N, and per m/s
    a = mass * 9.805 * rolling + gearbox
    car = nominal_car("x", mass, (a, gearbox / 0.32 / 60.0, 0.6 * drag_area), 1.8e-3, 90e3, 6)
    assert car.rolling_resistance == pytest.approx(rolling, rel=1e-9)
    assert car.drag_area == pytest.approx(drag_area, rel=1e-9)
    assert car.mass == mass and len(car.gear_ratios) == 6


def test_epa_units():
    a, b, c = epa_road_load(1.0, 1.0, 1.0)
    assert (
        a == pytest.approx(4.4482, rel=1e-4)
        and b == pytest.approx(9.950, rel=1e-3)
        and c == pytest.approx(22.26, rel=1e-3)
    )


def test_a_ladder_descends_to_its_top():
    for gears in range(1, 11):
        ladder = gear_ladder(gears, 2.5)
        assert len(ladder) == gears and ladder[-1] == pytest.approx(2.5)
        assert all(upper > lower for upper, lower in pairwise(ladder))
