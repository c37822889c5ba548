"""Something that the catalogue does not hold: physical regressors, sought among those of `generic`.

`outside`: those that no named effect could stand for, and their evidence. `correction`: what all of them together
predict, averaged over the models of one to three terms; no name is needed for that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.calibration import Reduced
from rollingroad.gap.fits import Fit, fit
from rollingroad.gap.trips import Layout, Lexicon

Array = NDArray[np.float64]
MORE = 2
"""Regressors, or families of them, that may join the first."""
BETTER = 2.0
"""Log units that one must add."""


@dataclass(frozen=True)
class Model:
    """Regressors `terms` (numbers in the lexicon) together: their fit, and the log of their share among all models."""

    terms: tuple[int, ...]
    fit: Fit
    log_prior: float


def seen(r: Reduced, lexicon: Lexicon, layout: Layout) -> list[int]:
    """Regressors that the data can tell anything of."""
    sd = np.array([g.sd for g in lexicon.regressors])
    size = np.diag(r.information)[layout.effects :] * sd**2
    return [int(i) for i in np.flatnonzero(size > 1.0)]


def models(
    r: Reduced, lexicon: Lexicon, layout: Layout, candidates: Sequence[int], more: int = MORE
) -> tuple[list[Model], Model | None]:
    """Every one of `candidates` (and family of them) alone, then, up to `more` times, with the best of the models
    before; the best of all.

    A model of two is one among as many firsts times as many seconds, and its share is as small.
    """
    sd = np.array([g.sd for g in lexicon.regressors])

    def fitted(terms: tuple[int, ...], log_prior: float) -> Model:
        return Model(terms, fit(r, [layout.effects + i for i in terms], sd[list(terms)]), log_prior)

    families: dict[str, list[int]] = {}
    for i in candidates:
        if lexicon.regressors[i].family:
            families.setdefault(lexicon.regressors[i].family, []).append(i)
    terms = [(i,) for i in candidates] + [tuple(members) for members in families.values() if len(members) > 1]
    if not terms:
        return [], None
    alone = [fitted(one, -float(np.log(len(terms)))) for one in terms]
    found, chosen = list(alone), max(alone, key=lambda model: model.fit.log_bayes)
    for joined in range(1, more + 1):
        extra = [one for one in terms if not set(one) & set(chosen.terms)]
        if not extra:
            break
        log_prior = -joined * float(np.log(len(terms))) - float(np.log(len(extra)))
        wider = [fitted((*chosen.terms, *one), log_prior) for one in extra]
        found += wider
        best = max(wider, key=lambda model: model.fit.log_bayes)
        if best.fit.log_bayes < chosen.fit.log_bayes + BETTER:
            break
        chosen = best
    return found, chosen


OFF = 0.2
"""Share of its size by which a signature may be off in the direction of something that is much like it."""


def outside(
    r: Reduced, lexicon: Lexicon, layout: Layout, named: Sequence[tuple[NDArray, float]], bare: Reduced
) -> tuple[Model | None, float]:
    """Best regressors and the evidence of "something else".

    `named` are the columns of each effect that may be named, with the correlation (in `bare`: before the floors of the
    effects are marginalised, which take a column away and leave what is nearly that column) from which on a regressor
    is much like that effect. Two of such would stand for two effects, so they are no terms of a model of several. One
    alone may be something else if it fits better by more than a signature that is OFF would let it.
    """
    candidates = np.array(seen(r, lexicon, layout), int)
    if not len(candidates):
        return None, NOTHING
    columns = layout.effects + candidates
    apart = np.ones(len(candidates), bool)
    for index, alike in named:
        a = bare.information[np.ix_(index, index)]
        c = bare.information[np.ix_(index, columns)]
        inner = np.linalg.solve(a + 1e-9 * np.diag(np.diag(a)) + 1e-300 * np.eye(len(a)), c)
        apart &= np.sum(c * inner, axis=0) < alike**2 * np.diag(bare.information)[columns]
    unlike = {int(i) for i in candidates[apart]}
    found, _ = models(r, lexicon, layout, sorted(unlike))
    alone, _ = models(r, lexicon, layout, [int(i) for i in candidates], 0)
    found += [
        replace(m, log_prior=m.log_prior - 0.5 * OFF**2 * m.fit.explained)
        for m in alone if not unlike.issuperset(m.terms)
    ]  # fmt: skip
    logs = np.array([m.fit.log_bayes + m.log_prior for m in found])
    return found[int(np.argmax(logs))], float(np.logaddexp.reduce(logs))


NOTHING = -30.0
"""Log evidence of "something else" where no regressor could carry it."""


def correction(r: Reduced, lexicon: Lexicon, layout: Layout) -> Array:
    """(generics,): coefficients of every regressor, averaged over the models by their evidence in `r`.

    Terms that are sought and fitted by least squares say anything of a trip that they have not seen; what several
    models share is kept, what only one of many says is small.
    """
    out = np.zeros(layout.generics)
    found, _ = models(r, lexicon, layout, seen(r, lexicon, layout))
    if not found:
        return out
    log = np.array([m.fit.log_bayes + m.log_prior for m in found])
    share = np.exp(log - log.max())
    for model, weight in zip(found, share / share.sum(), strict=True):
        out[list(model.terms)] += weight * model.fit.value
    return out
