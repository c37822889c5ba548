"""Seed 001: theorem 2 and its examples, the three ways to A_q, stationarity by a rule, and the simulation study."""

from itertools import pairwise

import numpy as np
import pytest

from observer import bias_augmentation as bias
from observer.diesel import SCALE, DieselObserver, diesel_jacobian, diesel_rates, run_filter
from vehicle_model.car.diesel_engine import DieselParameters
from vehicle_model.plant.diesel import schedule, simulate_diesel, transient_cycle

STEP = 0.01
TWO_OF_THREE = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
SOME_A = np.array([[-2.0, 1.0, 0.5], [0.3, -1.5, 0.7], [0.4, 0.2, -1.0]])


def rank_of_observability_matrix(F, C):
    rows = [C]
    for _ in range(len(F) - 1):
        rows.append(rows[-1] @ F)
    return np.linalg.matrix_rank(np.vstack(rows), tol=1e-10)


def test_example_1_a_column_in_the_kernel_of_c_is_not_possible():
    assert not bias.possible(SOME_A, TWO_OF_THREE, np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]]))
    for row in (0, 1):  # either zero of the second column made a one; row 0 makes the columns' seen parts parallel
        A_q = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
        A_q[row, 1] = 1.0
        assert bias.possible(SOME_A, TWO_OF_THREE, A_q) == (row == 1)


def test_example_2_the_largest_augmentations():
    assert bias.possible(SOME_A, TWO_OF_THREE, np.array([[2.0, 0.0], [0.0, 3.0], [0.0, 0.0]]))
    assert bias.possible(SOME_A, TWO_OF_THREE, np.array([[0.0, 2.0], [3.0, 0.0], [0.0, 0.0]]))
    assert not bias.possible(SOME_A, TWO_OF_THREE, np.array([[2.0, 0.0], [0.0, 0.0], [0.0, 3.0]]))
    largest = bias.largest_augmentation(TWO_OF_THREE)
    assert largest.shape == (3, 2) and bias.possible(SOME_A, TWO_OF_THREE, largest)
    with pytest.raises(ValueError):
        bias.possible(SOME_A, np.zeros((1, 3)), largest)


def test_example_3_rows_that_c_does_not_see_come_out_zero():
    F = np.array([[1.0, 1.0, -1.0], [-1.0, 0.0, 1.0], [1.0, 1.0, -1.0]])
    rng = np.random.default_rng(0)
    for _ in range(5):
        K = 0.3 * rng.normal(size=(3, 2))
        G = bias.residual_gain(TWO_OF_THREE, F, K)
        residual = G @ np.array([1.0, 1.0, 1.0])
        found = bias.from_residuals(residual[None], G[None])[:, 0]
        assert found[2] == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(found[:2], [1.0, 1.0], atol=1e-9)


def test_theorem_2_agrees_with_the_rank_of_the_observability_matrix():
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(200):
        A = rng.normal(size=(3, 3))
        C = rng.integers(0, 2, size=(2, 3)).astype(float)
        A_q = rng.integers(-1, 2, size=(3, rng.integers(1, 4))).astype(float)
        if not bias.observable(np.eye(3) + A, C):
            continue
        F, C_aug = bias.augmented_system(A, C, A_q, 0.1)
        wanted = rank_of_observability_matrix(F, C_aug) == len(F)
        assert bias.possible(A, C, A_q) == wanted
        seen.add(wanted)
    assert seen == {True, False}


def test_theorem_2_does_not_hold_for_a_singular_a():
    """A integrates nothing in one direction: C A_q has full rank, and yet the augmented model is not observable."""
    A = np.array([[-1.0, 1.0], [0.0, 0.0]])
    C = np.array([[1.0, 0.0]])
    A_q = np.array([[1.0], [1.0]])
    assert np.linalg.matrix_rank(C @ A_q) == 1 and bias.observable(np.eye(2) + 0.1 * A, C)
    F, C_aug = bias.augmented_system(A, C, A_q, 0.1)
    assert not bias.observable(F, C_aug)
    with pytest.raises(ValueError, match="non-singular"):
        bias.possible(A, C, A_q)
    with pytest.raises(ValueError, match="observable"):
        bias.possible(np.diag([-1.0, -2.0]), C, A_q)


