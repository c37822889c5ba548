"""The closed forms of the evidence against independent ones: the multivariate normal density, least squares."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from rollingroad.gap.calibration import Calibration, Reduced, reduce
from rollingroad.gap.evidence import Hypotheses, Thresholds, weighed
from rollingroad.gap.fits import SCALES, Fit, cosine, fit, log_mean_exp
from rollingroad.gap.noise import default_noise
from rollingroad.gap.signature_form import Variant
from rollingroad.gap.trips import Layout


def _problem(seed: int, n: int = 40):
    """Unit noise, two nuisances (one calibrated, one tolerance), three effects."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(n, 5))
    y = rng.normal(size=n) + columns @ np.array([0.7, -0.2, 1.1, 0.0, 0.0])
    return columns, y


def _layout() -> Layout:
    return Layout(("map",), np.array([2.0]), ("mass",), np.array([0.5]), 3, 0)


def _reduced(columns, y, mean=0.4, information=9.0) -> Reduced:
    both = np.column_stack([columns, y])
    calibration = Calibration(np.array([[information]]), np.array([information * mean]), default_noise(), 1.0, 3)
    return reduce(both.T @ both, _layout(), calibration)


@pytest.mark.parametrize("index", [[0], [1], [0, 2]])
def test_bayes_factor_is_the_ratio_of_normal_densities(index: list[int]) -> None:
    """Given a mixture of Gaussian priors, then the log Bayes factor is that of multivariate normals over the data, and
    the coefficients are the mixture's."""
    columns, y = _problem(1)
    sd = np.array([1.5, 0.6, 0.9])[index]
    found = fit(_reduced(columns, y), index, sd)
    mean = 0.4 * columns[:, 0]
    none = np.eye(len(y)) + np.outer(columns[:, 0], columns[:, 0]) / 9.0 + 0.25 * np.outer(columns[:, 1], columns[:, 1])
    logs = []
    for scale in SCALES:
        effect = columns[:, 2:][:, index] * sd * scale
        logs.append(
            multivariate_normal(mean, none + effect @ effect.T).logpdf(y) - multivariate_normal(mean, none).logpdf(y)
        )
    assert found.log_bayes == pytest.approx(log_mean_exp(np.array(logs)), rel=1e-9)


def test_posterior_is_generalised_least_squares() -> None:
    """Given wide priors, then value and covariance are those of least squares with the nuisance's covariance."""
    columns, y = _problem(2)
    found = fit(_reduced(columns, y), [0, 1, 2], np.full(3, 1e4))
    noise = (
        np.eye(len(y)) + np.outer(columns[:, 0], columns[:, 0]) / 9.0 + 0.25 * np.outer(columns[:, 1], columns[:, 1])
    )
    weight = np.linalg.inv(noise)
    x = columns[:, 2:]
    covariance = np.linalg.inv(x.T @ weight @ x)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-5)
    np.testing.assert_allclose(found.value, covariance @ x.T @ weight @ (y - 0.4 * columns[:, 0]), rtol=1e-4)


def test_collinear_effects_have_cosine_one_and_equal_evidence() -> None:
    """Given a copy of a signature, then nothing separates the two."""
    columns, y = _problem(3)
    columns[:, 3] = -2.0 * columns[:, 2]
    r = _reduced(columns, y)
    assert cosine(r, np.array([0]), np.array([1])) == pytest.approx(1.0, abs=1e-6)
    first, second = fit(r, [0], np.array([1.0])), fit(r, [1], np.array([0.5]))
    assert first.log_bayes == pytest.approx(second.log_bayes, rel=1e-9)


def test_cosine_is_invariant_under_scale_of_columns() -> None:
    """Given other units, then the same correlation."""
    columns, y = _problem(4)
    before = cosine(_reduced(columns, y), np.array([0, 1]), np.array([2]))
    scaled = columns * np.array([1.0, 1.0, 1e6, 1e-3, 10.0])
    assert cosine(_reduced(scaled, y), np.array([0, 1]), np.array([2])) == pytest.approx(before, rel=1e-5)


def test_no_data_no_opinion() -> None:
    """Given columns that the data cannot see, then the Bayes factor is one."""
    nothing = Reduced(np.zeros((3, 3)), np.zeros(3))
    assert fit(nothing, [0, 1], np.ones(2)).log_bayes == 0.0


def test_log_mean_exp_does_not_overflow() -> None:
    """Given logs in the thousands, then their mean is still the mean."""
    assert log_mean_exp(np.array([5000.0, 5000.0 + np.log(3.0)])) == pytest.approx(5000.0 + np.log(2.0))


@pytest.mark.parametrize("gain, told", [(60.0, "pair"), (8.0, "single")])
def test_a_loud_effect_does_not_drown_a_second(gain: float, told: str) -> None:
    """Given an effect that explains a chi square of 2,800 and a second that adds 60 log units, then both are named;
    what adds 8 may be an error of the first one's signature."""
    loud, faint = Fit(1390.0, 2800.0, np.ones(1), np.eye(1)), Fit(20.0, 45.0, np.ones(1), np.eye(1))
    variant = Variant("loud", (), {}, lambda c: np.zeros((0, 0)))
    both = Fit(1390.0 + gain, 2800.0 + 2.0 * gain, np.ones(2), np.eye(2))
    h = Hypotheses(
        {"loud": 1390.0, "faint": 20.0}, {"loud": (variant, loud), "faint": (variant, faint)},
        {("loud", "faint"): (variant, variant, both)}, -30.0, None,
    )  # fmt: skip
    p = weighed(h, Thresholds(prior_pair=1e-4, misfit=0.075, barrier=2.3))
    assert p.none + p.outside < 1e-6
    assert (p.pairs[("loud", "faint")] if told == "pair" else p.singles["loud"]) > 0.8


def test_what_no_effect_explains_is_not_two_effects() -> None:
    """Given effects of which one explains a quarter of a loud signal and two of them half, and regressors that explain
    all of it, then it is something else, and not the two."""
    variant = Variant("a", (), {}, lambda c: np.zeros((0, 0)))
    first, second = Fit(500.0, 1010.0, np.ones(1), np.eye(1)), Fit(450.0, 910.0, np.ones(1), np.eye(1))
    both = Fit(900.0, 1820.0, np.ones(2), np.eye(2))
    h = Hypotheses(
        {"a": 500.0, "b": 450.0}, {"a": (variant, first), "b": (variant, second)},
        {("a", "b"): (variant, variant, both)}, 2000.0, ((), Fit(2010.0, 4040.0, np.ones(1), np.eye(1))),
    )  # fmt: skip
    assert weighed(h, Thresholds(misfit=0.1, barrier=2.3)).outside > 0.99
