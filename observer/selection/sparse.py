"""The convex relaxation of seed 003, 2.2 to 2.4: H2 observer design as a semidefinite programme, few sensors by l1.

All equations are lost in print; the construction follows the text. With P > 0 and Y = P L,

    minimise  trace(F' P F) + trace(T) + lambda sum_j w_j sum |Y_j|
    subject to  P A - Y C + (P A - Y C)' + W' W <= 0,   [T, (Y H)'; Y H, P] >= 0

bounds the squared H2 norm of the observer error (observability form); a column of Y is zero where that of L = P^-1 Y
is. `alpha` of the paper's cost (1 - alpha) trace(T) + alpha |.|_1 is lambda = alpha / (1 - alpha), in units in which
the unpenalised optimum is 1 in the norm's square and in each column sum.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_continuous_lyapunov

from observer.selection.h2 import LinearSystem, kalman_h2

Array = NDArray[np.float64]
ACCURACY, SPARSE_ACCURACY = 1e-8, 1e-5
"""Of the solver: where the norm is wanted, and where only the support is."""
SLACK = 0.1
"""Share of its mean eigenvalue that is added to the gramian before it scales the coordinates: weakly weighted states
would else be blown up, and the solver needs three times the iterations."""
ALPHAS = tuple(np.round(np.geomspace(0.01, 0.95, 10), 4).tolist())


@dataclass(frozen=True)
class Design:
    """What one programme gave. Several systems (operating points) share their sensors."""

    alpha: float
    trace: float
    """Upper bound of the sum over the systems of the squared H2 norms."""
    use: Array
    """Share of its unpenalised column sum that each sensor keeps, (sensors,)."""
    relaxed_count: float
    """sum_j w_j |Y_j|_1: how many sensors, before rounding."""
    gains: tuple[Array, ...]
    """L (n, m) of each system, in its own units."""

    @property
    def chosen(self) -> tuple[int, ...]:
        """The sensors after rounding: the q most used, q the nearest integer to `relaxed_count`."""
        return tuple(sorted(np.argsort(-self.use)[: round(self.relaxed_count)].tolist()))

    def most_used(self, count: int) -> tuple[int, ...]:
        """The `count` most used sensors."""
        return tuple(sorted(np.argsort(-self.use)[:count].tolist()))


class SparseDesign:
    """The programme for `systems` with the same sensors, built once and solved for many penalties.

    Raises ValueError where no stable observer exists even with all sensors.
    """

    def __init__(self, systems: Sequence[LinearSystem]) -> None:
        self.systems = tuple(systems)
        self.sensors = len(systems[0].sensors)
        self._penalty = cp.Parameter(self.sensors, nonneg=True)
        self._pieces, constraints, self._sums, costs = [], [], [], []
        every = tuple(range(self.sensors))
        total = 0.0
        parts = []
        for system in self.systems:
            norm, gain = kalman_h2(system, every)
            if not np.isfinite(norm):
                raise ValueError("expected a system that can be observed with all its sensors")
            parts.append((system, gain))
            total += norm**2
        self.full = total
        for system, gain in parts:
            n, m = len(system.a), len(system.c)
            # coordinates in which the unpenalised optimum is P = 1: what the solver sees is of order one
            closed = system.a - gain @ system.c
            gramian = solve_continuous_lyapunov(closed.T, -system.weight.T @ system.weight)
            gramian = 0.5 * (gramian + gramian.T)
            slack = SLACK * np.trace(gramian) / n
            while True:
                try:
                    root = cholesky(gramian + slack * np.eye(n))
                    break
                except np.linalg.LinAlgError:
                    slack *= 10.0
            back = np.linalg.inv(root)
            a = root @ system.a @ back
            f = root @ system.noise
            c = (system.c @ back) / system.deviation[:, None]
            w = system.weight @ back
            p = cp.Variable((n, n), symmetric=True)  # positive by the second constraint
            y = cp.Variable((n, m))
            t = cp.Variable((m, m), symmetric=True)
            flow = p @ a - y @ c
            constraints += [flow + flow.T + w.T @ w << 0, cp.bmat([[t, y.T], [y, p]]) >> 0]
            costs.append((cp.trace(f.T @ p @ f) + cp.trace(t)) / total)
            reference = np.abs(root @ gain * system.deviation).sum(axis=0)
            self._pieces.append((p, y, back, system.deviation))
            self._sums.append((y, reference))
        scale = np.array([sum(ref[list(g)].sum() for _, ref in self._sums) for g in self.systems[0].sensors])
        scale = np.maximum(scale, 1e-6 * scale.max())
        columns = [
            sum(cp.sum(cp.abs(y[:, list(group)])) for y, _ in self._sums) / scale[j]
            for j, group in enumerate(self.systems[0].sensors)
        ]
        self._use = cp.hstack(columns)
        self._cost = cp.sum(cp.hstack(costs))
        self._problem = cp.Problem(cp.Minimize(self._cost + self._penalty @ self._use), constraints)

    def _solve(self, penalty: Array, accuracy: float) -> Array:
        self._penalty.value = penalty
        with warnings.catch_warnings():
            # an inaccurate support is accepted: it only proposes sets, the Kalman filter's norm decides
            warnings.filterwarnings("ignore", message="Solution may be inaccurate")
            self._problem.solve(solver=cp.CLARABEL, tol_gap_abs=accuracy, tol_gap_rel=accuracy, tol_feas=accuracy)
        if self._problem.status not in ("optimal", "optimal_inaccurate"):
            raise ValueError(f"the semidefinite programme ended as {self._problem.status}")
        return np.maximum(np.asarray(self._use.value), 0.0)

    def design(self, alpha: float = 0.0, rounds: int = 6, epsilon: float = 1e-2, tolerance: float = 1e-2) -> Design:
        """Return the design of weight `alpha` in [0, 1), reweighting w_j = 1 / (use_j + epsilon) until it settles."""
        strength = alpha / (1.0 - alpha)
        weights = np.ones(self.sensors)
        accuracy = SPARSE_ACCURACY if strength > 0.0 else ACCURACY
        use = self._solve(strength * weights, accuracy)
        if strength > 0.0:
            for _ in range(rounds):
                weights = 1.0 / (use + epsilon)
                before, use = use, self._solve(strength * weights, accuracy)
                if np.abs(use - before).max() < tolerance:
                    break
        count = float(np.sum(use / (use + epsilon)))
        gains = tuple(
            back @ np.linalg.solve(np.asarray(p.value), np.asarray(y.value)) / deviation
            for p, y, back, deviation in self._pieces
        )
        return Design(alpha, float(self._cost.value) * self.full, use, count, gains)


def sweep(programme: SparseDesign, alphas: Sequence[float] = ALPHAS) -> list[Design]:
    """Return the designs of all `alphas`; stops early at the first that uses no sensor."""
    found = []
    for alpha in sorted(alphas):
        found.append(programme.design(alpha))
        if round(found[-1].relaxed_count) == 0:
            break
    return found
