"""What the sensors can see: Kalman's rank test, Popov-Belevitch-Hautus, Lie derivatives; the table of 3.1.2.1 derived.

All tests work on scaled states, so that metres and joules weigh alike, and call a direction lost where the singular
value falls below `TOLERANCE` of the largest.
"""

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from observer import model
from observer.estimate import STATES
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]
TOLERANCE = 1e-9
SCALE = np.array([1e2, 10, 1e3, 1, 0.1, 1e2, 1e2, 1e2, 0.01, 1e-3, 1e4, 1e4, 1e2, 1e2, 0.1, 0.1, 0.1])
"""A usual size of each state, SI."""
SENSORS: dict[str, tuple[int, ...]] = {
    "gps": (model.GPS_NORTH, model.GPS_EAST, model.GPS_ALTITUDE),
    "accelerometer": (model.ACCELERATION_X, model.ACCELERATION_Y, model.ACCELERATION_Z),
    "wheel": (model.DISTANCE,),
    "road_map": (model.MAP_HEADING, model.MAP_ALTITUDE),
    "engine_speed": (model.ENGINE_ANGLE,),
    "fuel_flow": (model.INJECTED_ENERGY,),
}
"""The sensors of 3.1.2.1 and their measurements."""


def kalman_matrix(a: Array, c: Array) -> Array:
    """Q_o of A.2, (m n, n)."""
    blocks = [c]
    for _ in range(a.shape[0] - 1):
        blocks.append(blocks[-1] @ a)
    return np.vstack(blocks)


def rank(matrix: Array, tolerance: float = TOLERANCE) -> int:
    """Numerical rank after scaling each row to length 1 (rows of zeros apart)."""
    return int(np.count_nonzero(_singular(matrix)[0] > tolerance))


def _singular(matrix: Array) -> tuple[Array, Array]:
    length = np.linalg.norm(matrix, axis=1)
    rows = matrix[length > 0.0] / length[length > 0.0, None]
    n = matrix.shape[1]
    if not len(rows):
        return np.zeros(n), np.eye(n)
    _, s, vt = np.linalg.svd(np.vstack([rows, np.zeros((n, n))]))
    return s / max(s[0], 1e-300), vt


def lost_states(matrix: Array, tolerance: float = 1e-6) -> list[int]:
    """Return the states that the observability `matrix` (m, n) leaves open: those with a share in its null space."""
    s, vt = _singular(matrix)
    null = vt[s <= tolerance]
    return [i for i in range(matrix.shape[1]) if np.linalg.norm(null[:, i]) > 1e-3] if len(null) else []


def hautus(a: Array, c: Array, tolerance: float = TOLERANCE) -> bool:
    """Popov-Belevitch-Hautus: [s I - A; C] has full column rank at every eigenvalue s of `a`."""
    n = a.shape[0]
    return all(
        np.linalg.matrix_rank(np.vstack([s * np.eye(n) - a, c]), tol=tolerance) == n for s in np.linalg.eigvals(a)
    )


def lie_matrix(car: Car, kinds: Sequence[int], x: Array, order: int = 4, shaft: float | None = None) -> Array:
    """Q(x) of A.4, scaled: gradients of the Lie derivatives L_f^0 h to L_f^order h at `x` (17,), (m (order + 1), 17).

    `shaft` (rad/m) is the known ratio of engine speed and car speed, where the transmission tells it: one more
    measurement, omega - shaft v = 0.
    """
    symbol = ca.SX.sym("x", 17)
    rate = ca.vertcat(*model.dynamics(symbol, car, ca))
    rows = [ca.SX(model.measurement(kind, symbol, car, 0.0, ca)) for kind in kinds]
    if shaft is not None:
        rows.append(symbol[model.OMEGA] - shaft * symbol[model.V])
    h = ca.vertcat(*rows)
    gradients = []
    for _ in range(order + 1):
        gradient = ca.jacobian(h, symbol)
        gradients.append(gradient)
        h = ca.mtimes(gradient, rate)
    return np.array(ca.Function("q", [symbol], [ca.vertcat(*gradients)])(x)) * SCALE


def sensor_table(car: Car, speed: float, *, shaft: float | None = None) -> Mapping[str, list[str]]:
    """Return which states are lost with which sensor (and with none) at `speed` (m/s), on a gentle bend of a hill.

    Losing GPS loses the road map too: its nodes are found by place (footnote to 3.1.2.1).
    """
    x = np.zeros(17)
    x[[model.V, model.F, model.PSI, model.THETA, model.SJ, model.SK]] = speed, 900.0, 0.5, 0.03, 0.004, 0.0006
    x[[model.PIN, model.OMEGA]] = 2e4, 250.0
    if speed == 0.0:
        # held by its brakes: a car about to move off would be seen a moment later
        x[model.F] = car.mass * car.gravity * np.sin(x[model.THETA])
    table = {}
    for missing in ("", *SENSORS):
        gone = {missing, "road_map"} if missing == "gps" else {missing}
        kinds = [kind for name, kinds in SENSORS.items() if name not in gone for kind in kinds]
        table[missing or "none"] = [STATES[i] for i in lost_states(lie_matrix(car, kinds, x, shaft=shaft))]
    return table
