"""One dimension, acceleration on the straight and level (4.4): synthesis, shooting, multiple shooting and HJB.

With free time H = 0, and no shooting is needed at all: lambda_v(v) = min_u M_a P_in / (F - R), pointwise (ERRATA on
4.4.1). That synthesis is the oracle for the shooting. With fixed time H = h is the unknown, found by shooting on
lambda_v(0).
"""

import time as clock
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from controller import acceleration_kernel as kernel
from controller.controller_model import ControllerModel
from controller.direct import DirectAnswer, best_sequence
from controller.problem import Problem, acceleration_problem
from controller.solution import Certificate, Shift, Solution, failed
from vehicle_model.car.errors import BadInput

ROWS = 20_000
"""Room for the nodes of one trajectory."""


def synthesis_table(model: ControllerModel, speeds: NDArray[np.float64], h: float = 0.0) -> NDArray[np.float64]:
    """Optimal synthesis: for each speed (n,) m/s a row (lambda_v, gear, w, T, dv/dt, P_in), shape (n, 6).

    `h` is the Hamiltonian's value, W (0 with free time). NaN where the car cannot accelerate.
    """
    return kernel.synthesis(model.kernel_parameters(), np.asarray(model.ratios, float), speeds, h)


def check(model: ControllerModel, start: float, target: float, duration: float | None) -> None:
    """Refuse what cannot be asked, naming the nearest feasible value. Raises BadInput."""
    w, t = model.engine_speed, model.torque
    if not (0.0 < w[0] < w[1]) or not (0.0 <= t[0] < t[1]):
        raise BadInput("controller model", "bounds", f"lower bounds below upper ones, not {w} rad/s and {t} N m")
    grid_w, grid_t = np.meshgrid(np.linspace(*w, 60), np.linspace(max(t[0], 1e-3), t[1], 60))
    phi = model.inverse_efficiency(grid_w, grid_t)
    if np.any(phi < 1.0):
        worst = np.unravel_index(np.argmin(phi), phi.shape)
        place = f"{grid_w[worst]:.0f} rad/s, {grid_t[worst]:.0f} N m"
        raise BadInput("efficiency map", place, f"an efficiency above zero and at most one, not {1.0 / phi[worst]:.3f}")
    if start <= 0.0:
        raise BadInput("start speed", f"{start} m/s", "above zero (nearest feasible is 0.1 m/s)")
    if not model.cvt and start < w[0] / model.ratios[0]:
        lowest = w[0] / model.ratios[0]
        raise BadInput("start speed", f"{start:.2f} m/s", f"nearest feasible in first gear is {lowest:.2f} m/s")
    if target <= start:
        raise BadInput("target speed", f"{target:.2f} m/s", f"above the start speed of {start:.2f} m/s")
    speeds = np.linspace(start, target, 400)
    surplus = _strongest(model, speeds)
    if np.any(surplus <= 0.0):
        reachable = speeds[max(int(np.argmax(surplus <= 0.0)) - 1, 0)]
        raise BadInput("target speed", f"{target:.2f} m/s", f"nearest feasible is {reachable:.2f} m/s")
    if duration is not None:
        shortest = float(np.sum(np.diff(speeds) / (0.5 * (surplus[1:] + surplus[:-1]))))
        if duration < shortest:
            raise BadInput("duration", f"{duration:.2f} s", f"nearest feasible is {shortest:.2f} s")


