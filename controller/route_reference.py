"""The route planner's sweep again, slowly, in numpy: what `route_kernel.sweep` must reproduce, for tests and timing."""

import numpy as np
from numpy.typing import NDArray

from controller.route_kernel import BIG, PANIC, hold_line


def sweep(
    ds, grade_force, top, lowest, beyond, count, slow_speed, step, drag, mass, fuel, low, high, coast_force, coast_fuel,
    coast_mass, time_value, shift_price, restart_price, slow_price, up, down, hold_first, hold_width, hold_cost,
    hold_slope, hold_depth, value: NDArray[np.float64],
) -> None:  # fmt: skip
    """Same arguments, same `value` (K+1, G+1, n) as the compiled sweep over all nodes (it knows no corridor)."""
    gears, rows, levels = fuel.shape
    for k in range(len(ds) - 1, -1, -1):
        here = np.append(np.arange(count[k] - 1) * step, top[k])[:, None]
        there = np.append(np.arange(count[k + 1] - 1) * step, top[k + 1])[None, :]
        ahead, d = value[k + 1, :, : count[k + 1]], ds[k]
        mean = 0.5 * (np.sqrt(2.0 * here) + np.sqrt(2.0 * there))
        acceleration = (there - here) / d
        row = ((here + there) / step + 0.5).astype(int)
        start = np.minimum((2.0 * here[:, 0] / step + 0.5).astype(int), rows - 1)
        load = grade_force[k] + drag * 0.5 * (here + there)

        target_index = np.arange(count[k + 1])[None, :]
        first = np.minimum(np.maximum(np.ceil((here - down * d) / step).astype(int), 0), count[k + 1] - 1)
        last = np.where(
            here + up * d < top[k + 1],
            np.minimum(((here + up * d) / step).astype(int), count[k + 1] - 1),
            count[k + 1] - 1,
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            dt = d / mean
            price = time_value * dt
            if slow_speed[k] > 0.0:
                price = price + slow_price * np.maximum(dt - d / slow_speed[k], 0.0)
        reachable = (target_index >= first) & (target_index <= last) & (mean > 0.0)

        energies = 0.5 * step * np.arange(rows)
        lines = [
            hold_line(hold_first, hold_width, hold_cost, hold_slope, hold_depth, r, grade_force[k] + drag * e)
            for r, e in enumerate(energies)
        ]
        base, lean, bend = (np.array(part) for part in zip(*lines, strict=True))
        lean = mass[-1] * lean
        line = base[row] + acceleration * (lean[row] + acceleration * bend[row])

        chosen = np.full((gears + 1, count[k]), BIG)
        off = reachable & (coast_mass[row] * acceleration + load <= coast_force[row] + 1e-6)
        panic = np.where(acceleration < -down, PANIC * mass[0] * (-down - acceleration) * d, 0.0)
        chosen[0] = np.min(np.where(off, price + d * np.maximum(coast_fuel[row], line) + ahead[0] + panic, BIG), axis=1)
        drive = reachable & ~off & (acceleration >= -down)
        for g in range(gears):
            force = mass[g] * acceleration + load
            usable = drive & (high[g, row] >= 0.0) & (high[g, start] >= 0.0)[:, None]
            with np.errstate(invalid="ignore"):
                x = (force - low[g, row]) / (high[g, row] - low[g, row]) * (levels - 1)
            usable &= (x >= 0.0) & (x <= levels - 1)
            x = np.where(usable, x, 0.0)
            q = np.minimum(x.astype(int), levels - 2)
            burnt = fuel[g, row, q] + (x - q) * (fuel[g, row, q + 1] - fuel[g, row, q])
            chosen[g + 1] = np.min(np.where(usable, price + d * np.maximum(burnt, line) + ahead[g + 1], BIG), axis=1)

        energy = here[:, 0]
        rolled = energy + d * (coast_force[start] - grade_force[k] - drag * energy) / coast_mass[start]
        fits = (rolled > 0.0) & (rolled <= top[k + 1]) & (rolled >= energy - down * d) & (rolled <= energy + up * d)
        landed = np.where(fits, rolled, 1.0)
        dt = d / (0.5 * (np.sqrt(2.0 * energy) + np.sqrt(2.0 * landed)))
        a = (landed - energy) / d
        held = base[start] + a * (lean[start] + a * bend[start])
        total = time_value * dt + d * np.maximum(coast_fuel[start], held) + np.interp(landed, there[0], ahead[0])
        if slow_speed[k] > 0.0:
            total = total + slow_price * np.maximum(dt - d / slow_speed[k], 0.0)
        chosen[0] = np.where(fits, np.minimum(chosen[0], total), chosen[0])

        cheapest = chosen[1:].min(axis=0)
        value[k, 0, : count[k]] = np.minimum(chosen[0], cheapest + restart_price)
        for g in range(1, gears + 1):
            value[k, g, : count[k]] = np.minimum(np.minimum(chosen[g], cheapest + shift_price), chosen[0])
