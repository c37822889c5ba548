"""The league: the form of its tracked file, its page, and a short play."""

import json

import numpy as np
import pytest

from benchmarks.drives import Saved
from benchmarks.league import CASES, FILE, FILTERS, PAGE, page, play, share, standing
from sensors.settings import BoxSettings
from vehicle_model.car.files import read_car
from vehicle_model.car.route import Route
from vehicle_model.plant.cycle import Cycle, read_cycle, run_cycle


@pytest.fixture(scope="module")
def kept() -> dict:
    return json.loads(FILE.read_text())


def test_every_filter_in_the_file_met_every_fault(kept):
    assert set(kept) <= set(FILTERS)
    for found in kept.values():
        assert list(found["faults"]) == list(CASES)
        for row in found["faults"].values():
            assert row["cost"] > 0.0
            assert row["thrust"] is None or row["low"] <= row["thrust"] <= row["high"]


def test_the_page_is_made_of_the_file(kept):
    assert PAGE.read_text() == page(kept)


def test_share_is_the_root_of_the_ratio_of_squares():
    block = np.repeat(np.arange(5.0), 20)
    found = share([(np.full(100, 4.0), np.full(100, 100.0), block)])
    assert found == {"thrust": pytest.approx(0.2), "low": pytest.approx(0.2), "high": pytest.approx(0.2)}
    assert share([(np.full(100, np.nan), np.full(100, 100.0), block)])["thrust"] is None


@pytest.fixture(scope="module")
def short_drive() -> Saved:
    car, cycle = read_car("smart"), read_cycle("UDDS")
    keep = cycle.time <= 130.0
    trip, _ = run_cycle(car, Cycle("short", cycle.time[keep], cycle.speed[keep], np.zeros(int(keep.sum()))))
    c = trip.channels
    s = np.arange(0.0, c["distance"][-1], 1.0)
    names = ("north", "east", "altitude", "heading", "pitch", "straightness", "vertical_straightness", "speed_limit")
    moving = np.concatenate([[True], np.diff(c["distance"]) > 0.0])
    shape = (np.interp(s, c["distance"][moving], c[name][moving]) for name in names)
    route = Route(s, *shape, np.zeros(len(s), np.int8), trip.origin)
    return Saved("short", 0, trip, route, car, BoxSettings())


def test_standstill_put_in_moves_nothing(short_drive):
    longer = standing(short_drive.trip, 60.0)
    assert longer.duration == pytest.approx(short_drive.trip.duration + 60.0)
    assert longer.channels["distance"][-1] == short_drive.trip.channels["distance"][-1]
    assert (np.diff(longer.channels["time"]) > 0.0).all()
    assert (np.diff(longer.channels["fuel_energy"]) >= 0.0).all()


def test_a_short_play_gives_errors_and_costs(short_drive, monkeypatch):
    monkeypatch.setattr("benchmarks.league.saved_drive", lambda *arguments: short_drive)
    found = play(["default observer, live", "CD-EKF"], ["GPS jumps 500 m"], [0], FILE.parent)
    ours, reference = (found[name]["GPS jumps 500 m"] for name in ("default observer, live", "CD-EKF"))
    assert ours["thrust"] < 0.2
    assert reference["thrust"] is not None
    assert ours["cost"] < reference["cost"] or ours["thrust"] < reference["thrust"]
