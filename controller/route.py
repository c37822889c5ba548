"""The fuel-minimal drive over the road ahead: speed, torque and gear over distance, and the policy around them.

Problem (seed 004, 4.5, with slopes, limits, six gears and a price on time): minimise
    J = integral of (P_in + W) dt + price of gear changes - price of the kinetic energy left at the end
over v(s), gear(s), with M_eff dE/ds = F - R(s, E), E = v^2/2. In Pontryagin's words, with lambda_E = -dV/dE (J per
m2/s2; lambda_v = v lambda_E) and per metre of road
    H = lambda_E (F - R)/M_eff - (P_in + W)/v,
which the planned action maximises at each place. The value function comes of dynamic programming, so that it is a
global optimum on its grid, and the costate is its slope, at every speed and not only along the plan.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from controller.advice import Advice, RoadAhead
from controller.drive_table import DriveTable, drive_table
from controller.plan_certificate import Path, Stages, certify_plan
from controller.route_kernel import BIG, IMPOSSIBLE, act, sweep
from observer.efficiency_map import FuelMap
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

CREEP = 1.0
"""Lowest limit on the way, m/s: a stop on the way is passed at a walk, the safety rules of traffic do the rest."""


HARD_BRAKING = 3.0
"""What the policy asks for at most, m/s2, of a driver who is too fast for the limit ahead."""


@dataclass(frozen=True)
class Comfort:
    """What a driver accepts, and what a gear change costs him."""

    acceleration: float = 2.0
    """m/s2."""
    braking: float = 1.5
    """m/s2, planned."""
    shift_energy: float = 1500.0
    """J of fuel per gear change: clutch, and the engine's inertia."""
    shift_time: float = 0.15
    """s of trip time per gear change: what the torque gap costs in the end, well below the gap itself."""
    restart_energy: float = 15_000.0
    """J charged, not burnt, for each return from rolling to driving."""
    pulse_and_glide: bool = False
    """Whether the plan may swing about a speed for what a map that is not convex over thrust rewards it with. By
    default it is charged what holding the speed costs (`hold_lines`), and `certificate["hull_gain"]` says what is left
    on the road for that. (A price on acceleration instead only makes the swings smaller before it outweighs the fuel.)
    """
    dawdle_power: float = 30_000.0
    """W: price of the time lost below `RoadAhead.speed_min`."""


def cut_road(road: RoadAhead, car: Car, step: float) -> Stages:
    """Cut `road` into even stages of about `step` metres: mean slope per stage, lowest limit around each place.

    Raises BadInput when the road is shorter than two points, not ascending, or its limits cross or are not finite.
    """
    s = np.asarray(road.s, float)
    if len(s) < 2 or np.any(np.diff(s) <= 0.0):
        raise BadInput("road ahead", "s", "at least two ascending places")
    for name in ("pitch", "speed_max", "speed_min"):
        values = np.asarray(getattr(road, name))
        if values.shape != s.shape or not np.all(np.isfinite(values)):
            raise BadInput("road ahead", name, f"{len(s)} finite values, one for each place")
    if np.any(road.speed_min > road.speed_max + 1e-9):
        place = int(np.argmax(road.speed_min - road.speed_max))
        raise BadInput("road ahead", f"s = {s[place]:.0f} m", "speed_min not above speed_max")
    count = max(int(np.ceil((s[-1] - s[0]) / step - 1e-9)), 1)
    places = np.linspace(s[0], s[-1], count + 1)
    ds = np.diff(places)
    grade = np.concatenate([[0.0], np.cumsum(np.diff(s) * 0.5 * (np.sin(road.pitch[1:]) + np.sin(road.pitch[:-1])))])
    slope = np.diff(np.interp(places, s, grade)) / ds
    force = car.mass * car.gravity * (slope + car.rolling_resistance * np.sqrt(1.0 - slope**2))
    limit = np.interp(places, s, road.speed_max)
    nearest = np.clip(np.rint((s - s[0]) / ds[0]).astype(int), 0, count)
    np.minimum.at(limit, nearest, road.speed_max)
    courtesy = np.interp(0.5 * (places[1:] + places[:-1]), s, road.speed_min)
    return Stages(places, ds, force, 0.5 * np.maximum(limit, CREEP) ** 2, courtesy)


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
    policy_step: float = 50.0,
    certify: bool = True,
) -> Advice:
    """Plan the drive over `road` on the (estimated) `fuel_map` and the nominal `car`.

    `start_speed` and `end_speed` m/s; `end_speed` None leaves it free and credits the kinetic energy left with
    `end_price` J of fuel per J (the map's marginal cost by default; 0 gives lambda_v = 0 at the end).
    `time_value` W >= 0 is what a second is worth, J/s. `table` saves the tabulation of the map when replanning (its
    top speed must cover the road's). `step` m and `nodes` set the grid; `policy_step` m that of the policy. `certify`
    fills `Advice.certificate` (see `plan_certificate`).
    Raises BadInput for a road that cannot be driven or an end speed that cannot be reached (naming the nearest).
    """
    problem = _Problem.build(road, fuel_map, car, start_speed, end_speed, end_price, comfort, step, nodes, table)
    return problem.solve(time_value, start_gear, policy_step, certify)


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
    policy_step: float = 50.0,
    tolerance: float = 0.001,
    certify: bool = True,
) -> Advice:
    """Plan as `plan_route` does, with the time value that makes the predicted time `trip_time` s (within `tolerance`).

    Raises BadInput with the nearest feasible time when no time value gives it.
    """
    problem = _Problem.build(road, fuel_map, car, start_speed, end_speed, end_price, comfort, step, nodes, table)
    corridors = _Corridors(problem, problem.rough(road, fuel_map, step, nodes), start_gear)
    value = _time_value(problem, trip_time, tolerance, corridors.seconds)
    planned = problem.plan(value, start_gear)
    if abs(float(planned[0].seconds.sum()) - trip_time) > tolerance * trip_time:  # a step, or a better plan elsewhere
        value = _time_value(problem, trip_time, tolerance, lambda v: problem.trip_time(v, start_gear))
        planned = problem.plan(value, start_gear)
    return problem.advise(value, *planned, policy_step, certify)


