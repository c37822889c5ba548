"""The acceleration in one dimension by dynamic programming: HJB, upwind (B.3.3); a grid of controls for the CVT."""

import time as clock

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from controller import acceleration_kernel as kernel
from controller.acceleration import ROWS, check, shifts_of, strongest
from controller.controller_model import ControllerModel
from controller.problem import Problem, acceleration_problem
from controller.solution import Certificate, Solution
from vehicle_model.car.errors import BadInput


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
            np.sum(np.diff(np.linspace(start, target, 50)) / strongest(model, np.linspace(start, target, 49)))
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
