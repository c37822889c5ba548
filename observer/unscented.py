"""The unscented Kalman filter (A.3.2) and the square-root unscented Kalman-Bucy filter (A.3.3.2).

A_29 to A.32 call the lower factor of P "A"; here it is S, since A is the dynamics' Jacobian (ERRATA).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from observer.square_root import lower_factor
from observer.system import Reading, System, runge_kutta

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Spread:
    """alpha, beta, kappa of A.19; beta = 2 is right for a Gaussian."""

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    def scale(self, n: int) -> float:
        """c = alpha^2 (n + kappa)."""
        return self.alpha**2 * (n + self.kappa)

    def weights(self, n: int) -> tuple[Array, Array]:
        """Weights of mean and covariance, (2 n + 1,) each: 1 / (2 (n + lambda)), where A.19 prints lambda / ..."""
        c = self.scale(n)
        mean = np.full(2 * n + 1, 0.5 / c)
        mean[0] = 1.0 - n / c
        covariance = mean.copy()
        covariance[0] += 1.0 - self.alpha**2 + self.beta
        return mean, covariance


def sigma_points(x: Array, S: NDArray[np.floating], spread: Spread) -> Array:
    """Return the points (2 n + 1, n) about `x` (n,), from the lower factor `S` (n, n)."""
    offset = np.sqrt(spread.scale(len(x))) * S.T
    return np.vstack([x, x + offset, x - offset])


def predict(system: System, x: Array, P: Array, dt: float, spread: Spread) -> tuple[Array, Array]:
    """A.19 over `dt` (s): every point by Runge-Kutta, Q_d = Q_c dt."""
    wm, wc = spread.weights(len(x))
    points = runge_kutta(system.dynamics, sigma_points(x, np.linalg.cholesky(P), spread).T, dt).T
    mean = wm @ points
    d = points - mean
    return mean, d.T @ (wc[:, None] * d) + system.noise * dt


def correct(x: Array, P: Array, reading: Reading, spread: Spread) -> tuple[Array, Array]:
    """A.20. Angles must not spread over the turn."""
    wm, wc = spread.weights(len(x))
    points = sigma_points(x, np.linalg.cholesky(P), spread)
    told = reading.expected(points.T).T
    mean = wm @ told
    d, e = points - x, told - mean
    s = e.T @ (wc[:, None] * e) + reading.noise
    gain = np.linalg.solve(s, e.T @ (wc[:, None] * d)).T
    P = P - gain @ s @ gain.T
    return x + gain @ reading.innovation(mean), 0.5 * (P + P.T)


def _half(m: Array) -> Array:
    """Phi of A.31: the lower triangle with half the diagonal."""
    return np.tril(m, -1) + 0.5 * np.diag(np.diag(m))


def predict_square_root(
    system: System, x: Array, S: Array, dt: float, spread: Spread, step: float = 0.005
) -> tuple[Array, Array]:
    """A.29 over `dt` (s): the mean and the lower factor S of P obey one differential equation, integrated by RK4.

    d(mean)/dt = f(X) w_m; dS/dt = S Phi(M), M = S^-1 (X W f(X)' + f(X) W X' + Q) S^-T.
    """
    n = len(x)
    wm, wc = spread.weights(n)

    def rate(y: Array) -> Array:
        factor = y[:, 1:]
        points = sigma_points(y[:, 0], factor, spread)
        slopes = system.dynamics(points.T).T
        mean = wm @ slopes
        cross = (points - y[:, 0]).T @ (wc[:, None] * (slopes - mean))
        inner = solve_triangular(factor, cross + cross.T + system.noise, lower=True)
        m = solve_triangular(factor, inner.T, lower=True)
        return np.column_stack([mean, factor @ _half(m)])

    y = np.column_stack([x, S])
    count = max(int(np.ceil(dt / step)), 1)
    for _ in range(count):
        y = runge_kutta(rate, y, dt / count)
    return y[:, 0], np.tril(y[:, 1:])


def update_cholesky(L: Array, v: Array, sign: float) -> Array:
    """Return the lower factor of L L' + sign v v' (rank-one update or downdate; note 19).

    Raises numpy.linalg.LinAlgError where a downdate leaves it indefinite.
    """
    L, v = L.copy(), v.copy()
    for k in range(len(v)):
        square = L[k, k] ** 2 + sign * v[k] ** 2
        if square <= 0.0:
            raise np.linalg.LinAlgError("the downdated matrix is not positive definite")
        r = np.sqrt(square)
        c, s = r / L[k, k], v[k] / L[k, k]
        L[k, k] = r
        L[k + 1 :, k] = (L[k + 1 :, k] + sign * s * v[k + 1 :]) / c
        v[k + 1 :] = c * v[k + 1 :] - s * L[k + 1 :, k]
    return L


def correct_square_root(x: Array, S: Array, reading: Reading, spread: Spread) -> tuple[Array, Array]:
    """A.32: the innovation's factor by QR and one rank-one update, the new S by rank-one downdates."""
    wm, wc = spread.weights(len(x))
    points = sigma_points(x, S, spread)
    told = reading.expected(points.T).T
    mean = wm @ told
    e = told - mean
    factor = lower_factor(np.hstack([np.sqrt(wc[1]) * e[1:].T, np.linalg.cholesky(reading.noise)]))
    signs = np.sign(np.diag(factor))
    factor = update_cholesky(
        factor * np.where(signs == 0.0, 1.0, signs), np.sqrt(abs(wc[0])) * e[0], float(np.sign(wc[0]))
    )
    cross = (points - x).T @ (wc[:, None] * e)
    gain = solve_triangular(factor, solve_triangular(factor, cross.T, lower=True), lower=True, trans=1).T
    u = gain @ factor
    for column in u.T:
        S = update_cholesky(S, column, -1.0)
    return x + gain @ reading.innovation(mean), S
