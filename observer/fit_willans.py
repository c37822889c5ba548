"""Fuel power as physics shapes it, P_in = omega (a + b T + c T^2), and a kernel on what that leaves.

The quadratic Willans line: a(omega) > 0 is what the engine burns at zero torque (friction, pumping, accessories),
1/b(omega) < 1 the marginal efficiency, c(omega) >= 0 makes the line convex (knock retard, enrichment). The
coefficients are Bernstein polynomials over idle to red line, whose bounds hold everywhere when they hold for the
coefficients. The kernel (a Gaussian process on the logarithm of the ratio) takes up the rest and says how sure it is.
"""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import lsq_linear
from scipy.special import comb

from observer.efficiency_map import Limits
from observer.fit_form import PLACE_SCATTER, Cells, Fit, r_squared
from vehicle_model.car.parameters import Car

ORDERS = (3, 3, 2)
"""Degree in omega of a, b and c."""
PRIOR_INNER_EFFICIENCY, PRIOR_FRICTION = 0.36, 1.6e5
"""Where nothing was seen: marginal efficiency, and friction mean pressure in Pa (ordinary spark-ignition engines)."""
WIDE_SHARE, WIDE_LENGTH = 4.0, 3.0
"""Variance and length of the kernel's wide part over those of its bumps."""
SMOOTH_LENGTHS, SMOOTH_SIZE = (1000.0 * np.pi / 30.0, 1.0 / 3.0), 0.015
"""Of the smooth form, whose kernel is the wide part alone: 3,000 rpm by the largest torque, 3 %."""
SMOOTH_FLOOR = 5e-3
"""Relative: for the smooth form no cell is known better than this, because neighbours err alike."""
SEARCH_CELLS = 350
"""Cells that the search for the kernel's length scales and amplitude looks at."""
FRICTION_STEP = 0.1
"""For the smooth form: by how much more than an ordinary engine's friction is believed to differ, relatively, from one
Bernstein place to the next. A cold start burns its tenth more at the low speeds of the first minutes: a short trip must
not make high ones cheap by it."""
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
    amplitude: float
    bumps: float
    """1: bumps on top of the wide part of the kernel; 0: none."""
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
        ratio = _kernel(where, self.points, self.amplitude, self.bumps) @ self.weights
        return self.base.fuel_power(omega, torque) * np.exp(ratio.reshape(omega.shape))

    def deviation(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        """One standard deviation of `efficiency`: the kernel's, what all cells share, what neighbouring cells share.

        The kernel follows the last two as if they were the engine's, so they are no less for being followed.
        """
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        where = np.stack([omega.ravel(), torque.ravel()], axis=1) / self.lengths
        cross = _kernel(where, self.points, self.amplitude, self.bumps)
        inner = solve_triangular(self.factor, cross.T, lower=True)
        variance = np.maximum((self.bumps + WIDE_SHARE) * self.amplitude**2 - np.sum(inner**2, axis=0), 0.0).reshape(
            omega.shape
        )
        shared = self.base.shared_error(omega, torque, self.common_error)
        return self.efficiency(omega, torque) * np.sqrt(variance + shared**2 + PLACE_SCATTER**2)


def fit_willans(cells: Cells, car: Car, limits: Limits, friction_step: float = np.inf) -> WillansFit:
    """Weighted least squares under the bounds a > 0, b >= 1/0.55, c >= 0; works from no cell at all (the prior).

    `friction_step`: see `FRICTION_STEP`; infinite, the cells alone shape friction over engine speed.
    """
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
    steps = np.diff(np.diag(1.0 / prior), axis=0)[: ORDERS[0]]
    rows.append(steps / friction_step)
    wanted.append(np.zeros(ORDERS[0]))
    bend = _second_differences()
    rows.append(PRIOR_WEIGHT * 40.0 * bend / (np.abs(bend) @ size)[:, None])
    wanted.append(PRIOR_WEIGHT * 40.0 * (bend @ prior) / (np.abs(bend) @ size))
    least = np.concatenate([np.full(order + 1, bound) for order, bound in
                            zip(ORDERS, (0.1 * prior[0], scale / 0.55, 0.0), strict=True)])  # fmt: skip
    solution = lsq_linear(np.vstack(rows), np.concatenate(wanted), bounds=(least, np.inf), method="bvls")
    fit = WillansFit("P_in willans", low, high, scale, solution.x, float("nan"), float("nan"))
    return replace(fit, **_scores(fit, cells)) if len(cells.torque) else fit


def fit_kernel(base: WillansFit, cells: Cells) -> KernelFit:
    """A Gaussian process on log(P_in / base); length scales and amplitude by maximum marginal likelihood (a grid)."""
    places = np.stack([cells.engine_speed, cells.torque], axis=1)
    residual = np.log(cells.fuel_power / base.fuel_power(cells.engine_speed, cells.torque))
    shared = base.shared_error(cells.engine_speed, cells.torque, cells.common_error)
    # what neighbours share is no noise: it cannot be told from the engine
    noise = np.maximum((cells.standard_error / cells.efficiency) ** 2 - shared**2 - PLACE_SCATTER**2, 3e-3**2)
    # length scales and amplitude by the marginal likelihood of an even subset, then one factor of everything
    some = np.linspace(0, len(residual) - 1, min(len(residual), SEARCH_CELLS)).astype(int)
    best: tuple[float, NDArray, float] | None = None
    for rpm, share, amplitude in product((400.0, 900.0), (0.12, 0.3), (0.01, 0.03)):
        lengths = np.array([rpm * np.pi / 30.0, share * base.torque_scale])
        factor, weights = _solve(places[some] / lengths, residual[some], noise[some], amplitude, 1.0)
        likelihood = -0.5 * float(residual[some] @ weights) - float(np.log(np.diag(factor)).sum())
        if best is None or likelihood > best[0]:
            best = (likelihood, lengths, amplitude)
    assert best is not None
    _, lengths, amplitude = best
    lower, weights = _solve(places / lengths, residual, noise, amplitude, 1.0)
    fit = KernelFit("P_in willans+kernel", base, places / lengths, lengths, amplitude, 1.0, noise, lower, weights,
                    cells.common_error, 0.0, 0.0)  # fmt: skip
    return replace(fit, **_scores(fit, cells))


def fit_smooth(base: WillansFit, cells: Cells) -> KernelFit:
    """The same with the wide part of the kernel alone: what a planner needs.

    The errors of an hour's map have waves of some 500 rpm by 15 N m. A kernel that may follow them comes closer to the
    cells, but a planner steers into every dent: its regret is a fifth to a half higher.
    """
    places = np.stack([cells.engine_speed, cells.torque], axis=1)
    residual = np.log(cells.fuel_power / base.fuel_power(cells.engine_speed, cells.torque))
    noise = np.maximum(cells.standard_error / cells.efficiency, SMOOTH_FLOOR) ** 2
    lengths = np.array([SMOOTH_LENGTHS[0], SMOOTH_LENGTHS[1] * base.torque_scale])
    lower, weights = _solve(places / lengths, residual, noise, SMOOTH_SIZE, 0.0)
    fit = KernelFit("P_in smooth", base, places / lengths, lengths, SMOOTH_SIZE, 0.0, noise, lower, weights,
                    cells.common_error, 0.0, 0.0)  # fmt: skip
    return replace(fit, **_scores(fit, cells))


def _solve(
    places: NDArray, residual: NDArray, noise: NDArray, amplitude: float, bumps: float
) -> tuple[NDArray, NDArray]:
    """Lower Cholesky factor of the data's covariance, and the weights of the mean."""
    factor = cho_factor(_kernel(places, places, amplitude, bumps) + np.diag(noise), lower=True)
    return np.tril(factor[0]), cho_solve(factor, residual)


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


def _kernel(a: NDArray, b: NDArray, amplitude: float, bumps: float) -> NDArray[np.float64]:
    """Squared exponentials in scaled coordinates, (n, m): bumps, and a wide one for where the base form drifts off."""
    distance = (a[:, None, 0] - b[None, :, 0]) ** 2 + (a[:, None, 1] - b[None, :, 1]) ** 2
    return amplitude**2 * (bumps * np.exp(-0.5 * distance) + WIDE_SHARE * np.exp(-0.5 * distance / WIDE_LENGTH**2))
