"""The CD-EKF of chapter 3 as its algorithm 1 has it, compiled: Runge-Kutta 4 on state and covariance, three-row update.

The default observer (`observer.kernel`) moves the covariance by a second-order transition instead; this is the
reference for its accuracy and the subject of the benchmark `observer_event`. `observer.reference` is the readable form.
"""

import math

import numpy as np
from numba import njit

NX = 17
SIGN_BAND = 0.1
MASS, ACCELERATED, GRAVITY, DRAG, ROLLING = range(5)
"""Places in the car's constants: M, M_a, g, rho C_d A / 2, M C_rr."""
WORK = 5 * NX * NX + 6 * NX


@njit
def _acceleration(x, p, g):
    """dv/dt; fills g with its derivatives by v, F, theta, S_k."""
    v = x[1]
    ct, st = math.cos(x[4]), math.sin(x[4])
    root = math.sqrt(v * v + SIGN_BAND * SIGN_BAND)
    sign = v / root
    load = p[DRAG] * v * v + p[ROLLING] * (p[GRAVITY] * ct + x[9] * v * v)
    w = 1.0 / p[ACCELERATED]
    slope = SIGN_BAND * SIGN_BAND / (root * root * root)
    g[0] = -w * (slope * load + sign * 2.0 * v * (p[DRAG] + p[ROLLING] * x[9]))
    g[1] = w
    g[2] = w * (sign * p[ROLLING] * p[GRAVITY] * st - p[MASS] * p[GRAVITY] * ct)
    g[3] = -w * sign * p[ROLLING] * v * v
    return w * (x[2] - sign * load - p[MASS] * p[GRAVITY] * st)


@njit
def _rates(x, P, q, p, dx, dP, g, rows):
    """dx/dt and dP/dt = A P + P A' + Q (diagonal q), with the zeros of equation 3.4 left out."""
    v = x[1]
    a = _acceleration(x, p, g)
    cp, sp, ct, st = math.cos(x[3]), math.sin(x[3]), math.cos(x[4]), math.sin(x[4])
    for i in range(NX):
        dx[i] = 0.0
    dx[0], dx[1], dx[3], dx[4] = v, a, x[8] * v, x[9] * v
    dx[5], dx[6], dx[7] = v * cp * ct, v * sp * ct, -v * st
    dx[10], dx[12] = x[11], x[13]
    g0, g1, g2, g3 = g[0], g[1], g[2], g[3]
    sj, sk = x[8], x[9]
    n1, n2, n3 = cp * ct, -v * sp * ct, -v * cp * st
    e1, e2, e3 = sp * ct, v * cp * ct, -v * sp * st
    d1, d3 = -st, -v * ct
    for j in range(NX):
        pv, pt = P[1, j], P[4, j]
        rows[0, j] = pv
        rows[1, j] = g0 * pv + g1 * P[2, j] + g2 * pt + g3 * P[9, j]
        rows[2, j] = sj * pv + v * P[8, j]
        rows[3, j] = sk * pv + v * P[9, j]
        rows[4, j] = n1 * pv + n2 * P[3, j] + n3 * pt
        rows[5, j] = e1 * pv + e2 * P[3, j] + e3 * pt
        rows[6, j] = d1 * pv + d3 * pt
        rows[7, j] = P[11, j]
        rows[8, j] = P[13, j]
    for i in range(NX):
        for j in range(NX):
            dP[i, j] = 0.0
    for r in range(9):
        i = r if r < 2 else (r + 1 if r < 7 else (10 if r == 7 else 12))
        for j in range(NX):
            dP[i, j] = rows[r, j]
    for r in range(9):
        i = r if r < 2 else (r + 1 if r < 7 else (10 if r == 7 else 12))
        for j in range(NX):
            dP[j, i] += rows[r, j]
    for i in range(NX):
        dP[i, i] += q[i]


