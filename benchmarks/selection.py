"""How often the relaxation finds brute force's sets, and how long 20 sensors of 20 states take.

By hand: `python -m benchmarks.selection [SYSTEMS]` (100 by default). One BLAS thread.
"""

import sys
import time

import numpy as np
from threadpoolctl import threadpool_limits

from observer.selection import LinearSystem, SparseDesign, best_sets, brute_force, sweep
from observer.selection.search import agrees
from vehicle_model.car.randomness import generator

AGREEMENT_ALPHAS = (0.02, 0.15, 0.6)


def random_system(seed: int, states: int, sensors: int) -> LinearSystem:
    """A random system, stable or slightly unstable; each sensor hears about four in ten states; two are wanted."""
    rng = generator(seed, "random systems")
    a = rng.standard_normal((states, states)) / np.sqrt(states)
    a -= (np.linalg.eigvals(a).real.max() - rng.uniform(-0.3, 0.1)) * np.eye(states)
    shape = (sensors, states)
    c = rng.standard_normal(shape) * (rng.random(shape) < 0.4) + 1e-3 * rng.standard_normal(shape)
    noise, deviation = np.diag(rng.uniform(0.3, 1.0, states)), rng.uniform(0.3, 1.5, sensors)
    return LinearSystem.one_row_each(a, noise, c, deviation, np.eye(states)[:2])


def agreement(systems: int = 100) -> dict[str, float]:
    """Shares of `systems` (3 to 6 states, 4 to 8 sensors) on which all sizes' sets are brute force's."""
    found = {"with exchange": 0, "relaxation alone": 0}
    excess = []
    for seed in range(systems):
        rng = generator(seed, "sizes")
        system = random_system(seed, int(rng.integers(3, 7)), int(rng.integers(4, 9)))
        designs = sweep(SparseDesign([system]), AGREEMENT_ALPHAS)
        best = brute_force([system])
        found["with exchange"] += agrees(best_sets([system], designs=designs), best)
        alone = best_sets([system], exchange=False, designs=designs)
        found["relaxation alone"] += agrees(alone, best)
        excess.append(max(a.h2 / b.h2 for a, b in zip(alone, best, strict=True)) - 1.0)
    return {name: count / systems for name, count in found.items()} | {"worst excess alone": max(excess)}


def twenty_of_twenty() -> dict[str, float]:
    """Seconds to choose 5 of 20 sensors of a 20-state model: build, three penalties, exchange."""
    system = random_system(0, 20, 20)
    began = time.perf_counter()
    chosen = best_sets([system], 5, AGREEMENT_ALPHAS)
    wall, norm = time.perf_counter() - began, chosen[-1].h2
    return {"wall_s": wall, "h2": norm}


if __name__ == "__main__":
    with threadpool_limits(1):
        began = time.process_time()
        print(twenty_of_twenty(), "of which processor", time.process_time() - began)
        print(agreement(int(sys.argv[1]) if len(sys.argv) > 1 else 100))
