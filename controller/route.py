"""The fuel-minimal drive over the road ahead: speed, torque and gear over distance, and the policy around them.

Problem (seed 004, 4.5, with slopes, limits, six gears and a price on time): minimise
    J = integral of (P_in + W) dt + price of gear changes - price of the kinetic energy left at the end
over v(s), gear(s), with M_eff dE/ds = F - R(s, E), E = v^2/2. In Pontryagin's words, with lambda_E = -dV/dE (J per
m2/s2; lambda_v = v lambda_E) and per metre of road
    H = lambda_E (F - R)/M_eff - (P_in + W)/v,
which the planned action maximises at each place. The value function comes of dynamic programming, so that it is a
global optimum on its grid, and the costate is its slope, at every speed and not only along the plan.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from controller.advice import Advice, RoadAhead
from controller.drive_table import DriveTable
from controller.plan_certificate import Path, certify_plan
from controller.route_kernel import act
from controller.route_problem import Comfort, RouteProblem
from observer.efficiency_map import FuelMap
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

REACHED = 4.0
"""m/s beside the start's speed that a policy of short reach still answers for: a person does what is said inexactly."""
HARD_BRAKING = 3.0
"""What the policy asks for at most, m/s2, of a driver who is too fast for the limit ahead."""


def plan_route(
    road: RoadAhead,
    fuel_map: FuelMap,
    car: Car,
    *,
    start_speed: float,
    end_speed: float | None,
    time_value: float,
    start_gear: int | None = None,
    end_price: float | None = None,
    comfort: Comfort | None = None,
    step: float = 20.0,
    nodes: int = 200,
    table: DriveTable | None = None,
    policy_step: float | None = 50.0,
    policy_reach: float = math.inf,
    certify: bool = True,
) -> Advice:
    """Plan the drive over `road` on the (estimated) `fuel_map` and the nominal `car`.

    `start_speed` and `end_speed` m/s; `end_speed` None leaves it free and credits the kinetic energy left with
    `end_price` J of fuel per J (the map's marginal cost by default; 0 gives lambda_v = 0 at the end).
    `time_value` W >= 0 is what a second is worth, J/s. `table` saves the tabulation of the map when replanning (its
    top speed must cover the road's). `step` m and `nodes` set the grid; `policy_step` m that of the policy. With None
    there is no policy, only the plan, sought in a corridor around that of a coarse grid: several times faster.
    `policy_reach` m is how far the policy goes (at least one place); who plans again soon needs no more, nor speeds
    that he cannot have by then (`RouteProblem.within_reach`).
    `certify` fills `Advice.certificate` (see `plan_certificate`).
    Raises BadInput for a road that cannot be driven or an end speed that cannot be reached (naming the nearest).
    """
    problem = RouteProblem.build(road, fuel_map, car, start_speed, end_speed, end_price, comfort, step, nodes, table)
    if not (np.isfinite(time_value) and time_value >= 0.0):
        raise BadInput("time value", f"{time_value} J/s", "finite and not negative")
    if policy_reach < math.inf:
        problem = problem.within_reach(REACHED)
    if policy_step is not None:
        return _advise(problem, time_value, *problem.plan(time_value, start_gear), policy_step, certify, policy_reach)
    corridors = _Corridors(problem, problem.rough(road, fuel_map, step, nodes), start_gear)
    return _advise(problem, time_value, corridors.plan(time_value), None, None, certify)


