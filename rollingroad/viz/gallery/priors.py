"""Figures 4.2 to 4.15 of "Evaluation of a statistical method to use prior information" (2006): prior estimators.

The tracks are those of `observer.priors.tracks`; what print shows only in figures is ours there. One run each, seed 0.
"""

import numpy as np

from observer.priors import (
    WEIGHTINGS,
    AdaptivePriorEstimator,
    Bootstrap,
    Estimator,
    GaussianPrior,
    LowPass,
    MixturePrior,
    StaticPriorEstimator,
    Weighting,
)
from observer.priors import tracks as t
from rollingroad.viz import charts
from rollingroad.viz.charts import Array, Chart, Heat, Line, Panel
from vehicle_model.car.randomness import generator

_PRIOR = GaussianPrior(15.0, 1.0, floor=0.1)
_WEIGHTING = Weighting.matched("negative_exponential", 0.9)
_DRIFT = 0.08
"""Of the bootstrap's particles a sample: gives the printed share of the low-pass filter's variance."""
_RHO = 0.99
_COLOURS = (charts.BLUE, charts.PURPLE, charts.GREEN, charts.ORANGE, charts.SKY_BLUE, charts.YELLOW, charts.BLACK)
_LOW_PASS, _BOOTSTRAP = charts.VERMILION, charts.GREEN
_NOISE_IN_THE_PLANE = (0.1, 0.08)
_INSIDE = t.steps([(0.0, 0.0), (1.5, 0.075), (-1.0, -0.05), (0.5, 0.025), (0.0, 0.0)])
"""Figure 4.13: setpoints along the ridge of its prior."""
_OUTSIDE = t.steps([(0.0, 0.0), (0.5, -0.5), (0.7, 0.3), (-0.5, 0.4), (0.6, -0.2), (0.0, 0.0)])
"""Figure 4.14: off the ridge, back to (0, 0) at 500."""


def prior_charts() -> list[Chart]:
    """The fourteen figures, in order; they need no run."""
    spe, low, boot = StaticPriorEstimator(_PRIOR, _WEIGHTING), LowPass(0.9), Bootstrap(_DRIFT, 1.0)
    three: dict[str, Estimator] = {"SPE": spe, "low-pass": low, "bootstrap": boot}
    peaks = MixturePrior((1.0, 1.0), (GaussianPrior(15.0, 0.7), GaussianPrior(18.0, 0.5)), floor=0.1)
    weightings: dict[str, Estimator] = {
        name.replace("_", " "): StaticPriorEstimator(_PRIOR, _matched(name)) for name in WEIGHTINGS
    }
    slow = Weighting.matched("negative_exponential", 0.95)
    adaptive = {
        "4.7": ("adaptive centre and deviation", AdaptivePriorEstimator(15.0, 1.0, _WEIGHTING), low),
        "4.8": (
            "adaptive centre, static deviation",
            AdaptivePriorEstimator(15.0, 1.0, _WEIGHTING, adapt_spread=False),
            low,
        ),
        "4.9": ("low-pass factor 0.95", AdaptivePriorEstimator(15.0, 1.0, slow), LowPass(0.95)),
    }
    exact = "Prior N(15, 1) with floor 0.1, noise 1, weighting matched to a low-pass factor of 0.90."
    steps = t.LARGE_STEPS
    return [
        _weightings(),
        _tracking("4.3", "The seven weighting functions", steps, weightings | {"low-pass": low}, exact),
        _tracking("4.4", "Small steps", t.SMALL_STEPS, three, exact),
        _tracking("4.5", "Large steps", steps, three, exact),
        _tracking(
            "4.6",
            "A prior with two peaks",
            t.BIMODAL,
            {"SPE": StaticPriorEstimator(peaks, _WEIGHTING), "low-pass": low, "bootstrap": boot},
            "Peaks at 15 and 18 with deviations 0.7 and 0.5; between them, at 16, the estimate is erratic.",
        ),
        *(
            _tracking(number, f"Adaptive prior: {told}", steps, {"APE": ape, "SPE": spe, "low-pass": beside}, exact)
            for number, (told, ape, beside) in adaptive.items()
        ),
        _correlation(),
        _plane("4.11", "Steps off the ridge of a correlated prior", t.PLANE_STEPS, (0.3, 0.1), 0.2,
               "Slow away from what the prior holds probable (100), fast back (200), and (0.7, -0.1) is another thing "
               "than (0.7, -0.8)."),
        _plane("4.12", "The same without a floor", t.PLANE_STEPS, (0.3, 0.1), 0.0,
               "What the prior holds impossible is hardly followed at all."),
        _plane("4.13", "Within the probable area", _INSIDE, (2.0, 0.1), 0.2,
               "Along the ridge; setpoints are ours. In the paper nearly the low-pass filter: here slower, since the "
               "noise is wider than the ridge and most measurements are less probable than the estimate."),
        _plane("4.14", "In the improbable area", _OUTSIDE, (0.1, 2.0), 0.2,
               "Off the ridge, where the prior is flat: the low-pass filter. Setpoints are ours."),
        _plane("4.15", "A prior much narrower than the noise", t.PLANE_STATIONARY, (0.1, 2.0), 0.2,
               "Variance reduction at rest.", noise=(1.0, 0.8)),
    ]  # fmt: skip


def _matched(name: str) -> Weighting:
    return Weighting.matched(name, 0.9)


