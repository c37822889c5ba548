"""The catalogue: every effect of the list once, declared by the room that carries it, settable by its key."""

import pytest

from rollingroad.catalogue import catalogue, check_settings, parameters, read_settings
from scenarios.effects import EFFECTS as TRAFFIC
from sensors.effects import EFFECTS as SENSORS
from vehicle_model.car.errors import BadInput
from vehicle_model.plant.effects import EFFECTS as PLANT

LISTED = [
    "head_wind",
    "cross_wind",
    "rolling_resistance",
    "tyre_warm_up",
    "mass",
    "drag_area",
    "air_density",
    "cold_start",
    "cranking_fuel",
    "gearbox_oil_cold",
    "accessory_load",
    "ac_cycling",
    "enrichment",
    "fuel_cutoff",
    "idle_fuel",
    "injector_dead_time",
    "fuel_energy",
    "injector_fouling",
    "map_drift",
    "turbo_lag",
    "driveline_loss",
    "clutch_slip",
    "shift_loss",
    "wheel_slip",
    "wheel_radius",
    "cornering_drag",
    "brake_drag",
    "grade_map_error",
    "accelerometer_mount",
    "gps_lag",
    "clock_skew",
    "driver_lag",
    "traffic_actuation",
]
SUBSYSTEMS = [
    "driver",
    "road_load",
    "driveline",
    "engine_fuel",
    "accessory",
    "gps",
    "accelerometer",
    "wheel",
    "injector",
    "clock",
    "road_map",
    "traffic",
]


def test_all_33_effects_are_declared_and_none_twice():
    declared = [effect.id for effect in (*PLANT, *SENSORS, *TRAFFIC)]
    assert sorted(declared) == sorted(LISTED)


def test_each_effect_names_a_subsystem_and_each_parameter_a_range_around_its_neutral():
    for effect in catalogue().values():
        assert effect.subsystem in SUBSYSTEMS, effect.id
        for parameter in effect.parameters:
            assert parameter.low < parameter.high, (effect.id, parameter.name)
            assert parameter.source, (effect.id, parameter.name)


def test_a_setting_is_read_as_effect_dot_parameter_equals_number():
    assert read_settings(["head_wind.speed=4"]) == {"head_wind.speed": 4.0}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("head_wind.sped=4", "head_wind.speed"),
        ("nonsense=4", "no such effect parameter"),
        ("head_wind.speed", "EFFECT.PARAMETER=NUMBER"),
        ("head_wind.speed=fast", "EFFECT.PARAMETER=NUMBER"),
        ("head_wind.speed=4000", "outside"),
        ("head_wind.speed=nan", "outside"),
    ],
)
def test_a_bad_setting_is_told_with_what_was_expected(text, told):
    with pytest.raises(BadInput, match=told):
        read_settings([text])


def test_every_neutral_value_is_accepted():
    check_settings({key: parameter.neutral for key, parameter in parameters().items()}, "test")
