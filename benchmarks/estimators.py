"""The static prior estimator beside algorithm 1 in plain Python. By hand: `python -m benchmarks.estimators`."""

import math
from collections.abc import Callable

from benchmarks.timing import Row, least, row
from observer.priors import GaussianPrior, StaticPriorEstimator, Weighting
from vehicle_model.car.randomness import generator

RUNS, SAMPLES = 16_384, 128


def _plain(measurements: list[float], mean: float, deviation: float, floor: float, sigma: float) -> float:
    """Algorithm 1 of seed 000 as it is printed, one sample at a time."""

    def prior(theta: float) -> float:
        z = (theta - mean) / deviation
        return max(math.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * deviation), floor)

    theta = measurements[0]
    for y in measurements:
        alpha = math.exp(-prior(y) / prior(theta) / sigma)
        theta = alpha * theta + (1.0 - alpha) * y
    return theta


def estimator_spe() -> list[Row]:
    """Samples a second of the SPE (Gaussian prior with floor, negative exponential), many tracks at once."""
    weighting = Weighting.matched("negative_exponential", 0.9)
    estimator = StaticPriorEstimator(GaussianPrior(15.0, 1.0, floor=0.1), weighting)
    y = 15.0 + generator(0, "benchmark").standard_normal((SAMPLES, RUNS, 1))
    few = y.ravel()[:20_000].tolist()
    value = y.size / least(lambda: estimator.estimate(y), 7)
    reference = len(few) / least(lambda: _plain(few, 15.0, 1.0, 0.1, weighting.sigma), 3)
    return [row("estimator_spe", value, "samples/s", "plain Python", reference)]


BENCHMARKS: dict[str, Callable[[], list[Row]]] = {"estimator_spe": estimator_spe}

if __name__ == "__main__":
    for found in estimator_spe():
        print(found)
