"""The noise of each channel and regime, correlated as the references show it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.blocks import CHANNELS, REGIMES, Prepared
from rollingroad.gap.design import FUEL, HEIGHT_GPS, HEIGHT_MAP

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Per channel and regime, all (channels, regimes): factor on the first idea of the deviation, share of the variance
    that is correlated, and over which time (s). (Only the fuel's differ between regimes.)"""

    scale: Array
    correlated: Array
    time: Array


def default_noise() -> Noise:
    """Before any reference trip has been seen."""
    correlated = np.array([0.35, 0.3, 0.15, 0.4, 0.3, 0.2, 0.0, 0.0, 0.0, 0.0, 0.2])
    time = np.array([40.0, 120.0, 6.0, 60.0, 60.0, 60.0, 1.0, 200.0, 8.0, 1.0, 6.0])
    shape = (len(CHANNELS), len(REGIMES))
    return Noise(np.ones(shape), np.tile(correlated[:, None], shape[1]), np.tile(time[:, None], shape[1]))


LONGER = ((0.35, 40.0), (0.65, 40.0), (0.65, 150.0), (0.85, 150.0), (0.85, 400.0))
"""Shares and times (s) that the correlation of the fuel's errors is chosen from; the first is the default's."""


def log_likelihood(time: Array, residual: Array, share: float, tau: float) -> tuple[float, float]:
    """Sum of squares in units of the correlated noise, and log determinant, of one trip's errors (in their deviation)
    at `time` (s)."""
    covariance = share * np.exp(-np.abs(time[:, None] - time[None, :]) / tau)
    covariance[np.diag_indices(len(time))] += 1.0 - share
    return float(residual @ np.linalg.solve(covariance, residual)), float(np.linalg.slogdet(covariance)[1])


RATE = 0.025
"""s between the accelerometer's samples."""
WALK = 1.3
"""Of the default box's white noise (CLI.md): vibration and squat add to it."""


def whitener(p: Prepared, noise: Noise) -> Callable[[Array], Array]:
    """Return the function that turns (m,) or (m, k) over the trip's blocks into independent units of deviation."""
    layout = p.layout
    pieces: list[tuple[NDArray[np.intp], NDArray[np.floating]]] = []
    heights = np.flatnonzero((layout.channel == HEIGHT_GPS) | (layout.channel == HEIGHT_MAP))
    if len(heights):
        pieces.append((heights, np.linalg.cholesky(_height_covariance(p, heights, noise))))
    for number in range(len(CHANNELS)):
        index = np.flatnonzero(layout.channel == number)
        if number in (HEIGHT_GPS, HEIGHT_MAP) or not len(index):
            continue
        kind = layout.regime[index]
        share, tau = noise.correlated[number, kind], noise.time[number, kind]
        sigma = layout.sigma[index] * noise.scale[number, kind]
        gap = np.abs(layout.time[index][:, None] - layout.time[index][None, :])
        covariance = np.sqrt(np.outer(share, share)) * np.exp(-gap / np.sqrt(np.outer(tau, tau)))
        if number == FUEL:  # what the map does wrong in one regime says nothing of another
            covariance = covariance * (kind[:, None] == kind[None, :])
        covariance[np.diag_indices(len(index))] += 1.0 - share
        covariance *= sigma[:, None] * sigma[None, :]
        pieces.append((index, np.linalg.cholesky(covariance)))

    def apply(x: Array) -> Array:
        from scipy.linalg import solve_triangular

        out = np.zeros_like(x)
        for index, factor in pieces:
            out[index] = solve_triangular(factor, x[index], lower=True, check_finite=False)
        return out

    return apply


def _height_covariance(p: Prepared, index: NDArray, noise: Noise) -> Array:
    """Receiver: slow error; map: its own, which stays where it is while the car stands; both: the walk that
    integrating the accelerometer's noise makes, the faster the faster the car. A doubted block (`calibration.tamed`: a
    deviation above 1) has an error of its own."""
    layout, m = p.layout, p.samples.motion
    t, s = layout.time[index], layout.distance[index]
    gps = layout.channel[index] == HEIGHT_GPS
    gap = np.abs(t[:, None] - t[None, :])
    apart = np.abs(s[:, None] - s[None, :])
    both_gps = gps[:, None] & gps[None, :]
    both_map = ~gps[:, None] & ~gps[None, :]
    rate = (WALK * (0.10 + 0.004 * m.speed) * m.speed / 9.81) ** 2 * RATE + 0.01**2
    walked = np.interp(t, m.time, np.cumsum(rate) * (m.time[1] - m.time[0]))
    covariance = np.minimum.outer(walked, walked)
    covariance += both_gps * noise.scale[HEIGHT_GPS, 1] ** 2 * (3.5**2 * np.exp(-gap / 200.0) + 0.3**2 * (gap == 0))
    covariance += both_map * noise.scale[HEIGHT_MAP, 1] ** 2 * (1.0**2 * np.exp(-apart / 50.0) + 0.3**2 * (gap == 0))
    scale = np.where(gps, noise.scale[HEIGHT_GPS, 1], noise.scale[HEIGHT_MAP, 1])
    covariance += np.diag((layout.sigma[index] ** 2 - 1.0) * scale**2)
    return covariance
