"""Dynamic programming over distance, kinetic energy and gear: the compiled sweep, and one step of it anywhere.

State: E = v^2/2 on nodes `i * step` below the limit of the place plus one node exactly on it, or those of them in a
corridor; "gear" 0 is off the throttle (fuel cut, or brakes), 1 ... drive. V[k, g, i] = least cost to go from place k,
coming in gear g:
    V[k, g, i] = min over g' of  change(g, g') + W[k, g', i]
    W[k, g', i] = min over E' of  ds fuel(g', E, E') + time_value dt + V[k+1, g', E']
No action is charged less fuel than holding its speed would take, plus what it changes of the speed (`hold_lines`): so
pulse and glide is not rewarded. Targets E' are the nodes of the next place (no interpolation); rolling off the throttle
lands between nodes and interpolates. Everything is in this one file because numba's cache does not see edits in callees
elsewhere.
"""

import numpy as np
from numba import njit

BIG = 1.0e12
"""Cost of what cannot be done, J: finite, so that interpolation stays finite."""
IMPOSSIBLE = 1.0e11
PANIC = 10.0
"""Price of braking harder than planned braking allows, J per J of excess kinetic energy."""
# What compiles fast matters: the first run waits for it. INNER has no way in from Python, where calling it would crash;
# loops stand for what numpy would do in a line, because each numpy function is compiled too.
ENTRY = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
INNER = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True}


@njit(**INNER)
def node_energy(i, count, top, step):
    """E of node i at a place with `count` nodes and limit `top`, m2/s2."""
    return top if i == count - 1 else i * step


@njit(**INNER)
def value_at(value, energy, lowest, beyond, count, top, step):
    """Interpolate one gear's value (n,), kept for nodes `lowest` to `beyond` (excluded), at `energy`; BIG outside."""
    if energy >= top:
        return value[count - 1 - lowest] if beyond == count else BIG
    i = min(int(energy / step), count - 2)
    if i < lowest or i + 1 >= beyond:
        return BIG
    low = i * step
    high = node_energy(i + 1, count, top, step)
    share = (energy - low) / (high - low)
    return value[i - lowest] + share * (value[i + 1 - lowest] - value[i - lowest])


@njit(**ENTRY)
def interval_time(energy, target, ds, slow_speed, slow_price):
    """Return seconds over `ds` and the price, J, of being slower than courtesy asks. Constant acceleration."""
    mean = 0.5 * (np.sqrt(2.0 * energy) + np.sqrt(2.0 * target))
    dt = ds / mean
    dawdled = 0.0
    if mean < slow_speed:
        dawdled = slow_price * (dt - ds / slow_speed)
    return dt, dawdled


@njit(**ENTRY)
def hold_line(hold_first, hold_width, hold_cost, hold_slope, hold_depth, row, load):
    """The line of `hold_lines` where thrust `load` holds the speed of `row`: (c*, m, g); (-BIG, 0, 0) for none."""
    points = hold_cost.shape[1]
    if points < 2:
        return -BIG, 0.0, 0.0
    x = (load - hold_first[row]) / hold_width[row]
    if not 0.0 <= x <= points - 1:
        return -BIG, 0.0, 0.0
    q = min(int(x), points - 2)
    here, there = hold_cost[row, q], hold_cost[row, q + 1]
    if here >= BIG or there >= BIG:
        return -BIG, 0.0, 0.0
    depth = hold_depth[row, q] + (x - q) * (hold_depth[row, q + 1] - hold_depth[row, q])
    return here + (x - q) * (there - here), hold_slope[row, q], depth


