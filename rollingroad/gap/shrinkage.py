"""How far the gap shrinks on trips that the fit has not seen, beside the wrong effect, a generic correction, the
floor."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.blocks import CHANNELS
from rollingroad.gap.calibration import Calibration, Reduced, reduce
from rollingroad.gap.design import FUEL
from rollingroad.gap.evidence import Posterior
from rollingroad.gap.fits import fit
from rollingroad.gap.outside import correction
from rollingroad.gap.signature_form import Variant
from rollingroad.gap.trips import Layout, Lexicon, Trip, Whitened, stack, total_gram
from rollingroad.gap.where import signal

Array = NDArray[np.float64]
WINDOW = 30.0
"""s, of the means that are judged."""


@dataclass(frozen=True)
class Shrinkage:
    """The object of `diagnose --json` and what challenge scoring needs besides."""

    channel: str
    before: float
    after: float
    floor: float
    recovered: float | None
    ci95: tuple[float, float] | None
    window_s: tuple[float, float] | None
    held_out: bool
    wrong_effect: float | None
    generic: float | None
    fuel_before: float | None
    fuel_after: float | None
    per_trip: tuple[tuple[float, float, float], ...] = ()
    """(before, after, floor) of each trip."""
    after_by_effect: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class _Case:
    """One diagnosed trip: raw residual without the calibration, its own nuisance, and the columns of effects."""

    residual: Array
    nuisance: Array
    columns: Array
    window: NDArray[np.int64]
    weight: Array
    scale: float
    repeatability: float
    """What a block's mean varies by from trip to trip, as the references show it; normalised."""


def shrink(
    trips: Sequence[Trip], whitened: Sequence[Whitened], reference: Sequence[Trip], layout: Layout, calibration:
    Calibration,
    posterior: Posterior, lexicon: Lexicon, hidden: Sequence[str], *, until: float | None = None, coarse: bool = False,
) -> Shrinkage:  # fmt: skip
    """Fit on the other trips, judge on the one left out (on itself, if it is alone); over the first `until` s of each
    where the gap lies there. `coarse` logs have a declared repeatability, or what the references show of it: that is
    their floor; elsewhere the floor is what the cause, fitted to the very trip, leaves."""
    chosen = leading(posterior)
    columns, sd = _columns_of(chosen, posterior, lexicon, layout)
    channel = _channel(columns, posterior, whitened, trips, layout, chosen)
    held = len(trips) > 1
    total = total_gram(whitened)
    cases = [_case(t, w, layout, calibration, channel, until) for t, w in zip(trips, whitened, strict=True)]
    reductions = [reduce(total - w.gram if held else total, layout, calibration) for w in whitened]
    whole = reduce(total, layout, calibration)

    before = np.array([_rms(c, c.residual) for c in cases])
    # terms are sought and their coefficients averaged without the trip that is judged
    general = layout.effects + np.arange(layout.generics)
    corrections = [correction(r, lexicon, layout) for r in reductions]
    generic = np.array([_left(c, general, x) for c, x in zip(cases, corrections, strict=True)])
    if chosen == ("outside_catalogue",):
        used, coefficients, after = general, corrections, generic
    else:
        used, coefficients = columns, [_fitted(r, columns, sd) for r in reductions]
        after = np.array([_left(c, used, x) for c, x in zip(cases, coefficients, strict=True)])
    best = _fitted(whole, columns, sd)
    floor = np.array([_floor(c, c.columns[:, columns] @ best) for c in cases])
    if coarse:
        floor = np.array([c.repeatability for c in cases])

    def mean(x: Array) -> float:
        return float(np.sqrt(np.mean(x**2)))

    singles: dict[str, float] = {}
    for effect, (variant, _) in posterior.fits.items():
        index = lexicon.index_of(variant)
        alone = [_left(c, index, _fitted(r, index, lexicon.sd[index])) for c, r in zip(cases, reductions, strict=True)]
        singles[effect] = mean(np.array(alone))
    rivals = [value for effect, value in singles.items() if effect not in chosen]
    b, a, f = mean(before), mean(after), mean(floor)
    recovered = _recovered(before, after, floor) if chosen else None
    ci = _interval(before, after, floor) if chosen and held else None
    fuel = _trip_fuel(trips, used, coefficients, layout, calibration)
    return Shrinkage(
        channel, b, a, f, recovered, ci, None, held, min(rivals) if rivals else None, mean(generic), *fuel,
        tuple(zip(before.tolist(), after.tolist(), floor.tolist(), strict=True)), singles,
    )  # fmt: skip