def plan_route_in_time(
    road: RoadAhead,
    fuel_map: FuelMap,
    car: Car,
    *,
    start_speed: float,
    end_speed: float | None,
    trip_time: float,
    start_gear: int | None = None,
    end_price: float | None = None,
    comfort: Comfort | None = None,
    step: float = 20.0,
    nodes: int = 200,
    table: DriveTable | None = None,
    policy_step: float | None = 50.0,
    tolerance: float = 0.001,
    certify: bool = True,
) -> Advice:
    """Plan as `plan_route` does, with the time value that makes the predicted time `trip_time` s (within `tolerance`).

    Raises BadInput with the nearest feasible time when no time value gives it.
    """
    problem = RouteProblem.build(road, fuel_map, car, start_speed, end_speed, end_price, comfort, step, nodes, table)
    corridors = _Corridors(problem, problem.rough(road, fuel_map, step, nodes), start_gear)
    value = _time_value(problem, trip_time, tolerance, lambda v: float(corridors.plan(v).seconds.sum()))
    if policy_step is None:
        return _advise(problem, value, corridors.plan(value), None, None, certify)
    planned = problem.plan(value, start_gear)
    if abs(float(planned[0].seconds.sum()) - trip_time) > tolerance * trip_time:  # a step, or a better plan elsewhere
        value = _time_value(problem, trip_time, tolerance, lambda v: problem.trip_time(v, start_gear))
        planned = problem.plan(value, start_gear)
    return _advise(problem, value, *planned, policy_step, certify)


MOST = 500_000.0
"""W: time values are sought up to here."""


def _time_value(problem: RouteProblem, trip_time: float, tolerance: float, seconds: Callable[[float], float]) -> float:
    """Time value at which the plan takes `trip_time` s within `tolerance`; `seconds(value)` falls, in steps.

    The search begins at the time value whose cruise has the trip's mean speed on a Willans engine, brackets, and goes
    on by the secant of 1/time. Within a step of the time it returns the nearer side.
    Raises BadInput with the nearest feasible time when no time value gives it.
    """
    slow = fast = None
    value = problem.cruise_value(1.15 * float(problem.stages.ds.sum()) / max(trip_time, 1.0))
    value = min(max(value, 100.0), MOST)
    for round_ in range(60):
        found = seconds(value)
        if abs(found - trip_time) <= tolerance * trip_time:
            return value
        if found > trip_time:
            slow = (value, found)
        else:
            fast = (value, found)
        if slow is None or fast is None:
            if value in (0.0, MOST):
                raise BadInput("trip time", f"{trip_time:.1f} s", f"nearest feasible is {found:.1f} s")
            value = min(2.0 * value, MOST) if fast is None else (value / 2.5 if value > 200.0 else 0.0)
            continue
        if fast[0] - slow[0] < 1e-6 * fast[0]:
            break
        share = (1.0 / trip_time - 1.0 / slow[1]) / (1.0 / fast[1] - 1.0 / slow[1])
        share = 0.5 if round_ % 3 == 2 else min(max(share, 0.03), 0.97)
        value = slow[0] + share * (fast[0] - slow[0])
    assert slow is not None
    assert fast is not None
    return min(slow, fast, key=lambda side: abs(side[1] - trip_time))[0]


@dataclass
class _Corridors:
    """Fine plans, each sought in a corridor around the plan of the nearest time value known, or around a rough one."""

    problem: RouteProblem
    rough: RouteProblem
    start_gear: int | None
    known: dict[float, Path] = field(default_factory=dict)

    def plan(self, value: float) -> Path:
        """The plan at time value `value`, W; on the whole grid where the corridors fail."""
        if value in self.known:
            return self.known[value]
        problem, path = self.problem, None
        width = 2.5 * self.rough.table.energy_step
        near = min(self.known, key=lambda v: abs(np.log1p(v) - np.log1p(value)), default=None)
        if near is not None and abs(near - value) < 0.5 * near:
            path = problem.near(problem.stages.s, self.known[near].energy, 2.0 * width, value, self.start_gear)
        if path is None:
            guide = self.rough.plan(value, self.start_gear)[0].energy
            path = problem.near(self.rough.stages.s, guide, width, value, self.start_gear)
        self.known[value] = path or problem.plan(value, self.start_gear)[0]
        return self.known[value]


@dataclass(frozen=True)
class _Policy:
    """See `Advice`."""

    s: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    speed: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    acceleration: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 0)))
    gear: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 0), np.int64))
    costate: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 0)))


