"""The benchmark diesel: published values, conservation, and the behaviour that the paper is known for."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vehicle_model.car.diesel_engine import DieselParameters
from vehicle_model.plant.diesel import diesel_rates, simulate_diesel, steady_diesel, transient_cycle

PUBLISHED = Path(__file__).parents[2].parent / "shared" / "data" / "wahlstrom_eriksson_2011.json"


def step_response(before, after, seconds=15.0):
    """Run with the inputs `before` for 1 s, then `after`."""
    inputs = np.tile(np.asarray(before, float), (round(seconds / 0.01), 1))
    inputs[100:] = after
    return simulate_diesel(inputs)


def test_every_value_is_the_published_one():
    if not PUBLISHED.exists():
        pytest.skip(f"the published values are not at hand ({PUBLISHED.name})")
    published = json.loads(PUBLISHED.read_text())["parameters"]
    vectors = {"c_vol": "c_volVec", "c_fric": "c_fricVec", "c_egr": "c_egr", "c_m": "c_mVec", "c_wpsi": "c_wpsiVec",
               "c_wphi": "c_wphiVec"}  # fmt: skip
    matrix = {"Q_c11": (0, 0), "Q_c12": (0, 1), "Q_c22": (1, 1)}
    for name, value in DieselParameters()._asdict().items():
        if name in matrix:
            i, j = matrix[name]
            assert value == published["Q_c"][i][j]
        elif name[:-1] in vectors:
            assert value == published[vectors[name[:-1]]][int(name[-1]) - 1], name
        else:
            assert value == published["gamma_c" if name == "gamma_cyl" else name], name


def test_a_stationary_state_is_stationary_and_balances_its_flows():
    for inputs in ([110, 1500, 0, 40], [110, 1500, 40, 30], [40, 1000, 30, 30], [200, 1800, 0, 50]):
        state = steady_diesel(inputs)
        rates, flows = diesel_rates(state, inputs)
        assert np.all(np.abs(rates / state) < 1e-6)
        w_c, w_egr, w_ei, w_t, *_ = flows
        fuel = 1e-6 / 120 * inputs[0] * inputs[1] * 6
        assert w_c + w_egr == pytest.approx(w_ei, rel=1e-6)
        # what the compressor and the injectors let in leaves through the turbine
        assert w_c + fuel == pytest.approx(w_t, rel=1e-6)


def test_integration_agrees_with_an_adaptive_solver():
    inputs = np.tile([110.0, 1500.0, 20.0, 35.0], (300, 1))
    start = steady_diesel([60.0, 1300.0, 10.0, 45.0])
    run = simulate_diesel(inputs, start=start, actuators=False)
    wanted = solve_ivp(lambda _, x: diesel_rates(x, inputs[0])[0], (0, 2.99), start, "LSODA", rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(run.state[-1], wanted.y[:, -1], rtol=1e-6)


def test_opening_egr_first_raises_then_lowers_intake_pressure():
    """Non-minimum phase from u_egr to p_im: the valve feeds the manifold at once, the starved turbine follows."""
    run = step_response([110, 1500, 10, 30], [110, 1500, 20, 30])
    pressure = run.state[:, 0] - run.state[0, 0]
    peak = int(np.argmax(pressure))
    assert pressure[peak] > 1000.0 and run.time[peak] - 1.0 < 1.0
    assert pressure[-1] < -5000.0


def test_closing_the_turbine_changes_the_sign_of_its_effect_on_air_flow():
    """Sign reversal from u_vgt to W_c at 80 % EGR, and non-minimum phase where the final effect is positive."""
    small = step_response([110, 1500, 80, 30], [110, 1500, 80, 27])
    large = step_response([110, 1500, 80, 60], [110, 1500, 80, 57])
    first, second = (run.flows[:, 0] - run.flows[0, 0] for run in (small, large))
    assert first[-1] < -0.002 and second[-1] > 0.0005
    assert second.min() < -0.001


def test_actuators_delay_what_the_valves_do():
    inputs = np.tile([110.0, 1500.0, 10.0, 40.0], (200, 1))
    inputs[100:, 3] = 50.0
    slow, fast = simulate_diesel(inputs), simulate_diesel(inputs, actuators=False)
    assert slow.flows[103, 3] == pytest.approx(slow.flows[99, 3], rel=1e-4)
    assert fast.flows[101, 3] > 1.05 * fast.flows[99, 3]
    assert slow.flows[150, 3] == pytest.approx(fast.flows[150, 3], rel=0.02)


def test_a_bias_moves_the_stationary_point_by_itself():
    """Seed 001, 3a: dx/dt = f(x - A_q q, u) comes to rest at the old point plus A_q q."""
    inputs = np.tile([110.0, 1500.0, 20.0, 35.0], (3000, 1))
    bias = np.tile([3e3, -2e3, 0.0], (3000, 1))
    run = simulate_diesel(inputs, bias=bias, actuators=False)
    np.testing.assert_allclose(run.state[-1], steady_diesel(inputs[0]) + bias[0], rtol=1e-5)


def test_the_transient_cycle_covers_the_air_flows_and_stays_physical():
    run = simulate_diesel(transient_cycle(0, 300.0))
    assert np.isfinite(run.state).all() and (run.flows[:, :4] >= 0.0).all()
    assert run.flows[:, 0].min() < 0.15 and run.flows[:, 0].max() > 0.40
    again = simulate_diesel(transient_cycle(0, 300.0))
    assert np.array_equal(run.state, again.state)
