"""Fuel power as physics shapes it, P_in = omega (a + b T + c T^2), and a kernel on what that leaves.

The quadratic Willans line: a(omega) > 0 is what the engine burns at zero torque (friction, pumping, accessories),
1/b(omega) < 1 the marginal efficiency, c(omega) >= 0 makes the line convex (knock retard, enrichment). The
coefficients are Bernstein polynomials over idle to red line, whose bounds hold everywhere when they hold for the
coefficients. The kernel (a Gaussian process on the logarithm of the ratio) takes up the rest and says how sure it is.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import lsq_linear
from scipy.spatial import cKDTree
from scipy.special import comb

from observer.efficiency_map import Limits
from observer.fit_form import Cells, Fit, r_squared
from vehicle_model.car.parameters import Car

ORDERS = (3, 3, 2)
"""Degree in omega of a, b and c."""
PRIOR_INNER_EFFICIENCY, PRIOR_FRICTION = 0.36, 1.6e5
"""Where nothing was seen: marginal efficiency, and friction mean pressure in Pa (ordinary spark-ignition engines)."""
SMOOTH, AMPLITUDE = (3000.0 * np.pi / 30.0, 1.0), 0.03
"""What an engine departs from the quadratic form by: lengths (rad/s, share of the largest torque) and relative size.
The errors of an hour's map have shorter waves (500 rpm, 15 N m): a kernel that takes those up comes closer to the cells
(0.0031 against 0.0033 rms) but costs a planner more than twice the regret, for it steers into every dent."""
NOISE_FLOOR = 5e-3
"""Relative: a cell's own standard deviation is not believed below it, for neighbours err alike."""
DOUBT, NEAR = 0.02, 0.3
"""Relative deviation of the form itself where nothing was seen, and the share of the lengths that is near a cell."""
PRIOR_WEIGHT = 0.15
"""How hard the prior pulls: 1 would equal a cell known to a standard error of 0.005."""


