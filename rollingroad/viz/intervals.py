"""95 % intervals for the figures of one run, by a bootstrap over blocks of the drive or over cells of the map."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rollingroad.evaluation.scores import at, driving
from rollingroad.run import Run
from vehicle_model.car.randomness import generator

BLOCK = 20.0
"""s: errors of the estimate forget each other within a block."""
_DRAWS = 1000
Interval = tuple[float, float] | None


@dataclass(frozen=True)
class RunIntervals:
    """95 % intervals; None where there are fewer than two blocks or cells."""

    thrust: Interval
    """N, causal filter."""
    thrust_smoothed: Interval
    nis: Interval
    map_rmse: Interval
    """Fraction."""
    fit_rmse: Interval
    """Fraction, of the planner's fit."""


def run_intervals(run: Run, seed: int) -> RunIntervals:
    """Intervals of the observer's and the map's figures; the same `seed` gives the same intervals."""
    rng = generator(seed, "report intervals")
    estimate, trip, found, truth = run.estimate, run.baseline, run.efficiency_map, run.true_efficiency
    use = driving(trip, estimate.time)
    thrust = at(trip, "thrust", estimate.time)
    blocks = (estimate.time[use] // BLOCK).astype(int)
    errors = [(estimate.column("thrust", smoothed=smoothed) - thrust)[use] for smoothed in (False, True)]
    records = estimate.records[estimate.records["fused"]]
    cells = smooth = np.empty(0)
    if truth is not None:
        kept = found.valid & np.isfinite(found.mean) & np.isfinite(truth)
        cells = (found.mean - truth)[kept]
        planned = run.fits.get(str(run.results["map"]["fit"]))
        if planned is not None:
            omega, torque = np.meshgrid(found.engine_speed, found.torque, indexing="ij")
            smooth = planned.efficiency(omega[kept], torque[kept]) - truth[kept]
    return RunIntervals(
        thrust=_root(_mean_interval(errors[0] ** 2, blocks, rng)),
        thrust_smoothed=_root(_mean_interval(errors[1] ** 2, blocks, rng)),
        nis=_mean_interval(records["nis"], (records["t"] // BLOCK).astype(int), rng),
        map_rmse=_root(_mean_interval(cells**2, np.arange(len(cells)), rng)),
        fit_rmse=_root(_mean_interval(smooth**2, np.arange(len(smooth)), rng)),
    )


def _mean_interval(values: NDArray[np.float64], blocks: NDArray[np.int_], rng: np.random.Generator) -> Interval:
    """Interval of the mean of `values` (n,) that come in `blocks` (n,), whole blocks drawn with replacement."""
    finite = np.isfinite(values)
    values, blocks = values[finite], blocks[finite]
    _, member = np.unique(blocks, return_inverse=True)
    count = int(member.max()) + 1 if len(member) else 0
    if count < 2:
        return None
    sums, sizes = np.bincount(member, values), np.bincount(member)
    draws = rng.integers(0, count, (_DRAWS, count))
    means = sums[draws].sum(axis=1) / sizes[draws].sum(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def _root(interval: Interval) -> Interval:
    return None if interval is None else (interval[0] ** 0.5, interval[1] ** 0.5)
