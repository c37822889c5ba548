"""One hypothesis' evidence, closed form: coefficients with a Gaussian prior, averaged over sizes on three scales."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from rollingroad.gap.calibration import Reduced
from rollingroad.gap.signature_form import Variant

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """One hypothesis: log Bayes factor against none, explained chi square, coefficients and their covariance."""

    log_bayes: float
    explained: float
    value: Array
    covariance: Array


SCALES = (1.0, 0.3, 0.1)
"""Prior deviations of a size, in shares of the declared one, equally likely: effects are small more often than large,
and a single wide prior would charge a small one for all the sizes that it is not."""


def fit(r: Reduced, index: NDArray[np.int64] | list[int], sd: Array) -> Fit:
    """Evidence of the columns `index` with prior deviations `sd` (same length), averaged over SCALES; coefficients and
    covariance are the mixture's."""
    index = np.asarray(index, int)
    if not len(index):
        return Fit(0.0, 0.0, np.zeros(0), np.zeros((0, 0)))
    a, b = r.information[np.ix_(index, index)], r.vector[index]
    wide = np.outer(SCALES, sd)
    scaled = np.eye(len(index)) + wide[:, :, None] * a * wide[:, None, :]
    covariance = wide[:, :, None] * np.linalg.inv(scaled) * wide[:, None, :]
    values = covariance @ b
    explained = values @ b
    logs = 0.5 * explained - 0.5 * np.linalg.slogdet(scaled)[1]
    share = np.exp(logs - logs.max())
    log = float(logs.max() + np.log(share.mean()))
    share /= share.sum()
    value = share @ values
    apart = values - value
    spread = np.einsum("i,ijk->jk", share, covariance) + np.einsum("i,ij,ik->jk", share, apart, apart)
    return Fit(log, float(share @ explained), value, spread)


LEAST_SWING = 0.3
"""Of its power: a compressor that is on half of the time swings by 0.64 of it, at duty 0.35 or 0.65 by 0.57."""


def physical(found: Fit, variant: Variant) -> Fit:
    """`found` with its evidence times twice the probability that what has one sign only has that sign (the prior of the
    other sign's half is nothing), and so for a swing that is no smaller than LEAST_SWING of the power that comes and
    goes. Columns of one parameter add up."""
    groups: dict[str, list[int]] = {}
    for i, column in enumerate(variant.columns):
        if column.sign:
            groups.setdefault(column.parameter.split("~")[0], []).append(i)
    log = found.log_bayes
    for index in groups.values():
        total = variant.columns[index[0]].sign * float(found.value[index].sum())
        log += _charge(total, float(found.covariance[np.ix_(index, index)].sum()))
    if variant.swings:
        swing = float(np.hypot(*found.value[1:]))
        slope = np.array([-LEAST_SWING, *found.value[1:] / max(swing, 1e-300)])
        log += _charge(swing - LEAST_SWING * float(found.value[0]), float(slope @ found.covariance @ slope))
    return replace(found, log_bayes=log)


def _charge(value: float, variance: float) -> float:
    """log of twice the probability that something of this mean and variance is positive."""
    return float(np.log(2.0) + norm.logcdf(value / max(float(np.sqrt(variance)), 1e-300)))


def cosine(r: Reduced, first: NDArray, second: NDArray) -> float:
    """Largest canonical correlation of two sets of columns, in units of the noise, nuisance projected out."""
    a, b = r.information[np.ix_(first, first)], r.information[np.ix_(second, second)]
    c = r.information[np.ix_(first, second)]
    ridge = 1e-9
    fa = np.linalg.cholesky(a + ridge * np.diag(np.diag(a)) + 1e-300 * np.eye(len(a)))
    fb = np.linalg.cholesky(b + ridge * np.diag(np.diag(b)) + 1e-300 * np.eye(len(b)))
    inner = np.linalg.solve(fa, np.linalg.solve(fb, c.T).T)
    return float(np.linalg.svd(inner, compute_uv=False)[0])


def log_mean_exp(x: Array, weights: Array | None = None) -> float:
    """log of the (weighted) mean of exp(x)."""
    x = np.asarray(x, float)
    top = float(x.max())
    w = np.full(len(x), 1.0 / len(x)) if weights is None else weights / weights.sum()
    return top + float(np.log(np.sum(w * np.exp(x - top))))
