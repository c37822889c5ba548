"""Prior estimators against algorithm 1 written out, the Kalman filter, and every conclusion of seed 000, 4.3 to 4.6."""

import math

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.stats import multivariate_normal, norm

from observer.priors import (
    WEIGHTINGS,
    AdaptivePriorEstimator,
    AsymmetricPrior,
    Bootstrap,
    GaussianPrior,
    GaussianSum,
    HistogramPrior,
    LowPass,
    MixturePrior,
    StaticPriorEstimator,
    Weighting,
    histogram_prior,
)
from observer.priors import tracks as t
from observer.priors.densities import histogram_priors
from observer.priors.evaluation import criteria, rise_time, stationary

PRIOR = GaussianPrior(15.0, 1.0, floor=0.1)
WEIGHTING = Weighting.matched("negative_exponential", 0.9)
SPE, LP = StaticPriorEstimator(PRIOR, WEIGHTING), LowPass(0.9)
DRIFT = 0.08
RUNS = 200


def steady(estimator, name: str, deviation: float = 1.0):
    """Criteria on a stationary track of chapter 4."""
    track = t.STATIONARY[name]
    return stationary(estimator, t.measured(track, deviation, RUNS), track[0])


# --- the pieces


@pytest.mark.parametrize("name", WEIGHTINGS)
def test_a_weighting_is_matched_at_one_and_stays_within_its_limits(name):
    w = Weighting.matched(name, 0.9)
    q = np.concatenate([np.linspace(0.0, 200.0, 4001), [np.inf]])
    alpha = w(q)
    assert w(np.array([1.0]))[0] == pytest.approx(0.9)
    assert alpha.min() >= 0.0 and alpha.max() <= 1.0
    assert np.all(np.diff(alpha) <= 1e-12), "the more probable the measurement, the less is kept"
    if name != "hit_or_miss":
        assert alpha[0] == pytest.approx(1.0)


def test_hit_or_miss_is_the_constant_that_is_printed():
    w = Weighting("hit_or_miss", sigma=2.0, level=0.7)
    assert np.array_equal(w(np.array([0.0, 1.9, 2.0, 9.0])), [0.7, 0.7, 0.0, 0.0])


def test_a_weighting_refuses_what_is_none():
    for bad in (dict(name="cubic"), dict(sigma=0.0), dict(level=1.0)):
        with pytest.raises(ValueError, match="expected"):
            Weighting(**bad)


def test_gaussian_priors_are_what_scipy_says():
    covariance = np.array([[0.09, 0.0297], [0.0297, 0.01]])
    points = np.random.default_rng(0).normal(size=(50, 2)) * 0.3
    assert GaussianPrior([0.0, 0.1], covariance)(points) == pytest.approx(
        multivariate_normal([0.0, 0.1], covariance).pdf(points)
    )
    assert GaussianPrior(1.0, 2.0, floor=0.15)(np.array([[1.0], [9.0]])) == pytest.approx([norm.pdf(0, 0, 2), 0.15])


@pytest.mark.parametrize(
    "prior",
    [
        AsymmetricPrior((1.0,), (0.5,), (2.0,)),
        MixturePrior([1.0, 3.0], [GaussianPrior(-1.0, 0.7), GaussianPrior(2.0, 0.5)]),
        histogram_prior(np.random.default_rng(1).gamma(2.0, 1.0, 4000)),
    ],
)
def test_priors_without_floor_integrate_to_one(prior):
    x = np.linspace(-30.0, 40.0, 140_001)
    assert np.trapezoid(prior(x[:, None]), x) == pytest.approx(1.0, abs=2e-4)


def test_logged_data_make_the_prior_they_came_from_at_each_operating_point():
    rng = np.random.default_rng(2)
    labels = np.repeat([1500, 3000], 20_000)
    samples = np.concatenate([rng.normal(8.0, 1.0, 20_000), rng.normal(14.0, 2.0, 20_000)])
    found = histogram_priors(samples, labels)
    x = np.linspace(4.0, 20.0, 33)
    assert found[1500](x[:, None]) == pytest.approx(norm.pdf(x, 8.0, 1.0), abs=0.02)
    assert found[3000](x[:, None]) == pytest.approx(norm.pdf(x, 14.0, 2.0), abs=0.02)
    with pytest.raises(ValueError, match="finite"):
        histogram_prior([1.0, 1.0, np.nan])


