"""Errata of 4.5, appendix B and appendix G, each checked by an independent route."""

import casadi as ca
import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import solve_ivp

from controller.ball_and_wheel import BallAndWheel, backward_arc, optimal_control, time_optimal
from controller.controller_model import RPM, THESIS_CVT
from controller.distance import corner, corner_solution, lower_hull, with_floor
from controller.linear_quadratic import (
    continuous_regulator,
    discrete_regulator,
    kalman_rank,
    lie_rank,
    riccati_flow,
)
from vehicle_model.car.errors import BadInput


@pytest.mark.parametrize(("rpm", "torque"), [(850, 5), (2000, 30), (3000, 15)])
def test_the_corner_speed_is_the_root_of_the_power_balance(rpm, torque):
    """4.8 with p and q over rho C_d A / 2 (ERRATA on 4.7), against a polynomial root finder."""
    model = with_floor(THESIS_CVT, rpm * RPM, torque)
    roots = np.roots([0.5 * 1.2 * 0.39 * 1.93, 0.0, 0.010 * 920 * 9.805, -rpm * RPM * torque])
    real = roots[np.abs(roots.imag) < 1e-9].real
    assert corner(model).speed == pytest.approx(real[0], rel=1e-10)


def test_the_corner_costate_solves_its_equation_backwards_and_explodes_forwards():
    """4.11 with 1/M_a against integration of 4.4; an error at the start grows by about e^31 over 5 km at 20 m/s."""
    model = with_floor(THESIS_CVT, 2000 * RPM, 30.0)
    answer = corner(model)
    duration = 5000.0 / answer.speed
    w, t, v = 2000 * RPM, 30.0, answer.speed

    def rate(_, costate):
        return costate / 948 * (w * t / v**2 + 1.2 * 0.39 * 1.93 * v) - answer.costate_x

    backwards = solve_ivp(rate, (duration, 0.0), [0.0], rtol=1e-10, atol=1e-6)
    assert backwards.y[0, -1] == pytest.approx(float(answer.costate_v(np.array(duration))), rel=1e-6)
    low = corner(THESIS_CVT)
    assert low.alpha * 5000.0 / low.speed == pytest.approx(31.0, abs=0.5)


@pytest.mark.parametrize(
    ("rpm", "torque", "stands"),
    [(850, 5, False), (1500, 15, False), (2000, 30, True), (2500, 25, True), (3000, 15, True)],
)
def test_the_corner_is_an_extremal_only_for_high_floors(rpm, torque, stands):
    answer = corner_solution(with_floor(THESIS_CVT, rpm * RPM, torque), 5000.0)
    assert (answer.certificate.refused is None) == stands


def test_lower_hull_is_convex_below_and_touches():
    x = np.linspace(0, 5, 101)
    y = x + np.sin(3 * x)
    hull = lower_hull(x, y)
    assert np.all(hull <= y + 1e-12)
    assert np.all(np.diff(hull, 2) >= -1e-9)
    assert hull[0] == y[0]
    assert hull[-1] == y[-1]


def system(seed, n=4, m=2):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(n, n)), rng.normal(size=(n, m))
    q = rng.normal(size=(n, n))
    return a, b, q @ q.T + 0.1 * np.eye(n), np.diag(rng.uniform(0.5, 2.0, m))


@pytest.mark.parametrize("seed", range(6))
def test_continuous_riccati_against_scipy(seed):
    a, b, q, r = system(seed)
    s, gain = continuous_regulator(a, b, q, r)
    assert s == pytest.approx(scipy.linalg.solve_continuous_are(a, b, q, r), rel=1e-7, abs=1e-8)
    assert np.linalg.eigvals(a - b @ gain).real.max() < 0.0


def test_the_printed_sign_of_b7_does_not_settle_on_the_regulator():
    """-dS/dt = SA + A'S - SBR^-1B'S + Q; the printed +Q on the other side is Q with the wrong sign."""
    a, b, q, r = system(3)
    right, _ = continuous_regulator(a, b, q, r)
    residual = right @ a + a.T @ right - right @ b @ np.linalg.solve(r, b.T @ right)
    assert residual + q == pytest.approx(np.zeros_like(q), abs=1e-7)
    assert np.abs(residual - q).max() > 0.1


