"""Thresholds chosen on development sets: the floors and the score that they minimise."""

from pathlib import Path

import numpy as np
import pytest

from rollingroad.gap.calibration import Reduced
from rollingroad.gap.challenge.calibrate import Case, floors, log_score
from rollingroad.gap.challenge.kept import read_evidence, write_evidence
from rollingroad.gap.evidence import Hypotheses, Thresholds
from rollingroad.gap.fits import Fit
from rollingroad.gap.signature_form import Column, Variant
from rollingroad.gap.trips import Layout, Library
from vehicle_model.car.errors import BadInput

VARIANT = Variant("mass", (Column("factor", "", 1.0, 2.0),), {}, lambda c: np.zeros((0, 1)))
LIBRARY = Library((VARIANT,), ())
LAYOUT = Layout((), np.zeros(0), (), np.zeros(0), 1, 0)


def _case(x: float, deviation: float, kind: str = "gap_free") -> Case:
    a = deviation**-2.0
    parts = [] if kind == "gap_free" else [{"effect": "mass", "strength": 2.0}]
    key = {"kind": kind, "parts": parts, "hidden": False}
    return Case(key, Reduced(np.array([[a]]), np.array([a * x])), LAYOUT, LIBRARY, ())


def test_a_floor_is_what_noise_does_not_explain() -> None:
    """Given sizes that spread by 0.3 beyond their deviations of 0.1, then the floor is that; given sizes that spread by
    their deviations alone, then there is none."""
    rng = np.random.default_rng(1)
    wide = [_case(float(rng.normal(0.0, np.hypot(0.3, 0.1))), 0.1) for _ in range(200)]
    assert floors(wide)["mass.factor"] == pytest.approx(0.3, rel=0.25)
    calm = [_case(float(rng.normal(0.0, 0.08)), 0.1) for _ in range(200)]
    assert "mass.factor" not in floors(calm)


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
