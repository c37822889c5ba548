"""Where the gap lies: subsystem, channel and regime with shares, and false-discovery control over the cells."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from rollingroad.gap.blocks import CHANNELS, REGIMES
from rollingroad.gap.calibration import Calibration, Reduced, unexplained
from rollingroad.gap.evidence import Posterior
from rollingroad.gap.identify import SUBSYSTEM
from rollingroad.gap.trips import Layout, Lexicon, Trip, Whitened, settled

Array = NDArray[np.float64]
EARLY = 600.0
"""s: what fades within them is the first ten minutes' own."""


@dataclass(frozen=True)
class Place:
    """One cell. `share` of what is explained; `p_value` adjusted over all cells (Benjamini and Hochberg)."""

    subsystem: str
    channel: str
    regime: str
    share: float
    p_value: float


def regimes_of(trip: Trip) -> list[str]:
    """A name for the regime of each block: idle, launch, shift, overrun, climb, cruise, acceleration, all."""
    m, layout = trip.p.samples.motion, trip.p.layout
    grade = np.interp(layout.time, m.time, m.force - m.acceleration) / 9.805
    rate = np.interp(layout.time, m.time, m.acceleration)
    names = []
    for channel, regime, g, a in zip(layout.channel, layout.regime, grade, rate, strict=True):
        name = REGIMES[regime]
        if name == "drive" and CHANNELS[channel] in ("fuel_power", "gear_ratio"):
            name = "climb" if g > 0.02 else "acceleration" if a > 0.35 else "cruise"
        names.append({"open": "shift", "overrun": "deceleration", "drive": "moving"}.get(name, name))
    return names


def signal(index: NDArray, value: Array, w: Whitened, layout: Layout) -> Array:
    """Whitened signal of effect (or regressor) columns `index` with coefficients `value`, what the trip's own and the
    tolerances would swallow taken off."""
    left, _ = settled(w, layout, w.rows[:, layout.nuisance + index] @ value)
    return left


def hypotheses(posterior: Posterior, lexicon: Lexicon, layout: Layout) -> list[tuple[float, str, NDArray, Array]]:
    """(probability, subsystem, columns, coefficients) of every hypothesis with a gap; pairs give one row per member."""
    rows = []
    for effect, (variant, fit) in posterior.fits.items():
        rows.append((posterior.singles[effect], SUBSYSTEM[effect], lexicon.index_of(variant), fit.value))
    for pair, (first, second, fit) in posterior.pair_fits.items():
        if posterior.pairs[pair] < 1e-3:
            continue
        at = 0
        for effect, variant in zip(pair, (first, second), strict=True):
            index = lexicon.index_of(variant)
            rows.append((posterior.pairs[pair], SUBSYSTEM[effect], index, fit.value[at : at + len(index)]))
            at += len(index)
    if posterior.regressors is not None:
        found, fit = posterior.regressors
        for regressor, value in zip(found, fit.value, strict=True):
            index = np.array([layout.effects + lexicon.regressors.index(regressor)])
            rows.append((posterior.outside, regressor.subsystem, index, np.array([value])))
    return rows


def locate(
    trips: Sequence[Trip], whitened: Sequence[Whitened], layout: Layout, calibration: Calibration, posterior: Posterior,
    lexicon: Lexicon, reduced: Reduced,
) -> list[Place]:  # fmt: skip
    """Cells by share, largest first."""
    names = [regimes_of(t) for t in trips]
    energy: dict[tuple[str, str, str], float] = {}
    early: dict[tuple[str, str], list[float]] = {}
    for probability, subsystem, index, value in hypotheses(posterior, lexicon, layout):
        if probability < 1e-4:
            continue
        for trip, w, regimes in zip(trips, whitened, names, strict=True):
            power = probability * signal(index, value, w, layout) ** 2
            for block in np.flatnonzero(power > 1e-9):
                channel = CHANNELS[trip.p.layout.channel[block]]
                key = (subsystem, channel, regimes[block])
                energy[key] = energy.get(key, 0.0) + float(power[block])
                both = early.setdefault((subsystem, channel), [0.0, 0.0])
                both[0 if trip.p.layout.time[block] < EARLY else 1] += float(power[block])
    # what fades: one cell for the first ten minutes instead of many regimes
    longest = max(float(t.p.samples.motion.time[-1]) for t in trips)
    for (subsystem, channel), (first, later) in early.items():
        if longest > 1.3 * EARLY and first > 0.85 * (first + later):
            keys = [k for k in energy if k[:2] == (subsystem, channel)]
            energy[(subsystem, channel, "first_600_s")] = sum(energy.pop(k) for k in keys)
    total = sum(energy.values()) or 1.0
    tests = _tests(trips, whitened, names, layout, calibration)
    rows = [
        Place(*key, share / total, tests.get(key[1:], 1.0)) for key, share in energy.items() if share / total > 0.005
    ]
    return sorted(rows, key=lambda p: -p.share)[:24]


def _tests(
    trips: Sequence[Trip],
    whitened: Sequence[Whitened],
    names: Sequence[list[str]],
    layout: Layout,
    calibration: Calibration,
) -> dict[tuple[str, str], float]:
    """Adjusted p-value of each cell (channel, regime): is the residual there larger than its noise?"""
    squares: dict[tuple[str, str], list[float]] = {}
    for trip, w, regimes in zip(trips, whitened, names, strict=True):
        r = unexplained(w, layout, calibration)
        for block, value in enumerate(r):
            channel = CHANNELS[trip.p.layout.channel[block]]
            for regime in (regimes[block], *(("first_600_s",) if trip.p.layout.time[block] < EARLY else ())):
                both = squares.setdefault((channel, regime), [0.0, 0.0])
                both[0] += float(value) ** 2 / calibration.dispersion
                both[1] += 1.0
    keys = list(squares)
    p = np.array([chi2.sf(squares[k][0], squares[k][1]) for k in keys])
    order = np.argsort(p)
    adjusted = np.minimum.accumulate((p[order] * len(p) / np.arange(1, len(p) + 1))[::-1])[::-1]
    return {keys[i]: float(min(q, 1.0)) for i, q in zip(order, adjusted, strict=True)}