def test_riccati_flow_is_the_integral_of_the_differential_equation():
    a, b, q, r = system(1)
    start = np.eye(4)

    def rate(_, flat):
        s = flat.reshape(4, 4)
        return (s @ a + a.T @ s - s @ b @ np.linalg.solve(r, b.T @ s) + q).ravel()

    slow = solve_ivp(rate, (0.0, 0.4), start.ravel(), rtol=1e-10, atol=1e-12).y[:, -1].reshape(4, 4)
    assert riccati_flow(a, b, q, r, start, 0.4) == pytest.approx(slow, rel=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_discrete_riccati_against_scipy_and_stable(seed):
    a, b, q, r = system(seed)
    s, gain = discrete_regulator(a, b, q, r)
    assert s == pytest.approx(scipy.linalg.solve_discrete_are(a, b, q, r), rel=1e-7, abs=1e-8)
    assert np.abs(np.linalg.eigvals(a - b @ gain)).max() < 1.0


def test_the_printed_gain_of_b8_is_unstable():
    """K = (B'SB + R)(B')^-1 S A with a pseudo-inverse for the missing one: the loop leaves the unit circle.

    ERRATA's eigenvalue of 7.06 is that of the double integrator held for 0.1 s with Q = I, R = 1/2 (it names no
    example; this one gives its digits).
    """
    a, b = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
    q, r = np.eye(2), np.array([[0.5]])
    s, gain = discrete_regulator(a, b, q, r)
    printed = (b.T @ s @ b + r) @ np.linalg.pinv(b.T).T @ s @ a
    assert np.abs(np.linalg.eigvals(a - b @ gain)).max() < 1.0
    assert np.abs(np.linalg.eigvals(a - b @ printed)).max() == pytest.approx(7.06, abs=0.005)


def test_finite_horizon_starts_from_the_terminal_cost():
    """S_0 = Q_f: one step from x costs x'Qx + u'Ru + (Ax + Bu)'Q_f(Ax + Bu), minimised over u."""
    a, b, q, r = system(2)
    end = 3.0 * np.eye(4)
    s, _ = discrete_regulator(a, b, q, r, end, steps=1)
    x = np.array([1.0, -2.0, 0.5, 1.5])
    u = -np.linalg.solve(b.T @ end @ b + r, b.T @ end @ a @ x)
    after = a @ x + b @ u
    assert x @ s @ x == pytest.approx(x @ q @ x + u @ r @ u + after @ end @ after)


def test_what_cannot_be_stabilised_is_refused():
    a, b = np.diag([1.0, -1.0]), np.array([[0.0], [1.0]])
    with pytest.raises(BadInput, match="stabilise"):
        continuous_regulator(a, b, np.eye(2), np.eye(1))
    with pytest.raises(BadInput, match="stabilise"):
        discrete_regulator(np.diag([1.5, 0.5]), b, np.eye(2), np.eye(1))


def test_controllability_ranks():
    a = np.array([[0.0, 1.0], [0.0, 0.0]])
    assert kalman_rank(a, np.array([[0.0], [1.0]])) == 2
    assert kalman_rank(a, np.array([[1.0], [0.0]])) == 1
    # a unicycle: the drift-free linearisation is not controllable, the brackets span everything
    forward, turn = (lambda x: ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), 0)), (lambda x: ca.vertcat(0, 0, 1))
    still = lambda x: ca.SX.zeros(3)  # noqa: E731
    assert lie_rank(still, [forward, turn], [0.0, 0.0, 0.3], depth=0) == 2
    assert lie_rank(still, [forward, turn], [0.0, 0.0, 0.3], depth=1) == 3
    # for a linear system the brackets give Kalman's matrix
    linear = lambda x: ca.mtimes(ca.DM(a), x)  # noqa: E731
    assert lie_rank(linear, [lambda x: ca.SX([0.0, 1.0])], [0.4, 0.2]) == 2


@pytest.mark.parametrize("start", [(0.4, 0.3), (-0.3, -0.2), (0.2, -0.9), (-0.1, 0.7), (0.3, 0.0)])
def test_the_synthesis_brings_the_ball_to_the_top_in_the_time_it_promises(start):
    low, high = -3.0, 4.0
    plan = time_optimal(*start, low, high)
    x = np.array(start)
    for u, dt in ((plan.first, plan.switch), (plan.last, plan.duration - plan.switch)):
        x = np.array([x[0] + x[1] * dt + 0.5 * u * dt**2, x[1] + u * dt])
    assert x == pytest.approx([0.0, 0.0], abs=1e-12)
    assert plan.first == optimal_control(*start, low, high)


def test_costate_of_the_ball_is_the_slope_of_the_time():
    low, high, start, d = -3.0, 4.0, (0.4, 0.3), 1e-6
    plan = time_optimal(*start, low, high)
    for axis in range(2):
        shifted = [list(start), list(start)]
        shifted[0][axis] -= d
        shifted[1][axis] += d
        slope = (time_optimal(*shifted[1], low, high).duration - time_optimal(*shifted[0], low, high).duration) / (
            2 * d
        )
        assert plan.costate[axis] == pytest.approx(-slope, rel=1e-5)


def test_the_corrected_arc_solves_the_equations_and_the_printed_one_does_not():
    """G.21 against integration. The example that has ERRATA's digits: gamma 1.3, u in [-1.5, 2], s_0 = 0.7, s = 1.6."""
    low, high, s_0, s = -1.5 * 1.3, 2.0 * 1.3, 0.7, 1.6
    numeric = solve_ivp(
        lambda s, x: [-x[1], -(high if s < s_0 else low)], (0.0, s), [0.0, 0.0], rtol=1e-10, atol=1e-12, max_step=0.01
    ).y[:, -1]
    x1, x2 = backward_arc(np.array([s]), s_0, low, high)
    assert (x1[0], x2[0]) == pytest.approx(tuple(numeric), abs=1e-6)
    printed = 0.5 * low * s**2 + (low - high) * s_0 * s - 0.5 * s_0**2 * (low - high)
    assert x1[0] == pytest.approx(1.485, abs=5e-4)
    assert printed == pytest.approx(-6.477, abs=5e-4)


def test_terminal_costate_of_the_ball_has_gamma_in_it():
    """H(T) = 0 with x2 = 0: lambda2 gamma u = 1 (ERRATA on G.18)."""
    ball = BallAndWheel()
    low, high = ball.bounds()
    plan = time_optimal(0.05, 0.0, low, high)
    at_end = plan.costate[1] - plan.costate[0] * plan.duration
    assert at_end == pytest.approx(1.0 / plan.last)
    assert ball.torque(plan.last / ball.gamma, 0.0) == pytest.approx(ball.torque_high)


def test_feedback_linearisation_inverts():
    ball = BallAndWheel()
    for angle in (-0.3, 0.0, 0.2):
        assert ball.torque(ball.linearised(0.17, angle), angle) == pytest.approx(0.17)
    with pytest.raises(BadInput, match="torque bounds"):
        BallAndWheel(torque_low=0.1).bounds()
