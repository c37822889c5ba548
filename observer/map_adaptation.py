"""Map adaptation (seed 002, Höckerdal, Frisk and Eriksson): a map's nodes as Kalman states that age, here for our car.

The engine's fuel power is that of a known fit times (1 + theta(omega, T)), theta a bilinear map whose nodes walk at
random: nodes that no drive visits grow uncertain up to a limit and are then quick to learn; nodes visited daily resist
outliers. `observer.diesel` carries the same idea inside the joint state and parameter filter.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.estimate import Estimate
from observer.fit_form import Fit
from observer.operating_points import operating_points
from vehicle_model.car.parameters import Car

BLOCK = 1.0
"""s of contiguous driving that make one measurement: longer than the errors of the estimate stay alike."""
MODEL_ERROR = 0.012
"""Relative, of one such measurement beyond the observer's covariance: fit, grade, wind, transients."""


def linear_weights(nodes: NDArray, value: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The two nodes (ascending) around `value` and their weights: linear interpolation, constant beyond the ends."""
    left = int(np.clip(np.searchsorted(nodes, value) - 1, 0, len(nodes) - 2))
    share = float(np.clip((value - nodes[left]) / (nodes[left + 1] - nodes[left]), 0.0, 1.0))
    return np.array([left, left + 1]), np.array([1.0 - share, share])


def bilinear_weights(
    rows: NDArray, columns: NDArray, row: float, column: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The four nodes (row-major numbers) around (row, column) and their weights; they sum to one."""
    i, a = linear_weights(rows, row)
    j, b = linear_weights(columns, column)
    return (i[:, None] * len(columns) + j).ravel(), np.outer(a, b).ravel()


@dataclass(frozen=True)
class NodeFilter:
    """Nodes and their covariance: a Kalman filter whose transition is the identity."""

    value: NDArray[np.float64]
    """(n,), theta."""
    covariance: NDArray[np.float64]
    """(n, n)."""
    limit: NDArray[np.float64]
    """(n,): no variance grows beyond it (seed 002, 3.1)."""
    walk: float
    """Standard deviation of the random walk, per square root of a second."""
    rejected: int = 0
    """Outliers so far."""


def limited(covariance: NDArray, limit: NDArray) -> NDArray[np.float64]:
    """`covariance` with no variance above `limit`: rows and columns scaled together, so it stays positive definite."""
    scale = np.sqrt(np.minimum(1.0, limit / np.diag(covariance)))
    return covariance * np.outer(scale, scale)


def grow(nodes: NodeFilter, seconds: float) -> NodeFilter:
    """Time update: every node may have changed a little in `seconds`."""
    grown = nodes.covariance + nodes.walk**2 * seconds * np.eye(len(nodes.value))
    return replace(nodes, covariance=limited(grown, nodes.limit))


def observe_node(
    nodes: NodeFilter, index: NDArray, weights: NDArray, value: float, variance: float, gate: float = 4.0
) -> NodeFilter:
    """Measurement update with `value` = weights . theta[index] + noise; beyond `gate` deviations an outlier."""
    column = nodes.covariance[:, index] @ weights
    expected = float(weights @ column[index]) + variance
    innovation = value - float(weights @ nodes.value[index])
    if not np.isfinite(innovation) or innovation**2 > gate**2 * expected:
        return replace(nodes, rejected=nodes.rejected + 1)
    gain = column / expected
    return replace(
        nodes,
        value=nodes.value + gain * innovation,
        covariance=nodes.covariance - expected * np.outer(gain, gain),
    )


@dataclass(frozen=True)
class AdaptedMap:
    """The relative error of a fuel-power fit over engine speed and torque, as learnt so far."""

    engine_speed: NDArray[np.float64]
    """(a,), nodes, rad/s."""
    torque: NDArray[np.float64]
    """(b,), nodes, N m."""
    nodes: NodeFilter
    """Over the grid, row-major (a b,)."""

    @property
    def correction(self) -> NDArray[np.float64]:
        """(a, b): measured fuel power / fit - 1."""
        return self.nodes.value.reshape(len(self.engine_speed), len(self.torque))

    @property
    def deviation(self) -> NDArray[np.float64]:
        """(a, b)."""
        return np.sqrt(np.diag(self.nodes.covariance)).reshape(self.correction.shape)


def fresh_map(
    car: Car, *, speeds: int = 8, torques: int = 6, start: float = 0.05, shared: float = 0.5, walk: float = 1e-4
) -> AdaptedMap:
    """A map that knows nothing: zero with standard deviation `start`, `shared` of the variance common to all nodes.

    `walk` is what the engine may change by, relative, per square root of a second of driving (1e-4: 0.6 % an hour).
    """
    omega = np.linspace(1.2 * car.engine.idle_speed, 0.9 * car.engine.redline_speed, speeds)
    torque = np.linspace(5.0, 0.95 * car.engine.max_torque, torques)
    n = speeds * torques
    covariance = start**2 * (shared * np.ones((n, n)) + (1.0 - shared) * np.eye(n))
    return AdaptedMap(omega, torque, NodeFilter(np.zeros(n), covariance, np.full(n, start**2), walk))


def adapt(adapted: AdaptedMap, estimate: Estimate, car: Car, fit: Fit, *, smoothed: bool = False) -> AdaptedMap:
    """Return `adapted` after a trip, taken in the order of time (from the causal filter unless `smoothed`).

    Each `BLOCK` of contiguous mappable driving gives one measurement of the relative error of `fit`'s fuel power.
    """
    points = operating_points(estimate, car, smoothed=smoothed)
    side = max(1, round(BLOCK / points.step))
    index = np.flatnonzero(points.mapped)
    pieces = np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(index) else []
    nodes, last = adapted.nodes, float(points.time[0]) if len(points.time) else 0.0
    for piece in pieces:
        for start in range(0, len(piece) - side // 2, side):
            block = piece[start : start + side]
            omega, torque = points.engine_speed[block], points.torque[block]
            burnt = float(points.fuel_power[block].mean())
            wanted = float(fit.fuel_power(omega, torque).mean())
            efficiency = float(points.power[block].mean()) / burnt
            variance = float(points.variance[block].mean()) / max(efficiency, 0.02) ** 2 + MODEL_ERROR**2
            where, weights = bilinear_weights(adapted.engine_speed, adapted.torque, omega.mean(), torque.mean())
            now = float(points.time[block[-1]])
            nodes = observe_node(grow(nodes, now - last), where, weights, burnt / wanted - 1.0, variance)
            last = now
    return replace(adapted, nodes=nodes)


class AdaptedFit(Fit):
    """A fit with what an AdaptedMap has learnt since: P_in (1 + theta)."""

    def __init__(self, base: Fit, adapted: AdaptedMap) -> None:
        self.name, self.r2, self.r2_efficiency = f"{base.name} adapted", base.r2, base.r2_efficiency
        self.base, self.adapted = base, adapted

    def correction(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        """theta at rad/s and N m (broadcast)."""
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        a, b, grid = self.adapted.engine_speed, self.adapted.torque, self.adapted.correction
        i = np.clip(np.searchsorted(a, omega) - 1, 0, len(a) - 2)
        j = np.clip(np.searchsorted(b, torque) - 1, 0, len(b) - 2)
        x = np.clip((omega - a[i]) / (a[i + 1] - a[i]), 0.0, 1.0)
        y = np.clip((torque - b[j]) / (b[j + 1] - b[j]), 0.0, 1.0)
        low = (1.0 - y) * grid[i, j] + y * grid[i, j + 1]
        high = (1.0 - y) * grid[i + 1, j] + y * grid[i + 1, j + 1]
        return (1.0 - x) * low + x * high

    def fuel_power(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        return self.base.fuel_power(engine_speed, torque) * (1.0 + self.correction(engine_speed, torque))