@dataclass(frozen=True)
class WillansFit(Fit):
    """P_in = omega (a(omega) + b(omega) T + c(omega) T^2)."""

    name: str
    low: float
    """rad/s, where the Bernstein polynomials start."""
    high: float
    torque_scale: float
    coefficients: NDArray[np.float64]
    r2: float
    r2_efficiency: float

    def fuel_power(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        return omega * (_rows(omega, torque, self.low, self.high, self.torque_scale) @ self.coefficients)


@dataclass(frozen=True)
class KernelFit(Fit):
    """A Willans fit times exp(Gaussian process); `deviation` says how sure it is of the efficiency."""

    name: str
    base: WillansFit
    points: NDArray[np.float64]
    """(k, 2), engine speed and torque over their length scales."""
    lengths: NDArray[np.float64]
    """rad/s and N m."""
    noise: NDArray[np.float64]
    """(k,), variances of the data."""
    factor: NDArray[np.float64]
    """Lower Cholesky factor of the data's covariance, (k, k)."""
    weights: NDArray[np.float64]
    common_error: tuple[float, float]
    """N m, and relative, of the torque: shared by all data."""
    r2: float
    r2_efficiency: float

    def fuel_power(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        where = np.stack([omega.ravel(), torque.ravel()], axis=1) / self.lengths
        ratio = _kernel(where, self.points) @ self.weights
        return self.base.fuel_power(omega, torque) * np.exp(ratio.reshape(omega.shape))

    def deviation(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        """One standard deviation of `efficiency`."""
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        where = np.stack([omega.ravel(), torque.ravel()], axis=1) / self.lengths
        cross = _kernel(where, self.points)
        inner = solve_triangular(self.factor, cross.T, lower=True)
        nearest = cKDTree(self.points).query(where)[0] / NEAR
        unseen = DOUBT**2 * (1.0 - np.exp(-0.5 * nearest**2))
        variance = (np.maximum(AMPLITUDE**2 - np.sum(inner**2, axis=0), 0.0) + unseen).reshape(omega.shape)
        shared = self.base.shared_error(omega, torque, self.common_error)
        return self.efficiency(omega, torque) * np.sqrt(variance + shared**2)


def fit_willans(cells: Cells, car: Car, limits: Limits) -> WillansFit:
    """Weighted least squares under the bounds a > 0, b >= 1/0.55, c >= 0; works from no cell at all (the prior)."""
    engine = car.engine
    low, high, scale = 0.8 * engine.idle_speed, engine.redline_speed, engine.max_torque
    prior = _prior(car)
    data = cells.fuel_power / cells.engine_speed
    sigma = data * np.maximum(cells.standard_error, 1e-3) / cells.efficiency
    rows = [_rows(cells.engine_speed, cells.torque, low, high, scale) / sigma[:, None]]
    wanted = [data / sigma]
    if np.isfinite(limits.idle_power) and np.isfinite(limits.idle_speed):
        idle = limits.idle_power / limits.idle_speed
        rows.append(_rows(np.array([limits.idle_speed]), np.zeros(1), low, high, scale) / (0.1 * idle))
        wanted.append(np.array([10.0]))
    # the prior in the coefficients' own size, and in their second differences: smooth in omega as it is
    size = np.concatenate([np.full(order + 1, part) for order, part in zip(ORDERS, _sizes(prior), strict=True)])
    rows.append(PRIOR_WEIGHT * np.diag(1.0 / size) * 10.0)
    wanted.append(PRIOR_WEIGHT * prior / size * 10.0)
    bend = _second_differences()
    rows.append(PRIOR_WEIGHT * 40.0 * bend / (np.abs(bend) @ size)[:, None])
    wanted.append(PRIOR_WEIGHT * 40.0 * (bend @ prior) / (np.abs(bend) @ size))
    least = np.concatenate([np.full(order + 1, bound) for order, bound in
                            zip(ORDERS, (0.1 * prior[0], scale / 0.55, 0.0), strict=True)])  # fmt: skip
    solution = lsq_linear(np.vstack(rows), np.concatenate(wanted), bounds=(least, np.inf), method="bvls")
    fit = WillansFit("P_in willans", low, high, scale, solution.x, float("nan"), float("nan"))
    return replace(fit, **_scores(fit, cells)) if len(cells.torque) else fit


def fit_kernel(base: WillansFit, cells: Cells) -> KernelFit:
    """The smooth part of what the cells leave of log(P_in / base), by a Gaussian process."""
    places = np.stack([cells.engine_speed, cells.torque], axis=1)
    residual = np.log(cells.fuel_power / base.fuel_power(cells.engine_speed, cells.torque))
    noise = np.maximum(cells.standard_error / cells.efficiency, NOISE_FLOOR) ** 2
    lengths = np.array([SMOOTH[0], SMOOTH[1] * base.torque_scale])
    factor = cho_factor(_kernel(places / lengths, places / lengths) + np.diag(noise), lower=True)
    lower, weights = np.tril(factor[0]), cho_solve(factor, residual)
    fit = KernelFit("P_in willans+kernel", base, places / lengths, lengths, noise, lower, weights,
                    cells.common_error, 0.0, 0.0)  # fmt: skip
    return replace(fit, **_scores(fit, cells))


def _scores(fit: Fit, cells: Cells) -> dict[str, Any]:
    power = fit.fuel_power(cells.engine_speed, cells.torque)
    eta = fit.efficiency(cells.engine_speed, cells.torque)
    return {"r2": r_squared(cells.fuel_power, power), "r2_efficiency": r_squared(cells.efficiency, eta)}


def willans_rows(fit: WillansFit, engine_speed: NDArray, torque: NDArray) -> NDArray[np.float64]:
    """Columns (n, 11) whose product with `fit.coefficients` is P_in / omega."""
    return _rows(engine_speed, torque, fit.low, fit.high, fit.torque_scale)


def _rows(omega: NDArray, torque: NDArray, low: float, high: float, scale: float) -> NDArray[np.float64]:
    """Columns of p = P_in / omega: Bernstein polynomials of omega times (1, T/scale, (T/scale)^2)."""
    x = np.clip((omega - low) / (high - low), 0.0, 1.05)
    relative = torque / scale
    parts = []
    for power, order in enumerate(ORDERS):
        for k in range(order + 1):
            parts.append(comb(order, k) * x**k * (1.0 - x) ** (order - k) * relative**power)
    return np.stack(parts, axis=-1)


def _prior(car: Car) -> NDArray[np.float64]:
    """Coefficients of an ordinary engine of this displacement."""
    friction = PRIOR_FRICTION * car.engine.displacement / (4.0 * np.pi) / PRIOR_INNER_EFFICIENCY
    marginal = car.engine.max_torque / PRIOR_INNER_EFFICIENCY
    values = (friction * np.array([0.95, 1.0, 1.25, 1.8]), np.full(4, marginal), np.full(3, 0.05 * marginal))
    return np.concatenate(values)


def _sizes(prior: NDArray) -> tuple[float, float, float]:
    ends = np.cumsum([order + 1 for order in ORDERS])
    return float(prior[0]), float(prior[ends[0]]), float(prior[ends[0]])


def _second_differences() -> NDArray[np.float64]:
    total, start, rows = sum(order + 1 for order in ORDERS), 0, []
    for order in ORDERS:
        for k in range(order - 1):
            row = np.zeros(total)
            row[start + k : start + k + 3] = (1.0, -2.0, 1.0)
            rows.append(row)
        start += order + 1
    return np.array(rows)


def _kernel(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Squared exponential in scaled coordinates, (n, m)."""
    distance = (a[:, None, 0] - b[None, :, 0]) ** 2 + (a[:, None, 1] - b[None, :, 1]) ** 2
    return AMPLITUDE**2 * np.exp(-0.5 * distance)
