"""The bootstrap (SIR) filter of seed 000, algorithm 2, with the bounded set of chapter 6, for all runs at once."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.priors.densities import GaussianPrior
from observer.priors.estimators import begin
from vehicle_model.car.randomness import generator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Bootstrap:
    """Particles on theta_k = theta_{k-1} + w, y = theta + v; w and v are Gaussian.

    `drift` and `noise` are their deviations, (d,) or numbers. `initial` is P(theta_1) (None: around the start, with the
    deviation of the noise). `inside` maps (..., d) to a mask: the bounded set of 6.1; a particle that would leave it
    is drawn again, `redraws` times, and then stays where it was.
    """

    drift: ArrayLike
    noise: ArrayLike
    particles: int = 500
    initial: GaussianPrior | None = None
    inside: Callable[[Array], NDArray[np.bool_]] | None = None
    seed: int = 0
    redraws: int = 20

    def estimate(self, measurements: Array, start: ArrayLike | None = None) -> Array:
        """See `estimators.Estimator`; the estimate is the mean of the posterior. Raises ValueError where the bounded
        set holds none of the first particles."""
        first = begin(measurements, start)
        rng = generator(self.seed, "bootstrap")
        runs, d = first.shape
        noise = np.broadcast_to(np.asarray(self.noise, float), (d,))
        drift = np.broadcast_to(np.asarray(self.drift, float), (d,))
        cloud = self._first(first, noise, rng)
        out = np.empty_like(measurements)
        flat = cloud.reshape(-1, d)
        for k, y in enumerate(measurements):
            if k:
                cloud = self._moved(cloud, drift, rng)
            z = (y[:, None, :] - cloud) / noise
            log_weights = -0.5 * np.einsum("rpi,rpi->rp", z, z)
            weights = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
            weights /= weights.sum(axis=1, keepdims=True)
            out[k] = np.einsum("rp,rpi->ri", weights, cloud)
            flat = cloud.reshape(-1, d)
            cloud = flat[systematic(weights, rng)].reshape(runs, self.particles, d)
        return out

    def _first(self, start: Array, noise: Array, rng: np.random.Generator) -> Array:
        runs, d = start.shape
        shape = (runs, self.particles)

        def drawn() -> Array:
            if self.initial is None:
                return start[:, None, :] + noise * rng.standard_normal((*shape, d))
            return self.initial.draw(runs * self.particles, rng).reshape(*shape, d)

        cloud = drawn()
        if self.inside is None:
            return cloud
        for _ in range(self.redraws):
            bad = ~self.inside(cloud)
            if not bad.any():
                return cloud
            cloud[bad] = drawn()[bad]
        # what is still outside takes the place of one that is inside
        bad = ~self.inside(cloud)
        for run in np.flatnonzero(bad.any(axis=1)):
            good = cloud[run, ~bad[run]]
            if not len(good):
                raise ValueError("bootstrap: expected a bounded set that some of the first particles lie in")
            cloud[run, bad[run]] = good[rng.integers(len(good), size=int(bad[run].sum()))]
        return cloud

    def _moved(self, cloud: Array, drift: Array, rng: np.random.Generator) -> Array:
        moved = cloud + drift * rng.standard_normal(cloud.shape)
        if self.inside is None:
            return moved
        for _ in range(self.redraws):
            bad = ~self.inside(moved)
            if not bad.any():
                return moved
            moved[bad] = cloud[bad] + drift * rng.standard_normal((int(bad.sum()), cloud.shape[-1]))
        bad = ~self.inside(moved)
        moved[bad] = cloud[bad]
        return moved


def systematic(weights: Array, rng: np.random.Generator) -> NDArray[np.intp]:
    """Places (runs * particles,) in the flattened cloud: systematic resampling (3.26 with one draw per run).

    The printed independent draws give the same expectation with more variance.
    """
    runs, count = weights.shape
    # one rising staircase over all runs, so that a single search serves them
    steps = np.cumsum(weights, axis=1)
    steps /= steps[:, -1:]
    steps += np.arange(runs)[:, None]
    wanted = (np.arange(count) + rng.random((runs, 1))) / count + np.arange(runs)[:, None]
    found = np.searchsorted(steps.ravel(), wanted.ravel())
    low = np.repeat(np.arange(runs) * count, count)
    return np.clip(found, low, low + count - 1)
