"""Evidence for each hypothesis: nothing, one effect, two, or something that the catalogue does not hold.

Linear and Gaussian throughout, after the signatures: with whitened residuals y, nuisance columns N (map, tolerances,
weather) of known prior and effect columns S of prior deviation s, the evidence is closed form.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap import generic
from rollingroad.gap.calibration import Reduced
from rollingroad.gap.fits import Fit, cosine, fit, log_mean_exp, physical
from rollingroad.gap.floors import floored
from rollingroad.gap.outside import outside
from rollingroad.gap.signature_form import Variant
from rollingroad.gap.trips import Layout, Lexicon

Array = NDArray[np.float64]


def visible(r: Reduced, lexicon: Lexicon) -> dict[str, float]:
    """Effect -> prior signal to noise ratio of its best variant: below 1 the trips cannot show it at all."""
    out: dict[str, float] = {}
    for variant, place in zip(lexicon.variants, lexicon.places, strict=True):
        index = np.arange(place.start, place.stop)
        size = np.diag(r.information)[index] * lexicon.sd[index] ** 2
        out[variant.effect] = max(out.get(variant.effect, 0.0), float(np.sqrt(max(size.max(), 0.0))))
    return out


@dataclass(frozen=True)
class Thresholds:
    """Frozen on development data (`thresholds.json`): prior log odds, tempering, the allowed misfit of a signature."""

    prior_none: float = 0.5
    prior_single: float = 0.33
    prior_pair: float = 0.03
    prior_outside: float = 0.10
    misfit: float = 0.12
    temperature: float = 1.0
    alike: float = 0.85
    """Correlation with a named effect above which a regressor is that effect and not something else."""
    spread: float = 0.1
    """Share of the misfit of the likeliest effect that any second one could take for its own: errors of a signature lie
    in many directions."""
    barrier: float = 3.5
    """log units that any cause must overcome before "nothing" loses: pays for looking everywhere."""
    floor: Mapping[str, float] = field(default_factory=dict)
    """"effect.parameter" -> deviation of what our own model's errors make of it on trips without a gap."""


@dataclass(frozen=True)
class Posterior:
    """Probabilities of {none, singles, pairs, outside} and the fits behind them."""

    none: float
    singles: Mapping[str, float]
    pairs: Mapping[tuple[str, str], float]
    outside: float
    fits: Mapping[str, tuple[Variant, Fit]]
    pair_fits: Mapping[tuple[str, str], tuple[Variant, Variant, Fit]]
    regressors: tuple[tuple[generic.Regressor, ...], Fit] | None


LEADING = 8
"""Pairs have one of this many leading single effects in them; two effects that are both weaker are never the answer."""


FEW, NEAR = 8, 0.92
"""Of an effect with more shapes than this (a local error of the map, anywhere on it) one is always near a regressor:
the correlation that makes the regressor that effect is then higher."""


def _part(found: Fit, at: slice) -> Fit:
    """The coefficients `at` of a fit."""
    return replace(found, value=found.value[at], covariance=found.covariance[at, at])


@dataclass(frozen=True)
class Hypotheses:
    """Evidence (log Bayes factors against "none") of everything that may be the answer, before any prior."""

    singles: Mapping[str, float]
    fits: Mapping[str, tuple[Variant, Fit]]
    pairs: Mapping[tuple[str, str], tuple[Variant, Variant, Fit]]
    outside: float
    regressors: tuple[tuple[generic.Regressor, ...], Fit] | None

    @property
    def explained(self) -> float:
        """Chi square that the best of them explains."""
        fits = [f for _, f in self.fits.values()] + [f for *_, f in self.pairs.values()]
        fits += [self.regressors[1]] if self.regressors is not None else []
        return max((f.explained for f in fits), default=0.0)


