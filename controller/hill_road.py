"""A road with slopes solved three ways: Pontryagin's boundary value problem, IPOPT, and the route planner's own DP.

One gear and a smooth engine, P_in = w (f + T/e + c T^2), so that each method may show what it can: over distance s,
    dE/ds = (T N - R)/M_eff,  L = P_in/v + W/v = N (f + T/e + c T^2) + W/v
    H = lambda_E dE/ds - L,   T = (lambda_E / M_eff - 1/e) / (2 c),   d lambda_E/ds = -dH/dE
lambda_E in J per m2/s2; lambda_v = v lambda_E.
"""

import time as clock
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from controller.advice import RoadAhead
from controller.route import Comfort, plan_route
from controller.solution import Certificate, Solution
from observer.efficiency_map import FuelMap
from vehicle_model.car.parameters import Car, Engine, Injector


@dataclass(frozen=True)
class HillRoad:
    """The problem; SI units."""

    length: float = 4000.0
    grade: float = 0.025
    """Amplitude of the sinusoidal slope, rad."""
    wave: float = 2000.0
    """m."""
    speed: float = 22.0
    """At both ends, m/s."""
    time_value: float = 25_000.0
    """W, J/s."""
    ratio: float = 3.23 / 0.2954
    """N, 1/m."""
    mass: float = 920.0
    accelerated_mass: float = 948.0
    engine_inertia: float = 0.061
    rolling_resistance: float = 0.0125
    drag_area: float = 0.39 * 1.93
    air_density: float = 1.2
    gravity: float = 9.805
    friction: float = 12.0
    """f, N m of fuel per rad."""
    efficiency: float = 0.45
    """e."""
    curvature: float = 0.006
    """c, 1/(N m)."""

    @property
    def effective_mass(self) -> float:
        """M_eff."""
        return self.accelerated_mass + self.engine_inertia * self.ratio**2

    def road_load(self, s, energy, sin=np.sin, cos=np.cos):
        """R(s, E), N."""
        theta = self.grade * sin(2.0 * np.pi * s / self.wave)
        weight = self.mass * self.gravity
        return weight * (sin(theta) + self.rolling_resistance * cos(theta)) + self.air_density * self.drag_area * energy

    def fuel_per_metre(self, torque):
        """P_in / v, J/m."""
        return self.ratio * (self.friction + torque / self.efficiency + self.curvature * torque**2)


def indirect(problem: HillRoad) -> Solution:
    """Pontryagin's boundary value problem in (E, lambda_E) over s, by collocation with error control (scipy)."""
    began = clock.perf_counter()
    m, n = problem.effective_mass, problem.ratio

    def torque(worth: NDArray) -> NDArray:
        return (worth / m - 1.0 / problem.efficiency) / (2.0 * problem.curvature)

    def rates(s: NDArray, z: NDArray) -> NDArray:
        energy, worth = z
        energy = np.maximum(energy, 1.0)
        de = (torque(worth) * n - problem.road_load(s, energy)) / m
        dworth = worth * problem.air_density * problem.drag_area / m - problem.time_value * (2.0 * energy) ** -1.5
        return np.stack([de, dworth])

    goal = 0.5 * problem.speed**2
    s = np.linspace(0.0, problem.length, 401)
    guess = np.stack([np.full_like(s, goal), np.full_like(s, m * (1.0 / problem.efficiency + 0.5))])
    answer = solve_bvp(rates, lambda a, b: np.array([a[0] - goal, b[0] - goal]), s, guess, tol=1e-9, max_nodes=20_000)
    energy, worth = answer.sol(s)
    speed, t = np.sqrt(2.0 * energy), torque(worth)
    cost = float(np.trapezoid(problem.fuel_per_metre(t) + problem.time_value / speed, s))
    time = np.concatenate([[0.0], np.cumsum(np.diff(s) * 2.0 / (speed[1:] + speed[:-1]))])
    grid = np.linspace(0.0, 120.0, 241)[:, None]
    load = problem.road_load(s, energy)
    own = worth * (t * n - load) / m - problem.fuel_per_metre(t)
    other = worth * (grid * n - load) / m - problem.fuel_per_metre(grid)
    running = problem.fuel_per_metre(t)
    certificate = Certificate(
        hamiltonian_drift=None,  # the slope makes H depend on s: it need not be constant
        maximum_gap=float(np.max(other.max(axis=0) - own)) / float(running.mean()),
        bound_distance=float(t.min()) / 120.0,
        mesh_error=float(np.max(answer.rms_residuals)),
    )
    solution = _solution("indirect", cost, s, speed, t, worth * speed, time, clock.perf_counter() - began, certificate)
    return solution if answer.success else solution.refuse(answer.message)


