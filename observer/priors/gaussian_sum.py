"""The Gaussian-sum filter (seed 000, 2.7 and 4.6): Kalman filters side by side, weighed by what each foretold."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.priors.densities import GaussianPrior, MixturePrior
from observer.priors.estimators import begin

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GaussianSum:
    """theta_k = theta_{k-1} + w, y = theta + v, where initial density, w and v are sums of Gaussians.

    `drift` and `noise` are the densities of w and v. `initial` None: around the start with the covariance of the
    noise's first part. After every step the `parts` heaviest are kept.
    """

    drift: MixturePrior | GaussianPrior
    noise: MixturePrior | GaussianPrior
    initial: MixturePrior | GaussianPrior | None = None
    parts: int = 8

    def estimate(self, measurements: Array, start: ArrayLike | None = None) -> Array:
        """See `estimators.Estimator`; the estimate is the mean of the posterior."""
        first = begin(measurements, start)
        runs, d = first.shape
        drift, noise = _sum(self.drift), _sum(self.noise)
        if self.initial is None:
            log_w = np.zeros((runs, 1))
            mean = first[:, None, :]
            cov = np.broadcast_to(noise.parts[0].covariance, (runs, 1, d, d))
        else:
            initial = _sum(self.initial)
            log_w = np.broadcast_to(np.log(initial.weights), (runs, len(initial.parts)))
            mean = np.broadcast_to(np.array([p.mean for p in initial.parts]), (runs, len(initial.parts), d))
            cov = np.broadcast_to(np.array([p.covariance for p in initial.parts]), (*mean.shape, d))
        out = np.empty_like(measurements)
        for k, y in enumerate(measurements):
            if k:
                log_w, mean, cov = _spread(log_w, mean, cov, drift)
            log_w, mean, cov = _corrected(log_w, mean, cov, noise, y)
            log_w, mean, cov = self._pruned(log_w, mean, cov)
            out[k] = np.einsum("rp,rpi->ri", np.exp(log_w), mean)
        return out

    def _pruned(self, log_w: Array, mean: Array, cov: Array) -> tuple[Array, Array, Array]:
        if log_w.shape[1] > self.parts:
            keep = np.argpartition(-log_w, self.parts, axis=1)[:, : self.parts]
            log_w = np.take_along_axis(log_w, keep, 1)
            mean = np.take_along_axis(mean, keep[..., None], 1)
            cov = np.take_along_axis(cov, keep[..., None, None], 1)
        top = log_w.max(axis=1, keepdims=True)
        return log_w - top - np.log(np.exp(log_w - top).sum(axis=1, keepdims=True)), mean, cov


def _sum(density: MixturePrior | GaussianPrior) -> MixturePrior:
    return density if isinstance(density, MixturePrior) else MixturePrior([1.0], [density])


def _spread(log_w: Array, mean: Array, cov: Array, drift: MixturePrior) -> tuple[Array, Array, Array]:
    """Every part moved by every part of the drift."""
    pieces = [
        (log_w + np.log(w), mean + part.mean, cov + part.covariance)
        for w, part in zip(drift.weights, drift.parts, strict=True)
    ]
    a, b, c = zip(*pieces, strict=True)
    return np.concatenate(a, 1), np.concatenate(b, 1), np.concatenate(c, 1)


def _corrected(log_w: Array, mean: Array, cov: Array, noise: MixturePrior, y: Array) -> tuple[Array, Array, Array]:
    """Every part corrected under every part of the measurement's noise, and weighed by its likelihood."""
    pieces = []
    for w, part in zip(noise.weights, noise.parts, strict=True):
        s = cov + part.covariance
        nu = y[:, None, :] - mean - part.mean
        solved = np.linalg.solve(s, nu[..., None])[..., 0]
        likelihood = -0.5 * (np.einsum("rpi,rpi->rp", nu, solved) + np.linalg.slogdet(s)[1])
        gained = np.linalg.solve(s, cov)
        pieces.append(
            (log_w + np.log(w) + likelihood, mean + np.einsum("rpij,rpj->rpi", cov, solved), cov - cov @ gained)
        )
    a, b, c = zip(*pieces, strict=True)
    return np.concatenate(a, 1), np.concatenate(b, 1), np.concatenate(c, 1)
