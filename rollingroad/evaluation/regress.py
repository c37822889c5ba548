"""The regression suite: every scenario's metrics against those that were accepted last, within tolerances."""

import json
import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rollingroad.evaluation.engine import run_units
from rollingroad.evaluation.store import Store, Unit
from rollingroad.folder import write_json
from rollingroad.json_form import plain
from scenarios.files import names
from vehicle_model.car.errors import BadInput

RUN = "rollingroad.evaluation.regress_runs:regression_run"
FOLDER = Path(str(resources.files("scenarios"))) / "baselines"
"""More scenarios (`*.toml`), what was accepted (`*.json`) and the tolerances (`suite.toml`)."""


class Tolerance(BaseModel):
    """How far a metric may move from its baseline."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    absolute: float = Field(0.0, ge=0.0)
    relative: float = Field(0.0, ge=0.0)
    worse: Literal["up", "down", "both"] = "both"
    because: str = Field(min_length=10)

    def around(self, baseline: float) -> float:
        """The tolerance in the metric's unit."""
        return self.absolute + self.relative * abs(baseline)

    def fell_short(self, was: float, now: float) -> bool:
        """Whether `now` is beyond the tolerance in a direction that is worse."""
        moved = now - was
        if (self.worse == "up" and moved < 0.0) or (self.worse == "down" and moved > 0.0):
            return False
        return abs(moved) > self.around(was)


class Suite(BaseModel):
    """`suite.toml`."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    short: tuple[str, ...]
    metrics: dict[str, Tolerance]


@dataclass(frozen=True)
class Difference:
    """One metric of one scenario. `was` None: never accepted; `now` None: could not be had."""

    scenario: str
    metric: str
    was: float | None
    now: float | None
    tolerance: float | None
    fell_short: bool


def read_suite(folder: Path = FOLDER) -> Suite:
    """Read `suite.toml` in `folder`. Raises BadInput."""
    path = folder / "suite.toml"
    try:
        return Suite.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise BadInput(path, "", "expected the suite's tolerances, but there is no such file") from None
    except tomllib.TOMLDecodeError as error:
        raise BadInput(path, "", f"expected TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        raise BadInput(path, ".".join(str(part) for part in first["loc"]), first["msg"]) from None


def suite_scenarios(folder: Path = FOLDER) -> dict[str, str]:
    """Every scenario of the suite, by name: the shipped ones and the files in `folder`; what `load` takes."""
    files = {path.stem: str(path) for path in sorted(folder.glob("*.toml")) if path.name != "suite.toml"}
    return {name: name for name in names()} | files


def measure(
    chosen: Mapping[str, str],
    store: Store,
    *,
    workers: int | None = None,
    run: str = RUN,
    tell: Callable[[str], None] = lambda text: None,
) -> dict[str, dict[str, Any]]:
    """Run the `chosen` scenarios; by name what `regression_run` returns, or `error` where it failed."""
    done = [0]

    def count(_: Any) -> None:
        done[0] += 1
        tell(f"{done[0]} of {len(chosen)} scenarios done")

    units = [Unit(run, {"scenario": scenario}) for scenario in chosen.values()]
    outcomes = run_units(units, store, workers=workers, done=count)
    return {
        name: {"metrics": {}, "broken": [], "error": outcome.error} if outcome.result is None else outcome.result
        for name, outcome in zip(chosen, outcomes, strict=True)
    }


def accept(found: Mapping[str, Mapping[str, Any]], folder: Path = FOLDER) -> None:
    """Make what was found the baselines: one JSON file a scenario. Raises BadInput for one that failed."""
    for name, result in found.items():
        if result.get("error"):
            raise BadInput(name, "", f"cannot be accepted: {result['error']}")
    for name, result in found.items():
        write_json(folder / f"{name}.json", {"metrics": plain(result["metrics"])})


def differences(found: Mapping[str, Mapping[str, Any]], suite: Suite, folder: Path = FOLDER) -> list[Difference]:
    """Every metric of every scenario beside its baseline, and the broken expectations. Raises BadInput."""
    return [row for name, result in found.items() for row in _of(name, result, suite, folder)]


def _of(name: str, result: Mapping[str, Any], suite: Suite, folder: Path) -> Iterator[Difference]:
    if result.get("error"):
        yield Difference(name, f"ran ({result['error']})", 1.0, 0.0, 0.0, True)
        return
    for row in result["broken"]:
        yield Difference(name, row["metric"], row["was"], row["is"], 0.0, True)
    path = folder / f"{name}.json"
    try:
        before = json.loads(path.read_text())["metrics"]
    except FileNotFoundError:
        yield Difference(name, "baseline (--accept makes it)", None, None, None, True)
        return
    except (ValueError, KeyError, TypeError):
        raise BadInput(path, "metrics", "expected what `rollingroad regress --accept` writes") from None
    for metric in dict.fromkeys([*before, *result["metrics"]]):
        was, now = _number(before.get(metric)), _number(result["metrics"].get(metric))
        allowed = suite.metrics.get(metric)
        if allowed is None:
            raise BadInput(folder / "suite.toml", f"metrics.{metric}", "expected its tolerance and the reason for it")
        if was is None or now is None:
            yield Difference(name, metric, was, now, None, was is not now)
        else:
            yield Difference(name, metric, was, now, allowed.around(was), allowed.fell_short(was, now))


def worth_recording(rows: Sequence[Difference]) -> list[str]:
    """Scenarios in which a figure fell short: not those that could not run, or were never accepted."""
    return list(dict.fromkeys(row.scenario for row in rows if row.fell_short and row.was is not None and row.now))


def as_json(rows: Sequence[Difference], scenarios: int) -> dict[str, Any]:
    """The object of `regress --json`."""
    return {
        "scenarios": scenarios,
        "fell_short": [
            {"scenario": row.scenario, "metric": row.metric, "was": row.was, "is": row.now, "tolerance": row.tolerance}
            for row in rows
            if row.fell_short
        ],
    }


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
