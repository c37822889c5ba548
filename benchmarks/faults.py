"""Two hundred injected faults, and what became of the answers: python -m benchmarks.faults [SEED]

Good units and bad ones (killed, hung, failing) go through the engine in random order; meanwhile the disk is full for
some results, and between two invocations some kept results are cut short or overwritten. Counted are answers lost,
answers wrong, and faults that nobody was told of: all must be nought. A fault may be told as another one where the
machine is so busy that a unit's process takes longer to start than its time limit.
"""

import errno
import json
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rollingroad.evaluation.engine import Outcome, run_units
from rollingroad.evaluation.store import Store, Unit

GOOD = 200
FAULTS = {"killed": 50, "hung": 30, "failing": 40, "disk full": 40, "corrupt": 40}
TIMEOUT = 2.0
TOLD = {"killed": "process died", "hung": "took longer", "failing": "ValueError", "disk full": "not kept"}


def good(x: int) -> dict[str, Any]:
    """The square of `x`."""
    return {"square": x * x}


def killed(x: int) -> dict[str, Any]:
    """Its own process is killed from outside the interpreter."""
    os.kill(os.getpid(), signal.SIGKILL)
    return {}


def hung(x: int) -> dict[str, Any]:
    """Never returns."""
    time.sleep(3600.0)
    return {}


def failing(x: int) -> dict[str, Any]:
    """A scenario that cannot be driven."""
    raise ValueError(f"no route between the ends ({x})")


@dataclass(frozen=True)
class FullForSome(Store):
    """A disk that is full whenever one of these units is to be kept."""

    refused: frozenset[str] = frozenset()

    def write(self, unit: Unit, result: dict[str, Any]) -> None:
        """Keep `result`, or raise as a full disk does."""
        if unit.key in self.refused:
            raise OSError(errno.ENOSPC, "No space left on device")
        super().write(unit, result)


def campaign(seed: int = 0, workers: int = 2) -> dict[str, Any]:
    """Inject `FAULTS`, twice over one store. Returns the counts, by kind."""
    rng = np.random.default_rng(seed)
    units = [Unit("benchmarks.faults:good", {"x": x}) for x in range(GOOD)]
    chosen = rng.permutation(GOOD)
    no_room = frozenset(units[i].key for i in chosen[: FAULTS["disk full"]])
    spoilt = [units[i] for i in chosen[FAULTS["disk full"] :][: FAULTS["corrupt"]]]
    kinds = {unit.key: "disk full" for unit in units if unit.key in no_room}
    for kind in ("killed", "hung", "failing"):
        for x in range(FAULTS[kind]):
            units.append(Unit(f"benchmarks.faults:{kind}", {"x": x}))
            kinds[units[-1].key] = kind
    order = [units[i] for i in rng.permutation(len(units))]
    untold: Counter[str] = Counter()
    told_otherwise: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        first = run_units(order, FullForSome(Path(folder), no_room), workers=workers, timeout=TIMEOUT)
        for outcome in first:
            kind = kinds.get(outcome.unit.key)
            if (kind is None) != (outcome.error is None):
                untold[kind or "good"] += 1
            elif kind and TOLD[kind] not in (outcome.error or ""):
                told_otherwise[f"{kind}: {outcome.error}"] += 1
        wrong = _wrong(first)
        store = Store(Path(folder))
        for unit in spoilt:
            path, cut = store.path(unit), int(rng.integers(0, 3))
            text = path.read_text()
            path.write_text(["", text[: len(text) // 2], "\x00" * len(text)][cut])
        healthy = [unit for unit in order if unit.function.endswith(":good")]
        second = run_units(healthy, store, workers=workers, timeout=TIMEOUT)
        wrong += _wrong(second)
        again = {outcome.unit.key for outcome in second if outcome.computed}
        missing = no_room | {unit.key for unit in spoilt}
        whole = all(json.loads(store.path(unit).read_text())["result"] for unit in healthy)
    return {
        "faults": sum(FAULTS.values()),
        "answers": GOOD,
        "lost": sum(outcome.result is None for outcome in second) + (not whole),
        "wrong": wrong,
        "untold": dict(untold),
        "told_otherwise": dict(told_otherwise),
        "needlessly_computed": len(again - missing),
        "not_computed_again": len(missing - again),
    }


def _wrong(outcomes: list[Outcome]) -> int:
    return sum(o.result is not None and o.result != good(int(o.unit.arguments["x"])) for o in outcomes)


if __name__ == "__main__":
    print(json.dumps(campaign(int(sys.argv[1]) if len(sys.argv) > 1 else 0), indent=1))