def _policy(
    problem: RouteProblem, time_value: float, found: Path, value: NDArray[np.float64], policy_step: float, reach: float
) -> _Policy:
    """The best action at every speed of the corridor, at places about `policy_step` m apart."""
    stages, chosen = problem.stages, found.gear
    places = np.arange(0, len(stages.ds), max(round(policy_step / stages.ds[0]), 1))
    places = places[: max(int(np.searchsorted(stages.s[places], stages.s[0] + reach, side="right")), 1)]
    fastest = float(np.sqrt(2.0 * max(found.energy.max(), stages.top.max())))
    grid = np.linspace(0.0, fastest, max(int(np.ceil(fastest / 0.9)), 2) + 1)
    nodes = 0.5 * grid**2 / problem.table.energy_step
    kept = np.flatnonzero((nodes >= problem.lowest[places].min()) & (nodes < problem.beyond[places].max()))
    grid = grid[max(kept[0] - 1, 0) : kept[-1] + 2]
    shape = (len(places), len(grid))
    energies = np.broadcast_to(0.5 * grid**2, shape)
    _, ends, gears, _, slope = act(
        np.repeat(places, len(grid)),
        energies.ravel(),
        np.repeat(chosen[places], len(grid)),
        False,
        *problem.arguments(time_value, value),
    )
    acceleration = (ends.reshape(shape) - energies) / stages.ds[places][:, None]
    gear = np.where(gears > 0, gears, np.tile(problem.rolling_gear(grid), len(places))).reshape(shape)
    return _Policy(stages.s[places], grid, np.maximum(acceleration, -HARD_BRAKING), gear, slope.reshape(shape) * grid)


def _advise(
    problem: RouteProblem,
    time_value: float,
    found: Path,
    value: NDArray[np.float64] | None,
    policy_step: float | None,
    certify: bool,
    policy_reach: float = math.inf,
) -> Advice:
    """The advice that a plan and its value function make; no policy without these."""
    stages, table, car = problem.stages, problem.table, problem.car
    path, chosen = found.energy, found.gear
    speed = np.sqrt(2.0 * path)

    acceleration = np.diff(path) / stages.ds
    row = np.clip(np.rint((path[1:] + path[:-1]) / table.energy_step).astype(int), 0, len(table.coast_gear) - 1)
    off = chosen == 0
    gear = np.where(off, table.coast_gear[row], chosen)
    road_load = stages.grade_force + car.air_density * car.drag_area * 0.5 * (path[1:] + path[:-1])
    wheels = car.accelerated_mass * acceleration + road_load
    inertia = np.where(off, table.coast_mass[row], table.mass[np.maximum(chosen, 1) - 1]) - car.accelerated_mass
    rolling = table.coast_force[row] - inertia * acceleration
    thrust = np.where(off, rolling, wheels)
    ratio = np.where(gear > 0, table.ratio[np.maximum(gear, 1) - 1], np.inf)

    if value is None or policy_step is None:
        policy = _Policy()
    else:
        policy = _policy(problem, time_value, found, value, policy_step, policy_reach)
    certificate = (
        {}
        if not certify
        else certify_plan(
            table,
            stages,
            found,
            car.air_density * car.drag_area,
            time_value,
            problem.comfort.acceleration,
            problem.hold,
        )
    )
    return Advice(
        s=stages.s,
        speed=speed,
        torque=np.append(thrust / ratio, (thrust / ratio)[-1]),
        gear=np.append(gear, gear[-1]),
        costate=found.costate,
        time=np.concatenate([[0.0], np.cumsum(found.seconds)]),
        fuel=np.concatenate([[0.0], np.cumsum(found.fuel)]),
        policy_speed=policy.speed,
        policy_acceleration=policy.acceleration,
        policy_gear=policy.gear,
        policy_costate=policy.costate,
        time_value=time_value,
        policy_s=policy.s,
        coasting=np.append(off, off[-1]),
        brake_force=np.append(np.where(off, np.maximum(rolling - wheels, 0.0), 0.0), 0.0),
        certificate=certificate,
    )
