"""The advisors that ship: made by name, sent to other processes, and each says what its idea implies."""

import pickle
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from controller.advice import RoadAhead
from sim import advisors
from sim.advisor import Context, View
from sim.receding_horizon import HIS_OWN
from sim.truth import true_fuel_map
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car


@pytest.fixture(scope="module")
def context(car: Car) -> Context:
    """2 km flat at 50 km/h, 30 km/h from 1,200 m on."""
    s = np.arange(0.0, 2000.0, 5.0)
    limit = np.where(s < 1200.0, 50.0, 30.0) / 3.6
    return Context(RoadAhead(s, 0.0 * s, limit, 0.0 * s), true_fuel_map(car), car)


def view(**changes: float | str) -> View:
    return replace(View(60.0, 500.0, 13.5, 5, np.inf, np.nan, np.inf, "", 1490.0), **changes)


@pytest.mark.parametrize("name", list(advisors.ADVISORS))
def test_every_advisor_survives_the_way_to_another_process_and_is_silent_at_first(name: str, context: Context) -> None:
    advisor = pickle.loads(pickle.dumps(advisors.make(name, context)))
    advisor.reset()
    assert advisor.advise(view(distance=20.0)) is None


def test_an_unknown_name_is_refused_with_the_names_there_are(context: Context) -> None:
    with pytest.raises(BadInput, match="pontryagin, acceleration, glide, coach, oracle"):
        advisors.make("magic", context)


@pytest.mark.parametrize("name", ["pontryagin", "coach", "glide"])
def test_nobody_is_told_to_accelerate_towards_a_red_light(name: str, context: Context) -> None:
    advisor = advisors.make(name, context)
    advisor.reset()
    for distance in (140.0, 100.0, 60.0):
        told = advisor.advise(view(signal_distance=distance, signal_state="red", time=100.0 + distance))
        assert told is None or told.acceleration < 0.05


def test_the_receding_horizon_lifts_off_for_a_slower_leader_and_not_for_a_faster_one(context: Context) -> None:
    advisor = advisors.make("pontryagin", context)
    advisor.reset()
    slower = advisor.advise(view(leader_gap=70.0, leader_speed=7.0))
    advisor.reset()
    free = advisor.advise(view())
    advisor.reset()
    faster = advisor.advise(view(leader_gap=70.0, leader_speed=16.0))
    assert slower is not None and free is not None and faster is not None
    assert slower.acceleration < -0.2 and slower.acceleration < free.acceleration - 0.2
    assert faster == free


def test_the_receding_horizon_slows_down_ahead_of_the_lower_limit_and_its_costate_is_positive(context: Context) -> None:
    advisor = advisors.make("pontryagin", context)
    advisor.reset()
    told = advisor.advise(view(distance=1090.0, destination_distance=900.0))
    assert told is not None and told.acceleration < -0.3
    too_near_to_roll = advisor.advise(view(distance=1160.0, time=63.0, destination_distance=830.0))
    assert too_near_to_roll is None, "what is there to brake for he sees, and does it without delay"
    cruising = advisor.advise(view(distance=300.0, speed=11.0, time=90.0, destination_distance=1690.0))
    assert cruising is not None and cruising.costate > 0.0


def test_the_receding_horizon_asks_for_no_hard_braking_behind_a_leader_who_stops(context: Context) -> None:
    """Given a leader close by whose speed falls fast, then no arrow asks for more than to lift off; he sees it."""
    advisor = advisors.make("pontryagin", context)
    advisor.reset()
    told = []
    for k in range(40):
        seen = view(time=60.0 + 0.1 * k, speed=6.5, gear=3, leader_gap=16.0, leader_speed=max(5.0 - 0.13 * k, 0.0))
        told.append(advisor.advise(seen))
    given = [suggestion.acceleration for suggestion in told if suggestion is not None]
    assert told[-1] is None, "he is left to brake as he sees fit"
    assert min(given, default=0.0) >= -HIS_OWN


def test_the_receding_horizon_leaves_the_distance_to_who_follows_and_tells_gears_to_who_shifts_badly(
    context: Context,
) -> None:
    """Given a car 30 m ahead at the same speed, then haste gains nothing: the pace is his own."""
    following = view(leader_gap=30.0, leader_speed=13.5)
    for tells in (False, True):
        advisor = advisors.make("pontryagin", replace(context, tells_gears=tells))
        advisor.reset()
        told = advisor.advise(following)
        if not tells:
            assert told is None
        else:
            assert told is not None and told.free and told.gear == 6
    shifts_well = advisors.make("pontryagin", replace(context, tells_gears=False))
    shifts_well.reset()
    free = shifts_well.advise(view(distance=300.0, speed=9.0))
    assert free is not None and free.gear == 0 and free.acceleration > 0.3


def test_what_a_person_will_do_late_is_said_early(context: Context) -> None:
    """Given the road with a lower limit at 1,200 m, then who acts 0.8 s late is told to ease off, to roll and to brake
    0.8 s sooner: in the mean over these (the grid moves each a little) and over when in the second is replanned."""
    levels = (-0.05, -0.2, -0.3, -0.6)
    begun: dict[float, list[float]] = {0.0: [], 0.8: []}
    for phase, delay in product(range(10), begun):
        advisor = advisors.make("pontryagin", replace(context, delay=delay))
        advisor.reset()
        left = list(levels)
        for k in range(phase, 300):
            place = 900.0 + 1.35 * k
            told = advisor.advise(view(time=60.0 + 0.1 * k, distance=place, destination_distance=1990.0 - place))
            while left and (told is None or told.acceleration < left[0]):
                begun[delay].append(place)
                left.pop(0)
    assert len(begun[0.0]) == len(begun[0.8]) == 10 * len(levels)
    assert np.mean(begun[0.0]) - np.mean(begun[0.8]) == pytest.approx(0.8 * 13.5, abs=6.0)


def test_dearer_time_asks_for_a_stronger_launch(context: Context) -> None:
    told = []
    for price in (1_000.0, 60_000.0):
        advisor = advisors.make("acceleration", replace(context, time_value=price))
        advisor.reset()
        told.append(advisor.advise(view(distance=100.0, speed=8.0, gear=2)))
    assert told[0] is not None and told[1] is not None
    assert told[1].acceleration >= told[0].acceleration > 0.5
