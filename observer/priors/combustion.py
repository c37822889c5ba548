"""Combustion parameters from an ion current (seed 000, 2.5): where the pressure peaks, and how lean the mixture is.

The location of the peak pressure by two Gaussians (Klovmark's method): one for the flame front, one for the post
flame, fitted by least squares; the second one's place. The air-fuel ratio by the steepest rise of the flame front
(Reinmann's): linear in it. Both are calibrated on a test bench, level by level.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
RINGING_UNTIL = -18.0
"""Degrees: what comes before is the coil's (the thesis removes it by the spark's duration)."""
FLAME = (-18.0, 0.0)
"""Degrees: where the flame front's rise is sought."""
LOW = np.array([0.0, -18.0, 1.0, 0.0, 2.0, 3.0])
HIGH = np.array([40.0, 0.0, 8.0, 40.0, 40.0, 25.0])
"""Bounds of height, place and width of the two Gaussians."""


def two_gaussians(angle: Array, current: Array, rounds: int = 40) -> Array:
    """Fit (height, place, width) of the flame front's and the post flame's Gaussian to each cycle: (n, 6).

    `angle` (m,) degrees, `current` (n, m). Only samples after the ringing count. Levenberg's and Marquardt's method on
    all cycles at once, steps clipped to the bounds.
    """
    keep = angle >= RINGING_UNTIL
    a, y = angle[keep], current[:, keep]
    early, late = np.flatnonzero(a < 0.0), np.flatnonzero(a > 3.0)
    first, second = early[y[:, early].argmax(axis=1)], late[y[:, late].argmax(axis=1)]
    rows = np.arange(len(y))
    flat = np.ones(len(y))
    p = np.stack([y[rows, first], a[first], 3.0 * flat, y[rows, second], a[second], 9.0 * flat], axis=1)
    p = np.clip(p, LOW, HIGH)
    damping, (model, slopes) = 1e-2 * flat, _bells(p, a)
    left = np.sum((y - model) ** 2, axis=1)
    for _ in range(rounds):
        normal = np.einsum("nmi,nmj->nij", slopes, slopes)
        right = np.einsum("nmi,nm->ni", slopes, y - model)
        held = ((p <= LOW) & (right < 0.0)) | ((p >= HIGH) & (right > 0.0))
        diagonal = np.einsum("nii->ni", normal)
        normal = normal + np.eye(6) * (damping[:, None] * diagonal + 1e-9)[:, :, None]
        free = ~held
        normal = np.where(free[:, :, None] & free[:, None, :], normal, np.eye(6))
        tried = np.clip(p + np.linalg.solve(normal, np.where(free, right, 0.0)[..., None])[..., 0], LOW, HIGH)
        new_model, new_slopes = _bells(tried, a)
        new_left = np.sum((y - new_model) ** 2, axis=1)
        better = new_left < left
        done = np.all(left - new_left < 1e-9 * left) and np.all(np.abs(tried - p) < 1e-6)
        p = np.where(better[:, None], tried, p)
        model, slopes = np.where(better[:, None], new_model, model), np.where(better[:, None, None], new_slopes, slopes)
        left, damping = np.where(better, new_left, left), np.where(better, 0.3 * damping, 4.0 * damping)
        if done:
            break
    return p


def _bells(p: Array, angle: Array) -> tuple[Array, Array]:
    """Two Gaussians of (n, 6) parameters at `angle` (m,): values (n, m), derivatives (n, m, 6)."""
    total, slopes = 0.0, []
    for height, place, width in (p[:, :3].T[..., None], p[:, 3:].T[..., None]):
        off = (angle - place) / width
        bell = np.exp(-0.5 * off**2)
        total = total + height * bell
        slopes += [bell, height * bell * off / width, height * bell * off**2 / width]
    return np.asarray(total), np.stack(slopes, axis=-1)


def flame_slope(angle: Array, current: Array, smoothing: int = 5) -> Array:
    """Steepest rise of each cycle's flame front, uA per degree (n,), after a moving mean of `smoothing` samples."""
    kernel = np.ones(smoothing) / smoothing
    smooth = np.apply_along_axis(np.convolve, 1, current, kernel, "same")
    window = (angle >= FLAME[0]) & (angle <= FLAME[1])
    return np.gradient(smooth, angle, axis=1)[:, window].max(axis=1)


@dataclass(frozen=True)
class Calibration:
    """Linear maps from what is fitted to what is wanted, found on cycles of known truth."""

    location: tuple[float, float]
    """Offset, degrees, and slope: peak pressure over the second Gaussian's place."""
    mixture: tuple[float, float]
    """Offset and slope: lambda over the flame front's rise, 1/(uA per degree)."""

    @staticmethod
    def of(places: Array, slopes: Array, location: Array, mixture: Array) -> "Calibration":
        """Straight lines through the medians of the cycles (n,) at each level of `location` and of `mixture`.

        Through the cycles themselves they would be too flat: a regression on what varies so much shrinks to the mean.
        """

        def line(x: Array, y: Array) -> tuple[float, float]:
            levels = np.unique(y)
            medians = np.array([np.median(x[y == level]) for level in levels])
            slope, offset = np.polyfit(medians, levels, 1)
            return float(offset), float(slope)

        return Calibration(line(places, location), line(slopes, mixture))

    def locations(self, places: Array) -> Array:
        """Peak pressure, degrees after top dead centre."""
        return self.location[0] + self.location[1] * places

    def mixtures(self, slopes: Array) -> Array:
        """lambda."""
        return self.mixture[0] + self.mixture[1] * slopes