def test_the_estimator_is_algorithm_1_in_any_dimension():
    rng = np.random.default_rng(3)
    mean, root = rng.normal(size=3), rng.normal(size=(3, 3))
    prior = GaussianPrior(mean, root @ root.T + np.eye(3), floor=1e-4)
    y = rng.normal(size=(40, 2, 3)) * 2.0
    found = StaticPriorEstimator(prior, Weighting(sigma=8.0)).estimate(y, start=np.zeros(3))
    for run in range(2):
        theta = np.zeros(3)
        for k in range(40):
            alpha = math.exp(-float(prior(y[k, run])) / float(prior(theta)) / 8.0)
            theta = alpha * theta + (1.0 - alpha) * y[k, run]
            assert found[k, run] == pytest.approx(theta)


def test_the_low_pass_filter_is_its_difference_equation():
    y = np.random.default_rng(4).normal(size=(30, 3, 2))
    found, theta = LowPass(0.8).estimate(y, start=[1.0, 2.0]), np.array([1.0, 2.0])
    for k in range(30):
        theta = 0.8 * theta + 0.2 * y[k, 0]
        assert found[k, 0] == pytest.approx(theta)


# --- 4.3: one dimension


def test_extreme_priors_hold_the_estimate_or_leave_a_low_pass_filter():
    y = t.measured(t.steps([15.0, 20.0]), 1.0, 20)
    thin = StaticPriorEstimator(GaussianPrior(15.0, 0.05), WEIGHTING).estimate(y, start=15.0)
    wide = StaticPriorEstimator(GaussianPrior(15.0, 1e5), WEIGHTING).estimate(y, start=15.0)
    assert np.abs(thin - 15.0).max() < 0.3
    assert wide == pytest.approx(LP.estimate(y, start=15.0), abs=1e-6)


def test_on_the_prior_variance_is_less_than_the_low_pass_filters_near_it_there_is_bias_far_away_neither():
    on, near, far = (steady(SPE, name) for name in ("on", "near", "far"))
    low = steady(LP, "on")
    assert on.variance.mean() < 0.5 * low.variance.mean() and abs(on.bias.mean()) < 0.02
    # 0.385 is what the printed RMSE and variance leave
    assert near.bias.mean() == pytest.approx(-0.385, abs=0.03)
    assert near.rmse.mean() > 1.5 * low.rmse.mean()
    assert far.variance.mean() == pytest.approx(low.variance.mean(), rel=0.1) and abs(far.bias.mean()) < 0.02


def test_printed_on_prior_values_lie_within_single_runs():
    on, low = steady(SPE, "on"), steady(LP, "on")
    for values, printed in ((on.rmse, 0.1374), (on.variance, 0.0158), (low.rmse, 0.2326), (low.variance, 0.0494)):
        assert np.percentile(values, 2.5) < printed < np.percentile(values, 97.5)


def test_steps_toward_the_prior_are_followed_faster_and_away_slower_than_by_the_low_pass_filter():
    y = t.measured(t.LARGE_STEPS, 1.0, RUNS)
    spe, low = SPE.estimate(y, 15.0), LP.estimate(y, 15.0)
    away = rise_time(spe[:400], 15.0, 20.0, 100), rise_time(low[:400], 15.0, 20.0, 100)
    back = rise_time(spe[:500], 20.0, 15.0, 400), rise_time(low[:500], 20.0, 15.0, 400)
    assert away[0] > 1.5 * away[1]
    assert back[0] < 0.7 * back[1]


def _after(name: str, track, start: float):
    weighting = Weighting.matched(name, 0.9)
    return StaticPriorEstimator(PRIOR, weighting).estimate(t.measured(track, 1.0, RUNS), start)


def test_weightings_track_alike_but_for_the_inverse_quadratic_and_hit_or_miss():
    away = {name: rise_time(_after(name, t.LARGE_STEPS[:400], 15.0), 15.0, 20.0, 100) for name in WEIGHTINGS}
    alike = [away[name] for name in ("linear", "inverse", "negative_exponential", "tanh")]
    assert max(alike) <= 1.5 * min(alike)
    assert away["inverse_quadratic"] > max(alike), "slower away from the prior"
    assert away["hit_or_miss"] < min(alike), "next to the low-pass filter, the fastest"


