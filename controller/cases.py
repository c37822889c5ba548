"""The cases of `rollingroad solve`: each solved by every method that applies, each answer with its certificate."""

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from controller import acceleration, ball_and_wheel, distance, hill_road, linear_quadratic
from controller.controller_model import RPM, THESIS, THESIS_CVT, ControllerModel, model_of
from controller.direct import solve_phases
from controller.problem import Problem
from controller.pulse_and_glide import pulse_and_glide
from controller.soft_driving import compare
from controller.solution import Certificate, Solution
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

METHODS = ("indirect", "direct", "dp")
KMH = 1.0 / 3.6


def solve(case: str, methods: Sequence[str] = METHODS, car: Car | None = None) -> list[Solution]:
    """Solve `case` by `methods` ("indirect", "direct", "dp"); without `car`, the thesis' controller model (CLI.md).

    A solution that fails its certificate keeps its row, refused. Raises BadInput for an unknown case or method.
    """
    if case not in CASES:
        raise BadInput("case", case, f"one of {', '.join(CASES)}")
    for method in methods:
        if method not in METHODS:
            raise BadInput("method", method, f"one of {', '.join(METHODS)}")
    return CASES[case](tuple(methods), car)


def _gearbox(car: Car | None) -> ControllerModel:
    return THESIS if car is None else model_of(car)


def _stepless(car: Car | None) -> ControllerModel:
    return THESIS_CVT if car is None else model_of(car, cvt=True)


def _accelerate(
    case: str, model: ControllerModel, start: float, target: float, duration: float | None, methods: tuple[str, ...]
) -> list[Solution]:
    solvers: dict[str, Callable[..., Solution]]
    solvers = {"indirect": acceleration.shoot, "direct": acceleration.direct, "dp": acceleration.dynamic_programming}
    return [solvers[m](model, start, target, duration, case=case) for m in methods]


