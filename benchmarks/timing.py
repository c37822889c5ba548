"""Timing: the fastest of several runs, and the row that a figure and its reference make."""

import time
from collections.abc import Callable
from typing import Any

Row = dict[str, str | float | None]
RATES = ("x_real_time", "MB/s", "samples/s")
"""Units of which more is faster; of the others less is."""


def least(work: Callable[[], Any], repeats: int) -> float:
    """Seconds of the fastest of `repeats` runs: what else the machine does only ever adds."""
    best = float("inf")
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - began)
    return best


def row(name: str, value: float, unit: str, reference: str, reference_value: float) -> Row:
    """A row of `bench --json`; `ratio` > 1 means faster than the reference."""
    ratio = value / reference_value if unit in RATES else reference_value / value
    return {
        "name": name,
        "value": value,
        "unit": unit,
        "reference": reference,
        "reference_value": reference_value,
        "ratio": ratio,
    }