def test_the_inverse_quadratic_is_fastest_towards_the_prior_of_the_smooth_ones():
    track = t.steps([20.0, 15.0])
    back = {
        name: np.mean((_after(name, track, 20.0)[100:110] - 15.0) ** 2)
        for name in ("inverse", "negative_exponential", "inverse_quadratic")
    }
    assert back["inverse_quadratic"] < min(back["inverse"], back["negative_exponential"])


def test_quotients_are_mostly_between_zero_and_one_in_steady_state():
    y = t.measured(t.STATIONARY["on"], 1.0, RUNS)
    held = SPE.estimate(y)
    q = PRIOR(y[101:]) / PRIOR(held[100:-1])
    assert np.mean(q <= 1.0) > 0.7


def test_an_asymmetric_prior_leaves_less_bias_on_its_heavy_side():
    heavy = StaticPriorEstimator(AsymmetricPrior((15.0,), (1.0,), (4.0,), floor=0.02), WEIGHTING)
    y_above, y_below = (t.measured(t.steps([level], 200), 1.0, RUNS) for level in (16.5, 13.5))
    above = stationary(heavy, y_above, np.array([16.5])).bias.mean()
    below = stationary(heavy, y_below, np.array([13.5])).bias.mean()
    assert abs(above) < 0.6 * abs(below)


BIMODAL = StaticPriorEstimator(
    MixturePrior([0.5, 0.5], [GaussianPrior(15.0, 0.7), GaussianPrior(18.0, 0.5)], floor=0.1), WEIGHTING
)


def test_between_the_peaks_of_a_bimodal_prior_the_estimate_is_erratic():
    y = t.measured(t.steps([16.5], 200), 1.0, RUNS)
    between, on = BIMODAL.estimate(y)[100:], BIMODAL.estimate(y - 1.5)[100:]
    assert between.var(axis=0).mean() > 2.0 * on.var(axis=0).mean()


def test_from_peak_to_peak_a_bimodal_prior_is_nearer_to_the_low_pass_filter_than_a_single_one():
    y = t.measured(t.BIMODAL, 1.0, RUNS)
    low = LP.estimate(y, 15.0)[400:500].mean(axis=1)
    two, one = (e.estimate(y, 15.0)[400:500].mean(axis=1) for e in (BIMODAL, SPE))
    assert np.abs(two - low).mean() < np.abs(one - low).mean()


def test_severe_outliers_disrupt_the_low_pass_filter_but_not_the_prior_estimator():
    y = t.measured(t.STATIONARY["on"], 1.0, RUNS)
    struck = y.copy()
    struck[120::20] += 30.0
    without_floor = StaticPriorEstimator(GaussianPrior(15.0, 1.0, floor=1e-6), WEIGHTING)
    assert np.abs(LP.estimate(struck) - LP.estimate(y)).max() > 2.0
    found = without_floor.estimate(struck)
    assert np.abs(found[120::20] - found[119:-1:20]).max() < 0.01


# --- 4.4: the adaptive prior


def adaptive(**changes):
    return AdaptivePriorEstimator(15.0, 1.0, **{"weighting": WEIGHTING, **changes})


def test_an_adaptive_prior_has_no_lasting_bias_off_the_prior_and_less_variance():
    found, low = steady(adaptive(), "near"), steady(LP, "near")
    assert abs(found.bias.mean()) < 0.1 < abs(steady(SPE, "near").bias.mean())
    assert found.variance.mean() < low.variance.mean()


def test_an_adaptive_prior_is_slower_than_the_static_one_towards_it_and_slower_still_at_a_larger_factor():
    y = t.measured(t.LARGE_STEPS[:400], 1.0, RUNS)
    slow = rise_time(adaptive().estimate(y, 15.0), 15.0, 20.0, 100)
    slower = rise_time(
        adaptive(weighting=Weighting.matched("negative_exponential", 0.95)).estimate(y, 15.0), 15.0, 20.0, 100
    )
    assert rise_time(LP.estimate(y, 15.0), 15.0, 20.0, 100) < slow < slower


