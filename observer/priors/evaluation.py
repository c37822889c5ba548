"""The criteria of seed 000, 4.2: RMSE, variance and bias of estimates over a window, run by run."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.priors.estimators import Estimator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Criteria:
    """One value per run and dimension, each (runs, d). RMSE^2 = variance + bias^2."""

    rmse: Array
    variance: Array
    bias: Array


@dataclass(frozen=True)
class Interval:
    """A mean over runs, its 95 % interval, and the range of 95 % of single runs."""

    mean: float
    low: float
    high: float
    run_low: float
    run_high: float


def criteria(estimates: Array, setpoint: Array, begin: int = 0, end: int | None = None) -> Criteria:
    """Criteria of `estimates` (n, runs, d) against `setpoint` (d,) over samples `begin` to `end`."""
    window = estimates[begin:end]
    bias = window.mean(axis=0) - setpoint
    variance = window.var(axis=0)
    return Criteria(np.sqrt(variance + bias**2), variance, bias)


def interval(values: Array) -> Interval:
    """Mean of `values` (runs,) with its interval (normal approximation) and their own spread."""
    half = 1.96 * values.std(ddof=1) / np.sqrt(len(values))
    low, high = np.percentile(values, [2.5, 97.5])
    mean = float(values.mean())
    return Interval(mean, mean - half, mean + half, float(low), float(high))


def stationary(estimator: Estimator, measurements: Array, setpoint: Array, settle: int = 100) -> Criteria:
    """Criteria once `settle` samples have passed."""
    return criteria(estimator.estimate(measurements), setpoint, settle)


def rise_time(estimates: Array, start: float, end: float, first: int, share: float = 0.63) -> float:
    """Samples from `first` until the mean over runs of `estimates` (n, runs, 1) has gone `share` of a step.

    Infinite where it never does.
    """
    gone = (estimates[first:, :, 0].mean(axis=1) - start) / (end - start)
    there = np.flatnonzero(gone >= share)
    return float(there[0] + 1) if len(there) else float("inf")
