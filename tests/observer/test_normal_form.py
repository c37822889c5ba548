"""The observability normal form and the adaptive high-gain filter on it; tunings as data."""

import casadi as ca
import numpy as np
import pytest
from synthetic import SMART

from observer import kalman, model, normal_form, tunings
from observer.system import car_reading, car_system

START = np.zeros(17)
START[[1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13, 14, 15, 16]] = (
    18.0, 1500.0, 0.6, 0.03, 10.0, -20.0, -300.0, 0.002, 0.0005, 3e4, 250.0, 0.1, -0.05, 0.08,
)  # fmt: skip
NOISE = np.array([1e-6, 1e-5, 1e5, 1e-7, 1e-7, 1e-4, 1e-4, 1e-5, 1e-6, 1e-9, 1.0, 1e6, 1e-6, 50, 1e-9, 1e-9, 1e-9])


def test_the_change_of_coordinates_has_an_inverse():
    rng = np.random.default_rng(2)
    for _ in range(50):
        x = START + rng.normal(size=17) * np.array(
            [10, 3, 500, 1, 0.05, 50, 50, 20, 0.01, 1e-3, 1e4, 5e3, 10, 50, 0.1, 0.1, 0.1]
        )
        back = normal_form.from_normal(np.array(normal_form.to_normal(x, SMART)), SMART)
        np.testing.assert_allclose(back, x, rtol=1e-9, atol=1e-9)


def test_the_form_is_triangular():
    """dz/dt - A z may depend, but in a block's last line, only on what stands above it in the block (A.4.3)."""
    z = ca.SX.sym("z", 17)
    flow, _, _ = normal_form.normal_system(SMART)
    a = normal_form.structure(SMART)
    point = np.array(normal_form.to_normal(START, SMART))
    rest = np.array([flow(point + h) for h in 1e-4 * np.eye(17)]) - np.array(
        [flow(point - h) for h in 1e-4 * np.eye(17)]
    )
    rest = rest.T / 2e-4 - a
    for block in normal_form.BLOCKS:
        for depth, row in enumerate(block[:-1]):
            allowed = set(block[: depth + 1])
            outside = [column for column in range(17) if column not in allowed]
            if row in (5, 6):
                continue
            np.testing.assert_allclose(rest[row, outside], 0.0, atol=1e-6, err_msg=f"z{row + 1}")
    assert z.shape == (17, 1)


def test_the_flow_is_the_models():
    flow, slope, push = normal_form.normal_system(SMART)
    z = np.array(normal_form.to_normal(START, SMART))
    expected = push(z) @ np.array(model.dynamics(START, SMART))
    # the form has the drag's sign fixed forward; the smooth sign differs from 1 by 2e-5 at 18 m/s
    np.testing.assert_allclose(flow(z), expected, rtol=1e-3, atol=2e-3)
    numeric = np.array([(flow(z + h) - flow(z - h)) / 2e-5 for h in 1e-5 * np.eye(17)]).T
    np.testing.assert_allclose(slope(z), numeric, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("kind", sorted(normal_form.KINDS))
def test_outputs_are_states_of_the_form(kind):
    z = normal_form.to_normal(START, SMART)
    assert z[normal_form.KINDS[kind]] == pytest.approx(model.measurement(kind, START, SMART), rel=1e-4)


def test_high_gain_matrices_follow_the_blocks():
    states, outputs = normal_form.gain_matrices(2.0)
    assert list(states[:3]) == [1.0, 2.0, 4.0]
    assert list(states[3:5]) == [2.0, 4.0]
    assert states[14] == 4.0
    assert outputs.shape == (10,)


def test_without_adaptation_it_is_the_extended_filter():
    """Given G held at 1 and small uncertainty, then both filters agree."""
    P = np.diag(
        np.array([0.1, 0.05, 20, 1e-3, 1e-3, 0.3, 0.3, 0.3, 1e-4, 1e-5, 5, 100, 0.1, 0.5, 0.01, 0.01, 0.01]) ** 2
    )
    aekf = normal_form.AdaptiveHighGain(SMART, START, P, NOISE, highest=1.0)
    system = car_system(SMART, NOISE)
    x, cov = START, P
    rng = np.random.default_rng(1)
    for k in range(40):
        kind, variance = ((model.ACCELERATION_X, 0.04), (model.DISTANCE, 1e-4), (model.GPS_NORTH, 1.0))[k % 3]
        aekf.predict(0.01)
        x, cov = kalman.predict_continuous(system, x, cov, 0.01)
        value = model.measurement(kind, x, SMART) + np.sqrt(variance) * rng.normal() * 0.1
        aekf.correct(kind, value, variance)
        x, cov = kalman.correct(x, cov, car_reading(SMART, (kind,), np.array([value]), np.array([variance])))
    np.testing.assert_allclose((aekf.state() - x) / np.sqrt(np.diag(cov)), 0.0, atol=0.05)


def test_the_gain_rises_at_a_sudden_thrust_and_falls_again():
    """Note 21: braking is a perturbation that the model does not hold."""
    quiet = NOISE.copy()
    quiet[model.F] = 1e2
    P = np.diag(np.array([0.1, 0.05, 50, 1e-2, 1e-2, 1, 1, 1, 1e-3, 1e-4, 5, 100, 0.1, 0.5, 0.01, 0.01, 0.01]) ** 2)
    errors, gains = {}, []
    for highest in (1.0, 3.0):
        truth = START.copy()
        aekf = normal_form.AdaptiveHighGain(SMART, START, P, quiet, highest=highest)
        system = car_system(SMART, quiet)
        rng = np.random.default_rng(5)
        error = []
        for k in range(400):
            if k == 100:
                truth[model.F] -= 2500.0
            truth, _ = kalman.predict_continuous(system, truth, np.eye(17), 0.01)
            aekf.predict(0.01)
            kind, variance = ((model.ACCELERATION_X, 0.03), (model.DISTANCE, 1e-4))[k % 2]
            aekf.correct(kind, model.measurement(kind, truth, SMART) + np.sqrt(variance) * rng.normal(), variance)
            error.append(aekf.state()[model.F] - truth[model.F])
            if highest > 1.0:
                gains.append(aekf.gain)
        errors[highest] = float(np.sqrt(np.mean(np.square(error[110:250]))))
    assert max(gains[:95]) == 1.0
    assert max(gains[100:200]) == 3.0
    assert min(gains[300:]) == 1.0
    assert errors[3.0] < 0.8 * errors[1.0]


def test_printed_tables():
    """Spot checks of tables 3.2 and 3.3, and the bound at standstill."""
    thesis = tunings.THESIS
    assert thesis.state_noise[model.F] == 90000.0
    assert thesis.state_noise[model.THETA] == 1.5625e-8
    assert thesis.noise_at(20.0)[model.SK] == pytest.approx(1e-9 / 400.0)
    assert thesis.noise_at(0.0)[model.SK] == pytest.approx(1e-9)
    assert thesis.measurement_noise[model.ENGINE_ANGLE] == 0.016
    scaled = tunings.normalised(thesis)
    assert scaled.state_noise[model.F] == pytest.approx(0.09)
    assert scaled.measurement_noise[model.GPS_NORTH] == pytest.approx(0.01)
