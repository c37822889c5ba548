"""The family of appendix A against independent oracles: filterpy, scipy's Riccati solvers, closed forms, each other."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from scipy.linalg import expm, solve_continuous_are
from synthetic import SMART

from observer import kalman, model, particle, square_root, unscented
from observer.system import Reading, System, car_reading, car_system, runge_kutta

RNG = np.random.default_rng(11)
A = np.array([[0.0, 1.0, 0.0], [-0.4, -0.3, 1.0], [0.0, 0.0, -0.1]])
C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.2]])
Q, R = np.diag([0.01, 0.05, 0.2]), np.diag([0.04, 0.09])
LINEAR = kalman.linear_system(A, Q)
P0 = np.array([[1.0, 0.2, 0.0], [0.2, 0.8, 0.1], [0.0, 0.1, 0.5]])
X0 = np.array([1.0, -0.5, 0.3])
SPREAD = np.array([1.0, 0.3, 200, 0.02, 0.01, 2, 2, 2, 0.002, 3e-4, 50, 2e3, 1, 5, 0.05, 0.05, 0.05])
CAR = np.zeros(17)
CAR[[1, 2, 3, 4, 8, 9, 11, 13]] = 18.0, 1500.0, 0.6, 0.03, 0.002, 0.0005, 3e4, 250.0
SYSTEM = car_system(SMART, (0.3 * SPREAD) ** 2)
KINDS = (model.ACCELERATION_X, model.ACCELERATION_Y, model.ACCELERATION_Z, model.GPS_NORTH, model.DISTANCE)


def car_readings(count: int) -> list[Reading]:
    told = np.array([model.measurement(kind, CAR, SMART) for kind in KINDS])
    variance = np.array([0.04, 0.04, 0.2, 1.0, 0.01])
    return [car_reading(SMART, KINDS, told + np.sqrt(variance) * RNG.normal(size=5), variance) for _ in range(count)]


def close(x, P, expected_x, expected_P, tolerance):
    np.testing.assert_allclose((x - expected_x) / SPREAD[: len(x)], 0.0, atol=tolerance)
    scale = np.outer(SPREAD, SPREAD)[: len(x), : len(x)]
    np.testing.assert_allclose((P - expected_P) / scale, 0.0, atol=tolerance)


def test_linear_filter_is_filterpys():
    phi = expm(A * 0.1)
    theirs = KalmanFilter(3, 2)
    theirs.x, theirs.P, theirs.F, theirs.Q, theirs.H, theirs.R = X0[:, None].copy(), P0.copy(), phi, Q * 0.1, C, R
    x, P = X0, P0
    for _ in range(30):
        y = RNG.normal(size=2)
        x, P = kalman.predict_discrete(LINEAR, x, P, 0.1)
        x, P = kalman.correct(x, P, kalman.linear_reading(C, y, R))
        theirs.predict()
        theirs.update(y[:, None])
    # the state moves by Runge-Kutta here and by the exponential there
    np.testing.assert_allclose(x, theirs.x[:, 0], atol=2e-6)
    np.testing.assert_allclose(P, theirs.P, atol=1e-10)


def test_continuous_filter_settles_on_the_riccati_equation():
    x, P = kalman.integrate_continuous(
        LINEAR, X0, P0, lambda t: kalman.linear_reading(C, np.zeros(2), R), 0.0, 60.0, 0.02
    )
    np.testing.assert_allclose(P, solve_continuous_are(A.T, C.T, Q, R), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(x, 0.0, atol=1e-6)


def test_square_root_filter_is_the_plain_one_and_survives_where_it_does_not():
    x, P = CAR.copy(), np.diag(SPREAD**2)
    sx, S = CAR.copy(), np.diag(SPREAD)
    factor = np.linalg.cholesky(SYSTEM.noise)
    for reading in car_readings(20):
        middle = runge_kutta(SYSTEM.dynamics, x, 0.01)
        phi = expm(SYSTEM.jacobian(middle) * 0.02)
        x, P = runge_kutta(SYSTEM.dynamics, x, 0.02), phi @ P @ phi.T + SYSTEM.noise * 0.02
        x, P = kalman.correct(x, P, reading)
        sx, S = square_root.predict(SYSTEM, sx, S, factor, 0.02)
        sx, S = square_root.correct(sx, S, reading)
    close(sx, S @ S.T, x, P, 1e-8)
    # two all but exact measurements of nearly the same thing: (I - K H) P loses positivity, S has full rank
    c, wide, exact = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0 + 1e-6]]), P0 * 1e6, 1e-10 * np.eye(2)
    gain = wide @ c.T @ np.linalg.inv(c @ wide @ c.T + exact)
    assert np.linalg.eigvals(wide - gain @ c @ wide).real.min() < 0.0
    _, S = square_root.correct(X0, np.linalg.cholesky(wide), kalman.linear_reading(c, np.ones(2), exact))
    assert np.linalg.svd(S, compute_uv=False).min() > 0.0


def test_unscented_filter_is_filterpys():
    """On the car: same sigma points, same moments, predict and correct."""
    spread = unscented.Spread(alpha=0.5, beta=2.0, kappa=1.0)
    points = MerweScaledSigmaPoints(17, alpha=0.5, beta=2.0, kappa=1.0)
    readings = car_readings(3)
    theirs = UnscentedKalmanFilter(
        17, 5, 0.02, hx=readings[0].expected, fx=lambda x, dt: runge_kutta(SYSTEM.dynamics, x, dt), points=points
    )
    theirs.x, theirs.P = CAR.copy(), np.diag(SPREAD**2)
    theirs.Q, theirs.R = SYSTEM.noise * 0.02, readings[0].noise
    x, P = CAR, np.diag(SPREAD**2)
    for reading in readings:
        x, P = unscented.predict(SYSTEM, x, P, 0.02, spread)
        x, P = unscented.correct(x, P, reading, spread)
        theirs.predict()
        theirs.sigmas_f = points.sigma_points(theirs.x, theirs.P)  # A.20 draws the points anew
        theirs.update(reading.value)
    close(x, P, theirs.x, theirs.P, 1e-7)


def test_unscented_filter_is_kalmans_on_a_line():
    x, P = unscented.predict(LINEAR, X0, P0, 0.1, unscented.Spread())
    reading = kalman.linear_reading(C, np.array([0.4, -0.2]), R)
    x, P = unscented.correct(x, P, reading, unscented.Spread())
    ex, eP = kalman.correct(*kalman.predict_discrete(LINEAR, X0, P0, 0.1), reading)
    np.testing.assert_allclose(x, ex, atol=1e-7)
    np.testing.assert_allclose(P, eP, atol=1e-6)


def test_square_root_kalman_bucy_filter():
    """On a line it is the Riccati flow; on the car its correction is the plain unscented one."""
    spread = unscented.Spread()
    x, S = unscented.predict_square_root(LINEAR, X0, np.linalg.cholesky(P0), 0.3, spread)
    ex, eP = X0, P0
    for _ in range(60):
        ex, eP = kalman.predict_continuous(LINEAR, ex, eP, 0.005)
    np.testing.assert_allclose(x, ex, atol=1e-9)
    np.testing.assert_allclose(S @ S.T, eP, atol=1e-9)
    reading = car_readings(1)[0]
    P = np.diag(SPREAD**2)
    x, P = unscented.correct(CAR, P, reading, spread)
    sx, S = unscented.correct_square_root(CAR, np.diag(SPREAD), reading, spread)
    close(sx, S @ S.T, x, P, 1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rank_one_update_of_a_factor(sign):
    v = np.array([0.3, -0.2, 0.1])
    L = unscented.update_cholesky(np.linalg.cholesky(P0), v, sign)
    np.testing.assert_allclose(L @ L.T, P0 + sign * np.outer(v, v), atol=1e-12)
    with pytest.raises(np.linalg.LinAlgError):
        unscented.update_cholesky(np.linalg.cholesky(P0), 10.0 * v, -1.0)


def test_continuous_and_discrete_prediction_agree_in_the_limit():
    x, P = CAR, np.diag(SPREAD**2)
    dx, dP = CAR, np.diag(SPREAD**2)
    for _ in range(10):
        x, P = kalman.predict_continuous(SYSTEM, x, P, 0.001)
        dx, dP = kalman.predict_discrete(SYSTEM, dx, dP, 0.001)
    close(dx, dP, x, P, 1e-3)


def test_luenberger_observer_converges_at_its_poles():
    gain = kalman.luenberger_gain(A, C, np.array([-2.0, -3.0, -4.0]))
    assert np.sort(np.linalg.eigvals(A - gain @ C).real) == pytest.approx([-4.0, -3.0, -2.0])
    dt, x = 0.01, X0.copy()
    truth = np.array([expm(A * dt * k) @ X0 for k in range(400)])
    found = kalman.observe_luenberger(A, C, gain, np.zeros(3), truth @ C.T, dt)
    error = np.linalg.norm(found[:-1] - truth[1:], axis=1)
    assert error[-1] < 0.02 * np.linalg.norm(x)
    with pytest.raises(ValueError):
        kalman.luenberger_gain(A, np.array([[0.0, 0.0, 0.0]]), np.array([-2.0, -3.0, -4.0]))


def test_particles_tell_what_kalman_tells():
    """Speed and thrust from the accelerometer and a speedometer over 2 s: mean within its own error of the EKF's."""
    rng = np.random.default_rng(4)
    keep = list(particle.REDUCED)
    noise = np.array([1e-3, 1e5, 1e-6, 1e-10, 1e-7])
    start, spread = CAR[keep], np.diag([0.5, 300.0, 0.01, 3e-4, 0.1]) ** 2
    cloud = particle.draw(start, spread, 4000, rng)

    def widen(x):
        full = np.zeros(17)
        full[keep] = x
        return full

    reduced = System(
        lambda x: np.array(model.dynamics(widen(x), SMART))[keep],
        lambda x: model.dynamics_jacobian(widen(x), SMART)[np.ix_(keep, keep)],
        np.diag(noise),
    )
    x, P = start, spread
    for k in range(40):
        kind, value, deviation = ((model.ACCELERATION_X, 1.2, 0.2), (model.SPEED, 18.0 + 0.04 * k, 0.1))[k % 2]
        particle.predict(cloud, SMART, noise, 0.05, rng)
        particle.correct(
            cloud, lambda full, kind=kind: model.measurement(kind, full, SMART, 0.0, np), value, deviation, rng
        )
        x, P = kalman.predict_continuous(reduced, x, P, 0.05)
        reading = Reading(
            np.array([value]),
            lambda x, kind=kind: np.array([model.measurement(kind, widen(x), SMART)]),
            lambda x, kind=kind: model.measurement_jacobian(kind, widen(x), SMART)[None, keep],
            np.array([[deviation**2]]),
        )
        x, P = kalman.correct(x, P, reading)
    np.testing.assert_allclose((cloud.mean() - x) / np.sqrt(np.diag(P)), 0.0, atol=0.35)
    np.testing.assert_allclose(np.diag(cloud.covariance()) / np.diag(P), 1.0, atol=0.35)
    assert cloud.weights.sum() == pytest.approx(1.0)
