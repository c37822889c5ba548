"""A compressor that comes and goes, told sharper than by the lexicon's sine of the nearest period.

The lexicon's frequencies are as far apart as a trip can tell, and its waves are sines. A loud compressor is neither:
over twenty minutes the nearest period is out of step by a part of a cycle, and on and off is a square wave. What that
leaves of its signal is larger than many an effect, and would be named beside it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.calibration import Calibration, reduce
from rollingroad.gap.channels import block_means
from rollingroad.gap.fits import Fit, fit
from rollingroad.gap.signature_form import COHERENT, Variant
from rollingroad.gap.trips import Layout, Trip, Whitened, marginal_gram

Array = NDArray[np.float64]
STEPS = 9
"""Frequencies that are tried from half the lexicon's distance below to half of it above."""
DUTIES = (0.25, 0.35, 0.42, 0.5, 0.58, 0.65, 0.75)
"""Shares of the time that a compressor is on, as they are tried."""


def tuned(
    trips: Sequence[Trip], whitened: Sequence[Whitened], layout: Layout, calibration: Calibration, variant: Variant,
    place: slice,
) -> list[Array]:  # fmt: skip
    """(m, 3) of each trip: `variant`'s mean and swing (columns `place`) at the likeliest period, phase and duty."""
    steady = [2.0 * trip.effects[:, place.start] for trip in trips]  # per W

    def best(columns: Callable[[Trip, Array], Array]) -> Fit:
        return _fit([columns(t, s) for t, s in zip(trips, steady, strict=True)], whitened, layout, calibration, variant)

    middle = 1.0 / variant.shape["ac_cycling.period"]
    frequencies = middle + np.linspace(-0.5, 0.5, STEPS) / COHERENT
    fits = [best(partial(_sine, frequency=float(f))) for f in frequencies]
    number = int(np.argmax([f.log_bayes for f in fits]))
    frequency, phase = float(frequencies[number]), float(np.arctan2(fits[number].value[2], fits[number].value[1]))
    squares = [best(partial(_square, frequency=frequency, phase=phase, duty=d)) for d in DUTIES]
    duty = DUTIES[int(np.argmax([f.log_bayes for f in squares]))]
    return [_square(t, s, frequency, phase, duty) for t, s in zip(trips, steady, strict=True)]


def _fit(
    columns: Sequence[Array], whitened: Sequence[Whitened], layout: Layout, calibration: Calibration, variant: Variant
) -> Fit:
    n, grams = layout.nuisance, []
    for own, w in zip(columns, whitened, strict=True):
        rows = np.concatenate([w.rows[:, :n], w.apply(own), w.rows[:, -1:]], axis=1)
        grams.append(marginal_gram(rows, w.own, w.own_sd))
    count = len(variant.columns)
    reduced = reduce(np.sum(grams, axis=0), replace(layout, effects=count, generics=0), calibration)
    return fit(reduced, list(range(count)), np.array([c.sd for c in variant.columns]))


def _sine(trip: Trip, steady: Array, frequency: float) -> Array:
    angle = 2.0 * np.pi * frequency * trip.p.samples.motion.time
    cos, sin = (block_means(trip.p, "fuel_power", wave) for wave in (np.cos(angle), np.sin(angle)))
    return np.stack([0.5 * steady, steady * cos, steady * sin], axis=1)


def _square(trip: Trip, steady: Array, frequency: float, phase: float, duty: float) -> Array:
    """As `_sine`, with a square wave of the same fundamental in the place of its cosine about `phase`."""
    angle = 2.0 * np.pi * frequency * trip.p.samples.motion.time - phase
    on = (np.cos(angle) > np.cos(np.pi * duty)).astype(float)
    wave = block_means(trip.p, "fuel_power", (on - duty) * np.pi / 2.0 / np.sin(np.pi * duty))
    late = block_means(trip.p, "fuel_power", np.sin(angle))
    c, s = np.cos(phase), np.sin(phase)
    return np.stack([0.5 * steady, steady * (c * wave - s * late), steady * (s * wave + c * late)], axis=1)