@njit(**ENTRY)
def sweep(
    ds, grade_force, top, lowest, beyond, count, slow_speed, step, drag, mass, fuel, low,
    high, coast_force, coast_fuel, coast_mass, time_value, shift_price, restart_price, slow_price, up, down,
    hold_first, hold_width, hold_cost, hold_slope, hold_depth, value,
):  # fmt: skip
    """Fill `value` (K+1, G+1, n) backwards. Shapes: ds, grade_force, slow_speed (K,); top, ..., count (K+1,).

    Of the `count` nodes of a place those from `lowest` to before `beyond` are looked at, a corridor; `value[k, g, i]`
    belongs to node lowest[k] + i.

    `grade_force` M g (sin theta + C_rr cos theta), N; `drag` rho C_d A, so that R = grade_force + drag E;
    `up`, `down` the limits of comfort, m/s2, both positive; `hold_...` those of `hold_lines.hold_lines`, of no columns
    where pulse and glide is allowed.
    """
    gears, rows, levels = fuel.shape
    n = count[0]
    for k in range(len(ds)):
        n = max(n, count[k + 1])
    best = np.empty(gears + 1)
    speed, cost, accelerations, road, line = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        speed[i] = np.sqrt(2.0 * step * i)
    per_force = np.empty((gears, rows))
    for g in range(gears):
        for r in range(rows):
            per_force[g, r] = (levels - 1) / (high[g, r] - low[g, r]) if high[g, r] > 0.0 else 0.0
    base, lean, bend = np.empty(rows), np.empty(rows), np.empty(rows)
    for r in range(rows):
        base[r], lean[r], bend[r] = -BIG, 0.0, 0.0
    row_of = np.empty(n, np.int64)
    for k in range(len(ds) - 1, -1, -1):
        d = ds[k]
        top_next, count_next, ahead = top[k + 1], count[k + 1], value[k + 1]
        floor, ceiling = lowest[k + 1], beyond[k + 1]
        speed_next_top = np.sqrt(2.0 * top_next)
        if hold_cost.shape[1] > 1:
            for r in range(2 * min(lowest[k], floor), min(2 * max(beyond[k], ceiling), rows)):
                load = grade_force[k] + drag * 0.5 * r * step
                base[r], lean[r], bend[r] = hold_line(
                    hold_first, hold_width, hold_cost, hold_slope, hold_depth, r, load
                )
                lean[r] *= mass[gears - 1]
        for i in range(lowest[k], beyond[k]):
            energy = node_energy(i, count[k], top[k], step)
            v = speed[i] if i < count[k] - 1 else np.sqrt(2.0 * energy)
            for g in range(gears + 1):
                best[g] = BIG
            start = min(int(2.0 * energy / step + 0.5), rows - 1)
            first = min(max(int(np.ceil((energy - down * d) / step)), floor), ceiling - 1)
            last = ceiling - 1
            if energy + up * d < top_next:
                last = min(int((energy + up * d) / step), last)
            drive = last + 1  # targets from here on need the engine
            for j in range(last, first - 1, -1):
                target = node_energy(j, count_next, top_next, step)
                v_next = speed[j] if j < count_next - 1 else speed_next_top
                if v + v_next <= 0.0:
                    continue
                dt = 2.0 * d / (v + v_next)
                price = time_value * dt
                if d > slow_speed[k] * dt:
                    pass
                elif slow_speed[k] > 0.0:
                    price += slow_price * (dt - d / slow_speed[k])
                a = (target - energy) / d
                r = int((energy + target) / step + 0.5)
                load = grade_force[k] + drag * 0.5 * (energy + target)
                if coast_mass[r] * a + load <= coast_force[r] + 1e-6:
                    total = price + d * max(coast_fuel[r], base[r] + a * (lean[r] + a * bend[r])) + ahead[0, j - floor]
                    if a < -down:
                        total += PANIC * mass[0] * (-down - a) * d
                    if total < best[0]:
                        best[0] = total
                elif a >= -down:
                    cost[j], accelerations[j], road[j], row_of[j] = price, a, load, r
                    line[j] = base[r] + a * (lean[r] + a * bend[r])
                    drive = j
            for g in range(gears):
                if high[g, start] < 0.0:
                    continue
                cheapest = BIG
                for j in range(drive, last + 1):
                    r = row_of[j]
                    force = mass[g] * accelerations[j] + road[j]
                    x = (force - low[g, r]) * per_force[g, r]
                    if force > high[g, r]:
                        if high[g, r] > 0.0:
                            break  # more speed asks for yet more force: full load is behind us
                        continue
                    if x < 0.0 or x > levels - 1:
                        continue
                    q = min(int(x), levels - 2)
                    f = fuel[g, r, q]
                    f += (x - q) * (fuel[g, r, q + 1] - f)
                    total = cost[j] + d * max(f, line[j]) + ahead[g + 1, j - floor]
                    if total < cheapest:
                        cheapest = total
                best[g + 1] = cheapest
            row = start
            rolled = energy + d * (coast_force[row] - grade_force[k] - drag * energy) / coast_mass[row]
            if 0.0 < rolled <= top_next and rolled >= energy - down * d and rolled <= energy + up * d:
                dt, dawdled = interval_time(energy, rolled, d, slow_speed[k], slow_price)
                a = (rolled - energy) / d
                held = base[row] + a * (lean[row] + a * bend[row])
                total = time_value * dt + dawdled + d * max(coast_fuel[row], held)
                total += value_at(ahead[0], rolled, floor, ceiling, count_next, top_next, step)
                if total < best[0]:
                    best[0] = total
            settle(best, shift_price, restart_price, value, k, i - lowest[k])


