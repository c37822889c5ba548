"""The planned drive: it obeys the road, arrives on time, balances its energy, and nothing simple beats it."""

import numpy as np
import pytest

from controller.advice import RoadAhead
from controller.route import Comfort, plan_route, plan_route_in_time
from vehicle_model.car.errors import BadInput

KMH = 1 / 3.6


def flat(length: float, limit: float = 90 * KMH) -> RoadAhead:
    s = np.arange(0.0, length + 1.0, 10.0)
    return RoadAhead(s, np.zeros_like(s), np.full_like(s, limit), np.zeros_like(s))


def hilly(length: float) -> RoadAhead:
    s = np.arange(0.0, length + 1.0, 10.0)
    pitch = 0.03 * np.sin(2 * np.pi * s / 1700) + 0.015 * np.sin(2 * np.pi * s / 610)
    limit = np.where(s < 1000, 50.0, np.where(s < 3500, 90.0, 70.0)) * KMH
    return RoadAhead(s, pitch, limit, np.zeros_like(s))


def test_the_plan_keeps_limits_comfort_and_ends(smart, willans):
    road = hilly(5000)
    plan = plan_route(road, willans, smart, start_speed=0.0, end_speed=0.0, time_value=15_000.0)
    assert np.all(plan.speed <= np.interp(plan.s, road.s, road.speed_max) + 1e-6)
    acceleration = np.diff(plan.speed**2) / (2 * np.diff(plan.s))
    assert acceleration.max() <= 2.0 + 1e-9
    assert acceleration.min() >= -1.5 - 1e-9
    assert plan.speed[0] == 0.0
    assert plan.speed[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.all(plan.costate >= 0.0)
    assert np.all(np.diff(plan.time) > 0.0)
    assert np.all(np.diff(plan.fuel) >= 0.0)


def test_energy_is_conserved_along_the_plan(smart, willans):
    road = hilly(5000)
    plan = plan_route(road, willans, smart, start_speed=10.0, end_speed=10.0, time_value=15_000.0)
    ds = np.diff(plan.s)
    ratio = np.append(np.inf, np.asarray(smart.gear_ratios) / smart.wheel_radius)[plan.gear[:-1]]
    ratio[np.isinf(ratio)] = 0.0
    work = np.sum(plan.torque[:-1] * ratio * ds) - np.sum(plan.brake_force[:-1] * ds)
    height = np.trapezoid(np.sin(road.pitch), road.s)
    drag = np.sum(0.5 * smart.air_density * smart.drag_area * 0.5 * (plan.speed[1:] ** 2 + plan.speed[:-1] ** 2) * ds)
    rolling = smart.mass * smart.gravity * smart.rolling_resistance * np.trapezoid(np.cos(road.pitch), road.s)
    assert work == pytest.approx(smart.mass * smart.gravity * height + drag + rolling, rel=2e-3)


@pytest.mark.parametrize("trip_time", [260.0, 300.0, 360.0])
def test_it_arrives_when_asked(smart, willans, trip_time):
    plan = plan_route_in_time(hilly(5000), willans, smart, start_speed=0.0, end_speed=0.0, trip_time=trip_time)
    assert plan.trip_time == pytest.approx(trip_time, rel=1.5e-3)


def test_more_time_never_costs_more_fuel(smart, willans):
    plans = [
        plan_route(hilly(5000), willans, smart, start_speed=0.0, end_speed=0.0, time_value=w)
        for w in (2e3, 6e3, 12e3, 25e3, 60e3)
    ]
    assert np.all(np.diff([plan.trip_time for plan in plans]) < 0.0)
    assert np.all(np.diff([plan.trip_fuel for plan in plans]) > 0.0)


def test_cruise_speed_is_the_stationary_optimum(smart, willans):
    """On a long flat road d/dv of (P_in + W)/v vanishes at the cruise speed: found here by brute force over gears."""
    price = 20_000.0
    plan = plan_route(flat(8000, 40.0), willans, smart, start_speed=20.0, end_speed=20.0, time_value=price)
    ratios = np.asarray(smart.gear_ratios) / smart.wheel_radius
    best = (np.inf, 0.0)
    for v in np.linspace(10, 35, 501):
        force = 0.5 * 1.2 * smart.drag_area * v**2 + smart.mass * smart.gravity * smart.rolling_resistance
        for n in ratios:
            w = n * v
            if not 1.25 * willans.idle_speed <= w <= willans.engine_speed[-1]:
                continue
            power = np.interp(
                w, willans.engine_speed, [np.interp(force / n, willans.torque, row) for row in willans.fuel_power]
            )
            best = min(best, ((power + price) / v, v))
    middle = np.abs(plan.s - 4000) < 1500
    assert plan.speed[middle].mean() == pytest.approx(best[1], rel=0.015)
    rate = (np.diff(plan.fuel)[middle[:-1]].sum() + price * np.diff(plan.time)[middle[:-1]].sum()) / np.diff(plan.s)[
        middle[:-1]
    ].sum()
    assert rate == pytest.approx(best[0], rel=3e-3)


def test_policy_and_plan_agree_on_the_plan(smart, willans):
    plan = plan_route(hilly(5000), willans, smart, start_speed=0.0, end_speed=0.0, time_value=15_000.0)
    acceleration = np.diff(plan.speed**2) / (2 * np.diff(plan.s))
    for k in range(20, len(plan.s) - 20, 17):
        advised, gear, worth = plan.action(plan.s[k], plan.speed[k])
        assert advised == pytest.approx(acceleration[k], abs=0.6)
        assert abs(gear - plan.gear[k]) <= 2
        assert worth >= 0.0


def test_a_willans_engine_is_not_driven_in_pulses(smart, willans):
    plan = plan_route(flat(6000), willans, smart, start_speed=20.0, end_speed=20.0, time_value=12_000.0)
    restarts = np.count_nonzero(plan.coasting[:-1] & ~plan.coasting[1:])
    assert restarts == 0


def test_bad_input_names_the_nearest_feasible(smart, willans):
    road = hilly(5000)
    with pytest.raises(BadInput, match="nearest feasible is"):
        plan_route_in_time(road, willans, smart, start_speed=0.0, end_speed=0.0, trip_time=60.0)
    with pytest.raises(BadInput, match="nearest within the limit"):
        plan_route(road, willans, smart, start_speed=0.0, end_speed=50.0, time_value=1e4)
    with pytest.raises(BadInput, match=r"end speed.*nearest feasible"):
        plan_route(flat(100), willans, smart, start_speed=0.0, end_speed=24.0, time_value=1e4, comfort=Comfort())
    with pytest.raises(BadInput, match="time value"):
        plan_route(road, willans, smart, start_speed=0.0, end_speed=None, time_value=-1.0)
    crossing = RoadAhead(road.s, road.pitch, road.speed_max, road.speed_max + 1.0)
    with pytest.raises(BadInput, match="speed_min"):
        plan_route(crossing, willans, smart, start_speed=0.0, end_speed=None, time_value=1e4)


def test_the_compiled_sweep_equals_the_readable_one(smart, willans):
    from controller import route_kernel, route_reference
    from controller.route_problem import RouteProblem

    problem = RouteProblem.build(hilly(1200), willans, smart, 5.0, 12.0, None, None, 20.0, 90, None)
    fast = problem.value_function(9_000.0)
    slow = np.full_like(fast, route_kernel.BIG)
    slow[-1] = fast[-1]
    route_reference.sweep(*problem.arguments(9_000.0, slow))
    known = (fast < route_kernel.IMPOSSIBLE) & (slow < route_kernel.IMPOSSIBLE)
    assert np.array_equal(fast < route_kernel.IMPOSSIBLE, slow < route_kernel.IMPOSSIBLE)
    assert fast[known] == pytest.approx(slow[known], rel=1e-10)


@pytest.mark.parametrize("price", [8e3, 20e3])
def test_the_plan_is_an_extremal_of_pontryagin(smart, willans, price):
    """Where no limit is touched the action maximises H and the costate obeys its equation, to the grid's width."""
    plan = plan_route(hilly(5000), willans, smart, start_speed=0.0, end_speed=0.0, time_value=price)
    assert plan.certificate["maximum_gap"] < 0.01
    assert plan.certificate["costate_error"] < 0.02
    assert plan.certificate["pulses"] <= 1.0


def test_the_certificate_reports_that_a_map_rewards_pulses(smart, willans, dented):
    road = flat(4000, 25.0)
    calm = plan_route(road, willans, smart, start_speed=18.0, end_speed=18.0, time_value=12e3)
    tempting = plan_route(road, dented, smart, start_speed=18.0, end_speed=18.0, time_value=12e3)
    assert calm.certificate["hull_gain"] < 0.01
    assert tempting.certificate["hull_gain"] > 0.1


@pytest.fixture(scope="module")
def dented(willans):
    """A Willans map with part load made 30 % dearer around the cruise: not convex over thrust."""
    from dataclasses import replace

    dent = 1.0 + 0.3 * np.exp(-(((willans.torque - 25.0) / 12.0) ** 2))
    return replace(willans, fuel_power=willans.fuel_power * dent)


def steady_rate(smart, fuel_map, price: float, speeds) -> tuple[float, float]:
    """Least (P_in + W)/v over constant speeds and gears on the flat, J/m, and its speed: by brute force."""
    best = (np.inf, 0.0)
    for v in speeds:
        force = 0.5 * 1.2 * smart.drag_area * v**2 + smart.mass * smart.gravity * smart.rolling_resistance
        for ratio in smart.gear_ratios:
            w, torque = ratio / smart.wheel_radius * v, force / ratio * smart.wheel_radius
            if not 1.25 * fuel_map.idle_speed <= w <= fuel_map.engine_speed[-1]:
                continue
            if torque > np.interp(w, fuel_map.engine_speed, fuel_map.torque_max):
                continue
            over_torque = [np.interp(torque, fuel_map.torque, row) for row in fuel_map.fuel_power]
            best = min(best, ((np.interp(w, fuel_map.engine_speed, over_torque) + price) / v, v))
    return best


def test_pulse_and_glide_is_forbidden_unless_allowed(smart, dented):
    """The best drive without pulses is the best constant speed, which brute force finds; pulses are cheaper."""
    road, settings = flat(6000, 30.0), dict(start_speed=15.0, end_speed=15.0, time_value=12e3)
    calm = plan_route(road, dented, smart, **settings)
    pulsing = plan_route(road, dented, smart, **settings, comfort=Comfort(pulse_and_glide=True))
    assert (calm.certificate["swings"], calm.certificate["pulses"]) == (0.0, 0.0)
    assert pulsing.certificate["swings"] > 20
    rate, speed = steady_rate(smart, dented, 12e3, np.linspace(6, 28, 441))
    middle = np.abs(calm.s[:-1] - 3000) < 1000
    assert np.ptp(calm.speed[:-1][middle]) < 0.5
    assert calm.speed[:-1][middle].mean() == pytest.approx(speed, rel=0.02)
    spent = np.diff(calm.fuel)[middle].sum() + 12e3 * np.diff(calm.time)[middle].sum()
    assert spent / np.diff(calm.s)[middle].sum() == pytest.approx(rate, rel=5e-3)
    assert pulsing.trip_fuel + 12e3 * pulsing.trip_time < 0.97 * (calm.trip_fuel + 12e3 * calm.trip_time)


def test_forbidding_pulses_changes_nothing_on_a_convex_map(smart, willans):
    for road in (flat(4000), hilly(5000)):
        plans = [
            plan_route(
                road, willans, smart, start_speed=10.0, end_speed=10.0, time_value=12e3,
                comfort=Comfort(pulse_and_glide=allowed),
            )
            for allowed in (True, False)
        ]  # fmt: skip
        costs = [plan.trip_fuel + 12e3 * plan.trip_time for plan in plans]
        assert costs[1] == pytest.approx(costs[0], rel=2e-4)


def test_rolling_pulses_are_forbidden_too(smart, willans):
    """An engine that idles cheaply with the clutch open rewards rolling: allowed, the plan rolls; by default it drives.

    Rolling with the clutch open is made of an overrun torque of nothing and fuel cut.
    """
    from dataclasses import replace

    sailing = replace(willans, overrun_torque=-0.2 * np.ones_like(willans.overrun_torque))
    free = Comfort(pulse_and_glide=True, restart_energy=0.0)
    road, settings = flat(6000, 30.0), dict(start_speed=15.0, end_speed=15.0, time_value=8e3)
    rolling = plan_route(road, sailing, smart, **settings, comfort=free)
    driving = plan_route(road, sailing, smart, **settings, comfort=Comfort(restart_energy=0.0))
    assert rolling.certificate["pulses"] >= 3
    middle = np.abs(driving.s - 3000) < 1500
    assert not driving.coasting[middle].any()
    assert driving.certificate["pulses"] <= 1


@pytest.mark.parametrize("allowed", [True, False])
def test_the_compiled_sweep_equals_the_readable_one_on_a_map_that_is_not_convex(smart, dented, allowed):
    from controller import route_kernel, route_reference
    from controller.route_problem import RouteProblem

    comfort = Comfort(pulse_and_glide=allowed)
    problem = RouteProblem.build(hilly(800), dented, smart, 12.0, 12.0, None, comfort, 20.0, 90, None)
    fast = problem.value_function(9_000.0)
    slow = np.full_like(fast, route_kernel.BIG)
    slow[-1] = fast[-1]
    route_reference.sweep(*problem.arguments(9_000.0, slow))
    known = (fast < route_kernel.IMPOSSIBLE) & (slow < route_kernel.IMPOSSIBLE)
    assert fast[known] == pytest.approx(slow[known], rel=1e-10)


def test_a_plan_sought_in_a_corridor_is_the_plan_of_the_whole_grid(smart, willans, dented):
    for fuel_map in (willans, dented):
        for price in (4e3, 15e3):
            settings = dict(start_speed=0.0, end_speed=0.0, time_value=price)
            whole = plan_route(hilly(5000), fuel_map, smart, **settings)
            narrow = plan_route(hilly(5000), fuel_map, smart, **settings, policy_step=None)
            assert narrow.speed == pytest.approx(whole.speed, abs=1e-9)
            assert narrow.trip_fuel == pytest.approx(whole.trip_fuel, rel=1e-12)
            assert narrow.policy_speed.size == 0
    settings = dict(start_speed=0.0, end_speed=0.0, trip_time=330.0)
    whole = plan_route_in_time(hilly(5000), willans, smart, **settings)
    narrow = plan_route_in_time(hilly(5000), willans, smart, **settings, policy_step=None)
    assert narrow.time_value == whole.time_value
    assert narrow.trip_time == pytest.approx(whole.trip_time, rel=1e-12)


def test_a_policy_of_short_reach_is_the_beginning_of_the_whole_one(smart, willans):
    """Given a driver at 10 m/s who plans again soon, what he is told at the speeds that he can have by then is what the
    whole policy says, and the plan is the same, though speeds out of his reach are left out."""
    settings = dict(start_speed=10.0, end_speed=None, time_value=20e3, policy_step=50.0, certify=False)
    whole = plan_route(hilly(2000), willans, smart, **settings)
    short = plan_route(hilly(2000), willans, smart, **settings, policy_reach=220.0)
    places = len(short.policy_s)
    assert short.policy_s[-1] <= 220.0 < whole.policy_s[places]
    assert np.array_equal(short.speed, whole.speed)
    for place in range(places):
        for speed in np.linspace(7.0, 13.0, 9):
            said, all_said = (plan.action(float(short.policy_s[place]), speed) for plan in (short, whole))
            assert said[:2] == pytest.approx(all_said[:2], rel=1e-9)
    assert len(short.policy_speed) < len(whole.policy_speed)
