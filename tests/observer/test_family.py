"""The family behind one interface: thrust models of note 12 against closed forms, and every filter on a short log."""

import casadi as ca
import numpy as np
import pytest
from synthetic import SMART, drive, sense

from observer import family, kalman, model
from observer.instants import WIDTH, instants
from observer.system import car_reading, car_system, runge_kutta
from observer.thrust_models import thrust_system, widened

START = 3.0
"""s: the logger's clock at the truth's time 0 (as `sense` sets it)."""
X = np.zeros(17)
X[[1, 2, 3, 4, 8, 9, 11, 13]] = 18.0, 900.0, 0.6, 0.02, 0.002, 2e-4, 3e4, 250.0


@pytest.fixture(scope="module")
def short():
    truth = drive(seed=1, duration=60.0)
    return truth, sense(truth, seed=1)


def test_no_order_is_the_plain_car():
    plain, zero = car_system(SMART, family.NOISE), thrust_system(SMART, family.NOISE, 0, 0.0)
    np.testing.assert_array_equal(plain.dynamics(X), zero.dynamics(X))


@pytest.mark.parametrize("order", [1, 2])
def test_jacobian_of_a_polynomial_thrust_is_the_derivative(order):
    system = thrust_system(SMART, family.NOISE, order, 1.0)
    x = np.concatenate([X, [300.0, -40.0][:order]])
    step = 1e-4 * np.maximum(np.abs(x), 1e-2)
    columns = [(system.dynamics(x + d) - system.dynamics(x - d)) / (2.0 * d[i]) for i, d in enumerate(np.diag(step))]
    np.testing.assert_allclose(system.jacobian(x), np.array(columns).T, rtol=2e-6, atol=1e-6)


@pytest.mark.parametrize("order", [1, 2])
def test_thrust_moves_as_its_polynomial(order):
    """F(t) = F + xi_1 t + xi_2 t^2 / 2, exactly (Runge-Kutta is exact up to the fourth power)."""
    system = thrust_system(SMART, family.NOISE, order, 1.0)
    x = np.concatenate([X, [300.0, -40.0][:order]])
    moved = runge_kutta(system.dynamics, x, 0.5)
    expected = 900.0 + 300.0 * 0.5 + (0.5 * -40.0 * 0.25 if order == 2 else 0.0)
    assert moved[model.F] == pytest.approx(expected, rel=1e-12)


def test_a_ramp_of_thrust_is_followed_more_closely_at_order_one():
    """Given a thrust that climbs steadily, order 0 stays behind and order 1 catches up."""

    def last_error(order: int) -> float:
        noise = np.where(np.arange(17) == model.F, 1e4 if order == 0 else 1.0, 1e-12)
        system = thrust_system(SMART, noise, order, 1e4)
        x, P = np.concatenate([X, np.zeros(order)]), np.diag(np.concatenate([np.full(17, 1e-8), np.full(order, 1e4)]))
        true = X.copy()
        for _ in range(200):
            true[model.F] += 5.0
            true[model.V] += 0.1 * model.acceleration(true, SMART)
            told = np.array([model.measurement(kind, true, SMART) for kind in (model.SPEED, model.ACCELERATION_X)])
            x, P = kalman.predict_continuous(system, x, P, 0.1)
            reading = car_reading(SMART, (model.SPEED, model.ACCELERATION_X), told, np.array([1e-4, 1e-2]))
            x, P = kalman.correct(x, P, widened(reading, order))
        return abs(float(x[model.F] - true[model.F]))

    assert last_error(1) < 0.4 * last_error(0)


def test_readings_of_many_states_are_those_of_each():
    kinds = (model.ACCELERATION_X, model.GPS_NORTH, model.SPEED, model.GPS_COURSE)
    reading = car_reading(SMART, kinds, np.zeros(4), np.ones(4), np.array([0.0, 0.3, 0.0, 0.2]))
    system = car_system(SMART, family.NOISE)
    many = np.stack([X, 1.01 * X, 0.97 * X], axis=1)
    for k in range(3):
        np.testing.assert_allclose(reading.expected(many)[:, k], reading.expected(many[:, k]), rtol=1e-13)
        np.testing.assert_allclose(system.dynamics(many)[:, k], system.dynamics(many[:, k]), rtol=1e-13)
    symbol = ca.SX.sym("x", 17)
    exact = ca.Function("h", [symbol], [ca.SX(model.measurement(model.GPS_NORTH, symbol, SMART, 0.3, ca))])
    assert reading.expected(X)[1] == pytest.approx(float(exact(X)), rel=1e-12)


