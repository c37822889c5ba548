"""The performance benchmarks: every figure beside its reference, measured in the same process."""

import json
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from rollingroad.evaluation.store import code_fingerprint
from rollingroad.json_form import plain
from rollingroad.workers import cores

NAMES = (
    "observer_event",
    "observer_stream",
    "plant",
    "packet_read",
    "synthesis_table",
    "shooting_six_speed",
    "dp_sweep_5km",
    "route_50km",
    "chain",
    "eco_drive_env",
    "diagnose_10_trips",
    "estimator_spe",
)
"""What CLI.md names, in its order."""
MODULES = ("observer", "plant", "controller", "traffic", "diagnosis", "estimators", "growth", "memory", "scale")
"""Modules of `benchmarks` that may measure them: `BENCHMARKS`, and `LONG` for what takes long."""

Measure = Callable[[], list[dict[str, Any]]]


@dataclass(frozen=True)
class Skipped:
    """A benchmark that was not measured, and why."""

    name: str
    because: str


def benchmarks(table: str = "BENCHMARKS", modules: Sequence[str] = MODULES) -> dict[str, Measure]:
    """Every benchmark that there is, by name; `table` is that of the modules' attributes which lists them."""
    found: dict[str, Measure] = {}
    for name in modules:
        try:
            module = import_module(f"benchmarks.{name}")
        except ModuleNotFoundError as error:
            if error.name != f"benchmarks.{name}":
                raise
            continue
        found |= getattr(module, table, {})
    return found


def measure(
    names: Sequence[str] = NAMES,
    known: dict[str, Measure] | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> tuple[dict[str, Any], list[Skipped]]:
    """Measure `names` one after another. Returns the object of `bench --json` and what was skipped.

    A benchmark that fails is skipped with its error: a missing figure is told, never made up.
    """
    known = benchmarks() if known is None else known
    rows: list[dict[str, Any]] = []
    skipped: list[Skipped] = []
    for name in names:
        if name not in known:
            skipped.append(Skipped(name, "nothing here measures it"))
            continue
        tell(f"measuring {name}")
        try:
            rows += known[name]()
        except Exception as error:
            skipped.append(Skipped(name, f"{type(error).__name__}: {error}"))
    return {"benchmarks": rows}, skipped


def remember(found: dict[str, Any], history: Path) -> None:
    """Add a line to the `history`: when, on what machine, of which code, which figures."""
    line = {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": f"{platform.machine()}, {cores()} cores, Python {platform.python_version()}",
        "code": code_fingerprint()[:12],
        **found,
    }
    with history.open("a", encoding="utf-8") as file:
        file.write(json.dumps(plain(line)) + "\n")
