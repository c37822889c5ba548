"""Direct methods (B.3.2): the problem as a non-linear programme for IPOPT, gears as a given sequence of phases.

Relaxed (fractional) gears converge badly or to answers that cannot be driven (ERRATA); so the sequences are enumerated
and each phase has its own duration, which may be zero. Three transcriptions: "single" shooting (the states are
functions of the controls), "multiple" shooting and "collocation" (Radau, degree 3). Costates come from the multipliers
of the continuity conditions: perturbing x_{k+1} = F(x_k) by d costs dV/dx d, so that lambda_{k+1} is the multiplier.
"""

import itertools
import time as clock
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from controller.problem import Problem
from vehicle_model.car.errors import BadInput


@dataclass(frozen=True)
class DirectAnswer:
    """Nodes of all phases in order. `mode` (n,) is that of the interval that begins at the node."""

    cost: float
    time: NDArray[np.float64]
    state: NDArray[np.float64]
    control: NDArray[np.float64]
    costate: NDArray[np.float64]
    mode: NDArray[np.int64]
    wall: float

    def middles(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        """State, control, costate and mode in the middle of each interval, where a constant control belongs."""
        known = ~np.isnan(self.costate[:-1, 0]) & ~np.isnan(self.costate[1:, 0]) & (np.diff(self.time) > 1e-9)
        keep = np.flatnonzero(known)
        state = 0.5 * (self.state[keep] + self.state[keep + 1])
        costate = 0.5 * (self.costate[keep] + self.costate[keep + 1])
        return state, self.control[keep], costate, self.mode[keep]


def solve_phases(
    problem: Problem,
    sequence: Sequence[int],
    *,
    intervals: int = 12,
    transcription: str = "collocation",
    guess_duration: float = 10.0,
    guess: Sequence[NDArray[np.float64]] | None = None,
    guess_control: Sequence[float] | None = None,
    guess_durations: Sequence[float] | None = None,
    shortest: float = 0.0,
) -> DirectAnswer | None:
    """Solve `problem` with the modes of `sequence`, one phase each of `intervals` steps; None if IPOPT finds no answer.

    `guess_duration` s is the first guess of the whole, `guess_durations` the phases' shares of it; `guess` the states
    at the phases' ends. `shortest` s keeps phases from vanishing: a phase of no length is a trap (a stationary point).
    Raises BadInput for an unknown transcription.
    """
    if transcription not in ("single", "multiple", "collocation"):
        raise BadInput("direct method", transcription, "single, multiple or collocation")
    began = clock.perf_counter()
    nx, phases = len(problem.start), len(sequence)
    scale = np.asarray(problem.scale)
    variables, first, low, high = [], [], [], []
    constraints, c_low, c_high = [], [], []
    continuity: list[tuple[int, int]] = []  # (place in the constraint vector, node)

    def variable(name: str, value, lower, upper) -> ca.MX:
        symbol = ca.MX.sym(name, len(value))
        variables.append(symbol)
        first.extend(value)
        low.extend(lower)
        high.extend(upper)
        return symbol

    def require(expression, lower: float, upper: float) -> None:
        size = expression.numel() if isinstance(expression, ca.MX) else 1
        constraints.append(expression)
        c_low.extend([lower] * size)
        c_high.extend([upper] * size)

    span = guess_duration if problem.duration is None else problem.duration
    shares = guess_durations or [1.0 / phases] * phases
    durations = variable("h", [span * share for share in shares], [shortest] * phases, [20.0 * span] * phases)
    ends = _guess_states(problem, phases) if guess is None else [np.asarray(problem.start), *guess]
    middle = [0.5 * (a + b) for a, b in zip(problem.control_low, problem.control_high, strict=True)]
    middle = list(guess_control) if guess_control is not None else middle

    functions = {m: _mode_functions(problem, m) for m in set(sequence)}
    states, controls, modes, dts = [], [], [], []
    x = variable("x0", list(np.asarray(problem.start) / scale), [-ca.inf] * nx, [ca.inf] * nx)
    require(x - np.asarray(problem.start) / scale, 0.0, 0.0)
    continuity.append((0, 0))
    rows = nx
    cost = ca.MX(0.0)
    for p, mode in enumerate(sequence):
        rate, allowed = functions[mode]
        dt = durations[p] / intervals
        for k in range(intervals):
            u = variable(f"u{p}_{k}", middle, problem.control_low, problem.control_high)
            states.append(x * scale)
            controls.append(u)
            modes.append(mode)
            dts.append(dt)
            share = (k + 1) / intervals
            expected = (ends[p] + share * (ends[p + 1] - ends[p])) / scale
            if transcription == "collocation":
                end, gained, extra = _collocate(rate, x, u, dt, scale, variable, expected, f"{p}_{k}", allowed)
                for item, lower, upper in extra:
                    require(item, lower, upper)
                    rows += item.numel()
            else:
                end, gained = _runge_kutta(rate, x, u, dt, scale, SUBSTEPS)
            cost = cost + gained
            if transcription == "single":
                x = end
            else:
                x = variable(f"x{p}_{k}", list(expected), [-ca.inf] * nx, [ca.inf] * nx)
                require(x - end, 0.0, 0.0)
                continuity.append((rows, len(states)))
                rows += nx
            limits = allowed(states[-1])
            if limits.numel():
                require(limits, 0.0, ca.inf)
                rows += limits.numel()
                require(allowed(x * scale), 0.0, ca.inf)
                rows += limits.numel()
    for i, wanted in enumerate(problem.target):
        if wanted is not None:
            require(x[i] - wanted / scale[i], 0.0, 0.0)
            rows += 1
    if problem.duration is not None:
        require(ca.sum1(durations) - problem.duration, 0.0, 0.0)
    cost = cost + problem.terminal_cost([x[i] * scale[i] for i in range(nx)])
    points = ca.horzcat(*states, x * scale)

    cost_scale = 1.0 / max(problem_cost_scale(problem), 1e-9)
    nlp = {"x": ca.vertcat(*variables), "f": cost * cost_scale, "g": ca.vertcat(*constraints)}
    options: dict[str, Any] = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"}
    options |= {"ipopt.tol": 1e-9, "ipopt.max_iter": 600}
    solver = ca.nlpsol("solver", "ipopt", nlp, options)
    answer = solver(x0=first, lbx=low, ubx=high, lbg=c_low, ubg=c_high)
    if not solver.stats()["success"]:
        return None
    unpack = ca.Function("unpack", [nlp["x"]], [points, ca.horzcat(*controls), ca.vertcat(*dts)])
    state, control, steps = (np.asarray(part) for part in unpack(answer["x"]))
    multipliers = np.asarray(answer["lam_g"]).ravel() / cost_scale
    costate = np.full((len(states) + 1, nx), np.nan)
    for place, node in continuity:
        costate[node] = multipliers[place : place + nx] / scale
    if transcription == "single":
        _propagate(costate, functions, state.T, control.T, steps.ravel(), modes)
    return DirectAnswer(
        cost=float(answer["f"]) / cost_scale,
        time=np.concatenate([[0.0], np.cumsum(steps.ravel())]),
        state=state.T,
        control=np.vstack([control.T, control.T[-1:]]),
        costate=costate,
        mode=np.append(np.asarray(modes), modes[-1]),
        wall=clock.perf_counter() - began,
    )


def best_sequence(problem: Problem, sequences: Iterable[Sequence[int]], **settings) -> DirectAnswer | None:
    """Solve every sequence of modes, keep the cheapest; `wall` is that of the whole search."""
    began = clock.perf_counter()
    best: DirectAnswer | None = None
    for sequence in sequences:
        answer = solve_phases(problem, sequence, **settings)
        if answer is not None and (best is None or answer.cost < best.cost):
            best = answer
    if best is None:
        return None
    return DirectAnswer(
        best.cost, best.time, best.state, best.control, best.costate, best.mode, clock.perf_counter() - began
    )


def rising_sequences(modes: Sequence[int], longest: int) -> list[tuple[int, ...]]:
    """All runs of consecutive modes (1, 2, 3), (2, 3), ... up to `longest`: phases may shrink to nothing in between."""
    return [tuple(modes[i:j]) for i, j in itertools.combinations(range(len(modes) + 1), 2) if j - i <= longest]


def problem_cost_scale(problem: Problem) -> float:
    """A typical J: the running cost in the middle of the control set over the expected duration."""
    u = [0.5 * (a + b) for a, b in zip(problem.control_low, problem.control_high, strict=True)]
    x = [s if s else 1.0 for s in problem.start]
    return abs(float(problem.running_cost(x, u, problem.modes[0]))) * (problem.duration or 10.0) or 1.0


def _mode_functions(problem: Problem, mode: int):
    """CasADi functions of one mode: (x, u) -> (f, L), and x -> path constraints."""
    x, u = ca.MX.sym("x", len(problem.start)), ca.MX.sym("u", len(problem.control_low))
    xs, us = ca.vertsplit(x), ca.vertsplit(u)
    rate = ca.Function(
        "rate", [x, u], [ca.vertcat(*problem.dynamics(xs, us, mode)), ca.MX(problem.running_cost(xs, us, mode))]
    )
    limits = ca.vertcat(*problem.allowed(xs, mode)) if problem.allowed(xs, mode) else ca.MX(0, 1)
    return rate, ca.Function("limits", [x], [limits])


def _guess_states(problem: Problem, phases: int) -> list[NDArray[np.float64]]:
    """Straight line from start to target at the ends of the phases."""
    start = np.asarray(problem.start)
    end = np.array([s if t is None else t for s, t in zip(problem.start, problem.target, strict=True)])
    return [start + p / phases * (end - start) for p in range(phases + 1)]


def _runge_kutta(rate, x, u, dt, scale, substeps: int):
    """Classical Runge-Kutta over one interval of scaled states: (end, cost gained)."""
    gained = ca.MX(0.0)
    h = dt / substeps
    for _ in range(substeps):
        k1, l1 = rate(x * scale, u)
        k2, l2 = rate((x + 0.5 * h * k1 / scale) * scale, u)
        k3, l3 = rate((x + 0.5 * h * k2 / scale) * scale, u)
        k4, l4 = rate((x + h * k3 / scale) * scale, u)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / scale
        gained = gained + h / 6.0 * (l1 + 2.0 * l2 + 2.0 * l3 + l4)
    return x, gained


SUBSTEPS = 6
"""Runge-Kutta steps of one interval of a shooting method."""


def _propagate(
    costate: NDArray[np.float64],
    functions: Mapping[int, tuple[ca.Function, ca.Function]],
    state: NDArray[np.float64],
    control: NDArray[np.float64],
    steps: NDArray[np.float64],
    modes: Sequence[int],
) -> None:
    """Fill `costate` (n + 1, nx) from its first row, the multiplier of the start, by the discrete adjoint.

    Single shooting has no continuity conditions. V_k(x) = l(x, u) + V_{k+1}(F(x, u)) and lambda = -dV/dx give
    lambda_{k+1} = (dF/dx)^-T (lambda_k + dl/dx), where no path constraint is active.
    """
    nx = state.shape[1]
    x, u, dt = ca.MX.sym("x", nx), ca.MX.sym("u", control.shape[1]), ca.MX.sym("dt")
    slopes = {}
    for mode, (rate, _) in functions.items():
        end, gained = _runge_kutta(rate, x, u, dt, np.ones(nx), SUBSTEPS)
        slopes[mode] = ca.Function("slopes", [x, u, dt], [ca.jacobian(end, x), ca.gradient(gained, x)])
    for k, mode in enumerate(modes):
        over_x, cost_x = (np.asarray(part) for part in slopes[mode](state[k], control[k], steps[k]))
        costate[k + 1] = np.linalg.solve(over_x.T, costate[k] + cost_x.ravel())


RADAU = np.array([0.15505102572168222, 0.6449489742783178, 1.0])
"""Collocation points of degree 3."""


def _collocate(rate, x, u, dt, scale, variable, expected, tag, allowed):
    """Radau collocation over one interval of scaled states: (end, cost gained, constraints)."""
    taus = np.concatenate([[0.0], RADAU])
    derivative, weight = _lagrange(taus)
    inner = [variable(f"c{tag}_{j}", list(expected), [-ca.inf] * len(scale), [ca.inf] * len(scale)) for j in range(3)]
    nodes = [x, *inner]
    extra, gained = [], ca.MX(0.0)
    for j in range(3):
        slope = sum(derivative[r][j] * nodes[r] for r in range(4))
        f, running = rate(inner[j] * scale, u)
        extra.append((slope - dt * f / scale, 0.0, 0.0))
        gained = gained + weight[j] * dt * running
    return inner[2], gained, extra


def _lagrange(taus: NDArray[np.float64]):
    """Derivatives of the Lagrange basis at the collocation points, and Radau's quadrature weights."""
    basis = [np.poly1d([1.0]) for _ in taus]
    for r, t in enumerate(taus):
        for s, other in enumerate(taus):
            if s != r:
                basis[r] = basis[r] * np.poly1d([1.0, -other]) / (t - other)
    derivative = [[float(np.polyder(b)(t)) for t in taus[1:]] for b in basis]
    radau = [np.poly1d([1.0]) for _ in RADAU]
    for r, t in enumerate(RADAU):
        for s, other in enumerate(RADAU):
            if s != r:
                radau[r] = radau[r] * np.poly1d([1.0, -other]) / (t - other)
    weight = [float(np.polyint(b)(1.0)) for b in radau]
    return derivative, weight
