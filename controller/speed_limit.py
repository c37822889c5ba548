"""A speed limit as a limit on the state (B.2.5.3): the boundary arc by the constrained principle, and by penalty.

From one speed to another over a given distance of level road, six gears, a second worth W, v <= v_max. The place x does
not enter: lambda_x is constant, and with free time H = 0 all along,
    H = lambda_v (F - R)/M_a + lambda_x v - P_in - W = 0.
On the limit F = R, so that lambda_x = (P_hold(v_max) + W)/v_max: what a metre costs there. With it the extremal is
pointwise, without any shooting. Below the limit, towards it (least) and away from it (greatest, F < R),
    lambda_v = M_a (P_in + W - lambda_x v)/(F - R),
which for P_in = w (f + T/e + c T^2) has its optimum at
    T = R/N +- sqrt((P_in(R/N) + W - lambda_x v)/(w c)),
gear by gear, in closed form: the root vanishes on the limit, which is entered and left tangentially, lambda_v being
continuous. On the limit d lambda_v/dt = -dH/dv + eta with eta = dH/dv >= 0; where eta < 0 the car would rather be
slower, and the limit does not bind. The thesis' map of table 4.1 has no such arc below 160 km/h: at less load it is not
convex over torque and rewards pulse and glide; so the engine here is `hill_road`'s.
"""

import time as clock
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from controller.advice import RoadAhead
from controller.controller_model import RPM
from controller.direct import solve_phases
from controller.problem import Problem
from controller.route import plan_route
from controller.route_problem import Comfort
from controller.solution import Certificate, Shift, Solution
from observer.efficiency_map import FuelMap
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car, Engine, Injector

Array = NDArray[np.float64]
NODES = 4000
"""Nodes of each branch, even in the root of the speed missing to the limit."""


@dataclass(frozen=True)
class LimitedRoad:
    """The problem; SI units."""

    distance: float = 1500.0
    start_speed: float = 10.0
    end_speed: float = 50.0 / 3.6
    limit: float = 70.0 / 3.6
    time_value: float = 30_000.0
    """W, J/s."""
    ratios: tuple[float, ...] = tuple(r / 0.2954 for r in (13.25, 9.604, 7.37, 5.796, 4.208, 3.23))
    mass: float = 920.0
    accelerated_mass: float = 948.0
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
    engine_speed: tuple[float, float] = (850.0 * RPM, 6000.0 * RPM)
    torque_max: float = 110.0

    @property
    def torque_min(self) -> float:
        """Overrun: where no fuel is left, N m."""
        root = np.sqrt(self.efficiency**-2 - 4.0 * self.curvature * self.friction)
        return float((root - 1.0 / self.efficiency) / (2.0 * self.curvature))

    def road_load(self, speed):
        """R(v), N."""
        rolling = self.mass * self.gravity * self.rolling_resistance
        return rolling + 0.5 * self.air_density * self.drag_area * speed**2

    def fuel_power(self, engine_speed, torque):
        """P_in, W."""
        return engine_speed * (self.friction + torque / self.efficiency + self.curvature * torque**2)

    def usable(self, ratio, speed):
        """Whether the engine may turn so fast."""
        low, high = self.engine_speed
        return (ratio * speed >= low) & (ratio * speed <= high)


def hold(road: LimitedRoad, speed: float) -> tuple[float, int]:
    """Least fuel power that holds `speed` m/s, W, and its gear. Raises BadInput where no gear does."""
    load, best = float(road.road_load(speed)), (np.inf, 0)
    for gear, n in enumerate(road.ratios, start=1):
        if road.usable(n, speed) and load / n <= road.torque_max:
            best = min(best, (float(road.fuel_power(n * speed, load / n)), gear))
    if not best[1]:
        raise BadInput("speed limit", f"{speed:.2f} m/s", "a speed that some gear can hold")
    return best