def _strongest(model: ControllerModel, speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Greatest acceleration at each speed, m/s2."""
    (w0, w1), top = model.engine_speed, model.torque[1]
    if model.cvt:
        return model.acceleration(speeds, w1, top)
    best = np.full(len(speeds), -np.inf)
    for n in model.ratios:
        usable = (n * speeds >= w0 * (1 - 1e-9)) & (n * speeds <= w1 * (1 + 1e-9))
        best = np.where(usable, np.maximum(best, model.acceleration(speeds, n * speeds, top)), best)
    return best


def shoot(
    model: ControllerModel,
    start: float,
    target: float,
    duration: float | None,
    *,
    dt: float = 0.05,
    case: str = "acceleration",
    certify: bool = True,
) -> Solution:
    """Single shooting with gear events and a preserved Hamiltonian; `duration` None leaves time free (H = 0).

    Raises BadInput as `check` does.
    """
    check(model, start, target, duration)
    p, ratios = model.kernel_parameters(), np.asarray(model.ratios, float)
    record = np.empty((ROWS, 8))
    kernel.shoot(p, ratios, start, 1.0, 0.0, target, dt, True, record)  # compiled before the clock starts
    kernel.free_costate(p, ratios, start, 0.0)
    began = clock.perf_counter()
    costate, _ = kernel.free_costate(p, ratios, start, 0.0)
    if duration is None:
        nodes, t, _, _, cost = kernel.shoot(p, ratios, start, costate, 1e4, target, dt, True, record)
    else:
        costate = _bracket_and_aim(p, ratios, start, target, duration, costate, dt, record)
        nodes, t, _, _, cost = kernel.shoot(p, ratios, start, costate, duration, np.inf, dt, True, record)
    wall = clock.perf_counter() - began
    return _from_record(model, record[:nodes].copy(), cost, t, start, target, duration, case, "indirect", wall, certify)


def _bracket_and_aim(p, ratios, start: float, target: float, duration: float, free: float, dt: float, record) -> float:
    """lambda_v(0) whose extremal has v(duration) = target: bracketed from below by coasting, from above by doubling."""
    high = free
    for _ in range(60):
        _, _, v, _, _ = kernel.shoot(p, ratios, start, high, duration, np.inf, dt, True, record)
        if v > target:
            break
        high *= 1.5

    def miss(costate: float) -> float:
        return kernel.shoot(p, ratios, start, costate, duration, np.inf, dt, True, record)[2] - target

    if miss(0.0) * miss(high) > 0.0:
        raise BadInput("duration", f"{duration:.2f} s", "a time for which an extremal reaches the target")
    costate = float(brentq(miss, 0.0, high, xtol=1e-13 * high, rtol=8.9e-16))
    return costate


def _from_record(
    model: ControllerModel,
    record: NDArray[np.float64],
    cost: float,
    duration: float,
    start: float,
    target: float,
    fixed: float | None,
    case: str,
    method: str,
    wall: float,
    certify: bool,
    mesh_error: float | None = None,
) -> Solution:
    """Wrap the kernel's rows (t, v, lambda, J, gear, w, T, H)."""
    t, v, gear = record[:, 0], record[:, 1], record[:, 4].astype(np.int64)
    control = record[:, 5:7] if model.cvt else record[:, 6:7]
    problem = acceleration_problem(model, start, target, fixed)
    shifts = shifts_of(model, t, v, gear)
    certificate = Certificate()
    if certify:
        keep = _spread(len(t), 160)
        certificate = problem.certify(
            record[keep, 1:2], control[keep], record[keep, 2:3], gear[keep], samples=81, mesh_error=mesh_error
        )
    reached = abs(v[-1] - target) < 1e-6 * target
    solution = Solution(
        case=case,
        method=method,
        cost=float(cost),
        duration=float(duration),
        distance=float(np.trapezoid(v, t)),
        time=t,
        state=record[:, 1:2],
        control=control,
        costate=record[:, 2:3],
        gear=gear,
        shifts=shifts,
        wall=wall,
        certificate=certificate,
    )
    if not reached:
        return solution.refuse(f"the extremal ends at {v[-1]:.2f} m/s instead of {target:.2f} m/s")
    return solution.judged() if certify else solution


def shifts_of(
    model: ControllerModel, t: NDArray[np.float64], v: NDArray[np.float64], gear: NDArray[np.int64]
) -> tuple[Shift, ...]:
    """Gear changes along a trajectory whose node k is the first one driven in gear[k]."""
    changes = np.flatnonzero(np.diff(gear)) + 1
    if model.cvt:
        return ()
    return tuple(
        Shift(int(gear[k - 1]), int(gear[k]), float(v[k]), float(v[k] * model.ratios[gear[k - 1] - 1]), float(t[k]))
        for k in changes
    )


def _spread(n: int, wanted: int) -> NDArray[np.int64]:
    """Up to `wanted` indices spread over range(n), both ends included."""
    return np.unique(np.linspace(0, n - 1, min(n, wanted)).astype(np.int64))


def multiple_shooting(
    model: ControllerModel,
    start: float,
    target: float,
    duration: float,
    guess: Callable[[float], tuple[float, float]],
    *,
    segments: int = 8,
    dt: float = 0.02,
    workers: int = 2,
    tolerance: float = 1e-9,
) -> tuple[NDArray[np.float64], float, int]:
    """Indirect multiple shooting (B.3.1.2) for fixed time: nodes (segments, 2) of (v, lambda), residual, iterations.

    Newton on the matching conditions; the segments and their derivatives are integrated in parallel threads (the
    kernels hold no interpreter lock where numba is told so; each shot is independent). `guess(t)` gives (v, lambda).
    """
    p, ratios = model.kernel_parameters(), np.asarray(model.ratios, float)
    h = duration / segments
    z = np.array([guess(k * h) for k in range(segments)])
    z[0, 0] = start
    scale = np.array([target, max(abs(z[:, 1]).max(), 1.0)])

    def fly(state: NDArray[np.float64]) -> NDArray[np.float64]:
        record = np.empty((ROWS // 4, 8))
        _, _, v, costate, _ = kernel.shoot(p, ratios, state[0], state[1], h, np.inf, dt, False, record)
        return np.array([v, costate])

    def residual(ends: NDArray[np.float64]) -> NDArray[np.float64]:
        match = (ends[:-1] - z[1:]) / scale
        return np.concatenate([match.ravel(), [(ends[-1, 0] - target) / target]])

    miss, rounds = np.inf, 0
    with ThreadPoolExecutor(max_workers=workers) as pool:
        for rounds in range(1, 60):  # noqa: B007 - returned
            step = 1e-6 * scale
            shots = [z[k] for k in range(segments)]
            shots += [z[k] + [step[0], 0.0] for k in range(segments)] + [z[k] + [0.0, step[1]] for k in range(segments)]
            flown = np.array(list(pool.map(fly, shots)))
            ends = flown[:segments]
            r = residual(ends)
            miss = float(np.max(np.abs(r)))
            if miss < tolerance:
                break
            jacobian = np.zeros((len(r), 2 * segments))
            for k in range(segments):
                block = (
                    np.stack(
                        [
                            (flown[segments + k] - ends[k]) / step[0] * scale[0],
                            (flown[2 * segments + k] - ends[k]) / step[1] * scale[1],
                        ],
                        axis=1,
                    )
                    / scale[:, None]
                )
                if k < segments - 1:
                    jacobian[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
                    jacobian[2 * k : 2 * k + 2, 2 * k + 2 : 2 * k + 4] = -np.eye(2)
                else:
                    jacobian[-1, 2 * k : 2 * k + 2] = block[0] * scale[0] / target
            move = np.linalg.solve(jacobian[:, 1:], -r)  # v(0) is given
            length = min(1.0, 0.3 / max(np.max(np.abs(move)), 1e-12))
            z = z + length * np.concatenate([[0.0], move]).reshape(segments, 2) * scale
    return z, miss, rounds


def shoot_multiple(
    model: ControllerModel, start: float, target: float, duration: float | None, *, case: str = "acceleration"
) -> Solution:
    """`multiple_shooting` from a coarse dynamic programme's trajectory. Raises BadInput for free time."""
    check(model, start, target, duration)
    if duration is None:
        raise BadInput("indirect-multiple", case, "a case in fixed time: with free time H = 0 and nothing is to shoot")
    coarse = dynamic_programming(model, start, target, duration, nodes=101)
    began = clock.perf_counter()
    guess_t, guess_v, guess_l = coarse.time, coarse.state[:, 0], coarse.costate[:, 0]
    nodes, miss, rounds = multiple_shooting(
        model,
        start,
        target,
        duration,
        lambda t: (float(np.interp(t, guess_t, guess_v)), float(np.interp(t, guess_t, guess_l))),
    )
    p, ratios = model.kernel_parameters(), np.asarray(model.ratios, float)
    pieces, cost, h = [], 0.0, duration / len(nodes)
    for k, (v, costate) in enumerate(nodes):
        record = np.empty((ROWS, 8))
        n, *_, gained = kernel.shoot(p, ratios, v, costate, h, np.inf, 0.02, False, record)
        record[:n, 0] += k * h
        pieces.append(record[:n])
        cost += gained
    wall = clock.perf_counter() - began
    solution = _from_record(
        model, np.concatenate(pieces), cost, duration, start, target, duration, case, "indirect-multiple", wall, True
    )
    solution = replace(solution, notes={"mismatch": miss, "iterations": float(rounds)})
    return solution if miss < 1e-6 else solution.refuse(f"the segments do not meet: {miss:.1e}")


def direct(
    model: ControllerModel,
    start: float,
    target: float,
    duration: float | None,
    *,
    case: str = "acceleration",
    sequences: list[tuple[int, ...]] | None = None,
    transcription: str = "collocation",
    intervals: int | None = None,
) -> Solution:
    """The same by IPOPT, gears enumerated (`controller.direct`)."""
    check(model, start, target, duration)
    problem = acceleration_problem(model, start, target, duration)
    if model.cvt:
        answer = best_sequence(
            problem,
            [(0, 0, 0)],  # three stretches of one mode: the launch wants a finer mesh than the rest
            intervals=intervals or 20,
            transcription=transcription,
            guess=[np.array([start * (target / start) ** q]) for q in (0.3, 0.6, 1.0)],
            guess_durations=(0.02, 0.1, 0.88),
        )
    else:
        tried = sequences or gear_sequences(model, start, target, duration)
        answers: list[DirectAnswer] = []
        began = clock.perf_counter()
        for sequence in tried:
            answer = best_sequence(
                problem,
                [sequence],
                intervals=intervals or 8,
                transcription=transcription,
                guess=_phase_ends(model, start, target, sequence),
                guess_control=(0.8 * model.torque[1],),
                shortest=0.02,
            )
            if answer is not None:
                answers.append(answer)
        answer = min(answers, key=lambda a: a.cost) if answers else None
        if answer is not None:
            answer = DirectAnswer(
                answer.cost, answer.time, answer.state, answer.control, answer.costate, answer.mode,
                clock.perf_counter() - began,
            )  # fmt: skip
    if answer is None:
        return failed(case, "direct", "IPOPT found no answer for any sequence of gears")
    shifts = shifts_of(model, answer.time, answer.state[:, 0], answer.mode)
    state, control, costate, mode = answer.middles()
    certificate = problem.certify(state, control, costate, mode, samples=81)
    solution = Solution(
        case=case,
        method="direct",
        cost=answer.cost,
        duration=float(answer.time[-1]),
        distance=float(np.trapezoid(answer.state[:, 0], answer.time)),
        time=answer.time,
        state=answer.state,
        control=answer.control,
        costate=answer.costate,
        gear=answer.mode,
        shifts=shifts,
        wall=answer.wall,
        certificate=certificate,
    )
    return solution.judged()


def gear_sequences(
    model: ControllerModel, start: float, target: float, duration: float | None
) -> list[tuple[int, ...]]:
    """Runs of consecutive gears worth trying; with fixed time each of them also after coasting in the highest gear."""
    gears = range(1, len(model.ratios) + 1)
    low, high = model.engine_speed
    first = [g for g in gears if low <= model.ratios[g - 1] * start <= 0.9 * high][:2]
    last = [g for g in gears if model.ratios[g - 1] * target <= high and model.ratios[g - 1] * target >= 0.5 * high]
    runs = [tuple(range(a, b + 1)) for a in first for b in last if b >= a]
    if duration is None:
        return runs
    coasting = [g for g in gears if model.ratios[g - 1] * start >= low][-1]
    return runs + [(coasting, *run) for run in runs]


def _phase_ends(
    model: ControllerModel, start: float, target: float, sequence: tuple[int, ...]
) -> list[NDArray[np.float64]]:
    """Guess of the speed at the end of each phase: shifts at three quarters of the highest engine speed."""
    ends, rest = [], list(sequence)
    if len(rest) > 1 and rest[0] > rest[1]:
        ends.append(np.array([0.95 * start]))
        rest = rest[1:]
    ends += [np.array([min(0.75 * model.engine_speed[1] / model.ratios[g - 1], target)]) for g in rest[:-1]]
    return [*ends, np.array([target])]


def dynamic_programming(
    model: ControllerModel,
    start: float,
    target: float,
    duration: float | None,
    *,
    case: str = "acceleration",
    nodes: int = 401,
) -> Solution:
    """HJB by the upwind scheme of B.3.3 on `nodes` speeds, and on half as many for the mesh error.

    J is Richardson's extrapolation of the two (the scheme is of first order).
    """
    check(model, start, target, duration)
    if not model.cvt:  # compiled before the clock starts
        p, ratios = model.kernel_parameters(), np.asarray(model.ratios, float)
        kernel.march(p, ratios, start, target, 5, target, 1e-3, 1.0, True, 2)
    began = clock.perf_counter()
    solve = _bellman_cvt if model.cvt else _upwind
    coarse = solve(model, start, target, duration, (nodes + 1) // 2)[0]
    fine, speeds, costate = solve(model, start, target, duration, nodes)
    cost = 2.0 * fine - coarse
    certificate = Certificate(mesh_error=abs(fine - coarse) / cost)
    problem = acceleration_problem(model, start, target, duration)
    trace = _follow(model, problem, speeds, costate, start, target, duration)
    solution = Solution(
        case=case,
        method="dp",
        cost=cost,
        duration=float(trace[-1, 0]),
        distance=float(np.trapezoid(trace[:, 1], trace[:, 0])),
        time=trace[:, 0],
        state=trace[:, 1:2],
        control=trace[:, 5:7] if model.cvt else trace[:, 6:7],
        costate=trace[:, 2:3],
        gear=trace[:, 4].astype(np.int64),
        shifts=shifts_of(model, trace[:, 0], trace[:, 1], trace[:, 4].astype(np.int64)),
        wall=clock.perf_counter() - began,
        certificate=certificate,
    )
    return solution.judged()


def _upwind(model: ControllerModel, start: float, target: float, duration: float | None, nodes: int):
    """(J, speeds, costate snapshots (m, nodes) from the end backwards) by `acceleration_kernel.march`."""
    p, ratios = model.kernel_parameters(), np.asarray(model.ratios, float)
    floor = max(model.engine_speed[0] / model.ratios[-1], 0.05)
    floor = max(min(floor, 0.9 * start), model.engine_speed[0] / model.ratios[0])
    end_costate, _ = kernel.free_costate(p, ratios, target, 0.0)
    if duration is None:
        horizon = 3.0 * float(
            np.sum(np.diff(np.linspace(start, target, 50)) / _strongest(model, np.linspace(start, target, 49)))
        )
        v, s, kept = kernel.march(p, ratios, floor, target, nodes, target, horizon, 3.0 * end_costate, True, 2)
        costate = -np.gradient(s, v)
        return float(np.interp(start, v, s)), v, np.broadcast_to(costate, (2, nodes))
    high = target + 0.15 * (target - start)
    high = min(high, model.engine_speed[1] / model.ratios[-1])

    def bound(slope: float) -> float:
        v, s, _ = kernel.march(p, ratios, floor, high, nodes, target, duration, slope, False, 2)
        return -float(np.interp(start, v, s))

    best = minimize_scalar(
        bound, bounds=(0.2 * end_costate, 3.0 * end_costate), method="bounded", options={"xatol": 20.0}
    )
    v, s, kept = kernel.march(p, ratios, floor, high, nodes, target, duration, float(best.x), False, 601)
    return float(np.interp(start, v, s)), v, -np.gradient(kept, v, axis=1)


def _bellman_cvt(model: ControllerModel, start: float, target: float, duration: float | None, nodes: int):
    """CVT: V_i = min over a grid of (w, T) of V_{i+1} + (P_in + h) dv / (dv/dt), by brute force.

    h, the price of a second, is nothing in free time; in fixed time it is the one that takes `duration`, and J is told
    without it. It knows drives that only get faster, so that h >= 0. Raises BadInput with the longest time.
    """
    speeds = start * (target / start) ** np.linspace(0.0, 1.0, nodes)
    w, t = np.meshgrid(np.linspace(*model.engine_speed, 181), np.linspace(*model.torque, 181))
    power = model.fuel_power(w, t).ravel()
    rates = [model.acceleration(v, w, t).ravel() for v in speeds]
    slowness = [np.where(rate > 0.0, 1.0 / np.where(rate > 0.0, rate, 1.0), np.inf) for rate in rates]

    def cells(h: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """lambda_v and seconds per m/s at each speed."""
        best = [int(np.argmin((power + h) * s)) for s in slowness]
        pace = np.array([s[i] for s, i in zip(slowness, best, strict=True)])
        return (power[best] + h) * pace, pace

    def seconds(h: float) -> float:
        return float(np.sum(cells(h)[1][:-1] * np.diff(speeds)))

    h = 0.0
    if duration is not None:
        if duration > seconds(0.0):
            raise BadInput("duration", f"{duration:.2f} s", f"nearest feasible by this method is {seconds(0.0):.2f} s")
        h = float(brentq(lambda q: seconds(q) - duration, 0.0, 1e6, xtol=1.0, rtol=1e-4))
    costate, pace = cells(h)
    # first order, upwind: the cell from v_i to v_{i+1} at the cost of its lower end
    taken = float(np.sum(pace[:-1] * np.diff(speeds)))
    value = float(np.sum(costate[:-1] * np.diff(speeds))) - h * (taken if duration is None else duration)
    return value, speeds, np.broadcast_to(costate, (2, nodes))


def _follow(model, problem: Problem, speeds, costate, start, target, duration) -> NDArray[np.float64]:
    """Drive by the value function's slope: rows (t, v, lambda, J, gear, w, T, H), explicit steps of 20 ms."""
    p, ratios = model.kernel_parameters(), np.asarray(model.ratios, float)
    rows: list[tuple[float, ...]] = []
    t, v, cost, dt = 0.0, start, 0.0, 0.02
    limit = duration if duration is not None else 1e4
    while t < limit - 1e-9 and len(rows) < ROWS and (duration is not None or v < target):
        to_go = 0.0 if duration is None else (duration - t) / duration * (len(costate) - 1)
        below = min(int(to_go), len(costate) - 2)
        share = to_go - below
        worth = (1 - share) * np.interp(v, speeds, costate[below]) + share * np.interp(v, speeds, costate[below + 1])
        gear, h = kernel.best_gear(p, ratios, v, worth)
        rate, _, power, w, torque = kernel.rates(p, ratios, gear, v, worth)
        rows.append((t, v, worth, cost, gear, w, torque, h))
        size = min(dt, limit - t, 0.02 * v / max(abs(rate), 1e-9))
        if duration is None and rate > 0.0:
            size = min(size, max((target - v) / rate, 1e-6))
        t, v, cost = t + size, v + size * rate, cost + size * power
        if duration is None and rate <= 0.0:
            break
    rows.append((t, v, rows[-1][2], cost, *rows[-1][4:]))
    return np.array(rows)
