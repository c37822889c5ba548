"""Pontryagin's principle in one dimension, compiled: pointwise maximum, shooting, HJB by upwind differences.

    H(v, lambda, u) = lambda (F - R)/M_a - P_in        maximal in u = (gear, T) or (w, T); lambda = -dV/dv, J per m/s
    d lambda/dt = -dH/dv
In a gear P_in is cubic in T, so the maximum is at a bound or at a root of a quadratic: closed form (ERRATA on 4.4.1).
In a gear a limit on engine speed is one on the state v. Where it ends the use of a gear, lambda jumps by as much as
keeps H (the corner condition of the constrained principle; seed 004, B.2.5.3 and B.3.1.2). Or it is a price in the
running cost, weight (w/w_soft - 1)^2 beyond w_soft: the penalisation of B.2.5.3.
`p` is `ControllerModel.kernel_parameters()`; `ratios` (G,), empty for a CVT. All in one file because of numba's cache.
"""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def best_of_cubic(b, w, c0, c1, c2, low, high):
    """Maximise b T - w (c0 T + c1 T^2 + c2 T^3) on [low, high]; return T and the maximum."""
    best, value = low, b * low - w * low * (c0 + low * (c1 + low * c2))
    other = b * high - w * high * (c0 + high * (c1 + high * c2))
    if other > value:
        best, value = high, other
    qa, qb, qc = 3.0 * c2 * w, 2.0 * c1 * w, c0 * w - b
    root = high
    if qa != 0.0:
        disc = qb * qb - 4.0 * qa * qc
        if disc < 0.0:
            return best, value
        root = (-qb + np.sqrt(disc)) / (2.0 * qa)
    elif qb != 0.0:
        root = -qc / qb
    if low < root < high:
        other = b * root - w * root * (c0 + root * (c1 + root * c2))
        if other > value:
            best, value = root, other
    return best, value


@njit(cache=True, nogil=True, error_model="numpy")
def penalty(p, w):
    """Price of turning faster than the soft limit, W (gears only: a CVT chooses its engine speed)."""
    excess = max(w / p[14] - 1.0, 0.0)
    return p[13] * excess * excess


@njit(cache=True, nogil=True, error_model="numpy")
def best_torque(p, v, costate, n):
    """In the gear `n` (1/m): the torque that maximises H, and H."""
    w = n * v
    t, value = best_of_cubic(costate * n / p[0], w, p[3] + w * (p[4] + w * p[7]), p[5] + p[6] * w, p[8], p[11], p[12])
    return t, value - costate / p[0] * (p[1] + p[2] * v * v) - penalty(p, w)


@njit(cache=True, nogil=True, error_model="numpy")
def best_pair(p, mu):
    """CVT: maximise w T (mu - phi(w, T)) over the box: (w, T, maximum). mu = lambda / (M_a v).

    Closed form in each coordinate in turn, from the corners of the box and its middle; then Newton on both.
    """
    a0, a1, a2, a3, a4, a5 = p[3], p[4], p[5], p[6], p[7], p[8]
    w0, w1, t0, t1 = p[9], p[10], p[11], p[12]
    found_w, found_t, found = w0, t0, -np.inf
    for start in range(3):
        w = w0 if start == 0 else (w1 if start == 1 else 0.5 * (w0 + w1))
        t = t0
        for _ in range(60):
            t_new, _ = best_of_cubic(mu, 1.0, a0 + w * (a1 + w * a4), a2 + a3 * w, a5, t0, t1)
            w_new, value = best_of_cubic(mu, 1.0, a0 + t_new * (a2 + t_new * a5), a1 + a3 * t_new, a4, w0, w1)
            moved = abs(t_new - t) / t1 + abs(w_new - w) / w1
            w, t = w_new, t_new
            if moved < 1e-6:
                break
        for _ in range(4):  # Newton on the coordinates that lie inside
            phi = a0 + a1 * w + a2 * t + a3 * w * t + a4 * w * w + a5 * t * t
            phi_w, phi_t = a1 + a3 * t + 2.0 * a4 * w, a2 + a3 * w + 2.0 * a5 * t
            gw, gt = mu - phi - w * phi_w, mu - phi - t * phi_t
            hww, htt = -2.0 * phi_w - 2.0 * a4 * w, -2.0 * phi_t - 2.0 * a5 * t
            hwt, htw = -phi_t - a3 * w, -phi_w - a3 * t
            inside_w, inside_t = w0 < w < w1, t0 < t < t1
            if inside_w and inside_t:
                det = hww * htt - hwt * htw
                if det == 0.0:
                    break
                dw, dt = -(gw * htt - gt * hwt) / det, -(gt * hww - gw * htw) / det
            elif inside_w and hww != 0.0:
                dw, dt = -gw / hww, 0.0
            elif inside_t and htt != 0.0:
                dw, dt = 0.0, -gt / htt
            else:
                break
            if abs(dw) > 0.05 * w1 or abs(dt) > 0.05 * t1:
                break
            w, t = min(max(w + dw, w0), w1), min(max(t + dt, t0), t1)
        value = w * t * (mu - (a0 + a1 * w + a2 * t + a3 * w * t + a4 * w * w + a5 * t * t))
        if value > found:
            found_w, found_t, found = w, t, value
    return found_w, found_t, found


