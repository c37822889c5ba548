"""Given baselines and tolerances, then what moved too far in a direction that is worse falls short; no more."""

from pathlib import Path
from typing import Any

import pytest

from rollingroad.evaluation import regress
from rollingroad.evaluation.regress import Suite, Tolerance
from rollingroad.evaluation.regress_runs import broken
from rollingroad.evaluation.store import Store
from scenarios.files import load
from scenarios.schema import Expectations
from vehicle_model.car.errors import BadInput

WHY = "because the test says so"
SUITE = Suite(
    short=("a",),
    metrics={
        "error": Tolerance(absolute=0.1, relative=0.05, worse="up", because=WHY),
        "share": Tolerance(absolute=0.1, worse="down", because=WHY),
        "time": Tolerance(relative=0.1, because=WHY),
    },
)


def run(**metrics: float | None) -> dict[str, Any]:
    return {"metrics": metrics, "broken": []}


def short_of(tmp_path: Path, was: dict[str, Any], now: dict[str, Any]) -> list[str]:
    regress.accept({"a": was}, tmp_path)
    return [row.metric for row in regress.differences({"a": now}, SUITE, tmp_path) if row.fell_short]


def test_only_what_is_worse_falls_short_where_one_direction_is_better(tmp_path: Path) -> None:
    was = run(error=2.0, share=0.8, time=100.0)
    assert short_of(tmp_path, was, run(error=2.19, share=0.71, time=109.0)) == []
    assert short_of(tmp_path, was, run(error=2.21, share=0.69, time=111.0)) == ["error", "share", "time"]
    assert short_of(tmp_path, was, run(error=0.1, share=1.0, time=89.0)) == ["time"], "better is fine, another time not"


def test_a_figure_that_is_lost_or_was_never_accepted_falls_short(tmp_path: Path) -> None:
    assert short_of(tmp_path, run(error=1.0), run(error=None)) == ["error"]
    assert short_of(tmp_path, run(error=None), run(error=None)) == []
    rows = regress.differences({"b": run(error=1.0)}, SUITE, tmp_path)
    assert [(row.metric, row.fell_short) for row in rows] == [("baseline (--accept makes it)", True)]
    assert regress.worth_recording(rows) == []


def test_a_scenario_that_fails_falls_short_and_cannot_be_accepted(tmp_path: Path) -> None:
    failed = {"a": {"metrics": {}, "broken": [], "error": "no way"}}
    (row,) = regress.differences(failed, SUITE, tmp_path)
    assert row.fell_short and "no way" in row.metric
    with pytest.raises(BadInput, match="cannot be accepted"):
        regress.accept(failed, tmp_path)
    assert not list(tmp_path.iterdir())


def test_json_has_what_programs_rely_on(tmp_path: Path) -> None:
    regress.accept({"a": run(time=100.0)}, tmp_path)
    rows = regress.differences({"a": run(time=150.0)}, SUITE, tmp_path)
    assert regress.as_json(rows, 1) == {
        "scenarios": 1,
        "fell_short": [{"scenario": "a", "metric": "time", "was": 100.0, "is": 150.0, "tolerance": 10.0}],
    }
    assert regress.worth_recording(rows) == ["a"]


def test_expectations_of_the_scenario_file_are_held(tmp_path: Path) -> None:
    expected = Expectations(time_s=(100.0, 200.0), map_rmse=0.01, map_fuel_share=0.5)
    assert broken(expected, {"time_s": 150.0, "map_rmse": 0.005, "map_fuel_share": 0.6}) == []
    missed = broken(expected, {"time_s": 90.0, "map_rmse": 0.02, "map_fuel_share": None})
    assert [(row["metric"], row["was"]) for row in missed] == [
        ("expected time_s", 100.0), ("expected map_rmse", 0.01), ("expected map_fuel_share", 0.5)
    ]  # fmt: skip


def test_the_suite_has_thirty_scenarios_that_load_both_cars_and_a_reason_for_every_tolerance() -> None:
    suite, scenarios = regress.read_suite(), regress.suite_scenarios()
    read = [load(scenario) for scenario in scenarios.values()]
    assert len(scenarios) >= 30 and {s.car for s in read} >= {"smart", "peugeot"}
    assert any(s.sensors.faults for s in read) and any(s.effects for s in read)
    assert set(suite.short) <= set(scenarios)
    assert all(rule.absolute + rule.relative > 0.0 for rule in suite.metrics.values())


def test_a_damaged_suite_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "suite.toml").write_text('short = []\n[metrics.time_s]\nrelative = -1.0\nbecause = "long enough"\n')
    with pytest.raises(BadInput, match=r"metrics\.time_s\.relative"):
        regress.read_suite(tmp_path)


def test_one_short_scenario_runs_and_gives_every_metric_that_has_a_tolerance(tmp_path: Path) -> None:
    """The shortest of the suite, in this process."""
    name = "effect_accessories"
    found = regress.measure({name: regress.suite_scenarios()[name]}, Store(tmp_path), workers=0)[name]
    assert "error" not in found
    assert set(found["metrics"]) == set(regress.read_suite().metrics)
    assert 0.0 < found["metrics"]["thrust_error"] < 0.5
    assert found["metrics"]["advised_fuel_MJ"] > 0.0