def test_stationary_parts_are_the_flat_ones():
    time = np.arange(6000) * 0.01
    signal = np.interp(time, [0, 20, 25, 45, 45.01, 60], [1, 1, 3, 3, 5, 5])[:, None]
    signal = signal + 0.01 * np.random.default_rng(0).normal(size=signal.shape)
    parts = bias.stationary_parts(signal, 300, np.array([0.05]))
    assert len(parts) == 3
    for (start, end), (low, high) in zip(parts, [(0, 2000), (2500, 4500), (4500, 6000)], strict=True):
        # a window may lean over the edge by what the tolerance lets pass
        assert abs(start - low) < 60 and abs(end - high) < 60
    ramp = np.linspace(0.0, 10.0, 1000)[:, None]
    assert bias.stationary_parts(ramp, 300, np.array([0.05])) == []
    assert bias.stationary_parts(ramp[:100], 300, np.array([0.05])) == []
    settled = bias.stationary_parts(signal, 300, np.array([0.05]), settle=200)
    assert [s for s, _ in settled] == [s + 200 for s, _ in parts]


def test_order_from_singular_values():
    assert bias.significant(np.array([136.0, 30.0, 0.01]), noise=1.0) == 2
    assert bias.significant(np.array([1303.0, 24.0, 0.92]), noise=1.0) == 1
    assert bias.significant(np.array([0.4, 0.3, 0.2]), noise=1.0) == 0


def held_cycle(seed, points=30, hold=9.0, ramp=2.0):
    """Operating points held, with ramps between."""
    rng = np.random.default_rng(seed)
    goals = np.column_stack([rng.uniform(40, 200, points), rng.uniform(1000, 1900, points)])
    parts = []
    for now, after in pairwise(goals):
        parts += [np.tile(now, (round(hold / STEP), 1)), np.linspace(now, after, round(ramp / STEP))]
    driven = np.vstack(parts)
    return np.column_stack([driven, schedule(driven[:, 0], driven[:, 1])])


def measure(inputs, seed, **plant):
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(len(inputs), 3)) * [100.0, 100.0, 2.0]
    run = simulate_diesel(inputs, disturbance=noise, **plant)
    return run, run.state + rng.normal(size=(len(inputs), 3)) * [500.0, 500.0, 20.0]


ALL = {"sensors": (0, 1, 2), "noise": (500.0, 500.0, 20.0), "walk": (1e3, 1e3, 20.0)}
WITHOUT_EXHAUST = {"sensors": (0, 2), "noise": (500.0, 20.0), "walk": (1e3, 1e3, 20.0)}
TRUE_A_Q = np.array([[1.0, -2.0], [2.0, 1.0], [0.0, 0.0]])
"""Of the seed's simulation study, 6.1."""


def slow_bias(n):
    time = np.arange(n) * STEP
    q = 2500.0 * np.stack([1.0 + np.sin(time / 60.0), np.sin(time / 40.0 + 1.0)], axis=1)
    return q @ TRUE_A_Q.T


def stationary_biases(found, inputs):
    """Approach 2 on the stretches that the rule picks from the inputs."""
    parts = bias.stationary_parts(inputs[:, :2], 300, np.array([2.0, 5.0]), settle=300)
    C = np.eye(3)
    residuals = np.array([found.residual[a:b].mean(axis=0) for a, b in parts])
    gains = np.array(
        [bias.residual_gain(C, found.transition[a:b].mean(axis=0), found.gain[a:b].mean(axis=0)) for a, b in parts]
    )
    return bias.from_residuals(residuals, gains)


@pytest.fixture(scope="module")
def study():
    inputs = held_cycle(0)
    run, measured = measure(inputs, 1, bias=slow_bias(len(inputs)), actuators=False)
    return inputs, run, measured


def test_approach_2_recovers_the_space_of_the_bias(study):
    inputs, run, measured = study
    found = run_filter(DieselObserver(**ALL), inputs, measured, STEP, run.state[0])
    augmentation = bias.decompose(stationary_biases(found, inputs), scale=SCALE, share=0.1)
    assert augmentation.order == 2
    first, second, third = augmentation.singular_values
    assert second > 10.0 * third and first < 10.0 * second
    assert bias.subspace_angle(augmentation.basis / SCALE[:, None], TRUE_A_Q / SCALE[:, None]) < 0.05
    assert bias.possible(found.transition[500] - np.eye(3), np.eye(3), augmentation.basis)
    # two independent biases of the pressures cannot be told apart without a sensor for the second (section 3)
    assert not bias.possible(found.transition[500] - np.eye(3), np.eye(3)[[0, 2]], TRUE_A_Q)


