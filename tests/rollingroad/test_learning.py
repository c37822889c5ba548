"""The learning loop: each trip is driven with what the trips before it taught."""

from collections.abc import Callable

import pytest

import rollingroad.evaluation.learning as learning
from rollingroad.task import make_task


def test_each_trip_is_advised_by_the_map_of_the_trips_before_and_the_map_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two trips through the town: the first without advice, the second with it; the map holds both."""
    drives, maps = [], []
    drive, found = learning.drive, learning.map_found

    def watched(*args: object, **more: object) -> object:
        drives.append((args[2], more["advisor"]))
        return drive(*args, **more)  # type: ignore[arg-type]

    def counted(estimates: list, car: object) -> object:
        maps.append(len(estimates))
        return found(estimates, car)  # type: ignore[arg-type]

    monkeypatch.setattr(learning, "drive", watched)
    monkeypatch.setattr(learning, "map_found", counted)
    lessons, price = learning.learning_curve(make_task("town", seed=40), 2)
    assert [seed for seed, _ in drives] == [40, 41] and maps == [1, 2]
    assert drives[0][1] is None and drives[1][1] is not None
    assert [lesson.trips for lesson in lessons] == [1, 2] and price >= 100.0
    assert all(0.2 < lesson.fuel_share < 1.0 for lesson in lessons)
    assert all(lesson.regret == lesson.estimation + lesson.fit for lesson in lessons)


def test_a_true_map_would_lose_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Given an observer that finds the true map, when it is judged, then nothing is lost to it."""
    from dataclasses import replace

    from sim.truth import true_fuel_map

    task = make_task("town", seed=40)
    truth = true_fuel_map(task.car, task.plant_settings)

    def perfect(was: Callable) -> Callable:
        return lambda *args: replace(was(*args), fuel_map=truth)

    monkeypatch.setattr(learning, "map_found", perfect(learning.map_found))
    monkeypatch.setattr(learning, "map_of_the_truth", perfect(learning.map_of_the_truth))
    (lesson,), _ = learning.learning_curve(task, 1)
    assert lesson.estimation == pytest.approx(0.0, abs=1e-9) and lesson.fit == pytest.approx(0.0, abs=1e-9)
