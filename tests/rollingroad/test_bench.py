"""Given benchmarks that answer, are missing or fail, then each row has its reference and no figure is made up."""

import json
from pathlib import Path

import pytest

from benchmarks.timing import least, row
from rollingroad.evaluation.bench import NAMES, Skipped, benchmarks, measure, remember


def test_a_ratio_above_one_means_faster_than_the_reference() -> None:
    assert row("observer_event", 2.0, "us", "filterpy", 200.0)["ratio"] == pytest.approx(100.0)
    assert row("plant", 5000.0, "x_real_time", "Python", 50.0)["ratio"] == pytest.approx(100.0)
    assert row("packet_read", 1.0, "MB/s", "Python", 4.0)["ratio"] == pytest.approx(0.25)


def test_what_is_missing_or_fails_is_told_and_has_no_row() -> None:
    def broken() -> list[dict]:
        raise ValueError("no card")

    fine = row("plant", 2.0, "x_real_time", "Python", 1.0)
    found, skipped = measure(("plant", "chain", "packet_read"), {"plant": lambda: [fine], "packet_read": broken})
    assert found == {"benchmarks": [fine]}
    assert skipped == [Skipped("chain", "nothing here measures it"), Skipped("packet_read", "ValueError: no card")]


def test_every_benchmark_that_programs_rely_on_is_measured() -> None:
    assert set(benchmarks()) == set(NAMES)


def test_the_packet_reader_is_measured_beside_plain_python() -> None:
    (found,) = benchmarks(modules=("plant",))["packet_read"](1)
    assert found["unit"] == "MB/s" and found["value"] > 0.0 and found["reference_value"] > 0.0


def test_the_fastest_run_counts() -> None:
    calls = []
    assert 0.0 <= least(lambda: calls.append(1), 3) < 1.0
    assert len(calls) == 3


def test_the_history_grows_by_a_line_that_names_machine_and_code(tmp_path: Path) -> None:
    history = tmp_path / "bench.jsonl"
    for value in (1.0, 2.0):
        remember({"benchmarks": [{"name": "plant", "value": value}]}, history)
    first, second = (json.loads(line) for line in history.read_text().splitlines())
    assert first["code"] == second["code"] and "cores" in first["machine"]
    assert second["benchmarks"][0]["value"] == 2.0


def test_the_growth_exponent_of_a_square_is_two() -> None:
    from benchmarks.growth import exponent

    sizes = [1.0, 10.0, 100.0, 1000.0]
    assert exponent(sizes, [3.0 * size**2 for size in sizes]) == pytest.approx(2.0)


def test_a_card_streamed_piece_by_piece_gives_the_lines_of_the_whole(tmp_path: Path) -> None:
    from benchmarks import memory
    from observer.observe import observe
    from sensors.packets import read_log
    from vehicle_model.car.files import read_car

    card = tmp_path / "card.dat"
    memory._write(card, 0.02)
    assert memory._observe(card)["hours"] == len(observe(read_log(card), read_car("smart")).time) / 36_000.0


def test_the_long_benchmarks_each_have_a_name_of_their_own() -> None:
    long = benchmarks("LONG")
    assert not set(long) & set(NAMES)
    assert {"observer_growth", "vehicles_growth", "cells_growth", "effects_growth", "memory_10h", "faults"} <= set(long)


def test_a_campaign_of_few_events_against_the_observer_fails_nowhere() -> None:
    from benchmarks.growth import fuzz_observer

    (row,) = fuzz_observer(60_000)
    assert row["value"] == 0.0 and row["reference_value"] >= 60_000
