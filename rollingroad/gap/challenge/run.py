"""Diagnose every case of a blind set. The folder of the key is never entered here.

Cases are units of the evaluation's engine: on this machine's cores or a Dask cluster, kept in DIR/store by content, so
that what was done with this code is not done again and a case that dies leaves the others alone.
"""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rollingroad.evaluation.engine import Outcome, run_units
from rollingroad.evaluation.store import Store, Unit
from rollingroad.gap.challenge.kept import write_evidence
from rollingroad.gap.diagnose import investigate
from rollingroad.gap.result import as_json
from vehicle_model.car.errors import BadInput

UNIT = "rollingroad.gap.challenge.run:diagnose_case"


def run(
    folder: Path,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    keep: bool = False,
    tell: Callable[[str], None] = lambda text: None,
) -> tuple[list[dict[str, Any]], list[str]]:
    """Write `result.json` into each case of `folder`; return the results and a line for each case that failed.

    `workers` processes (0: none but this one) or the Dask scheduler at `cluster`. `keep` also writes what thresholds
    are chosen from (`kept.py`). Raises BadInput where `folder` is no blind set.
    """
    try:
        manifest = json.loads((folder / "manifest.json").read_text())
    except (OSError, ValueError) as error:
        raise BadInput(folder, "manifest.json", "a set made by `challenge make`") from error
    cases = manifest["cases"]
    units = [
        Unit(UNIT, {
            "folder": str((folder / row["case"]).resolve()), "hide": row["hide"], "keep": keep,
            "set": manifest["key_sha256"],
        })
        for row in cases
    ]  # fmt: skip
    done = [0]

    def count(_: Outcome) -> None:
        done[0] += 1
        tell(f"{done[0]} of {len(units)} cases diagnosed")

    outcomes = run_units(units, Store(folder / "store"), workers=workers, cluster=cluster, done=count)
    results, failed = [], []
    for row, outcome in zip(cases, outcomes, strict=True):
        if outcome.result is None:
            failed.append(f"{row['case']}: {outcome.error}")
            continue
        results.append(outcome.result)
        out = folder / row["case"] / "result.json"
        aside = out.with_name("result.json.part")
        aside.write_text(json.dumps(outcome.result))
        aside.replace(out)
    return results, failed


def diagnose_case(folder: str, hide: list[str], keep: bool, set: str) -> dict[str, Any]:
    """One case: the object of `diagnose --json` and what scoring needs besides. `set` is part of its address only."""
    place = Path(folder)
    start = time.perf_counter()
    found = investigate(place / "car.xml", place / "logs", place / "reference", None, tuple(hide))
    if keep:
        write_evidence(place, found.reduced, found.layout, hide)
    return as_json(found) | {
        "case": place.name, "hide": hide, "wall_s": time.perf_counter() - start,
        "per_trip": [list(row) for row in found.shrinkage.per_trip], "after_by_effect": found.shrinkage.after_by_effect,
        "detected_after_km": found.detected_after_km, "control": found.control,
    }  # fmt: skip
