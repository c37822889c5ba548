"""Diagnose every case of a blind set. The key is never opened here."""

import json
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from rollingroad.gap.diagnose import investigate
from rollingroad.gap.result import as_json
from vehicle_model.car.errors import BadInput


def run(folder: Path, *, workers: int = 2, keep: bool = False) -> list[dict[str, Any]]:
    """Write `result.json` into each case of `folder` and return the results. `keep` also pickles what thresholds are
    chosen from. Cases that have a result already are not done again. Raises BadInput where `folder` is no blind set."""
    try:
        manifest = json.loads((folder / "manifest.json").read_text())
    except (OSError, ValueError) as error:
        raise BadInput(folder, "manifest.json", "a set made by `challenge make`") from error
    jobs = [(folder, row["case"], tuple(row["hide"]), keep) for row in manifest["cases"]]
    if workers <= 1:
        return [_one(job) for job in jobs]
    with ProcessPoolExecutor(workers) as pool:
        return list(pool.map(_one, jobs))


def _one(job: tuple[Path, str, tuple[str, ...], bool]) -> dict[str, Any]:
    folder, case, hide, keep = job
    place = folder / case
    out = place / "result.json"
    if out.exists():
        return json.loads(out.read_text())
    start = time.perf_counter()
    found = investigate(place / "car.xml", place / "logs", place / "reference", None, hide)
    result = as_json(found) | {
        "case": case, "hide": list(hide), "wall_s": time.perf_counter() - start,
        "per_trip": [list(row) for row in found.shrinkage.per_trip], "after_by_effect": found.shrinkage.after_by_effect,
        "detected_after_km": found.detected_after_km, "control": found.control,
    }  # fmt: skip
    if keep:
        import pickle

        (place / "reduced.pickle").write_bytes(
            pickle.dumps((found.reduced, found.layout, found.calibration.dispersion, hide, found.calibration.noise))
        )
    aside = out.with_name("result.json.part")
    aside.write_text(json.dumps(result))
    aside.replace(out)
    return result
