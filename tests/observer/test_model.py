"""The 17-state model: Jacobians against automatic differentiation, signs against physics, kernel against reference."""

from dataclasses import fields

import casadi as ca
import entry
import numpy as np
import pytest
from synthetic import SMART

from observer import kernel, model
from observer.observe import start
from observer.settings import DEFAULT, ObserverSettings

LAGGED = (
    model.GPS_NORTH,
    model.GPS_EAST,
    model.GPS_ALTITUDE,
    model.GPS_SPEED,
    model.GPS_COURSE,
    model.MAP_HEADING,
    model.MAP_ALTITUDE,
)


def random_state(rng: np.random.Generator) -> np.ndarray:
    """A state anywhere a car may be, standing and rolling back included."""
    x = np.zeros(17)
    x[model.X], x[model.V] = rng.uniform(0, 1e4), rng.uniform(-2, 40)
    x[model.F] = rng.uniform(-6e3, 4e3)
    x[model.PSI], x[model.THETA] = rng.uniform(-3, 3), rng.uniform(-0.2, 0.2)
    x[model.N : model.D + 1] = rng.uniform(-1e4, 1e4, 3)
    x[model.SJ], x[model.SK] = rng.uniform(-0.05, 0.05), rng.uniform(-0.005, 0.005)
    x[model.EIN], x[model.PIN] = rng.uniform(0, 1e7), rng.uniform(0, 1e5)
    x[model.ANGLE], x[model.OMEGA] = rng.uniform(0, 1e5), rng.uniform(80, 600)
    x[model.BX :] = rng.uniform(-0.3, 0.3, 3)
    return x


def state(**values: float) -> np.ndarray:
    x = np.zeros(17)
    for name, value in values.items():
        x[getattr(model, name)] = value
    return x


def test_dynamics_jacobian_is_the_derivative():
    symbol = ca.SX.sym("x", 17)
    exact = ca.Function("a", [symbol], [ca.jacobian(ca.vertcat(*model.dynamics(symbol, SMART, ca)), symbol)])
    rng = np.random.default_rng(1)
    for _ in range(50):
        x = random_state(rng)
        np.testing.assert_allclose(
            model.dynamics_jacobian(x, SMART), np.array(exact(x)), rtol=1e-9, atol=1e-9, strict=True
        )


