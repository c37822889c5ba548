"""Signals that tell when they turn: what is told is what happens, and what is made of it is to arrive at green."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controller.advice import RoadAhead
from scenarios import files
from sim import advisors
from sim.advisor import Context, View
from sim.drive import journey
from sim.network import build
from sim.signal_timing import AFTER, SLOWEST, slower
from sim.truth import true_fuel_map
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car


@pytest.fixture(scope="module")
def context(car: Car) -> Context:
    """2 km flat at 50 km/h."""
    s = np.arange(0.0, 2000.0, 5.0)
    return Context(RoadAhead(s, 0.0 * s, np.full(len(s), 50.0 / 3.6), 0.0 * s), true_fuel_map(car), car, 20e3)


def _arrival(context: Context, green: tuple[tuple[float, float], ...], *, tells: bool = True) -> tuple[float, float]:
    """Time (s) and speed (m/s) at which a car that does exactly as advised passes a signal 400 m ahead."""
    advisor = advisors.make("pontryagin", context)
    advisor.reset()
    time, place, speed, line = 0.0, 200.0, 13.0, 600.0
    while place < line and time < 200.0:
        lit = any(start <= time < end for start, end in green)
        told = tuple((max(start - time, 0.0), end - time) for start, end in green if end > time)
        near = line - place < 150.0
        told_view = View(
            time, place, speed, 5, np.inf, np.nan, line - place if near else np.inf,
            ("green" if lit else "red") if near else "", 1700.0 - place,
            *((line - place, told) if tells else (np.inf, ())),
        )  # fmt: skip
        suggestion = advisor.advise(told_view)
        speed = max(speed + 0.1 * (suggestion.acceleration if suggestion is not None else 0.0), 0.3)
        place, time = place + 0.1 * speed, time + 0.1
    return time, speed


@pytest.mark.parametrize("opens", [36.0, 42.0, 50.0])
def test_who_would_come_to_a_red_light_comes_later_and_moving(context: Context, opens: float) -> None:
    """Given a signal that turns green later than one would be there, then he is there just after, without a stop."""
    time, speed = _arrival(context, ((opens, opens + 30.0),))
    assert opens + 1.0 < time < opens + AFTER + 2.0
    assert speed > SLOWEST


def test_a_green_that_is_about_to_end_is_caught_by_hurrying(context: Context) -> None:
    """Given a green that ends just before one would be there unhurried, then he hurries and passes in it."""
    unhurried, _ = _arrival(replace(context, time_value=500.0), ((0.0, 500.0),))
    caught, _ = _arrival(replace(context, time_value=500.0), ((0.0, unhurried - 0.5), (unhurried + 40.0, 400.0)))
    assert caught < unhurried - 0.5


def test_a_green_out_of_reach_is_let_go(context: Context) -> None:
    time, speed = _arrival(context, ((0.0, 15.0), (45.0, 80.0)))
    assert 45.0 < time < 52.0 and speed > SLOWEST


def test_slowing_down_and_holding_covers_the_distance_in_the_time() -> None:
    """Oracle: the sum of the two parts of the motion, stepped."""
    for speed, distance, seconds in ((14.0, 400.0, 40.0), (20.0, 300.0, 25.0), (12.0, 150.0, 15.0)):
        found = slower(speed, distance, seconds)
        assert found is not None
        target, braking = found
        place, now = 0.0, speed
        for _ in range(round(seconds / 0.001)):
            now = max(now - 0.001 * braking, target)
            place += 0.001 * now
        assert place == pytest.approx(distance, rel=2e-3)
    assert slower(10.0, 300.0, 20.0) == (np.inf, 0.0)
    assert slower(14.0, 60.0, 60.0) is None


def test_what_a_signal_tells_is_what_it_shows(tmp_path: Path, car: Car) -> None:
    """Given a town whose signals tell, then each is green at the driver's next looks exactly when it had said so."""
    town = files.load("town")
    traffic = town.traffic.model_copy(update={"vehicles": 0, "signals_tell": 600.0})
    town = town.model_copy(update={"traffic": traffic})
    steps = journey(town, car, 3, network=build(town, tmp_path))
    first: View | None = None
    checked = {"green": 0, "not": 0}
    for view, _ in steps:
        line = view.distance + view.told_distance
        if first is None or abs(line - (first.distance + first.told_distance)) > 5.0:
            first = view
            if not np.isfinite(view.told_distance):
                first = None
            continue
        if view.signal_state and abs(view.signal_distance - view.told_distance) < 1e-6:
            passed = view.time - first.time
            if any(abs(passed - edge) < 0.15 for window in first.told_green for edge in window):
                continue
            said = any(start <= passed < end for start, end in first.told_green)
            assert said == (view.signal_state == "green"), view
            checked["green" if said else "not"] += 1
        if view.time > 200.0:
            break
    steps.close()
    assert checked["green"] > 50 and checked["not"] > 50


def test_signals_that_do_not_tell_say_nothing(tmp_path: Path, car: Car) -> None:
    town = files.load("town")
    steps = journey(town, car, 3, network=build(town, tmp_path))
    for view, _ in steps:
        assert view.told_green == () and view.told_distance == np.inf
        if view.time > 60.0:
            break
    steps.close()


def test_a_reach_that_cannot_be_is_refused() -> None:
    from rollingroad.task import make_task, telling

    assert telling(make_task("town"), 300.0).scenario.traffic.signals_tell == 300.0
    with pytest.raises(BadInput, match="--signals-tell"):
        telling(make_task("town"), -1.0)
