"""Who knows what: the adviser has the map, the oracle and the judge have the truth, and the truth is the plant's."""

from dataclasses import replace

import numpy as np
import pytest

from controller.advice import Advice
from sensors.roadmap import from_route
from sim.advisor import AdviceFollower, View
from sim.drivers import STYLES, Gearbox
from sim.network import Network
from sim.road_ahead import road_ahead
from sim.route import true_route
from sim.true_efficiency import true_efficiency
from sim.truth import true_fuel_map
from vehicle_model.car.parameters import Car
from vehicle_model.car.trip import CHANNELS, Trip
from vehicle_model.plant import steady
from vehicle_model.plant.parameters import plant_parameters
from vehicle_model.plant.session import Plant


def test_the_road_ahead_comes_from_the_map_not_from_the_true_pitch(mixed: Network) -> None:
    route = true_route(mixed)
    road_map = from_route(route, 0)
    known = road_ahead(route, road_map)
    lied = road_ahead(replace(route, pitch=route.pitch + 0.5, altitude=route.altitude + 99.0), road_map)
    assert np.array_equal(known.pitch, lied.pitch)
    true_pitch = np.interp(known.s, route.s, route.pitch)
    assert 0.0 < np.std(known.pitch - true_pitch) < 0.008
    assert np.all(known.speed_min <= known.speed_max)
    assert known.speed_max.min() < 6.0, "street corners are slow"
    assert np.all(known.speed_max <= np.interp(known.s, route.s, route.speed_limit) + 14.0)


def test_the_true_map_is_the_plant_in_steady_state(car: Car) -> None:
    p = plant_parameters(car, {})
    fourth = true_fuel_map(car, {}, gear_weights=[0, 0, 0, 1, 0, 0])
    i, j = 20, 15
    expected = steady.fuel_power(p, 4, fourth.engine_speed[i], fourth.torque[j])
    assert fourth.fuel_power[i, j] == pytest.approx(float(expected), rel=1e-9)
    mean = true_fuel_map(car, {})
    assert np.all(mean.fuel_power[:, 0] > 0.0) and np.all(np.diff(mean.fuel_power, axis=1) > 0.0)
    assert np.all(mean.overrun_torque <= 0.0) and np.all(mean.torque_max > 0.0)


def test_true_efficiency_weighs_gears_by_the_time_in_the_cell(car: Car) -> None:
    """Given 30 s in third and 10 s in fifth gear in one cell, then three quarters of third and a quarter of fifth."""
    p = plant_parameters(car, {})
    omega, torque = 262.0, 41.0
    n = 40
    channels = {name: np.zeros(n) for name in CHANNELS}
    channels["gear"][:] = np.where(np.arange(n) < 30, 3.0, 5.0)
    channels["clutch"][:] = 1.0
    channels["engine_speed"][:] = omega
    channels["speed"][:] = 10.0
    channels["thrust"][:] = torque * omega / 10.0
    eta = true_efficiency(car, {}, [Trip(channels, 1.0, (0.0, 0.0, 0.0))])
    third, fifth = (float(steady.true_efficiency(p, gear, omega, torque)) for gear in (3, 5))
    assert float(eta(np.array(omega), np.array(torque))) == pytest.approx(0.75 * third + 0.25 * fifth, rel=1e-9)
    beyond = eta(np.array([omega, 3000.0]), np.array([500.0, 41.0]))
    assert np.isnan(beyond).all(), "the engine cannot be there"


def flat_advice(acceleration: float) -> Advice:
    n, m = 11, 4
    line, table = np.linspace(0.0, 1000.0, n), np.full((n, m), acceleration)
    table[5:, :] += 0.1
    return Advice(
        s=line, speed=line * 0 + 10, torque=line * 0, gear=np.full(n, 5), costate=line * 0, time=line / 10, fuel=line,
        policy_speed=np.array([0.0, 10.0, 20.0, 30.0]), policy_acceleration=table, policy_gear=np.full((n, m), 5),
        policy_costate=np.tile(np.arange(m) * 100.0, (n, 1)), time_value=8e3, policy_s=line,
    )  # fmt: skip


def view(**changes: float | str) -> View:
    plain = View(10.0, 100.0, 15.0, 4, np.inf, np.nan, np.inf, "", 900.0)
    return replace(plain, **changes)


def test_the_follower_tells_the_policy_of_the_place_and_speed() -> None:
    follower = AdviceFollower(flat_advice(0.2))
    told = follower.advise(view())
    assert told is not None
    assert told.acceleration == pytest.approx(0.2) and told.gear == 5 and told.costate == pytest.approx(150.0)
    later = follower.advise(view(distance=550.0))
    assert later is not None and later.acceleration == pytest.approx(0.3)


def test_the_follower_is_silent_before_it_begins() -> None:
    assert AdviceFollower(flat_advice(0.2), begin=150.0).advise(view()) is None


def test_the_follower_leaves_to_a_person_who_acts_late_what_he_does_better_himself() -> None:
    """Given who acts 0.8 s late, then braking and the car in front are his, gears if he shifts well."""
    late = AdviceFollower(flat_advice(0.2), delay=0.8, tells_gears=False)
    free = late.advise(view())
    assert free is not None and free.gear == 0 and free.acceleration == pytest.approx(0.2)
    soon = late.advise(view(distance=490.0))
    assert soon is not None and soon.acceleration == pytest.approx(0.3), "the policy of 502 m, where he will be"
    assert late.advise(view(leader_gap=50.0, leader_speed=15.0)) is None
    assert AdviceFollower(flat_advice(0.2)).advise(view(leader_gap=50.0, leader_speed=15.0)) is not None
    braking = flat_advice(-1.0)
    assert AdviceFollower(braking, delay=0.8).advise(view()) is None
    assert AdviceFollower(braking).advise(view()) is not None
    red = late.advise(view(signal_distance=120.0, signal_state="red", leader_gap=50.0, leader_speed=15.0))
    assert red is not None and red.coast, "a red light is still worth lifting off for"


def test_the_follower_rolls_to_a_red_light_that_it_can_reach_rolling_but_not_to_a_green_one() -> None:
    follower = AdviceFollower(flat_advice(0.2))
    red = follower.advise(view(signal_distance=120.0, signal_state="red"))
    green = follower.advise(view(signal_distance=120.0, signal_state="green"))
    far = follower.advise(view(speed=6.0, signal_distance=190.0, signal_state="red"))
    assert red is not None and red.coast
    assert green is not None and not green.coast
    assert far is not None and not far.coast, "it would come to rest long before the line"


def test_good_drives_in_the_cheapest_gear(car: Car, mixed: Network) -> None:
    """Against the steady map asked directly, among gears with power in reserve."""
    plant = Plant(car, true_route(mixed), None, 14.0, 4)
    force = 500.0
    wheel = 14.0 / car.wheel_radius
    p = plant.parameters
    costs = {
        gear: float(steady.fuel_power(p, gear, wheel * ratio, force * car.wheel_radius / ratio))
        for gear, ratio in enumerate(car.gear_ratios, start=1)
        if force * car.wheel_radius / ratio < 0.8 * float(steady.full_load(p, gear, wheel * ratio))
        and 121.0 < wheel * ratio < 0.92 * car.engine.redline_speed
    }
    chosen = Gearbox(car, STYLES["good"], plant).gear(plant, force, 0.3, 0.1)
    assert chosen == min(costs, key=lambda gear: costs[gear])
