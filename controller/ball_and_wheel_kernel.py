"""Minimum time to the origin by dynamic programming on a lattice that the bang-bang arcs themselves make, compiled.

Holding u for the time in which x2 moves by one step h moves x1 by (j + 1/2) h^2 / u: for u_low = -U/a, u_high = U/b and
x1 in steps of h^2 / (2 U), every arc runs through lattice points and nothing is interpolated. (The upwind scheme B.27
converges here like h^0.4 only, because V has a square-root crease along the switching locus.)
"""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def lattice_time(half_angles, half_rates, stride_low, stride_high, tau_low, tau_high, sweeps):
    """V (2 half_angles + 1, 2 half_rates + 1), s, by Gauss-Seidel value iteration; the origin is in the middle.

    From rate index j, `low` leads to j - 1 and moves x1 by (2 j - 1) stride_low steps, `high` to j + 1 and (2 j + 1)
    stride_high; `tau_low`, `tau_high` are the seconds that takes.
    """
    n, m = 2 * half_angles + 1, 2 * half_rates + 1
    value = np.full((m, n), 1e9)
    value[half_rates, half_angles] = 0.0
    for sweep in range(sweeps):
        changed = False
        for q in range(m):
            j = q if sweep % 2 == 0 else m - 1 - q
            rate = j - half_rates
            for side in range(2):
                ahead = j - 1 if side == 0 else j + 1
                if not 0 <= ahead < m:
                    continue
                move = (2 * rate - 1) * stride_low if side == 0 else (2 * rate + 1) * stride_high
                tau = tau_low if side == 0 else tau_high
                for i in range(max(0, -move), min(n, n - move)):
                    new = tau + value[ahead, i + move]
                    if new < value[j, i] - 1e-12:
                        value[j, i] = new
                        changed = True
        if not changed:
            break
    return value
