"""The ion current of a spark plug over crank angle, cycle by cycle: a plausible signal, not a model of the chemistry.

Seed 000, 2.3, names what it shows; no theory predicts it, so shapes and sizes here are ours, set by that text (the
tests hold them to it) and not by what suits an estimator: the coil's ringing after the spark (a duration in time: at
high speed it covers the flame front); the flame front from about -15 to -5 degrees, broken into several brief peaks by
turbulence, steeper for a rich mixture; the post flame, thermal, a little before the pressure's peak, skewed, sometimes
gone; large variation from cycle to cycle. None of it is a Gaussian, which is what the estimators fit.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ANGLE = np.arange(-35.0, 56.0, 1.0)
"""Crank angle of the samples, degrees after top dead centre."""


@dataclass(frozen=True)
class IonSettings:
    """Sizes; currents in uA, angles in degrees of crank, deviations relative unless said."""

    engine_speed: float = 2000.0 * 2.0 * np.pi / 60.0
    """rad/s."""
    spark_end: float = -22.0
    ringing: float = 4.0
    ringing_time: float = 0.25e-3
    """s: time constant of the ringing."""
    flame_place: float = -10.0
    flame_height: float = 6.0
    flame_variation: float = 0.25
    post_height: float = 4.0
    post_variation: float = 0.3
    post_lead: float = 1.5
    """By how much the post flame's peak precedes the pressure's, on average."""
    post_lead_variation: float = 1.5
    """Degrees."""
    vanishing: float = 0.08
    """Share of cycles whose post flame cannot be told from the noise."""
    location_variation: float = 2.5
    """Degrees: of the pressure's peak, from cycle to cycle."""
    mixture_variation: float = 0.02
    """Of lambda, from cycle to cycle."""
    noise: float = 0.15


@dataclass(frozen=True)
class IonCycles:
    """`current` (n, len(ANGLE)), and the truth of each cycle: `location` of the peak pressure, degrees, and lambda."""

    current: Array
    location: Array
    mixture: Array


def ion_cycles(location: Array, mixture: Array, rng: np.random.Generator, settings: IonSettings) -> IonCycles:
    """Cycles about the operating points `location` (n,), degrees, and `mixture` (n,), lambda."""
    s, n = settings, len(location)
    true_location = location + s.location_variation * rng.standard_normal(n)
    true_mixture = mixture * (1.0 + s.mixture_variation * rng.standard_normal(n))
    angle = ANGLE[None, :]
    return IonCycles(
        _ringing(s, n, rng, angle)
        + _flame_front(s, true_mixture, rng, angle)
        + _post_flame(s, true_location, true_mixture, rng, angle)
        + s.noise * rng.standard_normal((n, len(ANGLE))),
        true_location,
        true_mixture,
    )


def _ringing(s: IonSettings, n: int, rng: np.random.Generator, angle: Array) -> Array:
    degrees = np.rad2deg(s.engine_speed) * s.ringing_time
    end = s.spark_end + 0.5 * rng.standard_normal((n, 1))
    since = np.maximum(angle - end, 0.0)
    height = s.ringing * (1.0 + 0.1 * rng.standard_normal((n, 1)))
    return np.where(
        angle >= end, height * np.exp(-since / degrees) * np.cos(2.0 * np.pi * since / (1.3 * degrees)), 0.0
    )


def _flame_front(s: IonSettings, mixture: Array, rng: np.random.Generator, angle: Array) -> Array:
    """Three brief peaks about one place; later, lower and wider for a lean mixture."""
    n, lean = len(mixture), (mixture - 1.0)[:, None]
    place = s.flame_place + 12.0 * lean + 0.8 * rng.standard_normal((n, 1))
    height = s.flame_height * (1.0 - 1.6 * lean) * np.exp(s.flame_variation * rng.standard_normal((n, 1)) * 0.5)
    width = 1.4 * (1.0 + 1.2 * lean)
    total = np.zeros((n, angle.shape[1]))
    for share in (0.45, 0.33, 0.22):
        at = place + 2.6 * rng.standard_normal((n, 1))
        rise, fall = 0.7 * width, 1.5 * width
        off = angle - at
        size = share * height * np.exp(s.flame_variation * rng.standard_normal((n, 1)))
        total += size * np.exp(-0.5 * (off / np.where(off < 0.0, rise, fall)) ** 2)
    return total


def _post_flame(s: IonSettings, location: Array, mixture: Array, rng: np.random.Generator, angle: Array) -> Array:
    """A peak like a power of the pressure: steeper before than after, on a slow decay."""
    n = len(location)
    at = (location - s.post_lead + s.post_lead_variation * rng.standard_normal(n))[:, None]
    height = (
        s.post_height * np.exp(s.post_variation * rng.standard_normal((n, 1))) * (1.0 - 0.8 * (mixture - 1.0))[:, None]
    )
    height = np.where(rng.random((n, 1)) < s.vanishing, 0.05 * height, height)
    off = (angle - at) / np.where(angle < at, 7.0, 12.0)
    return height * (0.85 / (1.0 + off**2) ** 2 + 0.15 * np.exp(-np.maximum(angle - at, 0.0) / 25.0) * (angle > at))
