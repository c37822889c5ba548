"""Cases with known answers: the ball and wheel of appendix G, and a linear system with a quadratic cost."""

import time as clock

import casadi as ca
import numpy as np

from controller import ball_and_wheel, linear_quadratic
from controller.direct import solve_phases
from controller.problem import Problem
from controller.solution import Certificate, Solution, failed
from vehicle_model.car.parameters import Car


def ball_and_wheel_case(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """Appendix G: the ball back to the top in least time, from 0.05 rad at rest. J in seconds.

    The note `lie_rank` is that of the drift, the control field and their bracket (B.2): 2, so it can be controlled.
    """
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
            error = (sorted(meshes)[1] - best) / best
            found.append(_value_alone("ball-and-wheel", "dp", best, best, error, began))
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
        notes={"switch_s": answer.switch, "lie_rank": float(_ball_rank(angle, rate))},
    )
    return solution


def _ball_rank(angle: float, rate: float) -> int:
    """Rank of the control field and its bracket with the drift (B.2), of the linearised ball and wheel."""
    return linear_quadratic.lie_rank(lambda x: ca.vertcat(x[1], 0), [lambda x: ca.SX([0.0, 1.0])], [angle, rate])


def _ball_direct(angle: float, rate: float, low: float, high: float) -> Solution:
    """IPOPT with two phases of free duration, controls free."""
    problem = _ball_problem(angle, rate, low, high)
    guess = [np.array([0.5 * angle, -abs(high) * 0.05]), np.array([0.0, 0.0])]
    answer = solve_phases(problem, (0, 0), intervals=10, guess=guess, guess_duration=0.2)
    if answer is None:
        return failed("ball-and-wheel", "direct", "IPOPT found no answer")
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
    """Linear quadratic: close a 10 m gap error at a closing speed of -2 m/s; J is the quadratic cost.

    The note `kalman_rank` is that of (B, AB) (B.1): 2, so it can be controlled.
    """
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
                    notes={"kalman_rank": float(linear_quadratic.kalman_rank(a, b))},
                )
            )
        elif method == "direct":
            problem = _regulator_problem(a, b, q, r, start, horizon)
            answer = solve_phases(problem, (0, 0), intervals=60, guess_durations=(0.3, 0.7), guess_control=(0.0,))
            if answer is None:
                found.append(failed("lqr", method, "IPOPT found no answer"))
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
            error = abs(costs[0] - costs[1]) / costs[1]
            found.append(_value_alone("lqr", method, 2.0 * costs[1] - costs[0], horizon, error, began))
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


def _value_alone(case: str, method: str, cost: float, duration: float, error: float, began: float) -> Solution:
    """A method that finds what it costs, to a mesh's `error`, but no trajectory. `began`: its clock, s."""
    none = np.empty((0, 2))
    return Solution(
        case,
        method,
        cost,
        duration,
        np.nan,
        np.empty(0),
        none,
        none[:, :1],
        none,
        wall=clock.perf_counter() - began,
        certificate=Certificate(mesh_error=error),
    )
