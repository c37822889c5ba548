"""A command over a grid of settings and seeds: `rollingroad sweep FILE.toml`, resumable like an evaluation.

    command = "run"                        # any command that has --json
    arguments = ["town", "--car", "smart"] # the same for all
    seeds = 3                              # 0, 1, 2; or a list
    timeout_s = 900

    [grid]                                 # an effect parameter is set, anything else is an option
    "head_wind.speed" = [0.0, 4.0]
    "--driver" = ["a", "b"]

Units are the command's own processes: what it prints with `--json` is the result.
"""

import hashlib
import itertools
import json
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rollingroad.catalogue import check_settings, parameters
from rollingroad.evaluation.engine import run_units
from rollingroad.evaluation.store import Store, Unit
from vehicle_model.car.errors import BadInput

UNIT = "rollingroad.evaluation.sweep:command_run"
MOST = 100_000
"""Points of a grid: more is a slip of the keyboard."""
SEEDED = ("run",)
"""Commands that take a seed."""
WRITING = ("run",)
"""Commands that write a folder, which a sweep does not keep."""

Value = Annotated[float, Field(allow_inf_nan=False)] | str
Command = Literal["run", "cycle", "dyno", "solve", "select", "evaluate", "diagnose", "inspect", "map"]


class Sweep(BaseModel):
    """A sweep file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    command: Command = Field(description="a command of rollingroad that has --json")
    arguments: tuple[str, ...] = Field((), description="arguments that all points share")
    seeds: Annotated[int, Field(ge=1)] | tuple[Annotated[int, Field(ge=0)], ...] | None = Field(
        None, description="how many, from 0, or which; only for commands that take a seed"
    )
    timeout_s: float = Field(900.0, gt=0.0)
    grid: dict[str, tuple[Value, ...]] = Field(description="values of each setting or --option")


def read_sweep(path: Path) -> Sweep:
    """Read and check a sweep file. Raises BadInput naming the place."""
    try:
        sweep = Sweep.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (FileNotFoundError, IsADirectoryError):
        raise BadInput(path, "", "expected a sweep file (TOML), but there is none") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise BadInput(path, "", f"expected TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        raise BadInput(path, ".".join(str(part) for part in first["loc"]), first["msg"]) from None
    if sweep.seeds is not None and sweep.command not in SEEDED:
        raise BadInput(path, "seeds", f"{sweep.command} takes no seed")
    known = parameters()
    for key, values in sweep.grid.items():
        if not values:
            raise BadInput(path, f"grid.{key}", "expected at least one value")
        if key.startswith("--"):
            continue
        for value in values:
            if key in known and not isinstance(value, float):
                raise BadInput(path, f"grid.{key}", f"expected numbers, not {value!r}")
            check_settings({key: value}, f"{path}: grid")  # type: ignore[dict-item]
    return sweep


def points(sweep: Sweep) -> list[dict[str, Any]]:
    """Every combination of settings and seeds, seeds fastest. Raises BadInput for too many."""
    seeds = range(sweep.seeds) if isinstance(sweep.seeds, int) else sweep.seeds
    axes = dict(sweep.grid) | ({} if seeds is None else {"seed": tuple(seeds)})
    count = 1
    for values in axes.values():
        count *= len(values)
    if count > MOST:
        raise BadInput("grid", "", f"expected at most {MOST} points, not {count}")
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


def command_line(sweep: Sweep, point: Mapping[str, Any]) -> list[str]:
    """What would be typed after `rollingroad` for one point."""
    line = [sweep.command, *sweep.arguments]
    for key, value in point.items():
        text = f"{value:.17g}" if isinstance(value, float) else str(value)
        line += (
            ["--seed", text] if key == "seed" else [key, text] if key.startswith("--") else ["--set", f"{key}={text}"]
        )
    return line


def command_run(line: list[str], files: Mapping[str, str], timeout: float) -> dict[str, Any]:
    """Run the command `line` in a process of its own; returns what it printed, and its exit `status` (0 or 1).

    `files` (digest by path) is part of the unit's address: another file there is another unit. Raises RuntimeError
    with the line that the command told, and TimeoutExpired.
    """
    with tempfile.TemporaryDirectory(prefix="sweep-") as scratch:
        more = ["--out", str(Path(scratch) / "run")] if line[0] in WRITING else []
        # Its own workers: none. The sweep's processes are the parallel ones.
        more += ["--workers", "0"] if line[0] in WRITING else []
        asked = [sys.executable, "-c", "from rollingroad.cli import main; main()", *line, "--json", *more]
        done = subprocess.run(asked, capture_output=True, text=True, timeout=timeout, check=False)
    if done.returncode not in (0, 1) or not done.stdout.strip():
        told = done.stderr.strip().splitlines()
        raise RuntimeError(told[-1] if told else f"exit status {done.returncode}")
    return {"status": done.returncode, "output": json.loads(done.stdout)}


def run_sweep(
    sweep: Sweep,
    store: Store,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Run every point that `store` does not hold. Returns `rows`, one a point in the grid's order, and `failed`."""
    wanted = points(sweep)
    units = []
    for point in wanted:
        line = command_line(sweep, point)
        files = {word: _digest(Path(word)) for word in line if Path(word).is_file()}
        units.append(Unit(UNIT, {"line": line, "files": files, "timeout": sweep.timeout_s}))
    done = [0]

    def count(_: Any) -> None:
        done[0] += 1
        tell(f"{done[0]} of {len(units)} done")

    outcomes = run_units(units, store, workers=workers, cluster=cluster, timeout=sweep.timeout_s + 60.0, done=count)
    rows, failed = [], []
    for point, outcome in zip(wanted, outcomes, strict=True):
        if outcome.result is not None:
            rows.append({"settings": point, **outcome.result})
        if outcome.error:
            failed.append({"settings": point, "error": outcome.error})
    return {"command": sweep.command, "rows": rows, "failed": failed}


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
