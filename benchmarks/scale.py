"""What belongs to `bench --long`: what the engine costs, what a second process gains, faults.

By hand: `python -m benchmarks.scale [overhead | speed_up | faults]`. On an idle machine: `speed_up` shares it.
"""

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.faults import campaign
from benchmarks.timing import Row, row
from rollingroad.evaluation.engine import opened, run_units
from rollingroad.evaluation.store import Store, Unit

UNIT = 5.0
"""s."""
BENCH = "benchmarks.scale"


def waits(seconds: float, number: int) -> dict[str, Any]:
    """A unit that takes just so long, and no processor: what is measured is what the engine adds."""
    time.sleep(seconds)
    return {"number": number}


def works(number: int, turns: int) -> dict[str, Any]:
    """A unit that only computes, in this process alone."""
    total = 0.0
    for turn in range(turns):
        total += (turn * number) % 7
    return {"total": total}


def dask_overhead(units: int = 4, seconds: float = UNIT) -> list[Row]:
    """Wall time of units of 5 s on one worker, engine, store and child process included; reference: the units alone."""
    with tempfile.TemporaryDirectory(prefix="bench-") as folder, opened(1) as client:
        store = Store(Path(folder))
        run_units([Unit(f"{BENCH}:waits", {"seconds": 0.0, "number": -1})], store, client=client)
        work = [Unit(f"{BENCH}:waits", {"seconds": seconds, "number": number}) for number in range(units)]
        began = time.perf_counter()
        run_units(work, store, client=client)
        spent = time.perf_counter() - began
    return [row("dask_overhead", spent / units, "s", "the unit alone", seconds)]


def two_processes(units: int = 8, turns: int = 20_000_000) -> list[Row]:
    """Wall time of units that only compute on two processes; reference: on one. Asked: a ratio of 1.8."""
    spent = []
    for workers in (2, 1):
        with tempfile.TemporaryDirectory(prefix="bench-") as folder, opened(workers) as client:
            store = Store(Path(folder))
            first = [Unit(f"{BENCH}:waits", {"seconds": 0.5, "number": -1 - number}) for number in range(2 * workers)]
            run_units(first, store, client=client)  # the children start
            work = [Unit(f"{BENCH}:works", {"number": number, "turns": turns}) for number in range(units)]
            began = time.perf_counter()
            run_units(work, store, client=client)
            spent.append(time.perf_counter() - began)
    return [row("two_processes", spent[0], "s", "one process", spent[1])]


def faults() -> list[Row]:
    """200 injected faults (`benchmarks.faults`): answers lost or wrong and faults untold, which must be none."""
    found = campaign()
    failed = found["lost"] + found["wrong"] + sum(found["untold"].values())
    return [
        {
            "name": "faults",
            "value": float(failed),
            "unit": "lost, wrong or untold",
            "reference": f"faults among {found['answers']} answers",
            "reference_value": float(found["faults"]),
            "ratio": None,
        }
    ]


LONG = {"dask_overhead": dask_overhead, "two_processes": two_processes, "faults": faults}
"""Name of `rollingroad bench --long` -> the function that measures it."""

if __name__ == "__main__":
    chosen = {"overhead": dask_overhead, "speed_up": two_processes, "faults": faults}
    for name in sys.argv[1:] or list(chosen):
        for found in chosen[name]():
            print(json.dumps(found))