def _weightings() -> Chart:
    theta, q = np.linspace(11.0, 19.0, 201), np.linspace(0.0, 4.0, 401)
    return Chart(
        "priors-4.2",
        "4.2 Prior and weighting functions",
        "The prior with its floor, and each weighting function set so that it is 0.9 where a measurement is as "
        "probable as the estimate (quotient 1).",
        (
            Panel("density", (Line(theta, _PRIOR(theta[:, None]), "prior", charts.BLACK),), "", "parameter"),
            Panel(
                "weight of the estimate",
                tuple(
                    Line(q, _matched(name)(q), name.replace("_", " "), colour)
                    for name, colour in zip(WEIGHTINGS, _COLOURS, strict=True)
                ),
                "",
                "quotient of the prior",
            ),
        ),
        beside=True,
        height=340,
    )


def _tracking(number: str, title: str, track: Array, estimators: dict[str, Estimator], told: str) -> Chart:
    """One run of each estimator on the same measurements of `track` (n, 1), noise 1."""
    y = t.measured(track, 1.0, 1)
    k = np.arange(len(track), dtype=float)
    lines = [
        Line(k, y[:, 0, 0], "measured", charts.GREY, dots=True, size=2.0),
        Line(k, track[:, 0], "setpoint", charts.BLACK, width=1.0, step=True),
    ]
    styles = {"low-pass": (_LOW_PASS, "dash"), "bootstrap": (_BOOTSTRAP, "dot")}
    for i, (name, estimator) in enumerate(estimators.items()):
        colour, dash = styles.get(name, (_COLOURS[i % len(_COLOURS)], ""))
        lines.append(Line(k, estimator.estimate(y)[:, 0, 0], name, colour, dash=dash, width=1.3))
    span = float(track.min()) - 2.0, float(track.max()) + 2.0
    return Chart(
        f"priors-{number}",
        f"{number} {title}",
        told,
        (Panel("parameter", tuple(lines), x_label="sample", y_range=span),),
        height=360,
    )


def _ridge(spread: tuple[float, float], floor: float = 0.0) -> GaussianPrior:
    a, b = spread
    return GaussianPrior(np.zeros(2), np.array([[a * a, _RHO * a * b], [_RHO * a * b, b * b]]), floor)


def _density(prior: GaussianPrior, x: Array, y: Array) -> Heat:
    z = prior(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
    return Heat(x, y, z, "density of the prior", "cividis_r", 0.0, float(z.max()), units=("", ""))


def _correlation() -> Chart:
    """4.10: an experiment's scatter, rho = 0.9, and the prior that it makes."""
    prior = GaussianPrior(np.zeros(2), np.array([[1.0, 0.9], [0.9, 1.0]]))
    drawn = prior.draw(400, generator(0, "figure 4.10"))
    side = np.linspace(-3.0, 3.0, 121)
    scatter = (
        Line(side, 0.9 * side, "mean of one, the other known", charts.BLACK),
        Line(drawn[:, 0], drawn[:, 1], "experiment", charts.BLUE, dots=True),
    )
    return Chart(
        "priors-4.10",
        "4.10 Two correlated parameters",
        "400 draws with a correlation of 0.90, and the density that describes them.",
        (
            Panel("second parameter", scatter, "", "first parameter", (-3.0, 3.0), (-3.0, 3.0)),
            Panel("", (_density(prior, side, side),), "", "first parameter", (-3.0, 3.0), (-3.0, 3.0)),
        ),
        beside=True,
        height=380,
    )


def _plane(
    number: str,
    title: str,
    track: Array,
    spread: tuple[float, float],
    floor: float,
    told: str,
    *,
    noise: tuple[float, float] = _NOISE_IN_THE_PLANE,
) -> Chart:
    """Prior with measurements, and both parameters over the samples. `track` (n, 2)."""
    prior = _ridge(spread, floor)
    y = t.measured(track, noise, 1)
    spe = StaticPriorEstimator(prior, _WEIGHTING).estimate(y)[:, 0]
    low = LowPass(0.9).estimate(y)[:, 0]
    k = np.arange(len(track), dtype=float)
    reach = [1.1 * float(np.abs(y[:, 0, i]).max()) for i in (0, 1)]
    x1, x2 = (np.linspace(-r, r, 121) for r in reach)
    plane = (
        _density(prior, x1, x2),
        Line(y[:, 0, 0], y[:, 0, 1], "measured", charts.SKY_BLUE, dots=True, size=2.5),
        Line(track[:, 0], track[:, 1], "setpoints", charts.VERMILION, dots=True, size=8.0),
    )
    panels = [Panel("second parameter", plane, "", "first parameter", (-reach[1], reach[1]), (-reach[0], reach[0]))]
    for i, name in enumerate(("first parameter", "second parameter")):
        marks = (
            Line(k, track[:, i], "setpoint", charts.BLACK, width=1.0, step=True),
            Line(k, low[:, i], "low-pass", _LOW_PASS, dash="dash", width=1.2),
            Line(k, spe[:, i], "SPE", charts.BLUE, width=1.2),
        )
        panels.append(Panel(name, marks, "", "sample"))
    return Chart(
        f"priors-{number}",
        f"{number} {title}",
        f"Prior deviations {spread}, correlation {_RHO}, floor {floor:g}, noise {noise}. {told}",
        tuple(panels),
        beside=True,
        height=380,
    )