def branch(road: LimitedRoad, speed: Array, worth: float, *, faster: bool) -> tuple[Array, Array, Array]:
    """Synthesis below the limit at `speed` (n,): lambda_v, gear, T, towards it (`faster`) or away from it.

    `worth` is lambda_x. lambda_v is infinite, of either sign, where no gear can do it.
    """
    load, sign = road.road_load(speed), 1.0 if faster else -1.0
    best, gears, torques = np.full(len(speed), np.inf), np.zeros(len(speed)), np.zeros(len(speed))
    for gear, n in enumerate(road.ratios, start=1):
        w = n * speed
        spare = np.maximum(road.fuel_power(w, load / n) + road.time_value - worth * speed, 0.0)
        torque = load / n + sign * np.sqrt(spare / (w * road.curvature))
        torque = np.clip(torque, road.torque_min, road.torque_max)
        surplus = n * torque - load
        cost = road.fuel_power(w, torque) + road.time_value - worth * speed
        moving = sign * surplus > 1e-9
        value = np.where(moving, road.accelerated_mass * cost / np.where(moving, surplus, 1.0), sign * np.inf)
        better = road.usable(n, speed) & (sign * value < best)
        best, gears, torques = (
            np.where(better, sign * value, best), np.where(better, gear, gears), np.where(better, torque, torques)
        )  # fmt: skip
    return sign * best, gears, torques


def indirect(road: LimitedRoad) -> Solution:
    """The constrained principle. Notes: lambda_x, eta, the share of time on the limit.

    Raises BadInput where the limit does not bind or is not reached, naming the nearest feasible value.
    """
    began = clock.perf_counter()
    power, gear = hold(road, road.limit)
    worth = (power + road.time_value) / road.limit
    n = road.ratios[gear - 1]
    held = float(road.road_load(road.limit)) / n
    marginal = n * road.limit * (1.0 / road.efficiency + 2.0 * road.curvature * held)
    costate = road.accelerated_mass * marginal / n
    drag = road.air_density * road.drag_area * road.limit
    eta = worth - costate / road.accelerated_mass * drag - float(road.fuel_power(n, held))
    if eta < 0.0:
        raise BadInput("speed limit", f"{road.limit:.2f} m/s", f"nearest that binds is {_freely(road):.2f} m/s")
    for name, speed in (("start speed", road.start_speed), ("end speed", road.end_speed)):
        if not 0.0 < speed < road.limit:
            raise BadInput(name, f"{speed:.2f} m/s", f"nearest feasible is just below {road.limit:.2f} m/s")
    up = _leg(road, road.start_speed, worth, faster=True)
    down = _leg(road, road.end_speed, worth, faster=False)
    rest = road.distance - up["x"][-1] - down["x"][-1]
    if rest < 0.0:
        raise BadInput("distance", f"{road.distance:.0f} m", f"nearest feasible is {road.distance - rest:.0f} m")
    seconds, m = rest / road.limit, 101
    flat = {
        "t": np.linspace(0.0, seconds, m), "x": np.linspace(0.0, rest, m), "v": np.full(m, road.limit),
        "lambda": np.full(m, costate), "gear": np.full(m, float(gear)), "T": np.full(m, held),
    }  # fmt: skip
    rows = {key: np.concatenate([up[key], flat[key], down[key]]) for key in flat}
    for key in ("t", "x"):
        first = up[key][-1]
        rows[key] = np.concatenate([up[key], first + flat[key], first + flat[key][-1] + down[key]])
    cost = up["J"] + (power + road.time_value) * seconds + down["J"]
    keep = np.unique(np.linspace(0, len(rows["t"]) - 1, 200).astype(int))
    state = np.stack([rows["x"], rows["v"]], axis=1)
    lambdas = np.stack([np.full(len(rows["t"]), worth), rows["lambda"]], axis=1)
    gears = rows["gear"].astype(np.int64)
    certificate = problem_of(road).certify(state[keep], rows["T"][keep, None], lambdas[keep], gears[keep], samples=401)
    solution = Solution(
        "speed-limit", "indirect", float(cost), float(rows["t"][-1]), road.distance, rows["t"], state,
        rows["T"][:, None], lambdas, gears, _shifts(road, rows["t"], rows["v"], gears), clock.perf_counter() - began,
        certificate, {"lambda_x": worth, "eta": eta, "share_on_limit": seconds / float(rows["t"][-1])},
    )  # fmt: skip
    if (certificate.hamiltonian_drift or 0.0) > 1e-6 or (certificate.maximum_gap or 0.0) > 1e-6:
        return solution.refuse("H is not constant and maximal along it")
    return solution


