"""Thresholds chosen on development sets: the floors and the score that they minimise."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from rollingroad.gap.calibration import Reduced
from rollingroad.gap.challenge.calibrate import Case, log_score
from rollingroad.gap.challenge.kept import read_evidence, write_evidence
from rollingroad.gap.evidence import Hypotheses, Thresholds
from rollingroad.gap.fits import Fit
from rollingroad.gap.floors import ODD, floors
from rollingroad.gap.signature_form import Column, Variant
from rollingroad.gap.trips import Layout, Lexicon
from vehicle_model.car.errors import BadInput

VARIANT = Variant("mass", (Column("factor", "", 1.0, 2.0),), {}, lambda c: np.zeros((0, 1)))
LEXICON = Lexicon((VARIANT,), ())
LAYOUT = Layout((), np.zeros(0), (), np.zeros(0), 1, 0)


def _case(x: float, deviation: float, kind: str = "gap_free") -> Case:
    a = deviation**-2.0
    parts = [] if kind == "gap_free" else [{"effect": "mass", "strength": 2.0}]
    key = {"kind": kind, "parts": parts, "hidden": False}
    return Case(key, Reduced(np.array([[a]]), np.array([a * x])), LAYOUT, LEXICON, ())


def test_a_floor_is_what_noise_does_not_explain() -> None:
    """Given sizes that spread by 0.3 beyond their deviations of 0.1, then the floor is that; given sizes that spread by
    their deviations alone, then there is none."""
    rng = np.random.default_rng(1)
    wide = [_case(float(rng.normal(0.0, np.hypot(0.3, 0.1))), 0.1) for _ in range(200)]
    assert floors([(c.reduced, LEXICON) for c in wide])["mass.factor"] == pytest.approx(0.3, rel=0.25)
    calm = [_case(float(rng.normal(0.0, 0.08)), 0.1) for _ in range(200)]
    assert "mass.factor" not in floors([(c.reduced, LEXICON) for c in calm])


def test_one_error_is_not_the_floor_of_all_that_look_like_it() -> None:
    """Given ten effects that are nearly one another, and errors of the model in that one direction, then the floors
    together allow for that error once, and not ten times; given one trip in twenty whose error is ten times as large,
    then they hardly grow."""
    rng = np.random.default_rng(2)
    alike = 0.95
    information = 100.0 * (alike * np.ones((10, 10)) + (1.0 - alike) * np.eye(10))
    names = [Variant(f"effect_{i}", VARIANT.columns, {}, VARIANT.make) for i in range(10)]
    lexicon = Lexicon(tuple(names), ())
    root = np.linalg.cholesky(information)

    def drawn(odd: bool) -> tuple[Reduced, Lexicon]:
        wrong = np.zeros(10)
        wrong[3] = rng.normal(0.0, 3.0 if odd else 0.3)
        return Reduced(information, information @ wrong + root @ rng.normal(size=10)), lexicon

    for share in (0, 20):
        found = floors([drawn(bool(share) and i % share == 0) for i in range(200)])
        together = np.sqrt(sum(x**2 for x in found.values()))
        assert together == pytest.approx(0.3, rel=0.3)


def test_floors_are_where_the_trips_are_likeliest() -> None:
    """Given trips with two unlike effects, then finite differences of the joint likelihood of their signals, a normal
    law of the noise and the floors, vanish at the floors found."""
    rng = np.random.default_rng(3)
    information = np.array([[100.0, 30.0], [30.0, 25.0]])
    lexicon = Lexicon(tuple(Variant(f"effect_{i}", VARIANT.columns, {}, VARIANT.make) for i in range(2)), ())
    scores = [
        information @ rng.normal(0.0, (0.3, 0.5)) + np.linalg.cholesky(information) @ rng.normal(size=2)
        for _ in range(300)
    ]
    found = floors([(Reduced(information, b), lexicon) for b in scores])

    def log(f0: float, f1: float) -> float:
        total = 0.0
        for b in scores:
            logs = []
            for times, share in ODD:
                law = multivariate_normal(
                    np.zeros(2), information + information @ np.diag([f0**2, f1**2]) @ information * times**2
                )
                logs.append(np.log(share) + law.logpdf(b))
            total += float(np.logaddexp.reduce(logs))
        return total

    best = found["effect_0.factor"], found["effect_1.factor"]
    for step in (0.03, -0.03):
        assert log(best[0] * (1 + step), best[1]) < log(*best)
        assert log(best[0], best[1] * (1 + step)) < log(*best)


def test_the_score_rewards_calibration() -> None:
    """Given causes whose evidence says little and which are right half of the time, then a temperature that makes the
    probabilities say so scores better than one that makes them certain."""

    def weak(log: float) -> Hypotheses:
        fit = Fit(log, 2.0 * log, np.zeros(1), np.eye(1))
        return Hypotheses({"mass": log}, {"mass": (VARIANT, fit)}, {}, -30.0, None)

    cases = [(_case(0.0, 1.0, kind), weak(8.0)) for kind in ("gap_free", "single") * 5]
    sure = log_score(cases, Thresholds(barrier=0.0, temperature=0.2))
    honest = log_score(cases, Thresholds(barrier=8.0, temperature=1.0))
    assert honest < sure


def test_kept_evidence_is_plain_arrays(tmp_path: Path) -> None:
    """Given evidence that was kept, then it is read back the same; given a file that holds objects which reading would
    have to build, or none at all, then it is refused in one line that names it."""
    reduced = Reduced(np.diag([4.0, 9.0]), np.array([1.0, 2.0]))
    layout = Layout(("map.a", "map.b"), np.array([1.0, 2.0]), ("tolerance.mass",), np.array([0.02]), 1, 1)
    with pytest.raises(BadInput, match=r"evidence\.npz"):
        read_evidence(tmp_path)
    write_evidence(tmp_path, reduced, layout, ("mass",))
    again, shape, hide = read_evidence(tmp_path)
    np.testing.assert_array_equal(again.information, reduced.information)
    np.testing.assert_array_equal(again.vector, reduced.vector)
    assert (shape.calibration, shape.tolerance, shape.effects, shape.generics) == (
        layout.calibration, layout.tolerance, 1, 1,
    )  # fmt: skip
    assert hide == ("mass",)
    with (tmp_path / "evidence.npz").open("wb") as file:
        np.savez(file, information=np.array([{"an": "object"}], dtype=object))
    with pytest.raises(BadInput, match=r"evidence\.npz"):
        read_evidence(tmp_path)