def test_an_instant_holds_what_was_measured_then(short):
    truth, log = short
    told, _ = instants(log, SMART)
    speeds, powers = [], []
    for instant in told:
        at = np.clip(round((instant.time - START) / 0.01), 0, len(truth.time) - 1)
        if model.SPEED in instant.kinds and truth.speed[at] > 3.0:
            speeds.append(instant.value[instant.kinds.index(model.SPEED)] - truth.speed[at])
        if model.FUEL_POWER in instant.kinds and truth.driving[at]:
            powers.append(instant.value[instant.kinds.index(model.FUEL_POWER)] / truth.fuel_power[at] - 1.0)
    assert len(speeds) > 300
    assert np.sqrt(np.mean(np.square(speeds))) < 0.06
    assert abs(np.median(powers)) < 0.01
    assert np.diff([instant.time for instant in told]) == pytest.approx(WIDTH)


FRAGILE = ("particles",)
"""Five states cannot."""


@pytest.mark.parametrize("name", [name for name in family.FAMILY if name not in FRAGILE])
def test_every_filter_finds_the_speed(name, short):
    truth, log = short
    told = [instant for instant in instants(log, SMART)[0] if instant.time < START + 25.0]
    time, state, variance = family.run_family(name, told, SMART, heading=float(truth.heading[0]))
    late = time > START + 10.0
    true = np.interp(time[late] - START, truth.time, truth.speed)
    assert np.isfinite(state).all()
    assert (variance > 0.0).all()
    assert np.sqrt(np.mean((state[late, model.V] - true) ** 2)) < 0.6


def test_a_course_across_north_turns_nothing():
    """Given a high-gain filter heading 1 degree west of north, when told 1 degree east, then it turns by little."""
    x = X.copy()
    x[model.PSI] = 2.0 * np.pi - 0.02
    one = family.HighGain(SMART, x, family.SPREAD)
    one._asleep = False
    told = family.Instant(0.1, (model.GPS_COURSE,), np.array([0.02]), np.array([1e-4]), np.array([0.0]))
    reading = car_reading(SMART, told.kinds, told.value, told.variance, told.aux)
    one.predict(WIDTH)
    one.correct(reading, told)
    assert one.moments()[0][model.PSI] == pytest.approx(2.0 * np.pi + 0.02, abs=0.08)


def test_the_kalman_bucy_filter_agrees_with_the_unscented_one(short):
    """Given a sharp reading of a state that wanders fast, then both unscented filters still say the same."""
    truth, log = short
    told = [instant for instant in instants(log, SMART)[0] if instant.time < START + 15.0]
    heading = float(truth.heading[0])
    _, plain, _ = family.run_family("UKF", told, SMART, heading=heading)
    _, root, _ = family.run_family("square-root unscented Kalman-Bucy", told, SMART, heading=heading)
    assert np.sqrt(np.mean((plain[:, model.F] - root[:, model.F]) ** 2)) < 20.0
    assert np.sqrt(np.mean((plain[:, model.V] - root[:, model.V]) ** 2)) < 0.02


def test_a_filter_that_fails_is_lost_from_there_on(short, monkeypatch):
    _, log = short
    told = instants(log, SMART)[0][:40]
    rightful = kalman.correct

    def fails_late(x, P, reading):
        if fails_late.count > 20:
            raise np.linalg.LinAlgError("not positive")
        fails_late.count += 1
        return rightful(x, P, reading)

    fails_late.count = 0
    monkeypatch.setattr(kalman, "correct", fails_late)
    _, state, _ = family.run_family("CD-EKF", told, SMART)
    finite = np.isfinite(state).all(axis=1)
    assert finite[:20].all()
    assert not finite[22:].any()


def test_a_fix_far_off_is_turned_away_for_a_while_only():
    """500 m off: three seconds long nothing of it enters, then the gate opens."""
    far = family.Instant(1.0, (model.GPS_NORTH,), np.array([500.0]), np.array([25.0]), np.array([0.0]))
    observer = family.FAMILY["CD-EKF"](SMART, X, family.SPREAD)
    shut: dict[int, float] = {}
    entered = []
    for k in range(40):
        instant = family.Instant(0.1 * k, far.kinds, far.value, far.variance, far.aux)
        entered.append(len(family._gated(observer, instant, SMART, True, shut).kinds))
    assert sum(entered[:30]) == 0
    assert sum(entered[31:]) == 9