def _leg(road: LimitedRoad, speed: float, worth: float, *, faster: bool) -> dict[str, Array]:
    """From `speed` to the limit, or back: dt = M_a dv/(F - R), midpoint rule in y = sqrt(v_max - v)."""
    edge = np.linspace(np.sqrt(road.limit - speed), 0.0, NODES + 1)
    edge = edge if faster else edge[::-1]
    y = 0.5 * (edge[1:] + edge[:-1])
    v = road.limit - y**2
    costate, gear, torque = branch(road, v, worth, faster=faster)
    if not np.all(np.isfinite(costate)):
        raise BadInput("speed limit", f"{road.limit:.2f} m/s", f"nearest feasible is {v[~np.isfinite(costate)][0]:.2f}")
    ratio = np.asarray(road.ratios)[gear.astype(int) - 1]
    rate = (ratio * torque - road.road_load(v)) / road.accelerated_mass
    dt = -2.0 * y * np.diff(edge) / rate
    return {
        "t": np.cumsum(dt), "x": np.cumsum(v * dt), "v": v, "lambda": costate, "gear": gear, "T": torque,
        "J": np.sum((road.fuel_power(ratio * v, torque) + road.time_value) * dt),
    }  # fmt: skip


def _freely(road: LimitedRoad) -> float:
    """The speed at which a metre costs least, (P_hold + W)/v: beyond it no limit binds, m/s."""
    speeds = np.linspace(1.05 * road.engine_speed[0] / road.ratios[-1], road.limit, 400)
    return float(min(speeds, key=lambda v: (hold(road, float(v))[0] + road.time_value) / v))


def _shifts(road: LimitedRoad, t: Array, v: Array, gear: NDArray[np.int64]) -> tuple[Shift, ...]:
    changes = np.flatnonzero(np.diff(gear)) + 1
    return tuple(
        Shift(int(gear[k - 1]), int(gear[k]), float(v[k]), float(road.ratios[gear[k - 1] - 1] * v[k]), float(t[k]))
        for k in changes
    )


def problem_of(road: LimitedRoad, *, penalty: float | None = None) -> Problem:
    """The one definition; with `penalty` W the limit is a price, weight (v/v_max - 1)^2 beyond it, instead."""
    low, high = road.engine_speed

    def running(x, u, mode):
        cost = road.fuel_power(road.ratios[mode - 1] * x[1], u[0]) + road.time_value
        if penalty is None:
            return cost
        excess = x[1] / road.limit - 1.0
        return cost + penalty * (0.5 * (excess + (excess**2 + 1e-12) ** 0.5)) ** 2

    def allowed(x, mode):
        w = road.ratios[mode - 1] * x[1]
        return [w / low - 1.0, 1.0 - w / high] + ([] if penalty is not None else [1.0 + 1e-9 - x[1] / road.limit])

    return Problem(
        name="speed-limit",
        dynamics=lambda x, u, mode: [
            x[1], (road.ratios[mode - 1] * u[0] - road.road_load(x[1])) / road.accelerated_mass
        ],
        running_cost=running,
        start=(0.0, road.start_speed),
        target=(road.distance, road.end_speed),
        duration=None,
        control_low=(road.torque_min,),
        control_high=(road.torque_max,),
        modes=tuple(range(1, len(road.ratios) + 1)),
        allowed=allowed,
        scale=(road.distance, 10.0),
    )  # fmt: skip


def direct(road: LimitedRoad, sequence: tuple[int, ...], *, penalty: float | None = None) -> Solution | None:
    """IPOPT by collocation over the gears of `sequence`: towards the limit, on it, away. None without an answer."""
    problem = problem_of(road, penalty=penalty)
    phases = len(sequence)
    share = [0.3 / (phases - 2)] * (phases - 2) + [0.45, 0.25]
    marks = np.cumsum(share)
    rising = np.linspace(road.start_speed, road.limit, phases - 1)[1:]
    ends = [np.array([road.distance * m, v]) for m, v in zip(marks[:-2], rising, strict=True)]
    ends += [np.array([0.75 * road.distance, road.limit]), np.array([road.distance, road.end_speed])]
    answer = solve_phases(
        problem, sequence, intervals=16, guess=ends, guess_duration=road.distance / (0.9 * road.limit),
        guess_control=(20.0,), guess_durations=share,
    )  # fmt: skip
    if answer is None:
        return None
    method = "direct" if penalty is None else "direct-penalty"
    over = float(answer.state[:, 1].max() / road.limit - 1.0)
    return Solution(
        "speed-limit", method, answer.cost, float(answer.time[-1]), road.distance, answer.time, answer.state,
        answer.control, answer.costate, answer.mode, _shifts(road, answer.time, answer.state[:, 1], answer.mode),
        answer.wall, problem.certify(*answer.middles(), samples=81),
        {} if penalty is None else {"overshoot_percent": 100.0 * max(over, 0.0)},
    )  # fmt: skip