@njit(cache=True, nogil=True, error_model="numpy")
def control(p, ratios, gear, v, costate):
    """The maximising (w, T) in `gear` (0 for the CVT) and H."""
    if len(ratios) == 0:
        w, t, value = best_pair(p, costate / (p[0] * v))
        return w, t, value - costate / p[0] * (p[1] + p[2] * v * v)
    n = ratios[gear - 1]
    t, h = best_torque(p, v, costate, n)
    return n * v, t, h


@njit(cache=True, nogil=True, error_model="numpy")
def best_gear(p, ratios, v, costate):
    """The gear that maximises H among those whose engine speed is allowed: (gear, H); (0, H) for the CVT."""
    if len(ratios) == 0:
        return 0, control(p, ratios, 0, v, costate)[2]
    chosen, value = -1, -np.inf
    for g in range(len(ratios)):
        w = ratios[g] * v
        if w < p[9] * (1.0 - 1e-12) or w > p[10] * (1.0 + 1e-12):
            continue
        _, h = best_torque(p, v, costate, ratios[g])
        if h > value:
            chosen, value = g + 1, h
    return chosen, value


@njit(cache=True, nogil=True, error_model="numpy")
def fuel_power(p, w, t):
    """P_in, W."""
    return w * t * (p[3] + p[4] * w + p[5] * t + p[6] * w * t + p[7] * w * w + p[8] * t * t)


@njit(cache=True, nogil=True, error_model="numpy")
def rates(p, ratios, gear, v, costate):
    """(dv/dt, d lambda/dt, dJ/dt, w, T) with the maximising control of `gear`; dJ/dt with the penalty."""
    w, t, _ = control(p, ratios, gear, v, costate)
    power = fuel_power(p, w, t)
    dv = (w * t / v - p[1] - p[2] * v * v) / p[0]
    if len(ratios) == 0:
        dl = costate / p[0] * (w * t / (v * v) + 2.0 * p[2] * v)
    else:
        phi_w = p[4] + p[6] * t + 2.0 * p[7] * w
        dl = costate / p[0] * 2.0 * p[2] * v + power / v + ratios[gear - 1] * w * t * phi_w
        dl += ratios[gear - 1] * 2.0 * p[13] / p[14] * max(w / p[14] - 1.0, 0.0)
        power += penalty(p, w)
    return dv, dl, power, w, t


@njit(cache=True, nogil=True, error_model="numpy")
def step(p, ratios, gear, v, costate, dt):
    """One classical Runge-Kutta step in `gear`: (v, lambda, J gained)."""
    a1, b1, c1, _, _ = rates(p, ratios, gear, v, costate)
    a2, b2, c2, _, _ = rates(p, ratios, gear, v + 0.5 * dt * a1, costate + 0.5 * dt * b1)
    a3, b3, c3, _, _ = rates(p, ratios, gear, v + 0.5 * dt * a2, costate + 0.5 * dt * b2)
    a4, b4, c4, _, _ = rates(p, ratios, gear, v + dt * a3, costate + dt * b3)
    return (
        v + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
        costate + dt / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4),
        dt / 6.0 * (c1 + 2.0 * c2 + 2.0 * c3 + c4),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def switch_gap(p, ratios, gear, other, v, costate):
    """H of `other` minus H of `gear`; large where `gear` has left its engine speeds."""
    w = ratios[gear - 1] * v
    if w > p[10] * (1.0 + 1e-12) or w < p[9] * (1.0 - 1e-12):
        return 1e9
    return control(p, ratios, other, v, costate)[2] - control(p, ratios, gear, v, costate)[2]


