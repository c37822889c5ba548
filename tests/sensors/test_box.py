"""Each sensor's statistics against the numbers of the default box, and faults that touch nothing else."""

import dataclasses

import numpy as np
import pytest
from trips import drive, smart

from sensors import accelerometer, clock, gps, injector, wheel
from sensors.box import BoxSettings, Fault, box_settings, measure, record
from sensors.effects import EFFECTS, FIELD, with_effects
from sensors.faults import KINDS
from sensors.packets import decode
from sensors.projection import to_geodetic, to_local
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Mounting
from vehicle_model.car.route import CANYON, TUNNEL

QUIET = BoxSettings(
    accelerometer_noise=0.0, accelerometer_noise_per_speed=0.0, accelerometer_noise_vertical=0.0,
    accelerometer_noise_vertical_per_speed=0.0, accelerometer_vibration=0.0, accelerometer_bias=0.0,
    accelerometer_mount_error=0.0, body_squat=0.0, gps_horizontal_error=0.0, gps_white_noise=0.0,
    gps_altitude_error=0.0, gps_lag=0.0, gps_speed_noise=0.0, wheel_tooth_error=0.0, wheel_radius_error=0.0,
    injector_noise=0.0, clock_rate_error=0.0, clock_jitter=0.0,
)  # fmt: skip


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(trip, car, card):
    assert record(trip, car, BoxSettings(), 0) == card
    assert record(trip, car, BoxSettings(), 1) != card


def test_an_accelerometer_at_rest_on_the_flat_reads_plus_one_g_upwards():
    trip = drive(60.0, 0.0)
    trip.channels["pitch"][:] = 0.0
    log = decode(record(trip, smart(), QUIET))
    rows = log["accelerometer"]
    assert np.abs(rows["x"]).max() < 0.006
    assert rows["z"] == pytest.approx(9.805, abs=0.006)


def test_specific_force_of_a_left_turn_a_crest_and_a_climb():
    trip = drive(60.0, 20.0, bend=-0.01)
    t = np.array([30.0])
    force = accelerometer.specific_force(trip, 9.805, 0.0, t)[0]
    v = np.interp(30.0, trip.time, trip.speed)
    assert force[1] == pytest.approx(0.01 * v**2), "a left turn pushes the car, and so the reading, to the left"
    slope, bend = (np.interp(30.0, trip.time, getattr(trip, name)) for name in ("pitch", "vertical_straightness"))
    a = np.interp(30.0, trip.time, trip.acceleration)
    assert force[0] == pytest.approx(a + 9.805 * np.sin(slope))
    assert force[2] == pytest.approx(9.805 * np.cos(slope) + bend * v**2)


def test_the_car_files_mounting_brings_the_reading_back_into_body_axes(trip):
    mounting = Mounting(2.58287237237842, 0.0277744014756975, 1.66349305108413, 0.989656407165839)
    log = decode(record(trip, smart(mounting), QUIET))
    rows = log["accelerometer"]
    raw = np.column_stack([rows[axis] for axis in "xyz"])
    body = raw @ (mounting.scale * accelerometer.rotation(mounting.roll, mounting.pitch, mounting.yaw)).T
    truth = accelerometer.specific_force(trip, 9.805, 0.0, np.arange(len(rows)) / 40.0)
    assert np.abs(body - truth).max() < 0.012  # half a count on each axis


def test_accelerometer_noise_grows_with_speed_and_is_larger_upwards(trip, car):
    settings = dataclasses.replace(BoxSettings(), accelerometer_vibration=0.0)
    quiet = accelerometer.measure(trip, car, QUIET, clock.Clock(0.0), 0)
    level = dataclasses.replace(settings, body_squat=0.0, accelerometer_mount_error=0.0)
    noisy = accelerometer.measure(trip, car, level, clock.Clock(0.0), 0)
    v = np.interp(quiet["t"], trip.time, trip.speed)
    for axis, base, slope in (("x", 0.10, 0.004), ("y", 0.10, 0.004), ("z", 0.30, 0.02)):
        residual = noisy[axis] - quiet[axis]
        scaled = (residual - residual.mean()) / (base + slope * v)
        assert scaled.std() == pytest.approx(1.0, abs=0.03)