def test_approach_1_reads_the_space_off_the_measurements():
    """Given little noise and a bias small enough for the linearisation (4.1); noise shows as a third direction."""
    p = DieselParameters()
    inputs = held_cycle(0)
    run = simulate_diesel(inputs, bias=0.1 * slow_bias(len(inputs)), actuators=False)
    spaces = []
    for noise in (0.0, 20.0):
        measured = run.state + noise * np.random.default_rng(3).normal(size=run.state.shape)
        index = np.arange(800, len(inputs) - 1, 200)
        rates = np.array([diesel_rates(*measured[k], 0.0, inputs[k], p) for k in index])
        F = np.array([np.eye(3) + STEP * diesel_jacobian(measured[k], 0.0, inputs[k], p) for k in index])
        found = bias.from_measurements(measured[index + 1], measured[index] + STEP * rates, F)
        spaces.append(bias.decompose(found, scale=SCALE, order=2))
    clean, noisy = spaces
    assert bias.subspace_angle(clean.basis / SCALE[:, None], TRUE_A_Q / SCALE[:, None]) < 0.08
    assert clean.singular_values[1] > 5.0 * clean.singular_values[2]
    assert noisy.singular_values[2] > 5.0 * clean.singular_values[2]


def test_approach_3_finds_the_same_space(study):
    """As many bias states as theorem 2 allows, then the stationary parts of what they did."""
    inputs, run, measured = study
    full = DieselObserver(**ALL, augmentation=bias.largest_augmentation(np.eye(3)) * SCALE, augmentation_walk=0.02,
                          augmentation_start=0.1)  # fmt: skip
    found = run_filter(full, inputs, measured, STEP, run.state[0])
    parts = bias.stationary_parts(inputs[:, :2], 300, np.array([2.0, 5.0]), settle=300)
    moved = np.array([(found.bias[a:b] * SCALE).mean(axis=0) for a, b in parts]).T
    augmentation = bias.decompose(moved, scale=SCALE, share=0.1)
    assert augmentation.order == 2
    assert bias.subspace_angle(augmentation.basis / SCALE[:, None], TRUE_A_Q / SCALE[:, None]) < 0.08


def test_the_augmented_observer_loses_the_bias(study):
    inputs, run, measured = study
    found = run_filter(DieselObserver(**ALL), inputs, measured, STEP, run.state[0])
    A_q = bias.decompose(stationary_biases(found, inputs), scale=SCALE, order=2).basis
    cycle = transient_cycle(3, 300.0)
    truth, seen = measure(cycle, 5, bias=slow_bias(len(cycle)), actuators=False)
    default = run_filter(DieselObserver(**ALL), cycle, seen, STEP, truth.state[0])
    augmented = run_filter(
        DieselObserver(**ALL, augmentation=A_q, augmentation_walk=0.01, augmentation_start=0.1),
        cycle, seen, STEP, truth.state[0],
    )  # fmt: skip
    before, after = (np.abs((e.state - truth.state).mean(axis=0)) for e in (default, augmented))
    assert np.all(after < 0.5 * before)


def test_an_extra_sensor_in_design_helps_without_it_afterwards():
    """6.2: exhaust pressure is measured only to find A_q; the observer that uses A_q never sees it."""
    nominal = DieselParameters()
    wrong = nominal._replace(
        c_vol3=0.97 * nominal.c_vol3, A_vgtmax=0.94 * nominal.A_vgtmax, A_egrmax=1.1 * nominal.A_egrmax,
        eta_sc=1.02 * nominal.eta_sc,
    )  # fmt: skip
    inputs = held_cycle(1)
    run, measured = measure(inputs, 2, parameters=wrong)
    found = run_filter(DieselObserver(**ALL), inputs, measured, STEP, run.state[0])
    augmentation = bias.decompose(stationary_biases(found, inputs), scale=SCALE, share=0.2)
    assert augmentation.order == 1
    assert bias.possible(found.transition[500] - np.eye(3), np.eye(3)[[0, 2]], augmentation.basis)
    cycle = transient_cycle(3, 600.0)
    truth, seen = measure(cycle, 5, parameters=wrong)
    default, augmented = (
        run_filter(DieselObserver(**WITHOUT_EXHAUST, augmentation=A_q, augmentation_walk=0.02, augmentation_start=0.3),
                   cycle, seen[:, [0, 2]], STEP, truth.state[0])
        for A_q in (np.zeros((3, 0)), augmentation.basis)
    )  # fmt: skip
    before, after = (np.abs((e.state - truth.state).mean(axis=0)) for e in (default, augmented))
    assert after[1] < 0.5 * before[1]