@njit(**INNER)
def settle(best, shift_price, restart_price, value, k, place):
    """V of each incoming gear from W of each chosen one; gear 0 (off the throttle) is entered free of charge."""
    cheapest = best[1]
    for g in range(2, best.size):
        cheapest = min(cheapest, best[g])
    value[k, 0, place] = min(best[0], cheapest + restart_price)
    for g in range(1, best.size):
        value[k, g, place] = min(min(best[g], cheapest + shift_price), best[0])


@njit(**ENTRY)
def table_fuel(fuel, low, high, g, place, force):
    """Fuel per metre between rows (`place` = 2 E / step), J/m; BIG outside the engine's range."""
    levels = fuel.shape[2]
    r = min(int(place), fuel.shape[1] - 2)
    share = min(place - r, 1.0)
    if high[g, r] < 0.0 or high[g, r + 1] < 0.0:
        if high[g, r] < 0.0 and high[g, r + 1] < 0.0:
            return BIG
        share = 1.0 if high[g, r] < 0.0 else 0.0
    most = (1.0 - share) * high[g, r] if share < 1.0 else 0.0
    most += share * high[g, r + 1] if share > 0.0 else 0.0
    least = (1.0 - share) * low[g, r] if share < 1.0 else 0.0
    least += share * low[g, r + 1] if share > 0.0 else 0.0
    if force > most + 1.0 or force < least - 1.0:
        return BIG
    x = min(max((force - least) / (most - least), 0.0), 1.0) * (levels - 1)
    q = min(int(x), levels - 2)
    burnt = 0.0
    if share < 1.0:
        burnt += (1.0 - share) * (fuel[g, r, q] + (x - q) * (fuel[g, r, q + 1] - fuel[g, r, q]))
    if share > 0.0:
        burnt += share * (fuel[g, r + 1, q] + (x - q) * (fuel[g, r + 1, q + 1] - fuel[g, r + 1, q]))
    return burnt


