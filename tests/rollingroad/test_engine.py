"""Given units of work of which some die, hang or fail, the rest completes and nothing is lost or computed twice."""

import errno
from dataclasses import dataclass
from pathlib import Path

import pytest

from rollingroad.evaluation.engine import run_units
from rollingroad.evaluation.store import Store, Unit
from vehicle_model.car.errors import BadInput

UNITS = "tests.rollingroad.units"


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> None:
    root = str(Path(__file__).parents[2])
    monkeypatch.syspath_prepend(root)  # spawned children inherit sys.path


def squares(count: int) -> list[Unit]:
    return [Unit(f"{UNITS}:square", {"x": x}) for x in range(count)]


def test_a_killed_a_hung_and_a_failing_unit_are_told_and_the_rest_completes(tmp_path: Path) -> None:
    units = [*squares(4), *(Unit(f"{UNITS}:{name}", {}) for name in ("die", "hang", "fail"))]
    outcomes = run_units(units, Store(tmp_path), workers=2, timeout=3.0)
    assert [outcome.result for outcome in outcomes[:4]] == [{"square": x * x} for x in range(4)]
    died, hung, failed = (outcome.error or "" for outcome in outcomes[4:])
    assert "died" in died and "longer than 3 s" in hung and "no route between the ends" in failed
    assert "units.py" in outcomes[6].log


def test_a_second_invocation_computes_only_what_is_missing(tmp_path: Path) -> None:
    run_units(squares(2), Store(tmp_path), workers=0)
    outcomes = run_units(squares(4), Store(tmp_path), workers=0)
    assert [outcome.computed for outcome in outcomes] == [False, False, True, True]


def test_the_same_answers_without_dask_with_one_and_with_two_processes(tmp_path: Path) -> None:
    answers = [
        [outcome.result for outcome in run_units(squares(5), Store(tmp_path / str(workers)), workers=workers)]
        for workers in (0, 1, 2)
    ]
    assert answers[0] == answers[1] == answers[2] == [{"square": x * x} for x in range(5)]


def test_a_damaged_result_file_is_computed_again(tmp_path: Path) -> None:
    store, (unit,) = Store(tmp_path), squares(1)
    run_units([unit], store, workers=0)
    store.path(unit).write_text('{"result": {"squ')
    assert run_units([unit], store, workers=0)[0].computed
    assert store.read(unit) == {"square": 0}


def test_a_full_disk_is_told_loses_no_answer_and_leaves_nothing_half_written(tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class FullDisk(Store):
        def write(self, unit, result):
            raise OSError(errno.ENOSPC, "No space left on device")

    (outcome,) = run_units(squares(1), FullDisk(tmp_path), workers=0)
    assert outcome.result == {"square": 0}
    assert outcome.error == "computed, but not kept: No space left on device"
    assert not list(tmp_path.rglob("*"))


def test_other_arguments_have_another_address() -> None:
    assert Unit("m:f", {"seed": 1}).key != Unit("m:f", {"seed": 2}).key
    assert Unit("m:f", {"a": 1, "b": 2}).key == Unit("m:f", {"b": 2, "a": 1}).key


def test_a_scheduler_that_does_not_answer_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="Dask scheduler"):
        run_units(squares(1), Store(tmp_path), cluster="tcp://127.0.0.1:1")