def _fitted(r: Reduced, index: NDArray, deviations: Array) -> Array:
    """Coefficients of the columns `index`, fitted to `r`."""
    return fit(r, index, deviations).value if len(index) else np.zeros(0)


def _left(case: _Case, index: NDArray, value: Array) -> float:
    """Normalised rms that the columns `index` with coefficients `value` leave of a trip."""
    return _rms(case, case.residual - case.columns[:, index] @ value)


def leading(posterior: Posterior) -> tuple[str, ...]:
    """The most probable cause, if any is likelier than none; "outside_catalogue" is one."""
    outside = posterior.outside if posterior.regressors is not None else 0.0
    rows: list[tuple[float, tuple[str, ...]]] = [(posterior.none, ()), (outside, ("outside_catalogue",))]
    rows += [(p, (e,)) for e, p in posterior.singles.items()]
    rows += [(p, pair) for pair, p in posterior.pairs.items()]
    if posterior.none >= 0.5:
        return ()
    rows[0] = (0.0, ())
    return max(rows)[1]


def _columns_of(chosen, posterior: Posterior, lexicon: Lexicon, layout: Layout) -> tuple[NDArray, Array]:
    if not chosen:
        return np.zeros(0, int), np.zeros(0)
    if chosen == ("outside_catalogue",):
        assert posterior.regressors is not None
        found = posterior.regressors[0]
        return (
            np.array([layout.effects + lexicon.regressors.index(g) for g in found]),
            np.array([g.sd for g in found]),
        )
    if len(chosen) == 2:
        first, second, _ = posterior.pair_fits[chosen]
        variants: tuple[Variant, ...] = (first, second)
    else:
        variants = (posterior.fits[chosen[0]][0],)
    index = np.concatenate([lexicon.index_of(v) for v in variants])
    return index, lexicon.sd[index]


def _channel(columns, posterior, whitened, trips, layout, chosen) -> str:
    """The channel that carries most of the leading cause's signal; the fuel where there is none."""
    if not len(columns):
        return "fuel_power"
    if chosen == ("outside_catalogue",):
        value = posterior.regressors[1].value
    elif len(chosen) == 2:
        value = posterior.pair_fits[chosen][2].value
    else:
        value = posterior.fits[chosen[0]][1].value
    energy = np.zeros(len(CHANNELS))
    for trip, w in zip(trips, whitened, strict=True):
        np.add.at(energy, trip.p.layout.channel, signal(columns, value, w, layout) ** 2)
    return CHANNELS[int(np.argmax(energy))]


def _case(
    trip: Trip, w: Whitened, layout: Layout, calibration: Calibration, channel: str, until: float | None
) -> _Case:
    rows = stack(trip, layout)
    c, n = len(layout.calibration), layout.nuisance
    number = CHANNELS.index(channel)
    mask = trip.p.layout.channel == number
    counts = np.ones(len(mask))
    if channel in trip.p.layout.parts:
        counts[mask] = trip.p.layout.parts[channel][2]
    if until is not None and (mask & (trip.p.layout.time < until)).any():
        mask &= trip.p.layout.time < until
    residual = rows[mask, -1] - rows[mask, :c] @ calibration.mean
    # nuisance of the trip alone (offsets of an altitude, for one): free in every comparison alike
    own = np.concatenate([rows[mask, c:n], trip.own.matrix[mask]], axis=1)
    wide = np.concatenate([layout.tolerance_sd, trip.own.sd])
    if channel == "fuel_power":
        scale = float(np.nanmean(trip.p.samples.fuel))
    else:
        scale = float(np.sqrt(np.mean(trip.p.layout.sigma[mask] ** 2))) if mask.any() else 1.0
    window = (trip.p.layout.time[mask] / WINDOW).astype(int)
    sigma = trip.p.layout.sigma[mask] * calibration.noise.scale[number, trip.p.layout.regime[mask]]
    shown = float(np.sqrt(np.mean(sigma**2))) if mask.any() else 0.0
    scale = max(scale, 1e-12)
    return _Case(residual, own * wide, rows[mask, n:-1], window, counts[mask], scale, shown / scale)


