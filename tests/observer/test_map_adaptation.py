"""Seed 002: maps that adapt while driving, on the truck's air-flow sensor and on our car's engine."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_drive import CAR, RPM, drive, true_efficiency, true_power

from observer import map_adaptation as adaptation
from observer.diesel import DieselObserver, limit_covariance, run_filter
from observer.estimate import STATES
from observer.fit_form import Fit
from vehicle_model.car.diesel_engine import DieselParameters
from vehicle_model.plant.diesel import simulate_diesel, transient_cycle

STEP = 0.01
NODES = np.arange(1, 13) * 0.05
ERROR = np.array([-0.02, 0.01, 0.05, 0.07, 0.06, 0.03, 0.0, -0.03, -0.05, -0.04, -0.02, 0.0])
"""A sensor error map of the published one's kind: a few per cent, both signs, over the air flow."""
AIR_FLOW_ONLY = {"sensors": (3,), "noise": (0.002,), "walk": (1e3, 1e3, 20.0)}
MAP = {"nodes": NODES, "node_walk": 1e-4, "node_start": 0.05}


def test_interpolation_weights():
    index, weights = adaptation.linear_weights(NODES, 0.12)
    assert index.tolist() == [1, 2] and weights == pytest.approx([0.6, 0.4])
    for outside, node in ((0.0, 0), (9.0, 11)):
        index, weights = adaptation.linear_weights(NODES, outside)
        assert dict(zip(index.tolist(), weights.tolist(), strict=True))[node] == 1.0
    rows, columns = np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0])
    plane = (2.0 + 3.0 * rows[:, None] - columns).ravel()
    index, weights = adaptation.bilinear_weights(rows, columns, 2.2, 0.7)
    assert weights.sum() == pytest.approx(1.0) and weights @ plane[index] == pytest.approx(2.0 + 6.6 - 0.7)


def test_unvisited_nodes_grow_uncertain_up_to_the_limit_and_visited_ones_resist_outliers():
    nodes = adaptation.NodeFilter(np.zeros(3), np.diag([0.01, 0.01, 0.01]), np.full(3, 0.01), walk=1e-3)
    for _ in range(500):
        nodes = adaptation.grow(nodes, 10.0)
        nodes = adaptation.observe_node(nodes, np.array([0, 1]), np.array([0.5, 0.5]), 0.02, 1e-4)
    seen, unseen = nodes.covariance[0, 0] + nodes.covariance[0, 1], nodes.covariance[2, 2]
    assert unseen == pytest.approx(0.01) and seen < 0.01
    hit = adaptation.observe_node(nodes, np.array([0, 1]), np.array([0.5, 0.5]), 5.0, 1e-4)
    assert hit.rejected == nodes.rejected + 1 and np.array_equal(hit.value, nodes.value)
    old = adaptation.observe_node(nodes, np.array([2]), np.array([1.0]), 0.05, 1e-4)
    daily = adaptation.observe_node(nodes, np.array([0, 1]), np.array([0.5, 0.5]), 0.05, 1e-4)
    assert old.value[2] > 0.045 and daily.value[0] - nodes.value[0] < 0.015


def test_limited_covariances_stay_positive_definite():
    rng = np.random.default_rng(0)
    for _ in range(50):
        root = rng.normal(size=(8, 10))
        P = root @ root.T
        limit = rng.uniform(0.5, 3.0, 8)
        scaled = adaptation.limited(P, limit)
        assert np.linalg.eigvalsh(scaled)[0] > 0 and np.all(np.diag(scaled) <= limit + 1e-12)
        compiled = P.copy()
        limit_covariance(compiled, 0, limit)
        np.testing.assert_allclose(compiled, scaled)


@pytest.fixture(scope="module")
def cycle():
    rng = np.random.default_rng(0)
    inputs = transient_cycle(0, 900.0)
    noise = rng.normal(size=(len(inputs), 3)) * [100.0, 100.0, 2.0]
    run = simulate_diesel(inputs, disturbance=noise, actuators=False)
    air = run.flows[:, 0]
    return run, air, (1.0 + np.interp(air, NODES, ERROR)) * air + 0.002 * rng.normal(size=len(air))


def visited(air):
    """Nodes with at least five seconds of driving within half a step."""
    return np.array([STEP * np.sum(np.abs(air - node) < 0.025) for node in NODES]) > 5.0


def test_the_error_map_is_found_in_one_pass(cycle):
    run, air, measured = cycle
    found = run_filter(DieselObserver(**AIR_FLOW_ONLY, **MAP), run.inputs, measured[:, None], STEP, run.state[0])
    off = np.abs(found.nodes[-1] - ERROR)[visited(air)] / np.ptp(ERROR)
    assert visited(air).sum() >= 9 and off.max() < 0.10
    assert np.linalg.eigvalsh(found.covariance)[0] > 0
    assert np.all(found.variance[:, 3:] <= 0.05**2 * (1 + 1e-9))


def test_def_aug_map_compare_as_published(cycle):
    """Table 1: Aug and Map alike, both far better than Def."""
    run, air, measured = cycle
    observers = {
        "Def": DieselObserver(**AIR_FLOW_ONLY),
        "Aug": DieselObserver(**AIR_FLOW_ONLY, additive=True, augmentation_walk=0.02, augmentation_start=0.02),
        "Map": DieselObserver(**AIR_FLOW_ONLY, **MAP),
    }
    worst, mean = {}, {}
    for name, observer in observers.items():
        found = run_filter(observer, run.inputs, measured[:, None], STEP, run.state[0])
        error = np.column_stack([found.state - run.state, found.air_flow - air])
        worst[name], mean[name] = np.abs(error).max(axis=0), np.abs(error).mean(axis=0)
    assert np.all(worst["Map"] < 0.5 * worst["Def"]) and np.all(mean["Map"] < 0.2 * mean["Def"])
    assert np.all(worst["Aug"] < 0.5 * worst["Def"]) and np.all(mean["Aug"] < 0.2 * mean["Def"])
    assert np.all(mean["Map"] < 1.1 * mean["Aug"])