@pytest.mark.parametrize("kind", range(len(model.KINDS)), ids=model.KINDS)
def test_measurement_jacobian_is_the_derivative_and_the_kernel_agrees(kind):
    symbol, lag = ca.SX.sym("x", 17), ca.SX.sym("lag")
    squat = DEFAULT.body_squat
    value = ca.SX(model.measurement(kind, symbol, SMART, lag, ca, squat))
    exact = ca.Function("h", [symbol, lag], [value, ca.jacobian(value, symbol)])
    f = start(SMART, DEFAULT, None, 0.0)
    rng = np.random.default_rng(kind)
    for _ in range(20):
        x = random_state(rng)
        aux = rng.uniform(0.0, 0.5) if kind in LAGGED else (rng.uniform(10, 200) if kind == model.PULSE_POWER else 0.0)
        expected, gradient = (np.array(part) for part in exact(x, aux))
        np.testing.assert_allclose(model.measurement(kind, x, SMART, aux, squat=squat), expected.item(), rtol=1e-12)
        np.testing.assert_allclose(
            model.measurement_jacobian(kind, x, SMART, aux, squat), gradient[0], rtol=1e-9, atol=1e-9, strict=True
        )
        full = np.zeros(kernel.NX)
        full[:17] = x
        places, values, scratch = np.zeros(10, np.int64), np.zeros(8), np.zeros(4)
        told, size = entry.sparse_row(np.int64(kind), full, f.car, aux, places, values, scratch)
        row = np.zeros(kernel.NX)
        row[places[:size]] = values[:size]
        np.testing.assert_allclose(told, expected.item(), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(row[:17], gradient[0], rtol=1e-9, atol=1e-9, strict=True)


def test_kernels_acceleration_is_the_models():
    f = start(SMART, DEFAULT, None, 0.0)
    rng = np.random.default_rng(4)
    for _ in range(50):
        x, slopes = random_state(rng), np.zeros(4)
        assert entry.acceleration(x, f.car, slopes) == pytest.approx(model.acceleration(x, SMART), rel=1e-12)
        expected = model.acceleration_gradient(x, SMART)[[model.V, model.F, model.THETA, model.SK]]
        np.testing.assert_allclose(slopes, expected, rtol=1e-11)


def test_the_models_signs_are_physical():
    """A left turn, a crest, a dip, a hill held on the brakes, drag."""
    left = state(V=20.0, SJ=-0.01)
    assert model.dynamics(left, SMART)[model.PSI] < 0.0, "a left turn lessens the heading"
    assert model.measurement(model.ACCELERATION_Y, left, SMART) == pytest.approx(4.0), "it presses to the right"
    assert model.measurement(model.YAW_RATE, left, SMART) > 0.0, "right-handed about the upward axis"
    crest, dip = state(V=20.0, SK=-0.003), state(V=20.0, SK=0.003)
    assert model.measurement(model.ACCELERATION_Z, crest, SMART) < SMART.gravity
    assert model.measurement(model.ACCELERATION_Z, dip, SMART) > SMART.gravity
    assert model.dynamics(dip, SMART)[model.THETA] > 0.0, "a dip turns the nose up"
    held = state(THETA=0.1, F=SMART.mass * SMART.gravity * np.sin(0.1))
    assert model.dynamics(held, SMART)[model.V] == pytest.approx(0.0, abs=1e-12)
    reading = model.measurement(model.ACCELERATION_X, held, SMART)
    assert reading == pytest.approx(SMART.gravity * np.sin(0.1)), "specific force at rest, nose up"
    assert model.acceleration(state(V=20.0), SMART) < 0.0, "drag slows the car"
    assert model.acceleration(state(V=-20.0), SMART) > 0.0, "and slows it when it rolls back"
    climbing = state(V=20.0, THETA=0.05)
    assert model.dynamics(climbing, SMART)[model.D] < 0.0, "down falls on a climb"
    north, east = model.dynamics(state(V=10.0, PSI=0.0), SMART), model.dynamics(state(V=10.0, PSI=np.pi / 2), SMART)
    assert north[model.N] == pytest.approx(10.0)
    assert east[model.E] == pytest.approx(10.0)


def test_printed_accelerometer_row_differs_by_the_missing_share_of_gravity():
    """ERRATA on 1.9 and 1.18: the two differ by g sin(theta) (1 - M / M_a)."""
    x = state(V=20.0, THETA=0.06, F=900.0)
    gap = model.measurement(model.ACCELERATION_X, x, SMART) - model.measurement(model.ACCELERATION_X_THESIS, x, SMART)
    expected = SMART.gravity * np.sin(0.06) * (1.0 - SMART.mass / SMART.accelerated_mass)
    assert gap == pytest.approx(expected, rel=1e-12)


def test_a_late_fix_is_the_place_where_the_car_was():
    """The lagged rows against the model integrated backwards: the error falls with the third power of the lag."""
    from scipy.integrate import solve_ivp

    x = state(V=22.0, F=1500.0, PSI=0.7, THETA=0.04, SJ=0.01, SK=0.0005, N=100.0, E=-50.0, D=-300.0)
    errors = []
    for lag in (0.4, 0.2):
        back = solve_ivp(lambda t, y: model.dynamics(y, SMART), (0.0, -lag), x, rtol=1e-11, atol=1e-11).y[:, -1]
        errors.append(abs(model.measurement(model.GPS_NORTH, x, SMART, lag) - back[model.N]))
    assert errors[0] < 0.02
    assert errors[1] < errors[0] / 6.0


def test_kernel_and_settings_agree_on_the_order():
    """Given settings whose values are their own places, then the kernel's names find them."""
    names = [field.name for field in fields(ObserverSettings)]
    numbered = ObserverSettings(**{name: float(i) for i, name in enumerate(names)}).vector()
    pairs = {
        "S_ACC": "accelerometer_floor",
        "S_TOOTH": "tooth_deviation",
        "S_CUT_GAP": "cut_gap",
        "S_GPS_LAG": "gps_lag",
        "S_Q_THRUST": "thrust_noise",
        "S_Q_VERTICAL": "vertical_straightness_noise",
        "S_GATE": "gate",
        "S_REOPEN": "reopen",
        "S_THRUST_GAIN_HINDSIGHT": "thrust_gain_hindsight",
        "S_SLIP": "slip_deviation",
        "S_Q_SCALE": "scale_noise",
        "S_MAP_HEADING": "map_heading_scale",
        "S_MAP_STRAIGHT": "map_straightness_scale",
        "S_STANDSTILL": "standstill_deviation",
        "S_OPEN_CLUTCH": "open_clutch",
    }
    for constant, name in pairs.items():
        assert numbered[getattr(kernel, constant)] == names.index(name), constant
    assert names[kernel.S_OPEN_CLUTCH + 1 :] == ["body_squat", "scale_trip_deviation", "bias_trip_deviation"], (
        "which only the start of a trip reads"
    )
    assert tuple(np.arange(kernel.KIND_CODES)) == tuple(range(len(model.KINDS)))
    assert int(kernel.CUT_OFF) == model.CUT_OFF