def test_vibration_turns_with_the_firing_frequency(trip, car):
    only = dataclasses.replace(QUIET, accelerometer_vibration=0.5)
    shake = accelerometer.measure(trip, car, only, clock.Clock(0.0), 0)["x"]
    rest = accelerometer.measure(trip, car, QUIET, clock.Clock(0.0), 0)
    phase = np.interp(rest["t"], trip.time, trip.engine_angle) * 1.5
    part = shake - rest["x"]
    basis = np.column_stack((np.sin(phase), np.cos(phase)))
    size = np.linalg.lstsq(basis, part, rcond=None)[0]
    assert np.hypot(*size) == pytest.approx(0.5, rel=0.02)


def test_biases_stay_inside_their_limit_and_nearly_stay_from_trip_to_trip():
    found = np.array([accelerometer.bias(BoxSettings(), seed) for seed in range(200)])
    assert np.abs(found).max() <= 0.3
    assert found.std(axis=0).max() < 0.03
    boxes = np.array([accelerometer.bias(BoxSettings(device_seed=box), 0) for box in range(200)])
    assert boxes.std(axis=0).min() > 0.12


def test_wheel_pulses_measure_the_way_and_are_silent_at_a_walk(trip, car):
    t = wheel.measure(trip, car, QUIET, 0)["t"]
    assert np.interp(t, trip.time, trip.speed).min() >= 3.0 / 3.6 - 1e-6
    way = np.interp(t, trip.time, trip.distance)
    assert np.diff(way)[np.diff(t) < 1.0] == pytest.approx(car.metres_per_tick, rel=1e-3)


def test_tooth_errors_are_a_pattern_of_three_per_mille(trip, car):
    settings = dataclasses.replace(QUIET, wheel_tooth_error=0.003)
    pattern = np.concatenate(
        [wheel.tooth_pattern(car, dataclasses.replace(settings, device_seed=k)) for k in range(100)]
    )
    assert pattern.std() == pytest.approx(0.003, rel=0.1)
    assert wheel.measure(trip, car, settings, 0)["t"].tobytes() != wheel.measure(trip, car, QUIET, 0)["t"].tobytes()


def test_slip_and_wear_make_more_pulses_for_the_same_way(trip, car):
    plain = wheel.measure(trip, car, QUIET, 0).size
    worn = wheel.measure(trip, car, dataclasses.replace(QUIET, wheel_radius_change=-0.012), 0).size
    assert worn / plain == pytest.approx(1.0 / 0.988, rel=2e-3)


@pytest.mark.parametrize(("pattern", "per_cycle"), [("sequential", 1), ("grouped:2", 2), ("simultaneous", 3)])
def test_injector_pulses_hold_all_the_fuel_and_the_engines_turning(trip, pattern, per_cycle):
    car = smart(pattern=pattern)
    rows = injector.measure(trip, car, QUIET, 0)
    energy = car.injector_power * (rows["width"] + car.injector.lag)
    assert energy.sum() == pytest.approx(trip.fuel_energy[-1], rel=2e-3)
    turned = np.diff(np.interp(rows["t"], trip.time, trip.engine_angle))
    running = np.abs(turned - 4 * np.pi / per_cycle) < 0.1
    assert running.mean() > 0.9
    burnt = np.diff(np.interp(rows["t"], trip.time, trip.fuel_energy))
    assert energy[:-1][running] == pytest.approx(burnt[running], rel=1e-3, abs=1.0), (
        "a pulse's fuel burns until the next"
    )


