"""What takes the reward out of pulse and glide: the cost of holding the speed, and the line that supports it.

Where fuel per metre c(F) over thrust lies above its lower convex hull, a drive that swings between the two ends of the
chord burns less than one that holds the speed between them: Pontryagin's maximum alternates, ever faster (chattering),
and what a planner returns is no drive for people. Let R be the thrust that holds the speed at kinetic energy E on the
slope, c*(R) the least fuel per metre that does, in any gear, and m the slope of the hull there. A plan may swing, but
it is charged as if each action burnt at least
    c*(R) + m M a + g a^2,    a = dE/ds
with g the depth of the dent, c*(R) less the hull, per (m/s2)^2. Over any closed swing on an even slope the second term
sums to nothing (m depends on E alone), so that no swing of thrust, of gears or between driving and rolling is charged
less than holding each of its speeds would be; the third breaks the tie. Where the map is convex the line lies below c
and g is nothing: nothing changes.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

NONE = 1.0e12
"""Cost of holding a speed that cannot be held, J/m: there is no line."""
POINTS = 161
"""Thrusts of the table."""
SLOWEST = 12.5
"""m2/s2: below 5 m/s the car is starting or stopping, and no line is drawn."""


def hold_lines(
    energy_step: float,
    fuel: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    coast_force: NDArray[np.float64],
    coast_fuel: NDArray[np.float64],
) -> tuple[NDArray[np.float64], ...]:
    """Tabulate c* and the slope of its hull over thrust, row by row of a `DriveTable`.

    `fuel` (G, R, L) J/m between `low` and `high` (G, R) N; rolling burns `coast_fuel` (R,) at `coast_force` (R,) N.
    Returns the first thrust (R,) N, the spacing (R,) N, c* (R, POINTS) J/m, the slope (R, POINTS - 1) J/m per N and
    the depth of the dent (R, POINTS) J/m.
    """
    rows = fuel.shape[1]
    first, width = np.zeros(rows), np.ones(rows)
    cost, slope, depth = np.full((rows, POINTS), NONE), np.zeros((rows, POINTS - 1)), np.zeros((rows, POINTS))
    kept = np.empty(POINTS, np.int64)
    _fill(energy_step, fuel, low, high, coast_force, coast_fuel, first, width, cost, slope, depth, kept)
    return first, width, cost, slope, depth


@njit(cache=True, error_model="numpy", no_cfunc_wrapper=True)
def _fill(energy_step, fuel, low, high, coast_force, coast_fuel, first, width, cost, slope, depth, kept):
    """The loops of `hold_lines`: arrays that numpy makes need not be compiled. `kept` (POINTS,) is working room."""
    gears, rows, levels = fuel.shape
    for r in range(rows):
        if 0.5 * r * energy_step < SLOWEST:
            continue
        rolls = coast_force[r] > -1e8
        least, most = coast_force[r] if rolls else 1e9, -1e9
        for g in range(gears):
            if high[g, r] > 0.0:
                most = max(most, high[g, r])
                if not rolls:
                    least = min(least, low[g, r])
        if most <= least:
            continue
        first[r], width[r] = least, (most - least) / (POINTS - 1)
        for g in range(gears):
            if high[g, r] <= 0.0:
                continue
            for q in range(POINTS):
                x = (least + q * width[r] - low[g, r]) / (high[g, r] - low[g, r]) * (levels - 1)
                if -1e-9 <= x <= levels - 1 + 1e-9:
                    i = min(max(int(x), 0), levels - 2)
                    burnt = fuel[g, r, i] + (x - i) * (fuel[g, r, i + 1] - fuel[g, r, i])
                    cost[r, q] = min(cost[r, q], burnt)
        if rolls:
            cost[r, 0] = min(cost[r, 0], coast_fuel[r])
        n = 0
        for q in range(POINTS):  # Andrew's monotone chain
            if cost[r, q] >= NONE:
                continue
            while n > 1:
                a, b = kept[n - 2], kept[n - 1]
                if (cost[r, b] - cost[r, a]) * (q - a) < (cost[r, q] - cost[r, a]) * (b - a):
                    break
                n -= 1
            kept[n] = q
            n += 1
        for i in range(n - 1):
            a, b = kept[i], kept[i + 1]
            for q in range(a, b):
                slope[r, q] = (cost[r, b] - cost[r, a]) / ((b - a) * width[r])
                depth[r, q] = cost[r, q] - cost[r, a] - (q - a) * width[r] * slope[r, q]
