"""Floors: what our own model's errors make of each effect on trips without a gap, by maximum likelihood, together.

A floor estimated for each effect alone is counted again by every effect that is like it: one error of the map at high
load would be a floor of enrichment and of thirty local errors, each as large as the whole of it, and hide what all of
them together never were.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from rollingroad.gap.calibration import Reduced
from rollingroad.gap.trips import Lexicon

Array = NDArray[np.float64]
ODD = ((1.0, 0.9), (4.0, 0.1))
"""(times the floors, share of the trips): one odd trip in ten does not set the floor of all."""
SMALL = 0.1
"""A floor below this share of the median deviation of its size is none."""
ENOUGH = 1e-5
"""Share of the log likelihood below which a step is the last."""


def column_names(lexicon: Lexicon) -> list[str]:
    """ "effect.parameter" of every effect column, in order; columns of one parameter share their floor."""
    return [f"{v.effect}.{c.parameter.split('~')[0]}" for v in lexicon.variants for c in v.columns]


def floored(r: Reduced, lexicon: Lexicon, floor: Mapping[str, float]) -> Reduced:
    """`r` with what the model's own errors make of each effect marginalised: below that there is nothing to explain."""
    sd = np.array([floor.get(name, 0.0) for name in column_names(lexicon)])
    index = np.flatnonzero(sd > 0.0)
    return _marginalised(r, index, sd[index])[0] if len(index) else r


def _marginalised(r: Reduced, index: NDArray[np.int64], sd: Array) -> tuple[Reduced, float]:
    """`r` with the columns `index` marginalised under prior deviations `sd`, and the log likelihood of `r` under these
    less that under none."""
    cross, vector = r.information[:, index] * sd, r.vector[index] * sd
    middle = np.eye(len(index)) + sd[:, None] * r.information[np.ix_(index, index)] * sd[None, :]
    solve = np.linalg.solve(middle, np.column_stack([cross.T, vector]))
    left = Reduced(r.information - cross @ solve[:, :-1], r.vector - cross @ solve[:, -1])
    return left, 0.5 * float(vector @ solve[:, -1] - np.linalg.slogdet(middle)[1])


def _likelihood(r: Reduced, variance: Array) -> tuple[float, Array]:
    """Log likelihood of one trip's effects `r` under floors of this `variance` (k,), less that under none, and its
    derivative by each variance."""
    left, log = _marginalised(r, np.arange(len(variance)), np.sqrt(variance))
    return log, 0.5 * (left.vector**2 - np.diag(left.information))


def floors(cases: Sequence[tuple[Reduced, Lexicon]]) -> dict[str, float]:
    """Floor of each "effect.parameter" over `cases` without a gap; none where these trips are as likely without."""
    names = sorted({name for _, lexicon in cases for name in column_names(lexicon)})
    deviations: dict[str, list[float]] = {name: [] for name in names}
    rows = []
    for r, lexicon in cases:
        own, k = column_names(lexicon), len(lexicon.sd)
        a, b = r.information[:k, :k], r.vector[:k]
        seen = np.flatnonzero(np.diag(a) * lexicon.sd**2 > 1.0)
        for i in seen:
            deviations[own[i]].append(float(a[i, i] ** -0.5))
        rows.append((Reduced(a[np.ix_(seen, seen)], b[seen]), np.array([names.index(own[i]) for i in seen], int)))
    scale = np.array([float(np.median(deviations[name])) if deviations[name] else 0.0 for name in names])

    def loss(x: Array) -> tuple[float, Array]:
        total, slope = 0.0, np.zeros(len(names))
        for trip, of in rows:
            logs, slopes = [], []
            for times, share in ODD:
                unit = (times * scale[of]) ** 2
                log, by = _likelihood(trip, x[of] * unit)
                logs.append(log + np.log(share))
                slopes.append(np.bincount(of, by * unit, len(names)))
            both = float(np.logaddexp.reduce(logs))
            total += both
            slope += np.exp(np.array(logs) - both) @ np.array(slopes)
        return -total, -slope

    found = minimize(
        loss, np.full(len(names), 0.1), jac=True, method="L-BFGS-B", bounds=[(0.0, 100.0)] * len(names),
        options={"ftol": ENOUGH, "maxiter": 200},
    )  # fmt: skip
    size = np.sqrt(found.x)
    return {
        name: float(f"{share * unit:.3g}") for name, share, unit in zip(names, size, scale, strict=True)
        if share > SMALL and unit > 0.0
    }  # fmt: skip