@njit(cache=True, nogil=True, error_model="numpy")
def after_limit(p, ratios, v, costate, h, rising):
    """(gear, lambda) just beyond a speed v where an engine-speed limit ends the use of a gear: max H stays `h`."""
    beyond = v * (1.0 + 1e-10) if rising else v * (1.0 - 1e-10)
    gear = -1
    for _ in range(40):
        chosen, _ = best_gear(p, ratios, beyond, costate)
        if chosen < 0:
            return -1, costate
        dv = rates(p, ratios, chosen, v, costate)[0]
        if rising == (dv <= 0.0):  # max H is convex over lambda: the root wanted lies on its other branch
            costate *= 1.5 if rising else 0.5
            continue
        if abs(dv) < 1e-9:
            return -1, costate
        move = (control(p, ratios, chosen, v, costate)[2] - h) / dv
        costate -= move
        if chosen == gear and abs(move) <= 1e-14 * abs(costate):
            break
        gear = chosen
    return gear, costate


@njit(cache=True, nogil=True, error_model="numpy")
def free_costate(p, ratios, v, h):
    """lambda_v with max_u H = `h` while accelerating: min_u M_a (P_in + h)/(F - R), by Dinkelbach's iteration.

    Returns (lambda, gear); lambda is inf where the car cannot accelerate.
    """
    costate, chosen = 1e7, -1
    for _ in range(60):
        gear, _ = best_gear(p, ratios, v, costate)
        if gear < 0:
            return np.inf, -1
        dv, _, power, _, _ = rates(p, ratios, gear, v, costate)
        if dv <= 0.0:
            return np.inf, -1
        better = (power + h) / dv
        chosen = gear
        if abs(better - costate) <= 1e-14 * abs(costate):
            costate = better
            break
        costate = better
    return costate, chosen


@njit(cache=True, nogil=True, error_model="numpy")
def synthesis(p, ratios, speeds, h):
    """Optimal synthesis on `speeds` (n,): rows (lambda, gear, w, T, dv/dt, P_in), shape (n, 6)."""
    table = np.empty((len(speeds), 6))
    for i in range(len(speeds)):
        costate, gear = free_costate(p, ratios, speeds[i], h)
        if gear < 0:
            table[i, :] = np.nan
            continue
        dv, _, power, w, t = rates(p, ratios, gear, speeds[i], costate)
        table[i, 0], table[i, 1], table[i, 2], table[i, 3], table[i, 4], table[i, 5] = costate, gear, w, t, dv, power
    return table


@njit(cache=True, nogil=True, error_model="numpy")
def shoot(p, ratios, v, costate, duration, target, dt, preserve, record):
    """Integrate the extremal from (v, lambda) for `duration` s or until v rises to `target`.

    Gear switches are located to rounding; where an engine-speed limit forces one, lambda jumps (`after_limit`) and both
    its sides are recorded. `preserve`: after each step lambda is moved so that H keeps its first value
    (the projection of Busvelle et al., the thesis' note on Fig. 4.3). `record` (m, 8) receives
    t, v, lambda, J, gear, w, T, H at each node; returns (nodes, t, v, lambda, J).
    """
    gear, h0 = best_gear(p, ratios, v, costate)
    t, cost, row, repeats = 0.0, 0.0, 0, 0
    while row < len(record):
        _, _, _, w, torque = rates(p, ratios, gear, v, costate)
        h = control(p, ratios, gear, v, costate)[2]
        record[row, 0], record[row, 1], record[row, 2], record[row, 3] = t, v, costate, cost
        record[row, 4], record[row, 5], record[row, 6], record[row, 7] = gear, w, torque, h
        row += 1
        if t >= duration - 1e-12 or v >= target - 1e-12 or row == len(record) or gear < 0:
            break
        size = min(dt, duration - t, 0.02 * v / max(abs(rates(p, ratios, gear, v, costate)[0]), 1e-9))
        v1, l1, j1 = step(p, ratios, gear, v, costate, size)
        if v1 > target:  # stop on the target: secant on v(size)
            low, high = 0.0, size
            for _ in range(60):
                middle = 0.5 * (low + high)
                slope = (v1 - v) / size
                guess = size + (target - v1) / slope
                if low < guess < high:
                    middle = guess
                v1, l1, j1 = step(p, ratios, gear, v, costate, middle)
                size = middle
                if v1 > target:
                    high = middle
                else:
                    low = middle
                if abs(v1 - target) < 1e-13 * target:
                    break
        best, _ = best_gear(p, ratios, v1, l1)
        if best < 0:
            break
        forced = False
        if best != gear:  # an event inside the step: bracket where H of the two gears cross
            low, high = 0.0, size
            gap_low = switch_gap(p, ratios, gear, best, v, costate)
            if gap_low < 0.0:
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    vm, lm, jm = step(p, ratios, gear, v, costate, middle)
                    gap = switch_gap(p, ratios, gear, best, vm, lm)
                    if gap > 0.0:
                        high = middle
                        forced = gap == 1e9
                        v1, l1, j1, size = vm, lm, jm, middle
                    else:
                        low = middle
                    if high - low < 1e-14 * max(t, 1.0):
                        break
                repeats = 0
            else:
                repeats += 1
                if repeats > 8:
                    break
                gear = best
                row -= 1
                continue
        if preserve:
            dv = rates(p, ratios, gear, v1, l1)[0]
            if abs(dv) > 1e-3:
                l1 -= (control(p, ratios, gear, v1, l1)[2] - h0) / dv
        if forced and row < len(record):
            _, _, _, w, torque = rates(p, ratios, gear, v1, l1)
            record[row, 0], record[row, 1], record[row, 2], record[row, 3] = t + size, v1, l1, cost + j1
            record[row, 4], record[row, 5], record[row, 6] = gear, w, torque
            record[row, 7] = control(p, ratios, gear, v1, l1)[2]
            row += 1
            best, l1 = after_limit(p, ratios, v1, l1, h0, v1 > v)
            if best < 0:
                break
        t, v, costate, cost = t + size, v1, l1, cost + j1
        gear = best
        if v <= 0.0:
            break
    return row, t, v, costate, cost


