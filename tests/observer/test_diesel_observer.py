"""The observer's diesel: against automatic differentiation, against the plant, and the filter's own consistency."""

import casadi as ca
import numpy as np
import pytest

from observer import diesel
from observer.diesel import DieselObserver, run_filter
from vehicle_model.car.diesel_engine import DieselParameters
from vehicle_model.plant import diesel as plant

POINTS = (
    [110.0, 1500.0, 10.0, 40.0],
    [110.0, 1500.0, 40.0, 30.0],
    [40.0, 1000.0, 30.0, 30.0],
    [200.0, 1800.0, 0.0, 50.0],
)


def test_its_rates_are_the_plants():
    """Two programs of the same published equations, written apart."""
    rng = np.random.default_rng(0)
    for u in POINTS:
        for _ in range(5):
            x = plant.steady_diesel(u) * rng.uniform(0.93, 1.07, 3)
            mine = diesel.diesel_rates(*x, 0.0, np.array(u), DieselParameters())
            theirs, flows = plant.diesel_rates(x, u)
            np.testing.assert_allclose(mine, theirs, rtol=2e-4, atol=2.0)
            assert diesel.compressor_flow(x[0], x[2], DieselParameters()) == pytest.approx(flows[0], rel=1e-12)


def symbolic_rates(x, u, p):
    """The same equations in CasADi, away from every kink."""
    p_im, p_em, w = x[0], x[1], x[2]
    fuel = u[0] * u[1] * p.n_cyl / 120e6
    air = (p.c_vol3 + p.c_vol1 * ca.sqrt(p_im) + p.c_vol2 * ca.sqrt(u[1])) * p_im * u[1] * p.V_d
    air /= 120 * p.R_a * p.T_im
    q = fuel * p.q_HV / (fuel + air)
    squeeze, back = p.r_c ** (p.gamma_a - 1), p_em / p_im
    x_r, t_1, t_e = 0.03, p.T_im, p.T_im
    for _ in range(8):
        released = q * (1 - x_r)
        x_r = back ** (1 / p.gamma_a) / (p.r_c * (1 + released / (p.c_pa * t_1 * squeeze)))
        t_e = p.eta_sc * back ** (1 - 1 / p.gamma_a) * (released / (p.c_pa * squeeze) + t_1)
        t_1 = x_r * t_e + (1 - x_r) * p.T_im
    t_em = p.T_amb + (t_e - p.T_amb) * ca.exp(
        -p.h_tot * np.pi * p.d_pipe * p.l_pipe * p.n_pipe / ((fuel + air) * p.c_pe)
    )
    ratio = ca.fmax(p_im / p_em, p.PI_egropt)
    psi = 1 - ((1 - ratio) / (1 - p.PI_egropt) - 1) ** 2
    egr = p.A_egrmax * (p.c_egr1 * u[2] ** 2 + p.c_egr2 * u[2]) * p_em * psi / ca.sqrt(t_em * p.R_e)
    pi_t = p.p_amb / p_em
    f_vgt = p.c_f2 + p.c_f1 * np.sqrt(1 - ((u[3] - p.c_vgt2) / p.c_vgt1) ** 2)
    w_t = p.A_vgtmax * f_vgt * p_em * ca.sqrt(1 - pi_t**p.K_t) / ca.sqrt(t_em * p.R_e)
    drop = 1 - pi_t ** (1 - 1 / p.gamma_e)
    bsr = p.R_t * w / ca.sqrt(2 * p.c_pe * t_em * drop)
    eta_t = p.eta_tmmax - p.c_m1 * (w - p.c_m2) ** p.c_m3 * (bsr - p.BSR_opt) ** 2
    head = (p_im / p.p_amb) ** (1 - 1 / p.gamma_a) - 1
    psi_c = 2 * p.c_pa * p.T_amb * head / (p.R_c**2 * w**2)
    c_psi = p.c_wpsi1 * w**2 + p.c_wpsi2 * w + p.c_wpsi3
    c_phi = p.c_wphi1 * w**2 + p.c_wphi2 * w + p.c_wphi3
    w_c = p.p_amb * np.pi * p.R_c**3 * w / (p.R_a * p.T_amb) * ca.sqrt((1 - c_psi * psi_c**2) / c_phi)
    chi = ca.vertcat(w_c - p.w_copt, (p_im / p.p_amb - 1) ** p.c_pi - p.pi_copt)
    eta_c = p.eta_cmax - ca.bilin(ca.DM([[p.Q_c11, p.Q_c12], [p.Q_c12, p.Q_c22]]), chi, chi)
    power = eta_t * w_t * p.c_pe * t_em * drop - w_c * p.c_pa * p.T_amb / eta_c * head
    return ca.vertcat(
        p.R_a * p.T_im / p.V_im * (w_c + egr - air), p.R_e * t_em / p.V_em * (fuel + air - w_t - egr),
        power / (p.J_t * w),
    )  # fmt: skip


