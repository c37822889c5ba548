"""The compiled filter and smoother against slow references."""

import entry
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from synthetic import SMART, drive, sense

from observer import kernel, model, reference
from observer.events import GRID_STEP, prepare, with_grid
from observer.observe import start
from observer.settings import DEFAULT

CURVE = np.zeros(17)
CURVE[[1, 2, 3, 4, 8, 9, 11, 13]] = 18.0, 1500.0, 0.6, 0.03, 0.02, 0.001, 3e4, 250.0
SPREAD = np.array([1.0, 0.3, 200, 0.05, 0.01, 2, 2, 2, 0.002, 3e-4, 50, 2e3, 1, 5, 0.05, 0.05, 0.05])


def uncertain() -> np.ndarray:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(17, 17)) * 0.3 + np.eye(17)
    return SPREAD[:, None] * (root @ root.T) * SPREAD


def exact(x: np.ndarray, P: np.ndarray, q: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    def rate(_, y):
        dx, dP = reference.rates(y[:17], y[17:].reshape(17, 17), q, SMART)
        return np.concatenate([dx, dP.ravel()])

    end = solve_ivp(rate, (0.0, dt), np.concatenate([x, P.ravel()]), rtol=1e-12, atol=1e-14, method="DOP853").y[:, -1]
    return end[:17], end[17:].reshape(17, 17)


def scaled_error(x: np.ndarray, P: np.ndarray, of: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    return (
        float(np.abs((x - of[0]) / SPREAD).max()),
        float(np.abs((P - of[1]) / np.outer(SPREAD, SPREAD)).max()),
    )


@pytest.mark.parametrize(
    ("step", "order"), [(reference.predict_runge_kutta, 4), (reference.predict_transition, 2)], ids=["rk4", "second"]
)
def test_order_of_accuracy(step, order):
    """Halving the step divides the error over 0.4 s by 2^order (within a quarter of an order)."""
    P, q = uncertain(), np.zeros((17, 17))
    target = exact(CURVE, P, q, 0.4)
    errors = []
    for n in (4, 8):
        x, p = CURVE.copy(), P.copy()
        for _ in range(n):
            x, p = step(x, p, q, 0.4 / n, SMART)
        errors.append(scaled_error(x, p, target))
    for coarse, fine in zip(*errors, strict=True):
        assert np.log2(coarse / fine) == pytest.approx(order, abs=0.35)


def kernel_prediction(x: np.ndarray, P: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    f = start(SMART, DEFAULT, None, 0.0)
    full, cov = np.zeros(kernel.NX), np.zeros((kernel.NX, kernel.NX))
    full[:17], cov[:17, :17] = x, P
    entry.predict(
        full, cov, dt, f.car, f.settings, np.zeros(kernel.NX), np.empty((7, 8)), np.empty(kernel.NX + 4),
        np.empty((9, kernel.NX)),
    )  # fmt: skip
    return full[:17], cov[:17, :17]


def test_compiled_prediction_is_the_second_order_transition():
    P = uncertain()
    x, p = kernel_prediction(CURVE, P, 0.02)
    expected, covariance = reference.predict_transition(CURVE, P, np.zeros((17, 17)), 0.02, SMART)
    # the compiled transition keeps the dominant second-order terms: all that is left is of third order in dt
    assert max(scaled_error(x, p, (expected, covariance))) < 2e-6


def test_compiled_correction_is_the_vector_correction():
    """Three scalar updates one after another equal one update with three rows when the model is linear there."""
    f = start(SMART, DEFAULT, None, 0.0)
    f.x[:17], f.P[:17, :17] = CURVE, uncertain()
    before_x, before_P = f.x[:17].copy(), f.P[:17, :17].copy()
    kinds = (model.DISTANCE, model.INJECTED_ENERGY, model.ENGINE_ANGLE)
    y, r = np.array([0.4, 20.0, 0.3]), np.array([0.01, 4.0, 0.04])
    for kind, value, variance in zip(kinds, y, r, strict=True):
        assert entry.fuse(np.int64(kind), value, variance, 0.0, f) == kernel.FUSED
    x, P, _, _ = reference.correct(before_x, before_P, kinds, y, r, SMART)
    np.testing.assert_allclose(f.x[:17], x, rtol=1e-9, atol=1e-9)
    assert scaled_error(x, f.P[:17, :17], (x, P))[1] < 1e-9


def test_smoother_is_rauch_tung_striebel():
    """The modified Bryson-Frazier pass equals the textbook's fixed-interval smoother over 2 s of a drive."""
    log = sense(drive(seed=2, duration=60.0), seed=2)
    events = with_grid(prepare(log)[0])
    # accelerometer and grid alone: no anchor is set anew, so that the textbook's recursion applies as it stands
    begin = int(np.searchsorted(events[:, 0], 40.0))
    warm = start(SMART, DEFAULT, None, float(events[0, 0]))
    kernel.advance(events, 0, begin, warm)
    part = events[begin:]
    part = part[np.isin(part[:, 1], (kernel.ACCELEROMETER, kernel.GRID)) & (part[:, 0] < 42.0)]
    warm.memory[kernel.M_TICK_TIME] = warm.memory[kernel.M_PULSE_TIME] = 1e9  # nothing is silent
    lines = int(np.sum(part[:, 1] == kernel.GRID))

    tape = warm._replace(
        x=warm.x.copy(), P=warm.P.copy(), memory=warm.memory.copy(), counts=np.zeros(6, np.int64),
        grid_x=np.empty((lines, kernel.NX)), grid_P=np.empty((lines, kernel.NX)),
        tape=np.empty((5000, kernel.TAPE_ROW)), tape_index=np.zeros((5001, 10), np.int64),
        tape_P=np.empty((lines, kernel.NX, kernel.NX)),
    )  # fmt: skip
    tape.counts[kernel.TAPING] = 1
    kernel.advance(part, 0, len(part), tape)
    smooth_x, smooth_P = tape.grid_x.copy(), tape.grid_P.copy()
    kernel.retreat(
        tape,
        0,
        tape.counts[kernel.TAPE_LINES],
        -1,
        np.zeros(kernel.NX),
        np.zeros((kernel.NX, kernel.NX)),
        smooth_x,
        smooth_P,
    )

    # the textbook: filtered and predicted moments at every event, then backwards
    plain = warm._replace(x=warm.x.copy(), P=warm.P.copy(), memory=warm.memory.copy(), counts=np.zeros(6, np.int64))
    filtered, predicted, transitions, at_grid = [], [], [], []
    for event in part:
        dt = event[0] - plain.memory[kernel.M_TIME]
        filtered.append((plain.x.copy(), plain.P.copy()))
        n, xm = np.empty((7, 8)), np.empty(kernel.NX + 4)
        entry.transition(plain.x, dt, plain.car, n, xm)
        phi = np.eye(kernel.NX)
        moving, columns = [0, 1, 3, 4, 5, 6, 7], [1, 2, 4, 9, 3, 8, 20, 21]
        phi[np.ix_(moving, columns)] += n
        phi[10, 11] = phi[12, 13] = dt
        decay = np.exp(-dt / np.array([DEFAULT.gps_drift_time] * 2 + [DEFAULT.gps_vertical_drift_time]))
        phi[[17, 18, 19], [17, 18, 19]] = decay
        entry.move(event[0], plain)
        predicted.append((plain.x.copy(), plain.P.copy()))
        transitions.append(phi)
        if event[1] == kernel.ACCELEROMETER:
            entry.on_accelerometer(event, plain)
        else:
            at_grid.append(len(filtered) - 1)
    last = (plain.x.copy(), plain.P.copy())
    expected = {}
    x, P = last
    for k in range(len(part) - 1, -1, -1):
        # moments after event k are those that filtered[k + 1] holds; a grid line changes nothing
        if k in at_grid:
            expected[at_grid.index(k)] = (x, P)
        here_x, here_P = filtered[k]
        ahead_x, ahead_P = predicted[k]
        unit = np.sqrt(np.diag(ahead_P))
        gain = np.linalg.solve(ahead_P / np.outer(unit, unit), (transitions[k] @ here_P) / unit[:, None]).T / unit
        x, P = here_x + gain @ (x - ahead_x), here_P + gain @ (P - ahead_P) @ gain.T
    for line in range(3, lines - 1):
        wanted, covariance = expected[line]
        scale = np.sqrt(np.diag(covariance))
        np.testing.assert_allclose((smooth_x[line] - wanted) / scale, 0.0, atol=1e-3)
        np.testing.assert_allclose(smooth_P[line] / np.diag(covariance), 1.0, atol=1e-3)


def test_grid_lines_follow_the_events_of_their_time():
    rows = np.zeros((3, kernel.COLUMNS))
    rows[:, 0] = 0.05, 0.1, 0.31
    events = with_grid(rows)
    np.testing.assert_allclose(events[:, 0], [0.05, 0.1, 0.1, 0.2, 0.3, 0.31])
    assert list(events[:, 1] == kernel.GRID) == [False, False, True, True, True, False]
    assert pytest.approx(0.1) == GRID_STEP


def test_compiled_runge_kutta_event_is_the_reference():
    """Predict by RK4 on state and covariance, three-row update: compiled against dense, line by line."""
    from observer import runge_kutta

    car = runge_kutta.constants(
        SMART.mass,
        SMART.accelerated_mass,
        SMART.gravity,
        0.5 * SMART.air_density * SMART.drag_area,
        SMART.mass * SMART.rolling_resistance,
    )
    rng = np.random.default_rng(8)
    dt, y = rng.uniform(0.002, 0.03, 40), rng.normal(size=(40, 3)) * 0.1 + [0.5, -3.0, 9.9]
    q, r = (0.1 * SPREAD) ** 2, np.array([0.04, 0.04, 0.2])
    x, P = CURVE.copy(), uncertain()
    expected_x, expected_P = x.copy(), P.copy()
    runge_kutta.events(x, P, q, dt, y, r, car, np.empty(runge_kutta.WORK))
    kinds = (model.ACCELERATION_X, model.ACCELERATION_Y, model.ACCELERATION_Z)
    for step, values in zip(dt, y, strict=True):
        expected_x, expected_P = reference.predict_runge_kutta(expected_x, expected_P, np.diag(q), step, SMART)
        expected_x, expected_P, _, _ = reference.correct(expected_x, expected_P, kinds, values, r, SMART)
    assert max(scaled_error(x, P, (expected_x, expected_P))) < 1e-8
