"""Two dimensions: a distance on the straight and level with a CVT (4.5.1), and what the thesis' answer to it is worth.

The thesis holds the controls at the corner of least power, (w_min, T_min), at the steady speed of that power, and calls
it optimal "by uniqueness". It satisfies the costate equations; whether the corner *maximises* H all along must be
tested, and with a low floor it does not: pulse and glide is cheaper by a fifth (ERRATA on 4.5.1).
"""

import time as clock
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from controller.controller_model import ControllerModel
from controller.direct import solve_phases
from controller.drive_table import LEVELS
from controller.hold_lines import hold_lines
from controller.problem import Problem
from controller.route_kernel import BIG, act, sweep
from controller.solution import Certificate, Solution


@dataclass(frozen=True)
class Corner:
    """The constant extremal of 4.5.1."""

    speed: float
    """v~ of (4.8), m/s."""
    power: float
    """P~ of (4.5), W of fuel."""
    costate_x: float
    """lambda_x of (4.9), J/m: the price of a metre (lambda0 = -1, so H = 0 gives lambda_x v = P~)."""
    alpha: float
    """Rate of (4.11) with 1/M_a (ERRATA on 4.10), 1/s."""

    def costate_v(self, time_to_go: NDArray[np.float64]) -> NDArray[np.float64]:
        """lambda_v at `time_to_go`, s, J per m/s: (4.11); 0 at the end, where the speed is free."""
        return self.costate_x / self.alpha * (1.0 - np.exp(-self.alpha * time_to_go))


def corner(model: ControllerModel) -> Corner:
    """Steady speed and costates of the corner of least power: Cardano's root of (4.6), p and q over rho C_d A / 2."""
    w, t = model.engine_speed[0], model.torque[0]
    half_drag = 0.5 * model.air_density * model.drag_area
    p = model.rolling_resistance * model.mass * model.gravity / half_drag
    q = -w * t / half_drag
    root = np.sqrt(q * q + 4.0 / 27.0 * p**3)
    speed = float(np.cbrt((-q + root) / 2.0) + np.cbrt((-q - root) / 2.0))
    power = float(model.fuel_power(w, t))
    alpha = (w * t / speed**2 + 2.0 * half_drag * speed) / model.accelerated_mass
    return Corner(speed, power, power / speed, alpha)


def distance_problem(model: ControllerModel, distance: float, start_speed: float) -> Problem:
    """Least fuel over `distance` m from `start_speed`, final speed and time free; state (x, v), control (w, T)."""
    return Problem(
        name="cvt-distance",
        dynamics=lambda x, u, mode: [x[1], model.acceleration(x[1], u[0], u[1])],
        running_cost=lambda x, u, mode: model.fuel_power(u[0], u[1]),
        start=(0.0, start_speed),
        target=(distance, None),
        duration=None,
        control_low=(model.engine_speed[0], model.torque[0]),
        control_high=(model.engine_speed[1], model.torque[1]),
        scale=(distance, 10.0),
    )


def corner_solution(model: ControllerModel, distance: float, *, case: str = "cvt-distance") -> Solution:
    """The thesis' answer, from the corner's own steady speed; refused where the corner does not maximise H."""
    began = clock.perf_counter()
    answer = corner(model)
    duration = distance / answer.speed
    t = np.linspace(0.0, duration, 201)
    n = len(t)
    state = np.stack([answer.speed * t, np.full(n, answer.speed)], axis=1)
    control = np.tile([model.engine_speed[0], model.torque[0]], (n, 1))
    costate = np.stack([np.full(n, answer.costate_x), answer.costate_v(duration - t)], axis=1)
    problem = distance_problem(model, distance, answer.speed)
    certificate = problem.certify(state, control, costate, np.zeros(n, np.int64), samples=121)
    solution = Solution(
        case=case,
        method="indirect",
        cost=answer.power * duration,
        duration=duration,
        distance=distance,
        time=t,
        state=state,
        control=control,
        costate=costate,
        wall=clock.perf_counter() - began,
        certificate=certificate,
        notes={"speed": answer.speed, "lambda_x": answer.costate_x, "lambda_v_0": float(costate[0, 1])},
    )
    gap = certificate.maximum_gap or 0.0
    if gap > 1e-6:
        return solution.refuse(
            f"the corner of least power does not maximise H: another control raises it by {gap:.2f} of P_in"
        )
    return solution