def test_its_jacobian_agrees_with_automatic_differentiation():
    p = DieselParameters()
    for u in POINTS:
        state = plant.steady_diesel(u)
        x = ca.MX.sym("x", 3)
        exact = ca.Function("J", [x], [ca.jacobian(symbolic_rates(x, u, p), x)])
        mine = diesel.diesel_jacobian(state, 0.0, np.array(u), p)
        scale = 1.0 / diesel.SCALE
        wanted = np.array(exact(state))
        np.testing.assert_allclose(mine * scale[:, None] / scale, wanted * scale[:, None] / scale, rtol=2e-3, atol=2e-3)


@pytest.fixture(scope="module")
def run():
    return plant.simulate_diesel(plant.transient_cycle(0, 240.0), actuators=False)


def test_unbiased_on_its_own_model_and_honest_about_its_errors(run):
    rng = np.random.default_rng(1)
    disturbed = plant.simulate_diesel(
        run.inputs, disturbance=rng.normal(size=(len(run.time), 3)) * np.array([4e3, 4e3, 60.0]) * 0.1, actuators=False
    )
    measured = disturbed.state[:, [0, 2]] + rng.normal(size=(len(run.time), 2)) * [500.0, 20.0]
    found = run_filter(DieselObserver(), run.inputs, measured, 0.01, disturbed.state[0])
    error = found.state - disturbed.state
    assert np.all(np.abs(error.mean(axis=0)) < [200.0, 600.0, 6.0])
    inside = np.abs(error) < 1.645 * np.sqrt(found.variance[:, :3])
    assert np.all(inside[1000:].mean(axis=0) > 0.80)


def test_outliers_are_gated(run):
    rng = np.random.default_rng(2)
    measured = run.state[:, [0, 2]] + rng.normal(size=(len(run.time), 2)) * [500.0, 20.0]
    spoilt = measured.copy()
    hit = rng.choice(len(run.time), 200, replace=False)
    spoilt[hit, 0] += 8e4
    gated = run_filter(DieselObserver(gate=5.0), run.inputs, spoilt, 0.01, run.state[0])
    open_gate = run_filter(DieselObserver(), run.inputs, spoilt, 0.01, run.state[0])
    assert gated.rejected[hit, 0].mean() > 0.95
    worst = [np.sqrt(np.mean((e.state[:, 0] - run.state[:, 0]) ** 2)) for e in (gated, open_gate)]
    assert worst[0] < 0.4 * worst[1]


def test_a_missing_measurement_is_no_measurement(run):
    measured = run.state[:, [0, 2]].copy()
    measured[500:600] = np.nan
    found = run_filter(DieselObserver(), run.inputs, measured, 0.01, run.state[0])
    assert found.rejected[500:600].all() and np.isfinite(found.state).all()
    assert found.variance[599, 2] > found.variance[499, 2]


def test_limiting_keeps_the_covariance_positive_definite():
    """Limiting the diagonal alone does not (ERRATA): the counterexample is in the same test."""
    P = np.array([[1.0, 1.9], [1.9, 4.0]])
    alone = P.copy()
    alone[1, 1] = 1.0
    assert np.linalg.eigvalsh(alone)[0] < 0
    diesel.limit_covariance(P, 0, np.array([1e9, 1.0]))
    assert P[1, 1] == pytest.approx(1.0) and np.linalg.eigvalsh(P)[0] > 0
    assert P[0, 1] == P[1, 0] == pytest.approx(1.9 / 2.0)