MOST = 500_000.0
"""W: time values are sought up to here."""


def _time_value(problem: "_Problem", trip_time: float, tolerance: float, seconds: Callable[[float], float]) -> float:
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
    """Trip times of fine plans, each sought in a corridor around the plan of the nearest time value known."""

    problem: "_Problem"
    rough: "_Problem"
    start_gear: int | None
    known: dict[float, NDArray[np.float64]] = field(default_factory=dict)

    def seconds(self, value: float) -> float:
        """Duration of the plan at time value `value`, s."""
        problem, path = self.problem, None
        width = 2.5 * self.rough.table.energy_step
        near = min(self.known, key=lambda v: abs(np.log1p(v) - np.log1p(value)), default=None)
        if near is not None and abs(near - value) < 0.5 * near:
            path = problem.near(problem.stages.s, self.known[near], 2.0 * width, value, self.start_gear)
        if path is None:
            guide = self.rough.plan(value, self.start_gear)[0].energy
            path = problem.near(self.rough.stages.s, guide, width, value, self.start_gear)
        path = path or problem.plan(value, self.start_gear)[0]
        self.known[value] = path.energy
        return float(path.seconds.sum())


@dataclass(frozen=True)
class _Problem:
    """A road, a table and boundary conditions, ready to be swept for any time value."""

    stages: Stages
    table: DriveTable
    car: Car
    comfort: Comfort
    count: NDArray[np.int64]
    """(K+1,): nodes of kinetic energy at each place, the last on the limit."""
    lowest: NDArray[np.int64]
    beyond: NDArray[np.int64]
    """(K+1,): the corridor, nodes from `lowest` to before `beyond`."""
    start_speed: float
    end_speed: float | None
    end_price: float

    @staticmethod
    def build(
        road: RoadAhead,
        fuel_map: FuelMap,
        car: Car,
        start_speed: float,
        end_speed: float | None,
        end_price: float | None,
        comfort: Comfort | None,
        step: float,
        nodes: int,
        table: DriveTable | None,
    ) -> "_Problem":
        if not (np.isfinite(start_speed) and start_speed >= 0.0):
            raise BadInput("start speed", f"{start_speed} m/s", "finite and not negative")
        stages = cut_road(road, car, step)
        fastest = max(float(np.sqrt(2.0 * stages.top.max())), start_speed)
        if table is None:
            table = drive_table(fuel_map, car, speed_top=fastest, nodes=nodes)
        covered = 0.5 * (table.nodes - 1) * table.energy_step * 2.0
        if 0.5 * fastest**2 > covered * (1.0 + 1e-9):
            raise BadInput("drive table", "speed_top", f"at least {fastest:.1f} m/s for this road")
        top = stages.top.copy()
        if end_speed is not None:
            if end_speed < 0.0 or 0.5 * end_speed**2 > top[-1] * (1.0 + 1e-9):
                nearest = float(np.clip(end_speed, 0.0, np.sqrt(2.0 * top[-1])))
                raise BadInput("end speed", f"{end_speed:.2f} m/s", f"nearest within the limit is {nearest:.2f} m/s")
            top[-1] = 0.5 * end_speed**2
        e = table.energy_step
        below = np.maximum(np.ceil(top / e - 0.25), 1.0).astype(np.int64)  # nodes clearly below the limit
        count = np.minimum(below, table.nodes - 1) + 1
        stages = replace(stages, top=top)
        price = table.marginal_cost if end_price is None else end_price
        comfort = comfort or Comfort()
        none = np.zeros_like(count)
        return _Problem(stages, table, car, comfort, count, none, count, start_speed, end_speed, price)

    def around(self, s: NDArray[np.float64], energy: NDArray[np.float64], width: float) -> "_Problem":
        """The same in a corridor of `width` m2/s2 to both sides of `energy` (places `s`, m) and of what is next to it.

        The end is kept whole where its speed is given.
        """
        near = int(np.ceil(np.max(np.diff(s)) / self.stages.ds[0]))
        path, e = np.interp(self.stages.s, s, energy), self.table.energy_step
        low = np.floor((minimum_filter1d(path, 2 * near + 1) - width) / e).astype(np.int64)
        high = np.ceil((maximum_filter1d(path, 2 * near + 1) + width) / e).astype(np.int64) + 2
        lowest = np.clip(low, 0, np.maximum(self.count - 3, 0))
        beyond = np.clip(high, lowest + 2, self.count)
        beyond = np.where(beyond >= self.count - 1, self.count, beyond)
        if self.end_speed is not None:
            beyond[-1] = self.count[-1]
        return replace(self, lowest=lowest, beyond=beyond)

    def rough(self, road: RoadAhead, fuel_map: FuelMap, step: float, nodes: int) -> "_Problem":
        """The same on a grid three times as long in distance and half as fine in energy."""
        return _Problem.build(
            road, fuel_map, self.car, self.start_speed, self.end_speed, self.end_price, self.comfort, 3.0 * step,
            max(nodes // 2, 60), None,
        )  # fmt: skip

    def near(
        self, s: NDArray[np.float64], energy: NDArray[np.float64], width: float, time_value: float,
        start_gear: int | None,
    ) -> Path | None:  # fmt: skip
        """The plan in a corridor, see `around`; None where it runs along the corridor's walls or there is none."""
        corridor = self.around(s, energy, width)
        path = corridor.follow(time_value, corridor.value_function(time_value), start_gear)
        return path if path.cost < IMPOSSIBLE and corridor.within(path.energy) else None

    def cruise_value(self, speed: float) -> float:
        """Time value, W, at which a Willans engine cruises at `speed` m/s: v P' - P for P = marginal cost x R v."""
        return self.table.marginal_cost * self.car.air_density * self.car.drag_area * speed**3

    def within(self, energy: NDArray[np.float64]) -> bool:
        """Whether a path keeps clear of the corridor's walls, where those are not the road's limits."""
        node = energy / self.table.energy_step
        clear = (node > self.lowest + 1.0) | (self.lowest == 0)
        return bool(np.all((clear & ((node < self.beyond - 2.0) | (self.beyond == self.count)))[1:]))

    def arguments(self, time_value: float, value: NDArray[np.float64]) -> tuple:
        """What every kernel takes, in its order."""
        t, c, st = self.table, self.comfort, self.stages
        return (
            st.ds, st.grade_force, st.top, self.lowest, self.beyond, self.count, st.slow_speed, t.energy_step,
            self.car.air_density * self.car.drag_area, t.mass, t.fuel, t.force_low, t.force_high, t.coast_force,
            t.coast_fuel, t.coast_mass, time_value, c.shift_energy + c.shift_time * time_value, c.restart_energy,
            c.dawdle_power, c.acceleration, c.braking, *self.hold, value,
        )  # fmt: skip

    @property
    def hold(self) -> tuple[NDArray[np.float64], ...]:
        """The table's lines, without columns where pulse and glide is allowed."""
        first, width, *rest = self.table.hold
        return (first, width, *(part[:, :0] for part in rest)) if self.comfort.pulse_and_glide else self.table.hold

    def value_function(self, time_value: float) -> NDArray[np.float64]:
        """Sweep backwards: V (K+1, G+1, n) over the corridor's nodes, J."""
        stages, table = self.stages, self.table
        value = np.full((len(stages.s), len(table.mass) + 1, int(np.max(self.beyond - self.lowest))), BIG)
        first, last = self.lowest[-1], self.beyond[-1]
        if self.end_speed is None:
            energy = np.append(np.arange(self.count[-1] - 1) * table.energy_step, stages.top[-1])[first:last]
            value[-1, :, : last - first] = -self.end_price * self.car.accelerated_mass * energy
        elif self.end_speed == 0.0:
            value[-1, :, : last - first] = 0.0
        else:
            value[-1, :, last - first - 1] = 0.0
        sweep(*self.arguments(time_value, value))
        return value

    def follow(self, time_value: float, value: NDArray[np.float64], start_gear: int | None) -> Path:
        """The plan: from the start speed, always the best action."""
        stages = self.stages
        n = len(stages.ds)
        energies, coming = np.full(n, 0.5 * self.start_speed**2), np.full(n, -1 if start_gear is None else start_gear)
        cost, ends, gears, burnt, worth = act(np.arange(n), energies, coming, True, *self.arguments(time_value, value))
        energy = np.concatenate([energies[:1], ends])
        speed = np.sqrt(2.0 * energy)
        seconds = stages.ds / np.maximum(0.5 * (speed[1:] + speed[:-1]), 1e-3)
        shifted = np.concatenate([[False], (gears[1:] != gears[:-1]) & (gears[1:] > 0) & (gears[:-1] > 0)])
        return Path(
            energy,
            gears,
            seconds + self.comfort.shift_time * shifted,
            burnt + self.comfort.shift_energy * shifted,
            np.append(worth * speed[:-1], 0.0),
            float(cost[0]),
        )

    def plan(self, time_value: float, start_gear: int | None) -> tuple[Path, NDArray[np.float64]]:
        """Sweep and follow. Raises BadInput, saying why, when there is no drive: the end speed, or a hill."""
        value = self.value_function(time_value)
        path = self.follow(time_value, value, start_gear)
        if path.cost < IMPOSSIBLE:
            return path, value
        if self.end_speed is not None:
            free = replace(self, end_speed=None)
            again = free.follow(1.0e4, free.value_function(1.0e4), start_gear)
            if again.cost < IMPOSSIBLE:
                reached = float(np.sqrt(2.0 * again.energy[-1]))
                raise BadInput("end speed", f"{self.end_speed:.2f} m/s", f"nearest feasible is {reached:.2f} m/s")
        steepest = int(np.argmax(self.stages.grade_force))
        raise BadInput("road ahead", f"s = {self.stages.s[steepest]:.0f} m", "a slope that the car can climb")

    def trip_time(self, time_value: float, start_gear: int | None) -> float:
        """Predicted duration of the plan at `time_value`, s."""
        return float(self.plan(time_value, start_gear)[0].seconds.sum())

    def solve(self, time_value: float, start_gear: int | None, policy_step: float, certify: bool) -> Advice:
        """Sweep, follow, and tabulate the policy."""
        if not (np.isfinite(time_value) and time_value >= 0.0):
            raise BadInput("time value", f"{time_value} J/s", "finite and not negative")
        return self.advise(time_value, *self.plan(time_value, start_gear), policy_step, certify)

    def advise(
        self, time_value: float, found: Path, value: NDArray[np.float64], policy_step: float, certify: bool
    ) -> Advice:
        """The advice that a plan and its value function make."""
        stages, table, car = self.stages, self.table, self.car
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

        fastest = max(float(speed.max()), float(np.sqrt(2.0 * stages.top.max())))
        grid = np.linspace(0.0, fastest, max(int(np.ceil(fastest / 0.9)), 2) + 1)
        places = np.arange(0, len(stages.ds), max(round(policy_step / stages.ds[0]), 1))
        shape = (len(places), len(grid))
        energies = np.broadcast_to(0.5 * grid**2, shape)
        _, ends, gears, _, slope = act(
            np.repeat(places, len(grid)),
            energies.ravel(),
            np.repeat(chosen[places], len(grid)),
            False,
            *self.arguments(time_value, value),
        )
        policy_acceleration = (ends.reshape(shape) - energies) / stages.ds[places][:, None]
        policy_gear = np.where(gears > 0, gears, np.tile(self.rolling_gear(grid), len(places))).reshape(shape)
        certificate = (
            {}
            if not certify
            else certify_plan(
                table,
                stages,
                found,
                car.air_density * car.drag_area,
                time_value,
                self.comfort.acceleration,
                self.hold,
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
            policy_speed=grid,
            policy_acceleration=np.maximum(policy_acceleration, -HARD_BRAKING),
            policy_gear=policy_gear,
            policy_costate=slope.reshape(shape) * grid,
            time_value=time_value,
            policy_s=stages.s[places],
            coasting=np.append(off, off[-1]),
            brake_force=np.append(np.where(off, np.maximum(rolling - wheels, 0.0), 0.0), 0.0),
            certificate=certificate,
        )

    def rolling_gear(self, speed: NDArray[np.float64]) -> NDArray[np.int64]:
        """Gear in which the car rolls off the throttle at `speed`, 0 with the clutch open."""
        row = np.clip(np.rint(speed**2 / self.table.energy_step).astype(int), 0, len(self.table.coast_gear) - 1)
        return self.table.coast_gear[row]