def test_an_adaptive_spread_gives_less_variance_than_a_fixed_one():
    assert steady(adaptive(), "on").variance.mean() < steady(adaptive(adapt_spread=False), "on").variance.mean()


# --- 4.5: two dimensions


def plane(spread=(0.3, 0.1), rho: float = 0.99, floor: float = 0.2) -> StaticPriorEstimator:
    a, b = spread
    return StaticPriorEstimator(
        GaussianPrior([0.0, 0.0], np.array([[a * a, rho * a * b], [rho * a * b, b * b]]), floor), WEIGHTING
    )


def test_in_the_plane_steps_towards_the_prior_are_faster_and_away_slower():
    y = t.measured(t.PLANE_STEPS, (0.1, 0.08), RUNS)
    spe, low = plane().estimate(y, [0.0, 0.0]), LP.estimate(y, [0.0, 0.0])
    goal = t.PLANE_STEPS
    error = {name: np.abs(x.mean(axis=1) - goal)[:, 0] for name, x in (("spe", spe), ("low", low))}
    assert error["spe"][100:130].sum() > error["low"][100:130].sum()
    assert error["spe"][200:210].sum() < error["low"][200:210].sum()


def test_without_a_floor_improbable_setpoints_are_refused():
    y = t.measured(t.PLANE_STEPS[:200], (0.1, 0.08), RUNS)
    assert np.abs(plane(floor=0.0).estimate(y, [0.0, 0.0])[199]).max() < 0.2
    assert plane().estimate(y, [0.0, 0.0])[199, :, 0].mean() == pytest.approx(0.7, abs=0.1)


def test_a_sharper_prior_reduces_variance_less_than_tenfold_in_deviation_and_more_in_one_dimension():
    y = t.measured(t.PLANE_STATIONARY, (0.3, 0.1), RUNS)
    low = LP.estimate(y)[100:].var(axis=0).mean(axis=0)

    def shares(scale: float):
        two = plane((0.3 * scale, 0.1 * scale)).estimate(y)[100:].var(axis=0).mean(axis=0) / low
        one = [
            StaticPriorEstimator(GaussianPrior(0.0, s * scale, 0.2), WEIGHTING)
            .estimate(y[..., i : i + 1])[100:]
            .var(axis=0)
            .mean()
            / low[i]
            for i, s in enumerate((0.3, 0.1))
        ]
        return two, np.array(one)

    (two, one), (sharp_two, sharp_one) = shares(1.0), shares(0.1)
    assert np.all(sharp_two < two) and np.all(sharp_one < one)
    assert np.all(sharp_one < sharp_two), "with the sharper prior the one-dimensional estimator is better"
    assert np.all(one / sharp_one > two / sharp_two), "which affects it more"


# --- 3.6 and 4.6: the filters that a dynamic prior estimator would become


def kalman_gain(drift: float, noise: float) -> float:
    p = solve_discrete_are(np.eye(1), np.eye(1), np.eye(1) * drift**2, np.eye(1) * noise**2)[0, 0]
    return p / (p + noise**2)


def test_the_gaussian_sum_of_one_part_is_the_kalman_filter():
    y = t.measured(t.SMALL_STEPS, 1.0, 5)
    found = GaussianSum(GaussianPrior(0.0, DRIFT), GaussianPrior(0.0, 1.0)).estimate(y)
    expected = LowPass(1.0 - kalman_gain(DRIFT, 1.0)).estimate(y)
    assert found[300:] == pytest.approx(expected[300:], abs=1e-6)


def test_500_particles_tell_what_the_kalman_filter_tells():
    y = t.measured(t.STATIONARY["on"], 1.0, 20)
    exact = GaussianSum(GaussianPrior(0.0, DRIFT), GaussianPrior(0.0, 1.0)).estimate(y)
    found = Bootstrap(DRIFT, 1.0).estimate(y)
    assert np.sqrt(np.mean((found - exact)[50:] ** 2)) < 0.05
    assert np.array_equal(found, Bootstrap(DRIFT, 1.0).estimate(y)), "same seed, same bits"