def dynamic_programming(road: LimitedRoad, *, step: float = 10.0, nodes: int = 300) -> Solution:
    """The route planner, handed this car and map; shifts and acceleration are free of charge."""
    began = clock.perf_counter()
    car, fuel_map = car_and_map(road)
    s = np.linspace(0.0, road.distance, 151)
    ahead = RoadAhead(s, np.zeros_like(s), np.full_like(s, road.limit), np.zeros_like(s))
    free = replace(Comfort(), acceleration=6.0, braking=6.0, shift_energy=0.0, shift_time=0.0, restart_energy=0.0)
    costs, advice = [], None
    for refined in (2.0, 1.0):
        advice = plan_route(
            ahead, fuel_map, car, start_speed=road.start_speed, end_speed=road.end_speed, time_value=road.time_value,
            comfort=free, step=step * refined, nodes=round(nodes / refined),
        )  # fmt: skip
        costs.append(advice.trip_fuel + road.time_value * advice.trip_time)
    assert advice is not None
    solution = Solution(
        "speed-limit", "dp", costs[1], advice.trip_time, road.distance, advice.time,
        np.stack([advice.s, advice.speed], axis=1), advice.torque[:, None],
        np.stack([np.full(len(advice.s), np.nan), advice.costate], axis=1), advice.gear,
        _shifts(road, advice.time, advice.speed, np.maximum(advice.gear, 1)), clock.perf_counter() - began,
        Certificate(mesh_error=abs(costs[0] - costs[1]) / costs[1], maximum_gap=advice.certificate["maximum_gap"],
                    hull_gain=advice.certificate["hull_gain"]),
    )  # fmt: skip
    if abs(costs[0] - costs[1]) > 0.02 * costs[1]:
        return solution.refuse("halving the mesh changes J by more than 2 %")
    return solution


def car_and_map(road: LimitedRoad) -> tuple[Car, FuelMap]:
    """The route planner's view of `road`: a car whose engine has no inertia, and a tabulated fuel map."""
    radius, idle = 0.2954, road.engine_speed[0] / 1.25
    engine = Engine(700e-6, 3, 9.0, 60e3, 550.0, 110.0, 470.0, idle, road.engine_speed[1], 1e-9, True)
    wheels = (road.accelerated_mass - road.mass) * radius**2 / 4.0
    car = Car(
        "no inertia", road.mass - 76.0, road.drag_area, 1.0, road.rolling_resistance, radius, wheels,
        tuple(n * radius for n in road.ratios), 0.27, engine, Injector(8e-6, 0.0, "sequential"),
        air_density=road.air_density, gravity=road.gravity,
    )  # fmt: skip
    speed, torque = np.linspace(idle, road.engine_speed[1], 62), np.linspace(0.0, road.torque_max, 111)
    power = road.fuel_power(speed[:, None], torque[None, :])
    flat = np.ones_like(speed)
    return car, FuelMap(speed, torque, power, road.torque_max * flat, road.torque_min * flat, float(power[0, 0]), idle)


def car_road(car: Car) -> LimitedRoad:
    """The problem for a car of its own file, with this engine's losses."""
    return LimitedRoad(
        ratios=tuple(r / car.wheel_radius for r in car.gear_ratios),
        mass=car.mass,
        accelerated_mass=car.accelerated_mass,
        rolling_resistance=car.rolling_resistance,
        drag_area=car.drag_area,
        air_density=car.air_density,
        gravity=car.gravity,
        engine_speed=(car.engine.idle_speed, car.engine.redline_speed),
        torque_max=car.engine.max_torque,
    )
