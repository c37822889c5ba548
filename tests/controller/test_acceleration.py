"""The principle in one dimension: pointwise maxima, synthesis as oracle for shooting, conserved H, bad input."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad

from controller import acceleration_kernel as kernel
from controller.acceleration import shoot, synthesis_table
from controller.acceleration_multiple import multiple_shooting
from controller.controller_model import PHI, THESIS, THESIS_CVT
from controller.problem import acceleration_problem
from vehicle_model.car.errors import BadInput

P, RATIOS = THESIS.kernel_parameters(), np.array(THESIS.ratios)


def hamiltonian(v, costate, w, t):
    """By hand, from 4.3 and table 4.1."""
    phi = PHI[0] + PHI[1] * w + PHI[2] * t + PHI[3] * w * t + PHI[4] * w**2 + PHI[5] * t**2
    road = 0.5 * 1.2 * 0.39 * 1.93 * v**2 + 920 * 0.010 * 9.805
    return costate / 948 * (w * t / v - road) - w * t * phi


def test_closed_form_torque_beats_a_fine_grid():
    rng = np.random.default_rng(1)
    for _ in range(200):
        v, costate = rng.uniform(3, 45), rng.uniform(0, 3e5)
        for n in RATIOS:
            if not P[9] <= n * v <= P[10]:
                continue
            t, h = kernel.best_torque(P, v, costate, n)
            grid = hamiltonian(v, costate, n * v, np.linspace(5, 100, 2001))
            assert h == pytest.approx(hamiltonian(v, costate, n * v, t), rel=1e-9, abs=1e-6)
            assert h >= grid.max() - 1e-6


def test_cvt_maximum_beats_a_fine_grid():
    rng = np.random.default_rng(2)
    w, t = np.meshgrid(np.linspace(P[9], P[10], 301), np.linspace(5, 100, 301))
    for mu in rng.uniform(0, 12, 60):
        _, _, value = kernel.best_pair(P, mu)
        phi = PHI[0] + PHI[1] * w + PHI[2] * t + PHI[3] * w * t + PHI[4] * w**2 + PHI[5] * t**2
        assert value >= np.max(w * t * (mu - phi)) - 1e-6


def test_printed_maximum_condition_is_always_full_power():
    """ERRATA on 4.4.1: with 1/eta + lambda/(M v), a sum of positive terms, the corner of full power always wins."""
    w, t = np.meshgrid(np.linspace(P[9], P[10], 101), np.linspace(5, 100, 101))
    phi = PHI[0] + PHI[1] * w + PHI[2] * t + PHI[3] * w * t + PHI[4] * w**2 + PHI[5] * t**2
    for mu in (0.0, 1.0, 5.0):
        printed = np.unravel_index(np.argmax(w * t * (phi + mu)), w.shape)
        assert w[printed] == pytest.approx(P[10])
        assert t[printed] == pytest.approx(100.0)
    assert kernel.best_pair(P, 3.0)[0] < 0.9 * P[10]


def test_pointwise_synthesis_is_an_oracle_for_shooting():
    """H = 0 gives lambda_v without any integration; J = integral of lambda_v dv."""
    answer = shoot(THESIS, 10.0, 100 / 3.6, None)
    table = synthesis_table(THESIS, answer.state[:, 0])
    assert table[:, 0] == pytest.approx(answer.costate[:, 0], rel=1e-6)
    points = sorted(s.speed for s in answer.shifts)
    integral, _ = quad(
        lambda v: synthesis_table(THESIS, np.array([v]))[0, 0], 10.0, 100 / 3.6, points=points, limit=200
    )
    assert answer.cost == pytest.approx(integral, rel=1e-7)


def test_costate_equation_is_the_derivative_of_the_hamiltonian():
    """d lambda/dt = -dH/dv, by CasADi's automatic differentiation of the problem's own definition."""
    for model, mode in ((THESIS, 3), (THESIS_CVT, 0)):
        problem = acceleration_problem(model, 10.0, 20.0, None)
        v, costate = ca.SX.sym("v"), ca.SX.sym("l")
        u = [ca.SX.sym("u", 1) for _ in problem.control_low]
        h = problem.hamiltonian([v], u, [costate], mode)
        derivative = ca.Function("dh", [v, costate, *u], [ca.gradient(h, v)])
        ratios = np.asarray(model.ratios, float)
        for speed, worth in ((12.0, 3e4), (18.0, 6e4)):
            _, dl, _, w, t = kernel.rates(P, ratios, mode, speed, worth)
            control = [w, t] if model.cvt else [t]
            assert dl == pytest.approx(-float(derivative(speed, worth, *control)), rel=1e-9)


def test_hamiltonian_is_conserved_without_the_projection_to_the_order_of_the_integrator():
    record = np.empty((20_000, 8))
    costate, _ = kernel.free_costate(P, RATIOS, 10.0, 0.0)
    drifts = []
    for dt in (0.2, 0.1, 0.05):
        nodes = kernel.shoot(P, RATIOS, 10.0, costate, 1e3, 25.0, dt, False, record)[0]
        drifts.append(np.abs(record[:nodes, 7]).max())
    assert drifts[2] < 1e-6 * 5e4
    assert drifts[2] < drifts[0]


def test_coasting_belongs_to_the_lowest_ratio():
    """ERRATA on 4.4.2.2: at 36 km/h and 5 N m, first gear burns 12.1 kW, sixth 4.0 kW."""
    first = THESIS.fuel_power(RATIOS[0] * 10.0, 5.0)
    sixth = THESIS.fuel_power(RATIOS[5] * 10.0, 5.0)
    assert first == pytest.approx(12.1e3, rel=5e-3)
    assert sixth == pytest.approx(4.0e3, rel=1e-2)


def test_multiple_shooting_finds_the_same_costate_from_a_poor_guess():
    answer = shoot(THESIS, 10.0, 140 / 3.6, 30.0, certify=False)
    nodes, miss, _ = multiple_shooting(
        THESIS,
        10.0,
        140 / 3.6,
        30.0,
        lambda t: (
            1.01 * np.interp(t, answer.time, answer.state[:, 0]),
            1.03 * np.interp(t, answer.time, answer.costate[:, 0]),
        ),
    )
    assert miss < 1e-8
    assert nodes[0, 1] == pytest.approx(answer.costate[0, 0], rel=1e-6)


def test_more_time_costs_less_and_free_time_is_the_least():
    free = shoot(THESIS, 10.0, 100 / 3.6, None, certify=False)
    shorter = shoot(THESIS, 10.0, 100 / 3.6, 0.97 * free.duration, certify=False)
    assert shorter.cost > free.cost
    assert shorter.duration < free.duration


@pytest.mark.parametrize(
    ("model", "start", "target", "duration", "told"),
    [
        (THESIS, 10.0, 80.0, None, "nearest feasible is"),
        (THESIS, 10.0, 140 / 3.6, 8.0, "nearest feasible is"),
        (THESIS, 1.0, 20.0, None, "nearest feasible in first gear"),
        (THESIS, 10.0, 9.0, None, "above the start speed"),
        (replace(THESIS, torque=(100.0, 5.0)), 10.0, 20.0, None, "lower bounds below upper"),
        (replace(THESIS, phi=(-1.0, 0, 0, 0, 0, 0)), 10.0, 20.0, None, "efficiency above zero and at most one"),
        (replace(THESIS, phi=(0.5, 0, 0, 0, 0, 0)), 10.0, 20.0, None, "efficiency above zero and at most one"),
    ],
)
def test_what_cannot_be_asked_is_refused_with_the_nearest_that_can(model, start, target, duration, told):
    with pytest.raises(BadInput, match=told):
        shoot(model, start, target, duration)