def test_no_pulses_while_the_fuel_is_cut(trip, car):
    t = injector.measure(trip, car, QUIET, 0)["t"]
    cut = trip.fuel_power == 0.0
    inside = np.interp(t, trip.time, cut.astype(float)) > 0.99
    # A cycle that ends after the cut still gets its share.
    assert inside.mean() < 0.05


def test_a_wide_pulse_saturates_and_is_flagged(trip, car):
    wide = dataclasses.replace(QUIET, injector_dead_time=0.012)
    rows = decode(record(trip, car, wide))["injector"]
    assert rows["saturated"].any()
    assert rows["width"].max() == pytest.approx(16.38375e-3)
    assert np.all(rows["saturated"] == (rows["width"] > 16.3836e-3))


def test_gps_error_has_the_boxs_size_and_correlation():
    trip = drive(3600.0, 15.0, step=0.05)
    horizontal, vertical = [], []
    for seed in range(3):
        rows = gps.measure(trip, dataclasses.replace(BoxSettings(), gps_lag=0.0), seed)
        north, east = to_local(rows["latitude"], rows["longitude"], trip.origin)
        horizontal += [
            north - np.interp(rows["t"], trip.time, trip.north),
            east - np.interp(rows["t"], trip.time, trip.east),
        ]
        vertical.append(rows["altitude"] - np.interp(rows["t"], trip.time, trip.altitude))
    errors = np.array(horizontal)
    assert np.sqrt((errors**2).mean()) == pytest.approx(np.hypot(1.8, 0.4), rel=0.2)
    assert np.diff(errors).std() == pytest.approx(np.sqrt(2) * np.hypot(0.4, 1.8 * np.sqrt(0.2 / 120.0)), rel=0.05)
    assert np.sqrt((np.array(vertical) ** 2).mean()) == pytest.approx(3.5, rel=0.3)


def test_the_receivers_filter_lags_by_its_time_constant():
    trip = drive(120.0, 20.0)
    lagged = dataclasses.replace(QUIET, gps_lag=0.5)
    rows = gps.measure(trip, lagged, 0)
    here = (rows["t"] > 40) & (rows["t"] < 80)
    north, east = to_local(rows["latitude"], rows["longitude"], trip.origin)
    behind = np.hypot(
        np.interp(rows["t"], trip.time, trip.north) - north, np.interp(rows["t"], trip.time, trip.east) - east
    )
    v = np.interp(rows["t"] - 0.5, trip.time, trip.speed)
    assert behind[here] == pytest.approx(0.5 * v[here], rel=0.03)


def test_no_fix_in_a_tunnel_and_a_lying_hdop_between_houses():
    def sky(s):
        return np.where((s > 500) & (s < 900), TUNNEL, np.where(s > 1500, CANYON, 0)).astype(float)

    trip = drive(400.0, 15.0, sky=sky)
    rows = gps.measure(trip, BoxSettings(), 0)
    s = np.interp(rows["t"], trip.time, trip.distance)
    assert (rows["quality"][(s > 505) & (s < 895)] == 0).all()
    assert (rows["quality"][s < 490] == 1).all()
    north, east = to_local(rows["latitude"], rows["longitude"], trip.origin)
    off = np.hypot(
        north - np.interp(rows["t"], trip.time, trip.north), east - np.interp(rows["t"], trip.time, trip.east)
    )
    assert off[s > 1600].mean() > 2.0 * off[s < 490].mean()
    assert rows["hdop"][s > 1600].max() < 3.0


def test_sentences_arrive_in_time_and_in_order_of_the_card(trip, card):
    rows = decode(card)["gps"]
    delay = (rows["t"] - (rows["utc"] - trip.gps_epoch))[:-1]  # nothing stamped follows the last one
    assert delay.min() > 0.0
    assert delay.max() < 0.251
    assert delay.mean() == pytest.approx(0.145 - 0.0125, abs=0.02)
    assert np.all(np.diff(rows["order"]) > 0)