def bellman(
    model: ControllerModel,
    distance: float,
    start_speed: float,
    *,
    case: str = "cvt-distance",
    step: float = 10.0,
    nodes: int = 400,
    top_speed: float | None = None,
    relaxed: bool = True,
    method: str = "dp",
) -> Solution:
    """Dynamic programming over distance and kinetic energy with the route planner's kernel, CVT as one "gear".

    `relaxed` plans on the lower convex hull of the least fuel power over shaft power: the limit of ever faster pulse
    and glide, the infimum of the problem. Otherwise pulse and glide is not rewarded (`hold_lines`). Where the map is
    convex the two are the same.
    """
    began = clock.perf_counter()
    fastest = top_speed or 2.5 * start_speed
    shaft, least = cheapest_power(model)
    hull = lower_hull(shaft, least)
    curve = hull if relaxed else least
    cost, path, burnt, worth = _bellman(model, distance, start_speed, fastest, step, nodes, shaft, curve)
    coarse = _bellman(model, distance, start_speed, fastest, 2.0 * step, nodes // 2, shaft, curve)[0]
    speed = np.sqrt(2.0 * path)
    ds = np.diff(np.linspace(0.0, distance, len(path)))
    time = np.concatenate([[0.0], np.cumsum(ds / (0.5 * (speed[1:] + speed[:-1])))])
    middle = np.sqrt(0.5 * (speed[1:] ** 2 + speed[:-1] ** 2))
    thrust = model.accelerated_mass * np.diff(path) / ds + model.road_load(middle)
    power = 0.5 * (speed[1:] + speed[:-1]) * thrust
    gain = 1.0 - float(np.sum(np.interp(power, shaft, hull)) / np.sum(np.interp(power, shaft, least)))
    certificate = Certificate(mesh_error=abs(coarse - cost) / cost, hull_gain=max(gain, 0.0))
    solution = Solution(
        case=case,
        method=method,
        cost=cost,
        duration=float(time[-1]),
        distance=distance,
        time=time,
        state=np.stack([np.linspace(0.0, distance, len(path)), speed], axis=1),
        control=np.append(thrust, thrust[-1])[:, None],
        costate=np.stack([np.full(len(path), np.nan), np.append(worth, 0.0) * speed], axis=1),
        wall=clock.perf_counter() - began,
        certificate=certificate,
        notes={"mean_fuel_power": float(burnt.sum() / time[-1])},
    )
    return solution.judged()


def _bellman(
    model: ControllerModel, distance: float, start_speed: float, fastest: float, step: float, nodes: int, shaft, least
):
    """(J, E (K+1,), fuel (K,), -dV/dE (K,))."""
    count = round(distance / step)
    e = 0.5 * fastest**2 / (nodes - 1)
    speed = np.sqrt(np.arange(2 * nodes - 1) * e)
    speed[0] = 0.5 * speed[1]
    low, high = shaft[0] / speed, shaft[-1] / speed
    force = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, LEVELS * 8)
    fuel = np.interp(force * speed[:, None], shaft, least) / speed[:, None]
    ds = np.full(count, distance / count)
    top = np.full(count + 1, 0.5 * fastest**2)
    value = np.full((count + 1, 2, nodes), BIG)
    value[-1] = 0.0
    rows = len(speed)
    never = np.full(rows, -1e9)
    arguments = (
        ds, np.full(count, model.mass * model.gravity * model.rolling_resistance), top,
        np.zeros(count + 1, np.int64), np.full(count + 1, nodes), np.full(count + 1, nodes), np.zeros(count), e,
        model.air_density * model.drag_area,
        np.array([model.accelerated_mass]), fuel[None], low[None], high[None], never, np.zeros(rows),
        np.full(rows, model.accelerated_mass), 0.0, 0.0, 0.0, 0.0, 5.0, 5.0,
        *hold_lines(e, fuel[None], low[None], high[None], never, np.zeros(rows)), value,
    )  # fmt: skip
    sweep(*arguments)
    start = np.full(count, 0.5 * start_speed**2)
    _, ends, _, burnt, worth = act(np.arange(count), start, np.full(count, 1), True, *arguments)
    return float(burnt.sum()), np.append(start[0], ends), burnt, worth


def cheapest_power(model: ControllerModel, samples: int = 600) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least fuel power at each shaft power w T that the box allows: (p, P*(p)), W, p ascending."""
    (w0, w1), (t0, t1) = model.engine_speed, model.torque
    shaft = np.linspace(w0 * t0, w1 * t1, samples)
    w = np.linspace(0.0, 1.0, 2001)[None, :]
    low, high = np.maximum(w0, shaft / t1)[:, None], np.minimum(w1, shaft / t0)[:, None]
    w = low + (high - low) * w
    return shaft, np.min(model.fuel_power(w, shaft[:, None] / w), axis=1)


def lower_hull(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lower convex hull of y(x), x ascending, on the same x (Andrew's monotone chain)."""
    kept: list[int] = []
    for i in range(len(x)):
        while len(kept) > 1 and (y[kept[-1]] - y[kept[-2]]) * (x[i] - x[kept[-2]]) >= (y[i] - y[kept[-2]]) * (
            x[kept[-1]] - x[kept[-2]]
        ):
            kept.pop()
        kept.append(i)
    return np.interp(x, x[kept], y[kept])


def direct_solution(
    model: ControllerModel, distance: float, start_speed: float, *, case: str = "cvt-distance", pulses: int = 0
) -> Solution | None:
    """Collocation from a guess with `pulses` pulses (0: one steady phase); None when IPOPT finds no answer.

    From controls near the corner of least power and from farther off, the cheaper answer: this has local optima.
    """
    problem = distance_problem(model, distance, start_speed)
    phases = max(2 * pulses, 1)
    ends = [
        np.array([distance * (k + 1) / phases, start_speed * ((1.5 if k % 2 == 0 else 1.0) if pulses else 1.0)])
        for k in range(phases)
    ]
    found = [
        solve_phases(
            problem,
            (0,) * phases,
            intervals=60 if phases == 1 else 10,
            guess=ends,
            guess_duration=distance / start_speed,
            guess_control=(share * model.engine_speed[0], share * model.torque[0]),
        )
        for share in (1.01, 1.2)
    ]
    answer = min((one for one in found if one is not None), key=lambda one: one.cost, default=None)
    if answer is None:
        return None
    state, control, costate, mode = answer.middles()
    return Solution(
        case=case,
        method="direct",
        cost=answer.cost,
        duration=float(answer.time[-1]),
        distance=distance,
        time=answer.time,
        state=answer.state,
        control=answer.control,
        costate=answer.costate,
        wall=answer.wall,
        certificate=problem.certify(state, control, costate, mode, samples=81),
    )


def with_floor(model: ControllerModel, engine_speed: float, torque: float) -> ControllerModel:
    """The same model with higher lower bounds, rad/s and N m."""
    return replace(model, engine_speed=(engine_speed, model.engine_speed[1]), torque=(torque, model.torque[1]))
