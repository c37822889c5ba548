"""From designs to sets: the best of each size by the relaxation, and by brute force."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from observer.selection.h2 import LinearSystem, kalman_h2
from observer.selection.sparse import ALPHAS, Design, SparseDesign, sweep

LARGEST = 10
"""Sensors among which brute force is tried."""


@dataclass(frozen=True)
class Choice:
    """A set of sensors and the H2 norm of its Kalman filter (root of the mean square over the systems)."""

    sensors: tuple[int, ...]
    h2: float


def joint_h2(systems: Sequence[LinearSystem], chosen: Sequence[int]) -> float:
    """Root of the mean over `systems` of the squared H2 norm with the `chosen` sensors."""
    return float(np.sqrt(np.mean([kalman_h2(system, chosen)[0] ** 2 for system in systems])))


def best_sets(
    systems: Sequence[LinearSystem],
    largest: int | None = None,
    alphas: Sequence[float] = ALPHAS,
    exchange: bool = True,
    designs: Sequence[Design] | None = None,
) -> list[Choice]:
    """Return the best set found of each size from 1 to `largest`, by the relaxation swept over `alphas`.

    Every design proposes its most used sensors for each size (its own rounded count included); the Kalman filter's norm
    decides. With `exchange` single sensors are then exchanged while that lowers the norm: ours, not the paper's.
    """
    m = len(systems[0].sensors)
    found = sweep(SparseDesign(systems), alphas) if designs is None else designs
    known: dict[tuple[int, ...], float] = {}

    def norm(chosen: tuple[int, ...]) -> float:
        if chosen not in known:
            known[chosen] = joint_h2(systems, chosen)
        return known[chosen]

    choices = []
    for count in range(1, min(largest or m, m) + 1):
        best = min(sorted({design.most_used(count) for design in found}), key=norm)
        while exchange:
            swaps = [tuple(sorted((set(best) - {old}) | {new})) for old in best for new in range(m) if new not in best]
            better = min(swaps, key=norm, default=best)
            if norm(better) >= norm(best) * (1.0 - 1e-9):
                break
            best = better
        choices.append(Choice(best, norm(best)))
    return choices


def brute_force(systems: Sequence[LinearSystem], largest: int | None = None) -> list[Choice]:
    """Return the best set of each size from 1 to `largest` among all. Raises ValueError beyond ten sensors."""
    m = len(systems[0].sensors)
    if m > LARGEST:
        raise ValueError(f"brute force: expected at most {LARGEST} sensors, found {m}")
    choices = []
    for count in range(1, min(largest or m, m) + 1):
        sets = list(combinations(range(m), count))
        norms = [joint_h2(systems, chosen) for chosen in sets]
        best = int(np.argmin(norms))
        choices.append(Choice(sets[best], norms[best]))
    return choices


def agrees(found: Sequence[Choice], best: Sequence[Choice], tolerance: float = 1e-6) -> bool:
    """Whether each of `found` is as good as brute force's choice of that size (sets that tie are equal)."""
    return all(a.h2 <= b.h2 * (1.0 + tolerance) for a, b in zip(found, best, strict=False))
