"""Re-simulated refit of the leading hypotheses: the linear signature is right for small effects only.

A Gauss-Newton step with Broyden's rank-one update: the simulator is run once more with the effect at the size that was
fitted, and the columns are turned so that they give that signal there,

    c_j' = c_j + (s(x) - C x) w_j x_j / sum(w x^2),    w = 1 / prior variance.

A step that leaves the effect's own fit worse is not taken.

What comes and goes (a compressor) gets its period, phase and duty instead (`cycling.py`).

Everything downstream (Gram matrices, pairs, held-out trips) stays linear, about the optimum instead of about zero:
Laplace's approximation of the evidence there.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.calibration import Calibration, reduce
from rollingroad.gap.channels import block_means, values
from rollingroad.gap.cycling import tuned
from rollingroad.gap.design import FUEL, map_correction
from rollingroad.gap.evidence import Posterior
from rollingroad.gap.fits import fit
from rollingroad.gap.replay import replay_vector, vector_of
from rollingroad.gap.signature_form import Context, Variant
from rollingroad.gap.trips import Layout, Lexicon, Trip, Whitened, marginal_gram, total_gram
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]
SINGLES, PAIRS = 4, 3
"""How many of the leading hypotheses are re-simulated."""
LOUD = 60.0
"""Chi square from which on the times of what comes and goes are told sharper."""
SMALL = 0.3
"""Prior deviations below which the linear signature is as good."""


def leading(posterior: Posterior) -> dict[int, tuple[Variant, Array]]:
    """Variants that the leading hypotheses are made of, by identity, with their fitted coefficients."""
    out: dict[int, tuple[Variant, Array]] = {}
    for effect in sorted(posterior.singles, key=lambda e: -posterior.singles[e])[:SINGLES]:
        variant, fit = posterior.fits[effect]
        out[id(variant)] = (variant, fit.value)
    for pair in sorted(posterior.pairs, key=lambda e: -posterior.pairs[e])[:PAIRS]:
        first, second, fit = posterior.pair_fits[pair]
        if posterior.pairs[pair] > max(posterior.singles.values(), default=0.0):
            out[id(first)] = (first, fit.value[: len(first.columns)])
            out[id(second)] = (second, fit.value[len(first.columns) :])
    return {
        key: (variant, value)
        for key, (variant, value) in out.items()
        if variant.settings is not None and np.abs(value / np.array([c.sd for c in variant.columns])).max() > SMALL
    }


def refit(
    trips: Sequence[Trip], whitened: Sequence[Whitened], layout: Layout, calibration: Calibration, lexicon: Lexicon,
    posterior: Posterior, car: Car,
) -> tuple[list[Trip], list[Whitened]]:  # fmt: skip
    """Return the trips and their whitened form with the leading variants' columns re-simulated."""
    chosen = leading(posterior)
    sharper = [
        (lexicon.place_of(v), tuned(trips, whitened, layout, calibration, v, lexicon.place_of(v)))
        for v, f in posterior.fits.values() if v.swings and f.explained > LOUD
    ]  # fmt: skip
    if not chosen and not sharper:
        return list(trips), list(whitened)
    correction = dict(zip(layout.calibration, calibration.mean, strict=True)) if calibration.trips else None
    vector = vector_of(car)
    out_trips, out_whitened = [], []
    for number, (trip, w) in enumerate(zip(trips, whitened, strict=True)):
        context = context_of(trip, car, vector, correction)
        effects, rows = trip.effects.copy(), w.rows.copy()
        for place, columns in sharper:
            effects[:, place] = columns[number]
            rows[:, layout.nuisance + np.arange(place.start, place.stop)] = w.apply(columns[number])
        for variant, value in chosen.values():
            place = lexicon.place_of(variant)
            weight = np.array([c.sd for c in variant.columns]) ** -2.0 * value
            try:
                missing = variant.at(context, value) - effects[:, place] @ value
            except BadInput:  # a size that the simulator refuses
                continue
            effects[:, place] += np.outer(missing, weight / float(weight @ value))
            index = layout.nuisance + np.arange(place.start, place.stop)
            rows[:, index] = w.apply(effects[:, place])
        out_trips.append(replace(trip, effects=effects))
        out_whitened.append(replace(w, rows=rows, gram=marginal_gram(rows, w.own, w.own_sd)))
    before, after = (reduce(total_gram(some), layout, calibration) for some in (whitened, out_whitened))
    for variant, _ in chosen.values():
        index = lexicon.index_of(variant)
        old, new = (fit(r, index, lexicon.sd[index]).log_bayes for r in (before, after))
        if new < old:  # a step too far (a spike of curvature that leaves the map, for one) is not taken
            place = lexicon.place_of(variant)
            out_trips, out_whitened = _taken_back(place, layout, trips, whitened, out_trips, out_whitened)
    return out_trips, out_whitened


def _taken_back(
    place: slice, layout: Layout, trips: Sequence[Trip], whitened: Sequence[Whitened], new_trips: Sequence[Trip],
    new_whitened: Sequence[Whitened],
) -> tuple[list[Trip], list[Whitened]]:  # fmt: skip
    """The new trips and their whitened form with the columns of the effect at `place` as they were."""
    columns = layout.nuisance + np.arange(place.start, place.stop)
    out_trips, out_whitened = [], []
    for trip, w, new_trip, new_w in zip(trips, whitened, new_trips, new_whitened, strict=True):
        effects, rows = new_trip.effects.copy(), new_w.rows.copy()
        effects[:, place], rows[:, columns] = trip.effects[:, place], w.rows[:, columns]
        out_trips.append(replace(new_trip, effects=effects))
        out_whitened.append(replace(new_w, rows=rows, gram=marginal_gram(rows, w.own, w.own_sd)))
    return out_trips, out_whitened


def context_of(trip: Trip, car: Car, vector: Array, correction: dict[str, float] | None) -> Context:
    """The calibrated simulator along `trip`, for signatures to be run in."""
    p = trip.p
    burnt = block_means(p, "fuel_power", replay_vector(vector, p.samples.motion).fuel)
    if correction:
        known = np.array([correction.get(name, 0.0) for name in trip.calibration.names])
        burnt = burnt + (trip.calibration.matrix @ known) * (p.layout.channel == FUEL)
    slope = map_correction(car, correction) if correction else None
    return Context(p, car, vector, values(p, car, vector), np.maximum(burnt, 0.0), slope)