def _rms(case: _Case, residual: Array) -> float:
    """Normalised rms of the 30 s means, the trip's own and the tolerances fitted away within their limits."""
    return _unfitted(case, _windowed(case, residual), _own(case))


def _own(case: _Case) -> Array:
    return np.stack([_windowed(case, case.nuisance[:, i]) for i in range(case.nuisance.shape[1])], axis=1)


def _unfitted(case: _Case, means: Array, own: Array) -> float:
    """Normalised rms of `means` with the columns `own` fitted away, of deviation 1 each."""
    noise = 0.5 * np.median(np.abs(means)) + 1e-12 * case.scale
    fitted = own @ np.linalg.solve(noise**2 * np.eye(own.shape[1]) + own.T @ own, own.T @ means)
    return float(np.sqrt(np.mean((means - fitted) ** 2))) / case.scale


def _windowed(case: _Case, x: Array) -> Array:
    _, number = np.unique(case.window, return_inverse=True)
    return np.bincount(number, x * case.weight) / np.bincount(number, case.weight)


def _floor(case: _Case, signal_: Array) -> float:
    """What noise leaves of this very trip once the cause and its nuisance are fitted to it as well as can be."""
    sized = (_windowed(case, signal_) * 0.3)[:, None]
    means = _windowed(case, case.residual - signal_)
    return _unfitted(case, means, np.concatenate([_own(case), sized], axis=1))


def _recovered(before: Array, after: Array, floor: Array) -> float | None:
    b, a, f = (float(np.sqrt(np.mean(x**2))) for x in (before, after, floor))
    return float((b - a) / (b - f)) if b - f > 0.02 * b else None


def _interval(before: Array, after: Array, floor: Array) -> tuple[float, float] | None:
    """95 % interval over trips (bootstrap)."""
    rng = np.random.default_rng(0)
    values = []
    for _ in range(400):
        pick = rng.integers(len(before), size=len(before))
        value = _recovered(before[pick], after[pick], floor[pick])
        if value is not None:
            values.append(value)
    return (float(np.percentile(values, 2.5)), float(np.percentile(values, 97.5))) if len(values) > 100 else None


def _trip_fuel(
    trips: Sequence[Trip], index: NDArray, coefficients: Sequence[Array], layout: Layout, calibration: Calibration
) -> tuple[float | None, float | None]:
    """Mean absolute error of a trip's fuel, percent, before and after the columns `index` with each trip's own
    `coefficients` (those that the other trips gave)."""
    before, after = [], []
    for trip, value in zip(trips, coefficients, strict=True):
        mask = trip.p.layout.channel == FUEL
        if not mask.any():
            return None, None
        rows = stack(trip, layout)[mask]
        c, n = len(layout.calibration), layout.nuisance
        residual = rows[:, -1] - rows[:, :c] @ calibration.mean
        blocks, _, count = trip.p.layout.parts["fuel_power"]
        fuel = float(np.nansum(trip.p.samples.fuel[blocks]))
        before.append(float((residual * count).sum()) / fuel)
        after.append(float(((residual - rows[:, n + index] @ value) * count).sum()) / fuel)
    return 100.0 * float(np.mean(np.abs(before))), 100.0 * float(np.mean(np.abs(after)))
