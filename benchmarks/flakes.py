"""The short regression set, over and over, each time computed anew: python -m benchmarks.flakes [RUNS]

The same code must give the same figures each time. Counted are runs that failed and runs whose figures are not those of
the first, whatever the baselines are. One process, so that an evening's machine can bear it.
"""

import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rollingroad.evaluation.regress import measure, read_suite, suite_scenarios
from rollingroad.evaluation.store import Store

RUNS = 20


def campaign(
    runs: int = RUNS, names: tuple[str, ...] = (), tell: Callable[[str], None] = lambda text: None
) -> dict[str, Any]:
    """Run the scenarios `names` (the short set by default) `runs` times; what failed and what differed, by scenario."""
    known = suite_scenarios()
    chosen = {name: known[name] for name in names or read_suite().short}
    first: dict[str, dict[str, Any]] = {}
    failed: dict[str, int] = {}
    differed: dict[str, int] = {}
    for run in range(runs):
        with tempfile.TemporaryDirectory(prefix="flakes-") as folder:
            found = measure(chosen, Store(Path(folder)), workers=1)
        for name, result in found.items():
            if result.get("error"):
                failed[name] = failed.get(name, 0) + 1
            elif first.setdefault(name, result) != result:
                differed[name] = differed.get(name, 0) + 1
        tell(f"{run + 1} runs: {sum(failed.values())} failed, {sum(differed.values())} differed")
    return {"runs": runs, "scenarios": len(chosen), "failed": failed, "differed": differed}


if __name__ == "__main__":
    many = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    print(json.dumps(campaign(many, tell=lambda text: print(text, file=sys.stderr))))