def direct(problem: HillRoad, *, intervals: int = 200) -> Solution:
    """The same by IPOPT: E at the nodes, T on the intervals, implicit midpoint rule."""
    began = clock.perf_counter()
    ds = problem.length / intervals
    goal = 0.5 * problem.speed**2
    energy, torque = ca.MX.sym("E", intervals + 1), ca.MX.sym("T", intervals)
    s = (np.arange(intervals) + 0.5) * ds
    middle = 0.5 * (energy[1:] + energy[:-1])
    load = problem.road_load(ca.DM(s), middle, ca.sin, ca.cos)
    defect = (energy[1:] - energy[:-1]) - ds * (torque * problem.ratio - load) / problem.effective_mass
    cost = ca.sum1(problem.fuel_per_metre(torque) + problem.time_value / ca.sqrt(2.0 * middle)) * ds
    nlp = {"x": ca.vertcat(energy, torque), "f": cost * 1e-6, "g": ca.vertcat(defect, energy[0], energy[-1])}
    solver = ca.nlpsol("hill", "ipopt", nlp, {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"})
    zeros = [0.0] * intervals
    answer = solver(
        x0=[goal] * (intervals + 1) + [30.0] * intervals,
        lbx=[10.0] * (intervals + 1) + zeros,
        ubx=[2000.0] * (intervals + 1) + [120.0] * intervals,
        lbg=[*zeros, goal, goal],
        ubg=[*zeros, goal, goal],
    )
    x = np.asarray(answer["x"]).ravel()
    speed, t = np.sqrt(2.0 * x[: intervals + 1]), x[intervals + 1 :]
    worth = np.append(np.asarray(answer["lam_g"]).ravel()[:intervals] * 1e6, np.nan)
    time = np.concatenate([[0.0], np.cumsum(ds * 2.0 / (speed[1:] + speed[:-1]))])
    place = np.linspace(0.0, problem.length, intervals + 1)
    # the multiplier of the step from k to k + 1 is lambda_E in its middle
    other = np.linspace(0.0, 120.0, 241)[:, None]
    price = worth[:-1] / problem.effective_mass
    gain = price * other * problem.ratio - problem.fuel_per_metre(other)
    gap = gain.max(axis=0) - (price * t * problem.ratio - problem.fuel_per_metre(t))
    certificate = Certificate(maximum_gap=float(gap.max() / problem.fuel_per_metre(t).mean()))
    solution = _solution(
        "direct", float(answer["f"]) * 1e6, place, speed, np.append(t, t[-1]), worth * speed, time,
        clock.perf_counter() - began, certificate,
    )  # fmt: skip
    return solution if solver.stats()["success"] else solution.refuse("IPOPT did not converge")


def dynamic_programming(problem: HillRoad, *, step: float = 20.0, nodes: int = 400) -> Solution:
    """The same by the route planner, handed a car with this one gear and this engine's map."""
    began = clock.perf_counter()
    car, fuel_map = car_and_map(problem)
    s = np.linspace(0.0, problem.length, 801)
    road = RoadAhead(s, problem.grade * np.sin(2.0 * np.pi * s / problem.wave), np.full_like(s, 40.0), np.zeros_like(s))
    costs, advice = [], None
    for refined in (2.0, 1.0):
        advice = plan_route(
            road, fuel_map, car, start_speed=problem.speed, end_speed=problem.speed, time_value=problem.time_value,
            comfort=replace(Comfort(), shift_energy=0.0, restart_energy=0.0), step=step * refined,
            nodes=round(nodes / refined),
        )  # fmt: skip
        costs.append(advice.trip_fuel + problem.time_value * advice.trip_time)
    assert advice is not None
    certificate = Certificate(
        mesh_error=abs(costs[0] - costs[1]) / costs[1],
        maximum_gap=advice.certificate["maximum_gap"],
        hull_gain=advice.certificate["hull_gain"],
    )
    return _solution(
        "dp", costs[1], advice.s, advice.speed, advice.torque, advice.costate, advice.time,
        clock.perf_counter() - began, certificate,
    )  # fmt: skip


def car_and_map(problem: HillRoad) -> tuple[Car, FuelMap]:
    """The route planner's view of `problem`: a one-gear car and a tabulated fuel map."""
    radius = 0.2954
    inertia = (problem.accelerated_mass - problem.mass) * radius**2 / 4.0
    engine = Engine(700e-6, 3, 9.0, 60e3, 550.0, 110.0, 470.0, 40.0, 650.0, problem.engine_inertia, True)
    car = Car(
        "one gear", problem.mass - 76.0, problem.drag_area, 1.0, problem.rolling_resistance, radius, inertia,
        (problem.ratio * radius,), 0.27, engine, Injector(8e-6, 0.0, "sequential"),
        air_density=problem.air_density, gravity=problem.gravity,
    )  # fmt: skip
    speed, torque = np.linspace(40.0, 650.0, 62), np.linspace(0.0, 120.0, 121)
    power = speed[:, None] * problem.fuel_per_metre(torque)[None, :] / problem.ratio
    flat = np.ones_like(speed)
    return car, FuelMap(speed, torque, power, 120.0 * flat, -12.0 * flat, float(power[0, 0]), 40.0)


def _solution(method, cost, s, speed, torque, costate, time, wall, certificate) -> Solution:
    return Solution(
        case="route",
        method=method,
        cost=cost,
        duration=float(time[-1]),
        distance=float(s[-1] - s[0]),
        time=time,
        state=np.stack([s, speed], axis=1),
        control=np.asarray(torque)[:, None],
        costate=np.stack([np.full(len(s), np.nan), costate], axis=1),
        wall=wall,
        certificate=certificate,
    )