def hypotheses(
    r: Reduced, lexicon: Lexicon, layout: Layout, hidden: Sequence[str], t: Thresholds, pairs: bool = True
) -> Hypotheses:
    """Fit every hypothesis; `pairs` False leaves those out."""
    bare, r = r, floored(r, lexicon, t.floor)
    sd, places = lexicon.sd, lexicon.places
    by_effect: dict[str, list[tuple[Variant, Fit, NDArray]]] = {}
    seen = visible(r, lexicon)
    for variant, place in zip(lexicon.variants, places, strict=True):
        if variant.effect in hidden or seen[variant.effect] < 1.0:
            continue
        index = np.arange(place.start, place.stop)
        found = physical(fit(r, index, sd[index]), variant)
        by_effect.setdefault(variant.effect, []).append((variant, found, index))
    singles = {name: log_mean_exp(np.array([f.log_bayes for _, f, _ in rows])) for name, rows in by_effect.items()}
    best = {name: max(rows, key=lambda row: row[1].log_bayes) for name, rows in by_effect.items()}
    both: dict[tuple[str, str], tuple[Variant, Variant, Fit]] = {}
    names = sorted(best, key=lambda n: -singles[n])
    for i, first in enumerate(names[: LEADING if pairs else 0]):
        for second in names[i + 1 :]:
            (v1, _, i1), (v2, _, i2) = best[first], best[second]
            if cosine(r, i1, i2) > 0.97:
                continue
            index = np.concatenate([i1, i2])
            found = fit(r, index, sd[index])
            log = sum(
                physical(_part(found, at), v).log_bayes - found.log_bayes
                for v, at in ((v1, slice(0, len(i1))), (v2, slice(len(i1), None)))
            )
            both[(first, second)] = (v1, v2, replace(found, log_bayes=found.log_bayes + log))
    named = [
        (index[1:] if v.swings else index, t.alike if len(rows) <= FEW else max(t.alike, NEAR))
        for rows in by_effect.values() for v, _, index in rows
    ]  # fmt: skip
    other, log_outside = outside(r, lexicon, layout, named, bare)
    return Hypotheses(
        singles, {n: (v, f) for n, (v, f, _) in best.items()}, both, log_outside,
        (tuple(lexicon.regressors[i] for i in other.terms), other.fit) if other is not None else None,
    )  # fmt: skip


NO_FIT = Fit(0.0, 0.0, np.zeros(0), np.zeros((0, 0)))


def weighed(h: Hypotheses, t: Thresholds) -> Posterior:
    """Probabilities of `h` under the frozen priors. A signature is right to a share `misfit` of its size only, so the
    evidence of a loud effect is tempered; what a pair or something else has beyond the best effect alone is tempered by
    the part of that one's errors that may look like it. `barrier` is what any cause must overcome."""
    squeeze = t.temperature * (1.0 + 0.5 * t.misfit**2 * h.explained)
    rows: list[tuple[object, float]] = [("none", np.log(t.prior_none))]
    single = np.log(t.prior_single / max(len(h.singles), 1)) - t.barrier
    rows += [(n, single + x / squeeze) for n, x in h.singles.items()]
    top = max(h.singles.values(), default=0.0)
    best = max((f for _, f in h.fits.values()), key=lambda f: f.log_bayes, default=NO_FIT)
    gentle = t.temperature * (1.0 + 0.5 * t.spread * t.misfit**2 * best.explained)
    pair = np.log(t.prior_pair / max(len(h.pairs), 1)) - t.barrier + top / squeeze
    rows += [(n, pair + (f.log_bayes - best.log_bayes) / gentle) for n, (*_, f) in h.pairs.items()]
    rows.append(("outside", np.log(t.prior_outside) - t.barrier + top / squeeze + (h.outside - top) / gentle))
    logs = np.array([x for _, x in rows])
    probability = np.exp(logs - logs.max())
    probability /= probability.sum()
    table = {name: float(q) for (name, _), q in zip(rows, probability, strict=True)}
    return Posterior(
        table["none"], {n: table[n] for n in h.singles}, {n: table[n] for n in h.pairs}, table["outside"],
        h.fits, h.pairs, h.regressors,
    )  # fmt: skip


def posterior(r: Reduced, lexicon: Lexicon, layout: Layout, hidden: Sequence[str], t: Thresholds) -> Posterior:
    """Weigh all hypotheses."""
    return weighed(hypotheses(r, lexicon, layout, hidden, t), t)
