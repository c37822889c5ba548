"""Seed 003's engine: model and truth against conservation and each other, the orderings of the expected error."""

from itertools import pairwise

import numpy as np
import pytest

from observer.selection.engine import INTAKE_BURNT, NOMINAL, SCALE, STATES, dynamics, equilibrium, linearised, orifice
from rollingroad.engine_sensors import Study, study
from vehicle_model.plant.si_engine_egr import drive_cycle, run


@pytest.fixture(scope="module")
def rest():
    return equilibrium()


@pytest.fixture(scope="module")
def found() -> Study:
    return study(duration=20.0, swing=0.2)


def value(x, name: str) -> float:
    return float(x[STATES.index(name)])


def test_at_rest_mass_is_conserved_and_the_burnt_share_is_what_was_recycled(rest):
    assert np.abs(dynamics(rest, NOMINAL) / SCALE).max() < 1e-3
    recycled = value(rest, "maf") - value(rest, "maf_air")
    share = recycled / value(rest, "maf")
    assert value(rest, "intake_burnt") == pytest.approx(share * value(rest, "tail_burnt"), rel=1e-3)
    assert 0.01 < share < 0.11 and value(rest, "maf_high") == pytest.approx(value(rest, "maf"))


def test_a_nozzle_chokes_and_reverses():
    assert orifice(1e-4, 2e5, 300.0, 0.5e5) == pytest.approx(orifice(1e-4, 2e5, 300.0, 0.9e5))
    # choked flow of air: 0.0404 A p / sqrt(T)
    assert orifice(1e-4, 2e5, 300.0, 0.5e5) == pytest.approx(0.0404 * 1e-4 * 2e5 / np.sqrt(300.0), rel=2e-3)
    assert orifice(1e-4, 1e5, 300.0, 2e5) == pytest.approx(-orifice(1e-4, 2e5, 300.0, 1e5))


def test_the_linear_model_is_stable_and_foretells_a_small_step(rest):
    a, b = linearised(rest)
    assert np.linalg.eigvals(a).real.max() < 0.0
    opened = NOMINAL._replace(egr_valve=NOMINAL.egr_valve * 1.02)
    moved = (dynamics(rest, opened) - dynamics(rest, NOMINAL)) / SCALE
    assert b[:, 2] * 0.02 * NOMINAL.egr_valve == pytest.approx(moved, abs=1e-3)


def test_the_truth_rests_near_the_model_and_follows_the_valve(rest):
    commands = drive_cycle(6.0, swing=0.0)
    held = run(rest, commands)[-1]
    for name in ("boost_pressure", "intake_pressure", "tail_pressure", "intake_burnt", "maf"):
        assert value(held, name) == pytest.approx(value(rest, name), rel=0.1)
    commands[:, 2] *= 1.3
    assert run(rest, commands)[-1, INTAKE_BURNT] > 1.3 * held[INTAKE_BURNT]


def test_expected_errors_have_the_papers_order(found):
    by_count = {n: [i for i, names in enumerate(found.sets) if len(names) == n] for n in range(5)}
    best = {n: min(rows, key=lambda i: found.expected[i]) for n, rows in by_count.items()}
    assert found.sets[best[1]] == ("EGR dp",)
    assert found.sets[best[2]] == ("EGR dp", "MAFa")
    lowest = [found.expected[best[n]] for n in range(5)]
    assert all(a >= b for a, b in pairwise(lowest))
    assert 1.0 - lowest[3] / lowest[2] < 0.02 < 0.2 < 1.0 - lowest[2] / lowest[1], "two sensors are enough"


def test_near_the_operating_point_the_best_pair_halves_the_models_error(found):
    error = dict(zip(found.sets, found.simulated, strict=True))
    assert error["EGR dp", "MAFa"] < 0.5 * error[()]