def test_the_gaussian_sum_starts_from_the_right_peak_of_a_bimodal_prior():
    y = t.measured(t.steps([18.0], 30), 2.0, RUNS)
    peaks = MixturePrior([0.5, 0.5], [GaussianPrior(15.0, 0.3), GaussianPrior(18.0, 0.3)])
    narrow, wide = GaussianPrior(0.0, 0.01), GaussianPrior(0.0, 2.0)
    informed = GaussianSum(narrow, wide, peaks).estimate(y)[-1]
    ignorant = GaussianSum(narrow, wide).estimate(y)[-1]
    assert np.mean((informed - 18.0) ** 2) < 0.5 * np.mean((ignorant - 18.0) ** 2)


def test_a_gaussian_sum_noise_model_ignores_outliers_that_a_single_gaussian_follows():
    y = t.measured(t.STATIONARY["on"], 1.0, RUNS)
    y[150] += 30.0
    drift = GaussianPrior(0.0, DRIFT)
    tails = MixturePrior([0.95, 0.05], [GaussianPrior(0.0, 1.0), GaussianPrior(0.0, 20.0)])
    robust, plain = (GaussianSum(drift, noise).estimate(y)[150] for noise in (tails, GaussianPrior(0.0, 1.0)))
    assert np.abs(robust - 15.0).mean() < 0.3 < np.abs(plain - 15.0).mean()


def test_particles_in_a_bounded_set_stay_there_and_know_more_of_what_never_leaves_it():
    def inside(theta):
        return (theta[..., 0] >= 0.0) & (theta[..., 0] <= 0.8)

    rng = np.random.default_rng(6)
    truth = np.full((60, RUNS, 1), 0.4)
    for k in range(1, 60):
        truth[k] = truth[k - 1]
        moved = truth[k - 1] + 0.2 * rng.standard_normal((RUNS, 1))
        truth[k][inside(moved)] = moved[inside(moved)]
    y = truth + rng.standard_normal(truth.shape)
    free = Bootstrap(0.2, 1.0, particles=200).estimate(y, 0.4)
    bound = Bootstrap(0.2, 1.0, particles=200, inside=inside).estimate(y, 0.4)
    assert bound.min() >= 0.0 and bound.max() <= 0.8 and free.min() < 0.0
    assert np.sqrt(np.mean((bound - truth) ** 2)) < 0.7 * np.sqrt(np.mean((free - truth) ** 2))
    with pytest.raises(ValueError, match="bounded set"):
        Bootstrap(0.2, 1.0, inside=lambda theta: theta[..., 0] > 1e9).estimate(y)


def test_the_bootstrap_filter_is_better_than_the_prior_estimator_off_the_prior():
    far, near = (steady(Bootstrap(DRIFT, 1.0, particles=200), name).rmse.mean() for name in ("far", "near"))
    assert far < steady(SPE, "far").rmse.mean() and near < steady(SPE, "near").rmse.mean()


def test_a_histogram_prior_serves_as_well_as_the_gaussian_that_it_was_collected_from():
    logged = histogram_prior(np.random.default_rng(5).normal(15.0, 1.0, 20_000), floor=0.1)
    assert isinstance(logged, HistogramPrior)
    assert steady(StaticPriorEstimator(logged, WEIGHTING), "near").rmse.mean() == pytest.approx(
        steady(SPE, "near").rmse.mean(), rel=0.1
    )


def test_all_estimators_have_one_interface():
    y = t.measured(t.steps([(15.0, 14.0)], 20), 1.0, 3)
    prior = GaussianPrior([15.0, 14.0], 1.0, floor=0.1)
    for estimator in (
        LowPass(),
        StaticPriorEstimator(prior),
        AdaptivePriorEstimator([15.0, 14.0], 1.0),
        Bootstrap(0.1, 1.0),
        GaussianSum(GaussianPrior([0.0, 0.0], 0.1), GaussianPrior([0.0, 0.0], 1.0)),
    ):
        found = estimator.estimate(y, start=[15.0, 14.0])
        assert found.shape == y.shape and np.all(np.isfinite(found))
        assert criteria(found, np.array([15.0, 14.0])).rmse.max() < 1.5
        with pytest.raises(ValueError, match="shape"):
            estimator.estimate(y[0])