@njit
def predict(x, P, q, dt, p, work):
    """Move x (17,) and P (17, 17) over dt (s) by one Runge-Kutta step; q (17,) noise densities, work (WORK,)."""
    size = NX * NX
    Pm = work[0:size].reshape(NX, NX)
    Pa = work[size : 2 * size].reshape(NX, NX)
    dP = work[2 * size : 3 * size].reshape(NX, NX)
    rows = work[3 * size : 3 * size + 9 * NX].reshape(9, NX)
    rest = work[4 * size :]
    xm, xa, dx, g = rest[0:NX], rest[NX : 2 * NX], rest[2 * NX : 3 * NX], rest[3 * NX : 3 * NX + 4]
    _rates(x, P, q, p, dx, dP, g, rows)
    for stage in range(3):
        weight = dt / 6.0 if stage == 0 else dt / 3.0
        step = 0.5 * dt if stage < 2 else dt
        for i in range(NX):
            xa[i] = (x[i] if stage == 0 else xa[i]) + weight * dx[i]
            xm[i] = x[i] + step * dx[i]
        if stage == 0:
            for i in range(NX):
                for j in range(NX):
                    Pa[i, j] = P[i, j] + weight * dP[i, j]
                    Pm[i, j] = P[i, j] + step * dP[i, j]
        else:
            for i in range(NX):
                for j in range(NX):
                    Pa[i, j] += weight * dP[i, j]
                    Pm[i, j] = P[i, j] + step * dP[i, j]
        _rates(xm, Pm, q, p, dx, dP, g, rows)
    for i in range(NX):
        x[i] = xa[i] + dt / 6.0 * dx[i]
        for j in range(NX):
            P[i, j] = Pa[i, j] + dt / 6.0 * dP[i, j]


@njit
def correct_accelerations(x, P, y, r, p, work):
    """Correct with the three accelerations y (3,), variances r (3,): the three-row update of A.18, by scalars.

    The rows share one linearisation point, as the vector update does.
    """
    ph, x0, g = work[0:NX], work[NX : 2 * NX], work[2 * NX : 2 * NX + 4]
    for i in range(NX):
        x0[i] = x[i]
    v = x0[1]
    a = _acceleration(x0, p, g)
    ct, st = math.cos(x0[4]), math.sin(x0[4])
    for row in range(3):
        if row == 0:
            told = a + p[GRAVITY] * st + x0[14]
            h1, h2, h4, h8, h9, bias = g[0], g[1], g[2] + p[GRAVITY] * ct, 0.0, g[3], 14
        elif row == 1:
            told = -x0[8] * v * v + x0[15]
            h1, h2, h4, h8, h9, bias = -2.0 * x0[8] * v, 0.0, 0.0, -v * v, 0.0, 15
        else:
            told = p[GRAVITY] * ct + x0[9] * v * v + x0[16]
            h1, h2, h4, h8, h9, bias = 2.0 * x0[9] * v, 0.0, -p[GRAVITY] * st, 0.0, v * v, 16
        for i in range(NX):
            ph[i] = h1 * P[1, i] + h2 * P[2, i] + h4 * P[4, i] + h8 * P[8, i] + h9 * P[9, i] + P[bias, i]
        s = r[row] + h1 * ph[1] + h2 * ph[2] + h4 * ph[4] + h8 * ph[8] + h9 * ph[9] + ph[bias]
        told += h1 * (x[1] - x0[1]) + h2 * (x[2] - x0[2]) + h4 * (x[4] - x0[4]) + h8 * (x[8] - x0[8])
        told += h9 * (x[9] - x0[9]) + x[bias] - x0[bias]
        inverse = 1.0 / s
        nu = y[row] - told
        for i in range(NX):
            gain = ph[i] * inverse
            x[i] += gain * nu
            for j in range(NX):
                P[i, j] -= gain * ph[j]


@njit(cache=True)
def events(x, P, q, dt, y, r, p, work):
    """Run one event after another: predict over dt[k], correct with y[k] (n, 3). x and P are changed."""
    for k in range(dt.shape[0]):
        predict(x, P, q, dt[k], p, work)
        correct_accelerations(x, P, y[k], r, p, work)


def constants(mass: float, accelerated: float, gravity: float, drag: float, rolling: float) -> np.ndarray:
    """Return the car's constants in the kernel's order, SI (drag: rho C_d A / 2; rolling: M C_rr)."""
    return np.array([mass, accelerated, gravity, drag, rolling])