def test_occasional_wild_measurements_do_not_spoil_the_map(cycle):
    run, air, measured = cycle
    rng = np.random.default_rng(3)
    spoilt = measured.copy()
    hit = rng.choice(len(air), len(air) // 100, replace=False)
    spoilt[hit] += rng.choice([-0.2, 0.2], len(hit))
    gated = DieselObserver(**AIR_FLOW_ONLY, **MAP, gate=5.0)
    found = run_filter(gated, run.inputs, spoilt[:, None], STEP, run.state[0])
    assert (np.abs(found.nodes[-1] - ERROR)[visited(air)] / np.ptp(ERROR)).max() < 0.10


@pytest.mark.parametrize("wrong", [{"A_egrmax": 1.2}, {"c_vol3": 0.98}, {"c_wphi3": 1.05}], ids=str)
@pytest.mark.parametrize("told_noise", [0.001, 0.008])
def test_model_errors_and_wrong_noise_do_not_make_it_diverge(cycle, wrong, told_noise):
    run = cycle[0]
    nominal = DieselParameters()
    real = nominal._replace(**{name: factor * getattr(nominal, name) for name, factor in wrong.items()})
    inputs = run.inputs[:30000]
    engine = simulate_diesel(inputs, parameters=real)
    air = engine.flows[:, 0]
    measured = (1.0 + np.interp(air, NODES, ERROR)) * air + 0.002 * np.random.default_rng(1).normal(size=len(air))
    observer = DieselObserver(**{**AIR_FLOW_ONLY, "noise": (told_noise,)}, **MAP)
    found = run_filter(observer, inputs, measured[:, None], STEP, engine.state[0])
    assert np.all(np.abs(found.state / engine.state - 1.0).mean(axis=0) < 0.10)
    assert np.abs(found.nodes[5000:]).max() < 0.15 and np.linalg.eigvalsh(found.covariance)[0] > 0


def test_the_compressors_own_error_needs_a_state_of_its_own(cycle):
    """Table 2: with Delta_W the intake pressure loses its bias."""
    run = cycle[0]
    nominal = DieselParameters()
    inputs = run.inputs[:60000]
    engine = simulate_diesel(inputs, parameters=nominal._replace(c_wphi3=1.08 * nominal.c_wphi3))
    air = engine.flows[:, 0]
    rng = np.random.default_rng(2)
    measured = np.column_stack([engine.state[:, 0], engine.state[:, 2], (1.0 + np.interp(air, NODES, ERROR)) * air])
    measured = measured + rng.normal(size=measured.shape) * [500.0, 20.0, 0.002]
    sensors = {"sensors": (0, 2, 3), "noise": (500.0, 20.0, 0.002), "walk": (1e3, 1e3, 20.0)}
    bias = {}
    for own in (True, False):
        found = run_filter(
            DieselObserver(**sensors, **MAP, compressor_error=own), inputs, measured, STEP, engine.state[0]
        )
        bias[own] = abs((found.state - engine.state)[:, 0].mean())
    assert bias[True] < 0.5 * bias[False]


class TrueFit(Fit):
    name, r2, r2_efficiency = "true", 1.0, 1.0

    def fuel_power(self, engine_speed, torque):
        return true_power(np.asarray(engine_speed), np.asarray(torque))


def fouled(estimate, by):
    """The same drive with injectors that need `by` (of engine speed, torque) more opening for the same work."""
    rows = estimate.state.copy()
    omega = rows[:, STATES.index("engine_speed")]
    torque = rows[:, STATES.index("thrust")] * rows[:, STATES.index("speed")] / np.maximum(omega, 1.0)
    rows[:, STATES.index("fuel_power")] *= 1.0 + by(omega, torque)
    return replace(estimate, state=rows, smoothed=rows)


def test_our_cars_map_follows_fouled_injectors():
    """Given an engine known well, when its injectors foul by 6 % at low load, then the nodes show it, there, online."""

    def by(omega, torque):
        return 0.06 * np.clip(1.0 - torque / 80.0, 0.0, 1.0)

    adapted = adaptation.fresh_map(CAR)
    clean = adaptation.adapt(adapted, drive(0), CAR, TrueFit())
    assert np.abs(clean.correction[clean.deviation < 0.015]).max() < 0.02
    aged = clean
    for seed in (1, 2, 3):
        aged = adaptation.adapt(aged, fouled(drive(seed), by), CAR, TrueFit())
    known = aged.deviation < 0.015
    truth = by(aged.engine_speed[:, None], np.broadcast_to(aged.torque, aged.correction.shape))
    assert known.sum() > 10
    assert np.sqrt(np.mean((aged.correction - truth)[known] ** 2)) < 0.012
    fit = adaptation.AdaptedFit(TrueFit(), aged)
    omega, torque = np.array([2500 * RPM]), np.array([20.0])
    wanted = true_efficiency(omega, torque) / (1.0 + by(omega, torque))
    assert fit.efficiency(omega, torque) == pytest.approx(wanted, rel=0.02)
    # an old map says how old it is
    assert adaptation.grow(aged.nodes, 36000.0).covariance[0, 0] >= aged.nodes.covariance[0, 0]
