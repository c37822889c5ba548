"""The generic correction of what the catalogue does not hold: what it is worth on a trip that it has not seen."""

import numpy as np
import pytest

from rollingroad.gap.design import default_noise
from rollingroad.gap.evidence import Calibration, Layout
from rollingroad.gap.generic import Regressor
from rollingroad.gap.shrinkage import _Case, _kept, _lengths

LAYOUT = Layout(("map",), np.array([2.0]), ("mass",), np.array([0.5]), 3, 0)
CALIBRATION = Calibration(np.array([[1e6]]), np.array([0.0]), default_noise(), 1.0, 3)


def _trips(second: list[float]) -> tuple[list[_Case], list[np.ndarray]]:
    """One trip for each of `second`: all have a term of size 1; the second term has that size in each."""
    rng = np.random.default_rng(3)
    cases, grams = [], []
    for size in second:
        columns = rng.normal(size=(400, 5))
        y = columns[:, 2] + size * columns[:, 3] + 0.1 * rng.normal(size=400)
        both = np.column_stack([columns, y])
        none = np.zeros((400, 1))
        cases.append(_Case(y, none, columns[:, 2:], np.arange(400), np.ones(400), 1.0, 0.0))
        grams.append(both.T @ both)
    return cases, grams


@pytest.mark.parametrize(
    "second, terms", [([2.0, -2.0, 2.0, -2.0], 1), ([2.0, 2.0, 2.0, 2.0], 2)], ids=["each its own", "all alike"]
)
def test_a_term_that_says_nothing_of_other_trips_is_not_offered(second: list[float], terms: int) -> None:
    """Given a second term of another sign in every trip, then the correction is the first alone; alike in all: both."""
    cases, grams = _trips(second)
    kept = _kept(cases, grams, np.array([0, 1]), np.array([3.0, 3.0]), [0, 1, 2], LAYOUT, CALIBRATION)
    assert kept == [terms] * len(second)


def test_one_trip_to_fit_on_tells_one_term() -> None:
    """Given two trips, of which one is left to fit on and none to judge by, then the first term alone is offered."""
    cases, grams = _trips([2.0, -2.0])
    kept = _kept(cases, grams, np.array([0, 1]), np.array([3.0, 3.0]), [0, 1, 2], LAYOUT, CALIBRATION)
    assert kept == [1, 1]


def test_a_family_of_terms_stands_or_falls_together() -> None:
    """Given a phase's cosine and sine between two lone terms, then no correction has one of them without the other."""
    families = ("", "cycle", "cycle", "")
    found = [Regressor(str(i), "", "W", 1.0, "accessory", family) for i, family in enumerate(families)]
    assert _lengths(found) == [0, 1, 3, 4]
