"""Prior densities of seed 000, 3.3: Gaussian, asymmetric, sums of Gaussians, histograms; each with a floor.

The floor is a lowest value, `max(p(theta), floor)`, as in chapter 4 ("min(Prior)"): with one the prior no longer
integrates to 1, which does not matter, since only quotients of it are used. All are callable on (..., d) -> (...).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

Array = NDArray[np.float64]


class Prior(Protocol):
    """A density, not necessarily normalised."""

    @property
    def dimension(self) -> int:
        """d."""
        ...

    def __call__(self, theta: Array) -> Array:
        """P(theta): (..., d) to (...), at least the floor."""
        ...


def _floored(density: Array, floor: float) -> Array:
    return np.maximum(density, floor) if floor > 0.0 else density


class GaussianPrior:
    """N(`mean`, `covariance`) over d dimensions (3.3, whose exponent lacks its minus sign in print), with a `floor`.

    `mean` (d,) or a number; `covariance` (d, d), or (d,) deviations, or a number: the deviation.
    """

    def __init__(self, mean: ArrayLike, covariance: ArrayLike, floor: float = 0.0) -> None:
        self.mean = np.atleast_1d(np.asarray(mean, float))
        spread = np.asarray(covariance, float)
        d = len(self.mean)
        self.covariance = spread if spread.ndim == 2 else np.diag(np.broadcast_to(spread, (d,)) ** 2)
        self.floor = float(floor)
        factor = np.linalg.cholesky(self.covariance)  # raises LinAlgError where it is not positive definite
        self._whiten = np.linalg.inv(factor)
        self._peak = 1.0 / ((2.0 * math.pi) ** (d / 2.0) * float(np.prod(np.diag(factor))))

    @property
    def dimension(self) -> int:
        """d."""
        return len(self.mean)

    def __call__(self, theta: Array) -> Array:
        """P(theta): (..., d) to (...)."""
        if self.dimension == 1:  # without the sum over an axis of one: the fast path of the estimators
            z = np.asarray((theta[..., 0] - self.mean[0]) * self._whiten[0, 0])
            z *= z
        else:
            w = (theta - self.mean) @ self._whiten.T
            z = np.asarray(np.einsum("...i,...i->...", w, w))
        z *= -0.5
        np.exp(z, out=z)
        z *= self._peak
        return _floored(z, self.floor)

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """`count` samples (count, d)."""
        return rng.multivariate_normal(self.mean, self.covariance, count)


@dataclass(frozen=True)
class AsymmetricPrior:
    """Two half Gaussians that meet at `centre`, axis by axis: deviations `below` and `above`, each (d,)."""

    centre: tuple[float, ...]
    below: tuple[float, ...]
    above: tuple[float, ...]
    floor: float = 0.0

    @property
    def dimension(self) -> int:
        """d."""
        return len(self.centre)

    def __call__(self, theta: Array) -> Array:
        """P(theta): (..., d) to (...)."""
        low, high = np.asarray(self.below), np.asarray(self.above)
        off = theta - np.asarray(self.centre)
        z = off / np.where(off < 0.0, low, high)
        norm = math.sqrt(2.0 / math.pi) ** self.dimension / float(np.prod(low + high))
        return _floored(norm * np.exp(-0.5 * np.sum(z * z, axis=-1)), self.floor)


class MixturePrior:
    """Sum of Gaussians: `weights` (m,), summing to 1 after normalisation, `parts` m Gaussians without floors."""

    def __init__(self, weights: Sequence[float], parts: Sequence[GaussianPrior], floor: float = 0.0) -> None:
        if len(weights) != len(parts) or not parts:
            raise ValueError(f"mixture: expected as many weights as parts, found {len(weights)} and {len(parts)}")
        self.weights = np.asarray(weights, float) / float(np.sum(weights))
        self.parts = tuple(parts)
        self.floor = float(floor)

    @property
    def dimension(self) -> int:
        """d."""
        return self.parts[0].dimension

    def __call__(self, theta: Array) -> Array:
        """P(theta): (..., d) to (...)."""
        total = sum(w * part(theta) for w, part in zip(self.weights, self.parts, strict=True))
        return _floored(np.asarray(total), self.floor)


@dataclass(frozen=True)
class HistogramPrior:
    """Densities at the centres of bins of even width, linear between them, `floor` outside.

    `first` and `width` (d,): centre and width of the first bin of each axis; `density` has d axes.
    """

    first: tuple[float, ...]
    width: tuple[float, ...]
    density: Array
    floor: float = 0.0

    @property
    def dimension(self) -> int:
        """d."""
        return len(self.first)

    def __call__(self, theta: Array) -> Array:
        """P(theta): (..., d) to (...)."""
        place = (np.asarray(theta, float) - np.asarray(self.first)) / np.asarray(self.width)
        found = map_coordinates(self.density, np.moveaxis(place, -1, 0), order=1, mode="grid-constant", cval=0.0)
        return _floored(found, self.floor)


def histogram_prior(
    samples: ArrayLike, bins: int | Sequence[int] = 40, smoothing: float = 1.5, floor: float = 0.0
) -> HistogramPrior:
    """Return the prior that logged data make: the procedure of 3.3, steps 2 to 4 (collate, smooth, normalise, store).

    `samples` (n,) or (n, d); `smoothing` is the deviation of a Gaussian kernel, in bins. Samples that are not finite
    are left out. Raises ValueError where fewer than two different finite samples are left.
    """
    data = np.asarray(samples, float)
    data = data[:, None] if data.ndim == 1 else data
    data = data[np.all(np.isfinite(data), axis=1)]
    if len(data) < 2 or np.any(np.ptp(data, axis=0) == 0.0):
        raise ValueError("histogram_prior: expected at least two different finite samples on each axis")
    d = data.shape[1]
    counts_per_axis = [bins] * d if isinstance(bins, int) else list(bins)
    # the kernel needs room beyond the outermost samples, else smoothing would cut the tails off
    room = math.ceil(4.0 * smoothing)
    limits = []
    for values, count in zip(data.T, counts_per_axis, strict=True):
        low, high = float(values.min()), float(values.max())
        step = (high - low) / count
        limits.append((low - room * step, high + room * step))
    shape = [count + 2 * room for count in counts_per_axis]
    counts, edges = np.histogramdd(data, shape, limits)
    smooth = gaussian_filter(counts, smoothing, mode="constant")
    width = tuple(float(edge[1] - edge[0]) for edge in edges)
    first = tuple(float(edge[0] + 0.5 * step) for edge, step in zip(edges, width, strict=True))
    return HistogramPrior(first, width, smooth / (smooth.sum() * np.prod(width)), floor)


def histogram_priors(
    samples: ArrayLike, operating_points: Sequence[object], bins: int = 40, smoothing: float = 1.5, floor: float = 0.0
) -> Mapping[object, HistogramPrior]:
    """Return one prior per operating point (step 5 of 3.3). `operating_points` (n,) labels the `samples` (n,[ d])."""
    data = np.asarray(samples, float)
    labels = np.asarray(operating_points)
    return {
        label: histogram_prior(data[labels == label], bins, smoothing, floor) for label in np.unique(labels).tolist()
    }