def test_skew_packets_add_up_to_what_the_clock_gained():
    trip = drive(900.0, step=0.05)
    fast = dataclasses.replace(BoxSettings(), clock_skew=200e-6, clock_rate_error=0.0)
    rows = decode(record(trip, smart(), fast))["skew"]
    assert rows["gained"].sum() == pytest.approx(890 * 200e-6, abs=1.1e-3)
    assert np.all(rows["gained"] * 1e3 == np.round(rows["gained"] * 1e3))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sensor", ["accelerometer", "gps", "wheel", "injector", "skew", "gyroscope", "compass"])
def test_a_fault_changes_its_stream_there_and_then_and_no_other(sensor, kind):
    trip, car = drive(120.0, step=0.02), smart()
    fitted = BoxSettings(gyroscope=True, compass=True, clock_skew=430e-6)
    plain = measure(trip, car, fitted, 3)
    faulty = measure(trip, car, dataclasses.replace(fitted, faults=(Fault(sensor, kind, 35.0, 85.0),)), 3)
    for name in plain:
        if name != sensor:
            assert plain[name].tobytes() == faulty[name].tobytes()
    a, b = plain[sensor], faulty[sensor]
    assert (a.tobytes() == b.tobytes()) == (kind == "ok")
    for before_or_after in (lambda rows: rows[rows["t"] < 35.0], lambda rows: rows[rows["t"] >= 85.0]):
        assert before_or_after(a).tobytes() == before_or_after(b).tobytes()
    inside = b[(b["t"] >= 35.0) & (b["t"] < 85.0)]
    usual = a[(a["t"] >= 35.0) & (a["t"] < 85.0)]
    if kind == "off":
        assert inside.size == 0
    if kind == "slow":
        assert inside.size == -(-usual.size // 5)
    if kind == "delayed":
        assert np.all(inside["delay"] == 0.5)
    if kind == "stuck" and sensor != "wheel":
        values = [name for name in a.dtype.names if name in ("x", "latitude", "width", "gained", "heading")]
        assert all(np.unique(inside[name]).size == 1 for name in values)


def test_bad_faults_are_refused_with_their_place():
    for fault in (Fault("gsp", "off"), Fault("gps", "broken"), Fault("gps", "off", 5.0, 5.0)):
        with pytest.raises(BadInput, match=r"faults\[0\]"):
            record(drive(30.0, step=0.1), smart(), BoxSettings(faults=(fault,)))


def test_every_effect_reaches_the_box_and_neutral_changes_nothing():
    default = BoxSettings()
    for effect in EFFECTS:
        for part in effect.parameters:
            key = f"{effect.id}.{part.name}"
            assert getattr(default, FIELD[key]) == part.neutral
            assert with_effects(default, {key: part.neutral}) is default
            assert getattr(with_effects(default, {key: part.middle}), FIELD[key]) == part.middle
    assert len(FIELD) == sum(len(effect.parameters) for effect in EFFECTS)


def test_a_scenarios_box_is_checked():
    class Declared:
        def __init__(self, box, faults=()):
            self.box, self.faults = box, faults

    made = box_settings(Declared({"gps_lag": 1}, [{"sensor": "gps", "kind": "off", "start": 10}]))
    assert made.gps_lag == 1.0
    assert made.faults == (Fault("gps", "off", 10),)
    for box, faults in (({"gps_lagg": 1}, ()), ({"gps_lag": "x"}, ()), ({}, [{"sensor": "gps", "strange": 1}])):
        with pytest.raises(BadInput):
            box_settings(Declared(box, faults))


def test_the_local_plane_and_the_globe_agree_both_ways():
    rng = np.random.default_rng(0)
    north, east = rng.uniform(-20_000, 20_000, (2, 100))
    origin = (49.61, 6.13, 300.0)
    back = to_local(*to_geodetic(north, east, origin), origin)
    assert np.abs(np.array(back) - [north, east]).max() < 0.01