@njit(**ENTRY)
def best_action(
    energy, gear, k, ds, grade_force, top, lowest, beyond, count, slow_speed, step, drag, mass, fuel, low,
    high, coast_force, coast_fuel, coast_mass, time_value, shift_price, restart_price, slow_price, up, down,
    hold_first, hold_width, hold_cost, hold_slope, hold_depth, value,
):  # fmt: skip
    """The best step from any `energy` at place k, coming in `gear`: (cost to go, E', gear, J of fuel).

    Candidates: the nodes of the next place, holding the speed, the limit, and rolling off the throttle.
    """
    gears = fuel.shape[0]
    d = ds[k]
    top_next, count_next, ahead = top[k + 1], count[k + 1], value[k + 1]
    floor, ceiling = lowest[k + 1], beyond[k + 1]
    start = min(int(2.0 * energy / step + 0.5), len(coast_force) - 1)
    answer_cost, answer_energy, answer_gear, answer_fuel = BIG, min(energy, top_next), 0, 0.0
    last = ceiling - 1
    if energy + up * d < top_next:
        last = min(int((energy + up * d) / step), last)
    first = min(max(int(np.ceil((energy - down * d) / step)), floor), ceiling - 1)
    for candidate in range(first, last + 3):
        rolling = candidate == last + 2
        if rolling:
            row = start
            target = energy + d * (coast_force[row] - grade_force[k] - drag * energy) / coast_mass[row]
            if target <= 0.0 or target > top_next or target < energy - down * d or target > energy + up * d:
                continue
        elif candidate == last + 1:
            target = energy
            if energy > top_next:
                continue
        else:
            target = node_energy(candidate, count_next, top_next, step)
        if energy + target <= 0.0:
            continue
        dt, dawdled = interval_time(energy, target, d, slow_speed[k], slow_price)
        priced = time_value * dt + dawdled
        a = (target - energy) / d
        place = (energy + target) / step
        row = min(int(place + 0.5), len(coast_force) - 1)
        force_road = grade_force[k] + drag * 0.5 * (energy + target)
        base, lean, bend = hold_line(hold_first, hold_width, hold_cost, hold_slope, hold_depth, row, force_road)
        held = d * (base + a * (lean * mass[gears - 1] + a * bend))
        if rolling or coast_mass[row] * a + force_road <= coast_force[row] + 1e-6:
            burnt = d * coast_fuel[row]
            total = priced + max(burnt, held) + value_at(ahead[0], target, floor, ceiling, count_next, top_next, step)
            if a < -down:
                total += PANIC * mass[0] * (-down - a) * d
            if total < answer_cost:
                answer_cost, answer_energy, answer_gear, answer_fuel = total, target, 0, burnt
            continue
        if a < -down:
            continue
        for g in range(gears):
            if high[g, start] < 0.0:
                continue
            burnt = d * table_fuel(fuel, low, high, g, place, mass[g] * a + force_road)
            if burnt >= IMPOSSIBLE:
                continue
            total = (
                priced + max(burnt, held) + value_at(ahead[g + 1], target, floor, ceiling, count_next, top_next, step)
            )
            if gear == 0:
                total += restart_price
            elif gear != g + 1 and gear > 0:
                total += shift_price
            if total < answer_cost:
                answer_cost, answer_energy, answer_gear, answer_fuel = total, target, g + 1, burnt
    return answer_cost, answer_energy, answer_gear, answer_fuel


@njit(**INNER)
def slope(value, energy, lowest, beyond, count, top, step):
    """-dV/dE, J per m2/s2, by a central difference of one node's width, never negative, finite nodes only."""
    high = min(energy + step, top)
    low = max(min(energy, top) - step, 0.0)
    upper = value_at(value, high, lowest, beyond, count, top, step)
    lower = value_at(value, low, lowest, beyond, count, top, step)
    if upper >= IMPOSSIBLE or lower >= IMPOSSIBLE or high <= low:
        return 0.0
    return max((lower - upper) / (high - low), 0.0)


@njit(**ENTRY)
def act(
    places, energies, coming, chained, ds, grade_force, top, lowest, beyond, count, slow_speed, step, drag, mass, fuel,
    low, high, coast_force, coast_fuel, coast_mass, time_value, shift_price, restart_price, slow_price, up,
    down, hold_first, hold_width, hold_cost, hold_slope, hold_depth, value,
):  # fmt: skip
    """Best actions at stages `places` (q,), `energies` (q,), coming in gears `coming` (q,; -1 free to choose).

    Returns cost to go, E' at the stage's end, gear (0 off the throttle), J of fuel, and -dV/dE, each (q,).
    `chained`: each state is where the one before ended; then only the first of `energies` and `coming` counts.
    """
    n = len(places)
    cost, ends, gears = np.empty(n), np.empty(n), np.empty(n, np.int64)
    burnt, worth = np.empty(n), np.empty(n)
    energy, gear = energies[0], coming[0]
    for q in range(n):
        k = places[q]
        if not chained:
            energy, gear = energies[q], coming[q]
        cost[q], ends[q], gears[q], burnt[q] = best_action(
            energy, gear, k, ds, grade_force, top, lowest, beyond, count, slow_speed, step, drag, mass, fuel, low,
            high, coast_force, coast_fuel, coast_mass, time_value, shift_price, restart_price, slow_price, up, down,
            hold_first, hold_width, hold_cost, hold_slope, hold_depth, value,
        )  # fmt: skip
        worth[q] = slope(value[k, gears[q]], energy, lowest[k], beyond[k], count[k], top[k], step)
        energy, gear = ends[q], gears[q]
    return cost, ends, gears, burnt, worth
