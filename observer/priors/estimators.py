"""Estimators of seed 000 that hold one number per parameter: low-pass filter, static and adaptive prior estimator."""

from collections import deque
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter

from observer.priors.densities import Prior
from observer.priors.weighting import Weighting

Array = NDArray[np.float64]


class Estimator(Protocol):
    """What every estimator here does."""

    def estimate(self, measurements: Array, start: ArrayLike | None = None) -> Array:
        """Return the estimates (n, runs, d) after each of the `measurements` (n, runs, d).

        `start` (d,) or (runs, d) is the estimate before the first one; None: the first measurement itself.
        """
        ...


def begin(measurements: Array, start: ArrayLike | None) -> Array:
    """The estimate (runs, d) before the first measurement. Raises ValueError unless they are (n, runs, d)."""
    if measurements.ndim != 3 or len(measurements) == 0:
        raise ValueError(f"expected measurements of shape (n, runs, d), found {measurements.shape}")
    return np.array(
        np.broadcast_to(measurements[0] if start is None else np.asarray(start, float), measurements[0].shape)
    )


@dataclass(frozen=True)
class LowPass:
    """3.22: theta_k = a theta_{k-1} + (1 - a) y_k, with the forgetting factor a in [0, 1)."""

    forgetting: float = 0.9

    def estimate(self, measurements: Array, start: ArrayLike | None = None) -> Array:
        """See `Estimator`."""
        first = begin(measurements, start)
        a = self.forgetting
        return lfilter([1.0 - a], [1.0, -a], measurements, axis=0, zi=(a * first)[None])[0]


@dataclass(frozen=True)
class StaticPriorEstimator:
    """Algorithm 1 (SPE), in any dimension: 3.13, a weighting function of the quotient, 3.21 with one weight for all."""

    prior: Prior
    weighting: Weighting = field(default_factory=Weighting)

    def estimate(self, measurements: Array, start: ArrayLike | None = None) -> Array:
        """See `Estimator`. Where a prior without floor holds both values impossible, q = 1: it then says nothing."""
        theta = begin(measurements, start)
        out = np.empty_like(measurements)
        prior, weighting = self.prior, self.weighting
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for k, y in enumerate(measurements):
                q = prior(y)
                q /= prior(theta)
                if getattr(prior, "floor", 0.0) <= 0.0:
                    q[np.isnan(q)] = 1.0
                alpha = weighting(q)
                theta = np.subtract(theta, y, out=out[k])
                theta *= alpha[..., None]
                theta += y
        return out


@dataclass(frozen=True)
class AdaptivePriorEstimator:
    """4.4 (APE): the SPE with a Gaussian prior that follows the last `memory` estimates, axis by axis.

    Which equation moves the prior is lost in print; here its centre is the mean of the last n estimates and its
    deviation theirs, not below `least` (0.5 in print, against collapse). `adapt_spread` False holds the deviation.
    Before there are n estimates the initial prior (`mean`, `deviation`: (d,) or numbers) fills their places.
    """

    mean: ArrayLike
    deviation: ArrayLike
    weighting: Weighting = field(default_factory=Weighting)
    memory: int = 10
    adapt_spread: bool = True
    least: float = 0.5
    floor: float = 0.1

    def estimate(self, measurements: Array, start: ArrayLike | None = None) -> Array:
        """See `Estimator`."""
        theta = begin(measurements, start)
        initial = np.broadcast_to(np.asarray(self.deviation, float), theta.shape)
        centre = np.array(np.broadcast_to(np.asarray(self.mean, float), theta.shape))
        n = self.memory
        # n placeholders with the prior's own mean and deviation, replaced one by one
        signs = np.where(np.arange(n) % 2 == 0, 1.0, -1.0) if n > 1 else np.zeros(1)
        last = deque((centre + sign * initial for sign in signs), maxlen=n)
        total = sum(last, np.zeros_like(theta))
        squares = sum((value * value for value in last), np.zeros_like(theta))
        out = np.empty_like(measurements)
        for k, y in enumerate(measurements):
            mu = total / n
            spread = np.sqrt(np.maximum(squares / n - mu * mu, self.least**2)) if self.adapt_spread else initial
            alpha = self.weighting(self._density(y, mu, spread) / self._density(theta, mu, spread))
            theta = y + alpha[..., None] * (theta - y)
            oldest = last[0]
            last.append(theta)
            total = total + theta - oldest
            squares = squares + theta * theta - oldest * oldest
            out[k] = theta
        return out

    def _density(self, theta: Array, mu: Array, spread: Array) -> Array:
        z = (theta - mu) / spread
        peak = np.prod(np.sqrt(2.0 * np.pi) * spread, axis=-1)
        return np.maximum(np.exp(-0.5 * np.sum(z * z, axis=-1)) / peak, max(self.floor, 1e-300))
