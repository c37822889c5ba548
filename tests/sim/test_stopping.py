"""A light that turns: who can stop stops, evenly; who cannot drives through while it is yellow."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from sim.caution import STOP_SHORT, must_stop, safe_wish
from sim.drive_record import HARSH
from sim.drivers import ADVISED_ACCELERATION, STYLES
from sim.traffic import PERIOD

YELLOW = {50.0: 3.0, 70.0: 5.0, 80.0: 5.0}
"""s of the yellow phases of the road that ships, by limit, km/h."""


def overzealous(speed: float, gap: float, acceleration: float) -> float:
    """The IDM in front of a standing obstacle: it brakes by the square of what is needed."""
    wished = speed * 1.3 + speed**2 / (2.0 * math.sqrt(acceleration * 2.0))
    return max(speed - PERIOD * acceleration * (wished / max(gap, 0.1)) ** 2, 0.0)


@pytest.mark.parametrize("style", ["good", "eidm", "soft"])
@pytest.mark.parametrize("limit", list(YELLOW))
def test_a_yellow_light_is_obeyed_without_harsh_braking_or_passed_before_it_is_red(limit: float, style: str) -> None:
    """Given a light that turns yellow at any distance, when the limit is driven, then nobody brakes harshly, nobody
    passes a red light, and who stops does so before the line."""
    traffic = SimpleNamespace(
        released=0.0,
        stop_speed=overzealous,
        planned_acceleration=lambda: -8.0,
        may_enter=lambda reach: (True, math.inf),
    )
    outcomes = set()
    for distance in np.arange(2.0, 140.0, 1.5):
        speed, left, time, hardest, stopping = limit / 3.6, float(distance), 0.0, 0.0, False
        while left > 0.0 and (speed > 0.05 and time < 60.0):
            state = "y" if time < YELLOW[limit] else "r"
            stopping = must_stop(state, left, speed, stopping)
            wish = 0.0
            if stopping:
                wish = safe_wish(traffic, STYLES[style], speed, "", math.inf, math.nan, left, math.inf)  # type: ignore[arg-type]
            hardest = min(hardest, wish)
            moved = max(speed + wish * PERIOD, 0.0)
            left -= 0.5 * (speed + moved) * PERIOD
            speed, time = moved, time + PERIOD
        passed = left <= 0.0
        outcomes.add(passed)
        assert hardest > -HARSH, (distance, hardest)
        assert not passed or time <= YELLOW[limit], (distance, time)
        assert passed or left > STOP_SHORT - 0.7, distance
    assert outcomes == {True, False}


@pytest.mark.parametrize("leader_speed", [6.0, 10.0, 14.0])
def test_who_was_told_to_launch_harder_follows_the_car_in_front_as_ever(leader_speed: float) -> None:
    """Given a model that accelerates by what it may, when advice has released more, then he wishes what he wished."""
    wishes = []
    for released in (0.0, ADVISED_ACCELERATION):
        traffic = SimpleNamespace(
            released=released,
            follow_speed=lambda speed, gap, leader, leader_speed, acceleration: speed + PERIOD * acceleration,
            planned_acceleration=lambda: math.inf,
            may_enter=lambda reach: (True, math.inf),
        )
        wishes.append(safe_wish(traffic, STYLES["good"], 10.0, "w1", 40.0, leader_speed, math.inf, math.inf))  # type: ignore[arg-type]
    assert wishes[0] == wishes[1] == pytest.approx(STYLES["good"].acceleration)
