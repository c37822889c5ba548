"""Linear quadratic control (B.2.2) and controllability (B.1.2).

J = 1/2 integral of (x'Q x + u'R u) dt; u = -K x, V = x'S x / 2, and so the costate is lambda = -S x.
Printed equations are departed from where ERRATA says so: B.7 (- Q), B.8 (S_0 = Q_f, K = (B'SB + R)^-1 B'SA).
"""

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from vehicle_model.car.errors import BadInput

Matrix = NDArray[Any]


def riccati_flow(a: Matrix, b: Matrix, q: Matrix, r: Matrix, s_end: Matrix, time_to_go: float) -> Matrix:
    """S at `time_to_go` before S = `s_end`: -dS/dt = S A + A'S - S B R^-1 B'S + Q (B.7 with ERRATA's sign), exactly.

    The state and its costate p = S x flow linearly: d(x, p)/dt = (A x - B R^-1 B' p, -Q x - A'p).
    """
    n = len(a)
    hamiltonian = np.block([[a, -b @ np.linalg.solve(r, b.T)], [-q, -a.T]])
    flow = expm(-hamiltonian * time_to_go)
    state, costate = flow[:n, :n] + flow[:n, n:] @ s_end, flow[n:, :n] + flow[n:, n:] @ s_end
    s = costate @ np.linalg.inv(state)
    return 0.5 * (s + s.T)


def continuous_regulator(
    a: Matrix, b: Matrix, q: Matrix, r: Matrix, *, tolerance: float = 1e-13
) -> tuple[Matrix, Matrix]:
    """S and K = R^-1 B'S of the infinite horizon: `riccati_flow` until it stands still. Shapes (n, n), (nu, n).

    Raises BadInput when feedback cannot stabilise (A, B).
    """
    s = np.zeros_like(q)
    step = 1.0 / max(float(np.linalg.norm(a)), 1.0)
    for _ in range(20_000):
        new = riccati_flow(a, b, q, r, s, step)
        if not np.all(np.isfinite(new)) or np.linalg.norm(new) > 1e12 * (1.0 + np.linalg.norm(q)):
            break
        if np.linalg.norm(new - s) <= tolerance * (1.0 + np.linalg.norm(new)):
            return new, np.linalg.solve(r, b.T @ new)
        s = new
    raise BadInput("linear system", "(A, B)", "a pair that feedback can stabilise")


def discrete_regulator(
    a: Matrix, b: Matrix, q: Matrix, r: Matrix, q_end: Matrix | None = None, *, steps: int | None = None
) -> tuple[Matrix, Matrix]:
    """S and K of sum (x'Q x + u'R u): S_0 = Q_f, S_k = Q + A'(S^-1 + B R^-1 B')^-1 A, K = (B'SB + R)^-1 B'SA (B.8).

    `steps` backward steps, or until it stands still. The inverse of S is avoided by Woodbury's identity.
    Raises BadInput when feedback cannot stabilise (A, B).
    """
    s = q.copy() if q_end is None else q_end.copy()
    for _ in range(steps if steps is not None else 200_000):
        gain = np.linalg.solve(b.T @ s @ b + r, b.T @ s @ a)
        new = q + a.T @ s @ (a - b @ gain)
        new = 0.5 * (new + new.T)
        if not np.all(np.isfinite(new)) or np.linalg.norm(new) > 1e14 * (1.0 + np.linalg.norm(q)):
            raise BadInput("linear system", "(A, B)", "a pair that feedback can stabilise")
        still = np.linalg.norm(new - s) <= 1e-14 * (1.0 + np.linalg.norm(new))
        s = new
        if still and steps is None:
            break
    else:
        if steps is None:
            raise BadInput("linear system", "(A, B)", "a pair that feedback can stabilise")
    return s, np.linalg.solve(b.T @ s @ b + r, b.T @ s @ a)


def kalman_rank(a: Matrix, b: Matrix) -> int:
    """Rank of (B, AB, ..., A^(n-1) B) (B.1): controllable when it is n."""
    blocks = [b]
    for _ in range(len(a) - 1):
        blocks.append(a @ blocks[-1])
    return int(np.linalg.matrix_rank(np.hstack(blocks)))


def lie_rank(
    drift: Callable[[ca.SX], ca.SX],
    fields: Sequence[Callable[[ca.SX], ca.SX]],
    point: Sequence[float],
    *,
    depth: int | None = None,
) -> int:
    """Rank at `point` of the span of the control fields and their brackets with the drift and each other (B.2).

    dx/dt = drift(x) + sum of fields_i(x) u_i. [f, g] = (dg/dx) f - (df/dx) g, derivatives by CasADi; brackets are
    nested up to `depth` (n - 1 by default). Rank n: locally accessible.
    """
    n = len(point)
    x = ca.SX.sym("x", n)
    f, g = drift(x), [field(x) for field in fields]

    def bracket(first: ca.SX, second: ca.SX) -> ca.SX:
        return ca.jacobian(second, x) @ first - ca.jacobian(first, x) @ second

    found, newest = list(g), list(g)
    for _ in range(depth if depth is not None else n - 1):
        newest = [bracket(h, v) for v in newest for h in (f, *g)]
        found += newest
    matrix = ca.Function("span", [x], [ca.horzcat(*found)])(ca.DM(list(point)))
    return int(np.linalg.matrix_rank(np.asarray(matrix)))