@njit(cache=True, nogil=True, error_model="numpy")
def upwind_hamiltonian(p, ratios, v, right, left):
    """Numerical H of the scheme B.27: controls that raise v see the slope to the right, the others that to the left.

    `right`, `left`: -dS/dv, J per m/s. Returns (H, dv/dt of the maximiser).
    """
    road = p[1] + p[2] * v * v
    best, motion = -np.inf, 0.0
    for g in range(len(ratios)):
        n = ratios[g]
        w = n * v
        if w < p[9] * (1.0 - 1e-12) or w > p[10] * (1.0 + 1e-12):
            continue
        c0, c1, c2 = p[3] + w * (p[4] + w * p[7]), p[5] + p[6] * w, p[8]
        hold = road / n  # the torque that keeps the speed
        if hold < p[12]:
            b = right * n / p[0]
            t, value = best_of_cubic(b, w, c0, c1, c2, max(hold, p[11]), p[12])
            value -= right / p[0] * road
            if value > best:
                best, motion = value, (t * n - road) / p[0]
        if hold > p[11]:
            b = left * n / p[0]
            t, value = best_of_cubic(b, w, c0, c1, c2, p[11], min(hold, p[12]))
            value -= left / p[0] * road
            if value > best:
                best, motion = value, (t * n - road) / p[0]
    return best, motion


@njit(cache=True, nogil=True, error_model="numpy")
def march(p, ratios, low, high, nodes, target, duration, slope, absorbing, snapshots):
    """HJB of the six-speed problem by the explicit upwind scheme B.27, from the end backwards, on nodes in [low, high].

    `absorbing`: the target ends the drive whenever it is reached (free time); S = `slope` |v - target| at the latest.
    Otherwise (fixed time) the terminal condition is dualised: S = `slope` (target - v) at the end, a bound from below
    whose maximum over `slope` is the value sought, and `slope` then the costate at the end.
    Returns the speeds, S at time to go `duration`, and (m, nodes) snapshots of S at even times to go.
    """
    dv = (high - low) / (nodes - 1)
    v = low + dv * np.arange(nodes)
    s = slope * (target - v) if not absorbing else slope * np.abs(v - target)
    fastest = 0.0
    for i in range(nodes):
        for g in range(len(ratios)):
            w = ratios[g] * v[i]
            if p[9] <= w <= p[10]:
                fastest = max(fastest, abs(p[12] * ratios[g] - p[1] - p[2] * v[i] * v[i]) / p[0])
        fastest = max(fastest, (p[1] + p[2] * v[i] * v[i]) / p[0])
    steps = int(np.ceil(duration * fastest / (0.95 * dv)))
    dt = duration / steps
    kept = np.empty((snapshots, nodes))
    new = s.copy()
    taken = 0
    for k in range(steps + 1):
        while taken < snapshots and k * (snapshots - 1) >= taken * steps:
            kept[taken] = s
            taken += 1
        if k == steps:
            break
        for i in range(nodes):
            right = (s[i] - s[min(i + 1, nodes - 1)]) / dv if i < nodes - 1 else -slope
            left = (s[max(i - 1, 0)] - s[i]) / dv if i > 0 else slope
            new[i] = s[i] - dt * upwind_hamiltonian(p, ratios, v[i], right, left)[0]
            if absorbing and abs(v[i] - target) < 0.5 * dv:
                new[i] = 0.0
        s, new = new, s
    return v, s, kept