def cvt_free(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.4.1.1: CVT, 1 m/s to 100 km/h, free time."""
    return _accelerate("cvt-free", _stepless(car), 1.0, 100.0 * KMH, None, methods)


def six_speed_free(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.4.2.1: gears, 36 to 100 km/h, free time."""
    return _accelerate("six-speed-free", _gearbox(car), 10.0, 100.0 * KMH, None, methods)


def six_speed_fixed(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.4.2.2: gears, 36 to 140 km/h in 30 s."""
    return _accelerate("six-speed-fixed", _gearbox(car), 10.0, 140.0 * KMH, 30.0, methods)


def six_speed_limit(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """B.2.5.3: as six-speed-free with two thirds of the engine speeds allowed; costate jumps, and the same by penalty.

    In a gear the limit is one on the state, which the extremal of six-speed-free violates. The principle with state
    limits: lambda jumps where the limit ends a gear, by what keeps H; notes carry the jumps. By penalty (row
    "indirect-penalty"): J with the penalty is a bound from below, which rises to the constrained J with the weight; the
    limit is then exceeded by `overshoot_percent`.
    """
    model = _gearbox(car)
    low, high = model.engine_speed
    limited = replace(model, engine_speed=(low, high * 2.0 / 3.0))
    found = []
    for solution in _accelerate("six-speed-limit", limited, 10.0, 100.0 * KMH, None, methods):
        if solution.method != "indirect":
            found.append(solution)
            continue
        at = np.flatnonzero(np.diff(solution.time) == 0.0)
        jumps = solution.costate[at + 1, 0] - solution.costate[at, 0]
        notes = {f"costate_jump_{k}": float(jump) for k, jump in enumerate(jumps, start=1)}
        found.append(replace(solution, notes=notes))
        soft = replace(model, soft_limit=high * 2.0 / 3.0, penalty=1e8)
        priced = acceleration.shoot(soft, 10.0, 100.0 * KMH, None, dt=0.01, case="six-speed-limit")
        over = max((s.engine_speed for s in priced.shifts), default=0.0) / soft.soft_limit - 1.0
        found.append(replace(priced, method="indirect-penalty", notes={"overshoot_percent": 100.0 * max(over, 0.0)}))
    return found


def _distance(case: str, model: ControllerModel, methods: tuple[str, ...]) -> list[Solution]:
    length, found = 5000.0, []
    start = distance.corner(model).speed
    for method in methods:
        if method == "indirect":
            found.append(distance.corner_solution(model, length, case=case))
        elif method == "dp":
            found.append(distance.bellman(model, length, start, case=case, step=20.0, nodes=300))
        else:
            answer = distance.direct_solution(model, length, start, case=case)
            found.append(answer or acceleration.failed(case, "direct", "IPOPT found no answer"))
    least = min((s.cost for s in found if s.certificate.refused is None), default=np.nan)
    return [_beaten(s, least) if s.method == "direct" else s for s in found]


def _beaten(solution: Solution, least: float) -> Solution:
    """A local optimum, as IPOPT may return one, is refused when another method does better by more than 1 %."""
    if solution.certificate.refused is None and solution.cost > 1.01 * least:
        excess = solution.cost / least - 1.0
        return solution.refuse(f"a local optimum: another method's answer is {excess:.1%} cheaper")
    return solution


def cvt_distance(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.5.1: CVT, 5 km, free time and final speed; the thesis' corner is refused, dp gives the infimum.

    Row "pulse-and-glide" is a drive that can be driven, in six pulses; its note says what the corner costs more.
    """
    model = _stepless(car)
    found = _distance("cvt-distance", model, methods)
    if "indirect" in methods and found[methods.index("indirect")].certificate.refused is not None:
        corner = found[methods.index("indirect")]
        pulsed = pulse_and_glide(model, corner.distance, corner.notes["speed"], 6)
        excess = 100.0 * (corner.cost / pulsed.cost - 1.0)
        found.append(replace(pulsed, notes={**pulsed.notes, "corner_excess_percent": excess}))
    return found


def cvt_corner(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.5.1 with the floor at 2000 rpm and 30 N m, where the corner of least power is optimal."""
    model = _stepless(car)
    scale = model.torque[1] / THESIS_CVT.torque[1]
    return _distance("cvt-corner", distance.with_floor(model, 2000.0 * RPM, 30.0 * scale), methods)


def soft_vs_pontryagin(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.4.3: the soft driver against Pontryagin to 90 km/h, as printed and fairly. Methods do not apply."""
    return compare(_gearbox(car))


def route(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """Hills between two fixed speeds at a price on time, one gear, smooth engine."""
    problem = hill_road.HillRoad()
    if car is not None:
        problem = replace(
            problem,
            ratio=car.gear_ratios[-1] / car.wheel_radius,
            mass=car.mass,
            accelerated_mass=car.accelerated_mass,
            engine_inertia=car.engine.inertia,
            rolling_resistance=car.rolling_resistance,
            drag_area=car.drag_area,
        )
    solvers = {"indirect": hill_road.indirect, "direct": hill_road.direct, "dp": hill_road.dynamic_programming}
    return [solvers[m](problem) for m in methods]


def ball_and_wheel_case(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """Appendix G: the ball back to the top in least time, from 0.05 rad at rest. J in seconds."""
    low, high = ball_and_wheel.BallAndWheel().bounds()
    angle, rate = 0.05, 0.0
    found = []
    for method in methods:
        began = clock.perf_counter()
        if method == "indirect":
            found.append(_synthesised(angle, rate, low, high))
        elif method == "direct":
            found.append(_ball_direct(angle, rate, low, high))
        else:
            meshes = [
                ball_and_wheel.lattice_minimum_time(angle, rate, low, high, half_rates=n) for n in (50, 60, 73, 86)
            ]
            best = min(meshes)
            nothing = np.empty((0, 2))
            found.append(
                Solution(
                    "ball-and-wheel",
                    "dp",
                    best,
                    best,
                    np.nan,
                    np.empty(0),
                    nothing,
                    nothing[:, :1],
                    nothing,
                    wall=clock.perf_counter() - began,
                    certificate=Certificate(mesh_error=(sorted(meshes)[1] - best) / best),
                )
            )
    return found


def _ball_problem(angle: float, rate: float, low: float, high: float) -> Problem:
    return Problem(
        name="ball-and-wheel",
        dynamics=lambda x, u, mode: [x[1], u[0]],
        running_cost=lambda x, u, mode: 1.0,
        start=(angle, rate),
        target=(0.0, 0.0),
        duration=None,
        control_low=(low,),
        control_high=(high,),
        scale=(max(abs(angle), 1e-3), 1.0),
    )


def _synthesised(angle: float, rate: float, low: float, high: float) -> Solution:
    """The closed form, sampled."""
    began = clock.perf_counter()
    answer = ball_and_wheel.time_optimal(angle, rate, low, high)
    t = np.linspace(0.0, answer.duration, 201)
    first = np.minimum(t, answer.switch)
    later = np.maximum(t - answer.switch, 0.0)
    rate_at = rate + answer.first * first + answer.last * later
    at_switch = rate + answer.first * first
    angle_at = angle + rate * first + 0.5 * answer.first * first**2 + at_switch * later + 0.5 * answer.last * later**2
    control = np.where(t < answer.switch, answer.first, answer.last)[:, None]
    costate = np.stack([np.full_like(t, answer.costate[0]), answer.costate[1] - answer.costate[0] * t], axis=1)
    state = np.stack([angle_at, rate_at], axis=1)
    problem = _ball_problem(angle, rate, low, high)
    certificate = problem.certify(state, control, costate, np.zeros(len(t), np.int64))
    solution = Solution(
        "ball-and-wheel",
        "indirect",
        answer.duration,
        answer.duration,
        np.nan,
        t,
        state,
        control,
        costate,
        wall=clock.perf_counter() - began,
        certificate=certificate,
        notes={"switch_s": answer.switch},
    )
    return acceleration.judge(solution, drift=1e-9, gap=1e-9)


def _ball_direct(angle: float, rate: float, low: float, high: float) -> Solution:
    """IPOPT with two phases of free duration, controls free."""
    problem = _ball_problem(angle, rate, low, high)
    guess = [np.array([0.5 * angle, -abs(high) * 0.05]), np.array([0.0, 0.0])]
    answer = solve_phases(problem, (0, 0), intervals=10, guess=guess, guess_duration=0.2)
    if answer is None:
        return acceleration.failed("ball-and-wheel", "direct", "IPOPT found no answer")
    state, control, costate, mode = answer.middles()
    return Solution(
        "ball-and-wheel",
        "direct",
        answer.cost,
        float(answer.time[-1]),
        np.nan,
        answer.time,
        answer.state,
        answer.control,
        answer.costate,
        wall=answer.wall,
        certificate=problem.certify(state, control, costate, mode),
    )


def lqr(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """Linear quadratic: close a 10 m gap error at a closing speed of -2 m/s; J is the quadratic cost."""
    a, b = np.array([[0.0, 1.0], [0.0, -0.05]]), np.array([[0.0], [1.0]])
    q, r = np.diag([0.1, 1.0]), np.array([[4.0]])
    start, horizon = np.array([10.0, -2.0]), 60.0
    found = []
    for method in methods:
        began = clock.perf_counter()
        if method == "indirect":
            s, gain = linear_quadratic.continuous_regulator(a, b, q, r)
            t = np.linspace(0.0, horizon, 601)
            step = linear_quadratic.expm((a - b @ gain) * (t[1] - t[0]))
            state = [start]
            for _ in t[1:]:
                state.append(step @ state[-1])
            x = np.array(state)
            found.append(
                Solution(
                    "lqr",
                    method,
                    float(0.5 * start @ s @ start),
                    horizon,
                    np.nan,
                    t,
                    x,
                    -x @ gain.T,
                    -x @ s,
                    wall=clock.perf_counter() - began,
                    certificate=_regulator_problem(a, b, q, r, start, horizon).certify(
                        x[::20], (-x @ gain.T)[::20], (-x @ s)[::20], np.zeros(len(x[::20]), np.int64), samples=401
                    ),
                )
            )
        elif method == "direct":
            problem = _regulator_problem(a, b, q, r, start, horizon)
            answer = solve_phases(problem, (0, 0), intervals=60, guess_durations=(0.3, 0.7), guess_control=(0.0,))
            if answer is None:
                found.append(acceleration.failed("lqr", method, "IPOPT found no answer"))
                continue
            middles = answer.middles()
            found.append(
                Solution(
                    "lqr",
                    method,
                    answer.cost,
                    horizon,
                    np.nan,
                    answer.time,
                    answer.state,
                    answer.control,
                    answer.costate,
                    wall=answer.wall,
                    certificate=problem.certify(*middles, samples=401),
                )
            )
        else:
            costs = []
            for dt in (0.02, 0.01):
                flow = linear_quadratic.expm(np.block([[a, b], [np.zeros((1, 3))]]) * dt)
                s, _ = linear_quadratic.discrete_regulator(flow[:2, :2], flow[:2, 2:], q * dt, r * dt)
                costs.append(float(0.5 * start @ s @ start))
            nothing = np.empty((0, 2))
            found.append(
                Solution(
                    "lqr",
                    method,
                    2.0 * costs[1] - costs[0],
                    horizon,
                    np.nan,
                    np.empty(0),
                    nothing,
                    nothing[:, :1],
                    nothing,
                    wall=clock.perf_counter() - began,
                    certificate=Certificate(mesh_error=abs(costs[0] - costs[1]) / costs[1]),
                )
            )
    return found


def _regulator_problem(a, b, q, r, start, horizon: float) -> Problem:
    return Problem(
        name="lqr",
        dynamics=lambda x, u, mode: [x[1], a[1, 1] * x[1] + u[0]],
        running_cost=lambda x, u, mode: 0.5 * (q[0, 0] * x[0] ** 2 + q[1, 1] * x[1] ** 2 + r[0, 0] * u[0] ** 2),
        start=tuple(start),
        target=(None, None),
        duration=horizon,
        control_low=(-10.0,),
        control_high=(10.0,),
        scale=(10.0, 2.0),
    )


CASES: dict[str, Callable[[tuple[str, ...], Car | None], list[Solution]]] = {
    "cvt-free": cvt_free,
    "cvt-distance": cvt_distance,
    "cvt-corner": cvt_corner,
    "six-speed-free": six_speed_free,
    "six-speed-fixed": six_speed_fixed,
    "six-speed-limit": six_speed_limit,
    "soft-vs-pontryagin": soft_vs_pontryagin,
    "ball-and-wheel": ball_and_wheel_case,
    "route": route,
    "lqr": lqr,
}
"""Name -> solver; the first line of its docstring is what `solve --list` shows."""
