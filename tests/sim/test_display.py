"""What a human is shown: few changes, never late to lift off; what looking costs; and the warning of the car ahead."""

import numpy as np
import pytest

from scenarios import files
from sim.advisor import Suggestion, View
from sim.caution import WALKING, WARNED_TIME, warned
from sim.display import ARROW_DWELL, BRAKING, GEAR_DWELL, URGENT, Display
from sim.drive import drive
from sim.network import Network
from vehicle_model.car.parameters import Car


def shown(display: Display, accelerations: list[float], gears: list[int]) -> list[Suggestion]:
    found = [display.show(Suggestion(a, g)) for a, g in zip(accelerations, gears, strict=True)]
    assert all(suggestion is not None for suggestion in found)
    return found  # type: ignore[return-value]


def test_advice_that_swings_every_second_changes_the_display_at_most_once_per_dwell() -> None:
    """Two minutes of a plan between 0.05 and 0.45 m/s2 and between 4th and 5th gear, another every second."""
    display = Display(0.1)
    swing = [(0.45, 4) if k // 10 % 2 else (0.05, 5) for k in range(1200)]
    shown(display, [a for a, _ in swing], [g for _, g in swing])
    assert display.changes <= 120.0 / ARROW_DWELL + 120.0 / GEAR_DWELL


def test_steady_advice_is_shown_once_and_unaltered() -> None:
    display = Display(0.1)
    found = shown(display, [0.8] * 50, [3] * 50)
    assert display.changes == 0 and all(s == Suggestion(0.8, 3) for s in found)


def test_what_is_urgent_is_shown_at_once_gentle_acceleration_waits() -> None:
    display = Display(0.1)
    shown(display, [0.8] * 5, [3] * 5)
    (lift,) = shown(display, [-0.9], [3])
    assert lift.acceleration == -0.9
    gentle = URGENT - 0.1
    assert all(s.acceleration <= 0.0 for s in shown(display, [gentle] * 20, [3] * 20)), (
        "the arrow stays down for a while"
    )
    assert shown(display, [gentle] * 60, [3] * 60)[-1].acceleration == gentle
    shown(display, [-0.9], [3])
    (out_of_the_bend,) = shown(display, [0.8], [3])
    assert out_of_the_bend.acceleration == 0.8


def test_a_display_that_lights_up_again_is_looked_at_again() -> None:
    """Given silence in between, then the same advice costs a second look: silence is no free change of mind."""
    display = Display(0.1)
    shown(display, [0.8] * 20, [3] * 20)
    assert display.show(None) is None and display.changes == 0
    shown(display, [0.8] * 20, [3] * 20)
    assert display.changes == 1


def test_slowing_down_a_higher_gear_is_shown_at_once_a_lower_one_is_left_to_him() -> None:
    """Given third gear while he pulled, then off the throttle its drag would brake: sixth comes with the next step."""
    display = Display(0.1)
    shown(display, [0.8] * 60, [3] * 60)
    assert [s.gear for s in shown(display, [-0.9] * 3, [3, 6, 6])] == [3, 6, 6]
    assert [s.gear for s in shown(display, [-0.9] * 20, [4] * 20)] == [6] * 20


def test_what_is_acted_upon_never_contradicts_the_arrow() -> None:
    rng = np.random.default_rng(1)
    display = Display(0.1)
    for a in np.cumsum(rng.normal(0.0, 0.1, 3000)) % 3.0 - 1.5:
        told = display.show(Suggestion(float(a), 4, coast=a < -0.4))
        assert told is not None
        assert np.sign(told.acceleration) in (0, np.sign(a))
        assert a > -0.5 or told.acceleration == a, "braking is passed on as it is"


def test_an_arrow_makes_nobody_brake_hard() -> None:
    """Given a plan that asks for an emergency braking, then the arrow says: down. What is urgent, the road shows."""
    (braking,) = shown(Display(0.1), [-4.2], [3])
    assert braking.acceleration == -BRAKING


def test_the_gear_on_show_rests_while_slowing_down() -> None:
    display = Display(0.1)
    shown(display, [-1.0] * 10, [5] * 10)
    assert {s.gear for s in shown(display, [-1.0] * 100, [4] * 30 + [3] * 30 + [2] * 40)} == {5}


@pytest.mark.parametrize("leader", [0.0, 5.0])
@pytest.mark.parametrize("speed", [8.0, 14.0, 30.0])
def test_who_heeds_the_warning_keeps_the_time_to_collision(leader: float, speed: float) -> None:
    """A point that does nothing but what the warning allows, from 250 m behind a car at constant speed, until it
    closes in at walking pace: the rest is his own car following."""
    gap, shortest = 250.0, np.inf
    while speed - leader > WALKING + 0.01:
        shortest = min(shortest, (gap + 2.0) / (speed - leader))
        speed += 0.1 * min(warned(speed, gap, leader), 0.0)
        gap -= 0.1 * (speed - leader)
        assert gap > 0.0
    assert WARNED_TIME - 0.15 < shortest < np.inf


class Dance:
    """Another arrow every six seconds."""

    def reset(self) -> None: ...

    def advise(self, view: View) -> Suggestion | None:
        return Suggestion(0.4 if view.time % 12.0 < 6.0 else -0.6, 4) if view.distance > 50.0 else None


def test_looking_at_the_display_takes_the_eyes_off_the_road_and_is_measured(car: Car, mixed: Network) -> None:
    scenario = files.load("mixed")
    shares = []
    for glance in (0.0, 1.5):
        driver = scenario.driver.model_copy(update={"glance": glance, "refusal": 0.0})
        done = drive(scenario.model_copy(update={"driver": driver}), car, 3, advisor=Dance(), network=mixed)
        assert done.collisions == 0 and done.limit_violations == 0 and done.red_lights_run == 0
        shares.append(done.compliance.eyes_off_road_share)
        assert 5.0 < done.compliance.changes_per_minute < 12.0
    assert shares[0] == 0.0 and 0.1 < shares[1] < 0.3
