"""One dimension, acceleration on the straight and level (4.4): synthesis and shooting.

With free time H = 0, and no shooting is needed at all: lambda_v(v) = min_u M_a P_in / (F - R), pointwise (ERRATA on
4.4.1). That synthesis is the oracle for the shooting. With fixed time H = h is the unknown, found by shooting on
lambda_v(0).
"""

import time as clock

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from controller import acceleration_kernel as kernel
from controller.controller_model import ControllerModel
from controller.problem import acceleration_problem
from controller.solution import Certificate, Shift, Solution
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
    surplus = strongest(model, speeds)
    if np.any(surplus <= 0.0):
        reachable = speeds[max(int(np.argmax(surplus <= 0.0)) - 1, 0)]
        raise BadInput("target speed", f"{target:.2f} m/s", f"nearest feasible is {reachable:.2f} m/s")
    if duration is not None:
        shortest = float(np.sum(np.diff(speeds) / (0.5 * (surplus[1:] + surplus[:-1]))))
        if duration < shortest:
            raise BadInput("duration", f"{duration:.2f} s", f"nearest feasible is {shortest:.2f} s")


def strongest(model: ControllerModel, speeds: NDArray[np.float64]) -> NDArray[np.float64]:
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
    return from_record(model, record[:nodes].copy(), cost, t, start, target, duration, case, "indirect", wall, certify)


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


def from_record(
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
    """Solution of the kernel's rows `record` (n, 8): t (s), v (m/s), lambda, J (J), gear, w (rad/s), T (N m), H (W).

    `certify` asks for Pontryagin's conditions along it; what ends elsewhere than at `target` is refused.
    """
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
