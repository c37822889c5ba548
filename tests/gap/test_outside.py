"""What no name stands for: models of a few regressors, their average, and its worth on a trip it has not seen."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from rollingroad.gap.calibration import Reduced
from rollingroad.gap.fits import SCALES, cosine, fit
from rollingroad.gap.floors import floored
from rollingroad.gap.generic import Regressor
from rollingroad.gap.outside import correction, models, outside
from rollingroad.gap.signature_form import Column, Variant
from rollingroad.gap.trips import Layout, Lexicon

NAMED = 1


def _library(sd: list[float], families: list[str] | None = None) -> Lexicon:
    rows = zip(sd, families or [""] * len(sd), strict=True)
    return Lexicon((), tuple(Regressor(str(i), "", "W", s, "accessory", f) for i, (s, f) in enumerate(rows)))


def _layout(generics: int) -> Layout:
    return Layout((), np.zeros(0), (), np.zeros(0), NAMED, generics)


def _reduced(columns: np.ndarray, y: np.ndarray) -> Reduced:
    return Reduced(columns.T @ columns, columns.T @ y)


def test_the_correction_is_the_average_over_models_by_their_densities() -> None:
    """Given two regressors, then each coefficient is its posterior mean under {first}, {second}, {both}, weighted by
    the multivariate normal densities of the data, a model of two being one of two firsts and one second."""
    rng = np.random.default_rng(5)
    sd = [0.5, 0.8]
    x = rng.normal(size=(30, NAMED + 2))
    x[:, 2] = 0.8 * x[:, 1] + 0.6 * x[:, 2]
    y = 0.6 * x[:, 1] + 0.4 * x[:, 2] + rng.normal(size=30)
    found = correction(_reduced(x, y), _library(sd), _layout(2))
    weights, means = [], []
    for terms, prior in (([0], 0.5), ([1], 0.5), ([0, 1], 0.5)):
        for scale in SCALES:
            g = x[:, [NAMED + i for i in terms]]
            prior_covariance = np.diag((np.array(sd)[terms] * scale) ** 2)
            total = np.eye(30) + g @ prior_covariance @ g.T
            weights.append(prior / len(SCALES) * multivariate_normal(np.zeros(30), total).pdf(y))
            mean = np.zeros(2)
            mean[terms] = prior_covariance @ g.T @ np.linalg.solve(total, y)
            means.append(mean)
    np.testing.assert_allclose(found, np.average(means, axis=0, weights=weights), rtol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_correction_of_one_trip_serves_the_next(seed: int) -> None:
    """Given sixty regressors of which one is real, then the correction that one trip gives takes most of the gap off
    another, where least squares over as many terms as were sought would add to it."""
    rng = np.random.default_rng(seed)
    trips = [rng.normal(size=(80, NAMED + 60)) for _ in range(2)]
    data = [0.7 * x[:, 11] + rng.normal(size=80) for x in trips]
    found = correction(_reduced(trips[0], data[0]), _library([0.5] * 60), _layout(60))
    squares = np.linalg.lstsq(trips[0][:, NAMED:], data[0], rcond=None)[0]
    gap = 0.7 * trips[1][:, 11]

    def left(value: np.ndarray) -> float:
        return float(np.mean((gap - trips[1][:, NAMED:] @ value) ** 2) / np.mean(gap**2))

    assert left(found) < 0.3 < 1.0 < left(squares)


def test_nothing_to_correct_is_left_alone() -> None:
    """Given regressors that the data cannot see, then no correction."""
    assert not correction(Reduced(np.zeros((4, 4)), np.zeros(4)), _library([1.0] * 3), _layout(3)).any()


def test_a_family_is_tried_whole() -> None:
    """Given a phase of which both halves are in the data, then the best model holds both, at once."""
    rng = np.random.default_rng(7)
    x = rng.normal(size=(200, NAMED + 3))
    y = x[:, 2] - x[:, 3] + rng.normal(size=200)
    _, best = models(_reduced(x, y), _library([1.0] * 3, ["", "cycle", "cycle"]), _layout(3), [0, 1, 2])
    assert best is not None and set(best.terms) == {1, 2}


def test_what_a_named_effect_could_be_is_not_something_else() -> None:
    """Given a regressor that is a named effect's signal, then it is not offered as something else."""
    rng = np.random.default_rng(8)
    x = rng.normal(size=(200, NAMED + 2))
    x[:, 1] = x[:, 0] + 0.1 * x[:, 1]
    y = x[:, 0] + rng.normal(size=200)
    r = _reduced(x, y)
    _, log = outside(r, _library([1.0] * 2), _layout(2), [(np.array([0]), 0.75)], r)
    _, freely = outside(r, _library([1.0] * 2), _layout(2), [], r)
    assert log < fit(r, [0], np.ones(1)).log_bayes - 2.0 < freely


@pytest.mark.parametrize(("share", "told"), [(1.0, True), (0.15, False)])
def test_what_is_like_a_named_effect_is_told_from_it_by_the_data(share: float, told: bool) -> None:
    """Given a regressor with a correlation of 0.87 to a named effect, then it is likelier than that effect where the
    signal is its own, and not where the signal is the effect's, a little off towards the regressor."""
    rng = np.random.default_rng(9)
    x, _ = np.linalg.qr(rng.normal(size=(300, NAMED + 1)))
    own = x[:, 1].copy()
    x[:, 1] = 0.87 * x[:, 0] + np.sqrt(1.0 - 0.87**2) * own
    r = _reduced(x, 15.0 * ((1.0 - share) * x[:, 0] + share * x[:, 1]))
    best, log = outside(r, _library([20.0]), _layout(1), [(np.array([0]), 0.75)], r)
    assert best is not None and best.terms == (0,)
    assert (log > fit(r, [0], np.array([20.0])).log_bayes + 5.0) == told
    assert (log > fit(r, [0], np.array([20.0])).log_bayes) == told


def test_a_floor_makes_no_effect_something_else() -> None:
    """Given an effect of which the model's own errors make much, then what is nearly its signal stays it: the likeness
    is that of the signals, not of what the floor leaves of them."""
    rng = np.random.default_rng(10)
    x, _ = np.linalg.qr(rng.normal(size=(300, NAMED + 1)))
    x[:, 1] = 0.97 * x[:, 0] + np.sqrt(1.0 - 0.97**2) * x[:, 1]
    bare = _reduced(x, 20.0 * x[:, 1])
    name = Column("factor", "", 0.0, 20.0)
    lexicon = Lexicon((Variant("drag", (name,), {}, lambda c: x[:, :1]),), _library([20.0]).regressors)
    r = floored(bare, lexicon, {"drag.factor": 5.0})
    _, log = outside(r, lexicon, _layout(1), [(np.array([0]), 0.75)], bare)
    _, taken = outside(r, lexicon, _layout(1), [(np.array([0]), 0.75)], r)
    assert cosine(r, np.array([0]), np.array([1])) < 0.75 < cosine(bare, np.array([0]), np.array([1]))
    assert log < taken
