"""The acceleration in one dimension by indirect multiple shooting (B.3.1.2), from a coarse dynamic programme."""

import time as clock
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from controller import acceleration_kernel as kernel
from controller.acceleration import ROWS, check, from_record
from controller.acceleration_programme import dynamic_programming
from controller.controller_model import ControllerModel
from controller.solution import Solution
from vehicle_model.car.errors import BadInput


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
    solution = from_record(
        model, np.concatenate(pieces), cost, duration, start, target, duration, case, "indirect-multiple", wall, True
    )
    solution = replace(solution, notes={"mismatch": miss, "iterations": float(rounds)})
    return solution if miss < 1e-6 else solution.refuse(f"the segments do not meet: {miss:.1e}")
