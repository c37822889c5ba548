"""The fuel-minimal drive over the road ahead: speed, torque and gear over distance, and the policy around them.

Problem (seed 004, 4.5, with slopes, limits, six gears and a price on time): minimise
    J = integral of (P_in + W) dt + price of gear changes - price of the kinetic energy left at the end
over v(s), gear(s), with M_eff dE/ds = F - R(s, E), E = v^2/2. In Pontryagin's words, with lambda_E = -dV/dE (J per
m2/s2; lambda_v = v lambda_E) and per metre of road
    H = lambda_E (F - R)/M_eff - (P_in + W)/v,
which the planned action maximises at each place. The value function comes of dynamic programming, so that it is a
global optimum on its grid, and the costate is its slope, at every speed and not only along the plan.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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
    """J charged, not burnt, for each return from rolling to driving: what makes pulse and glide dear.

    It does not see pulses with the throttle open: on a map far from convex over thrust the plan still swings between
    two thrusts from stage to stage (`certificate["swings"]`; `hull_gain` says what more is to be had). Tried against
    it, and left out: a price on acceleration. With part load 60 % dearer even 2 kJ/m per (m/s2)^2 only makes the swings
    smaller, and at 10 kJ/m it outweighs the fuel. On a Willans map there are no swings.
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
    rough = _Problem.build(
        road, fuel_map, car, start_speed, end_speed, end_price, comfort, 3.0 * step, max(nodes // 2, 60), None
    )
    # a coarse grid finds the time value, the fine grid corrects it by what the two disagree about, then brackets it
    known: dict[float, float] = {}
    fine: dict[float, float] = {}
    offset = 0.0
    for round_ in range(12):
        slower = max((v for v in fine if fine[v] > trip_time), default=None)
        faster = min((v for v in fine if fine[v] <= trip_time), default=None)
        if slower is not None and faster is not None:
            if not slower < faster * (1.0 - 1e-6):
                break
            share = (1.0 / trip_time - 1.0 / fine[slower]) / (1.0 / fine[faster] - 1.0 / fine[slower])
            value = slower + (0.5 if round_ % 3 == 2 else min(max(share, 0.05), 0.95)) * (faster - slower)
        else:
            value = _time_value(rough, trip_time - offset, start_gear, known, tolerance / 2.0)
            value = max(value, 1.005 * slower) if slower is not None else value
            value = min(value, 0.995 * faster) if faster is not None else value
        planned = problem.plan(value, start_gear)
        found = float(planned[0].seconds.sum())
        if abs(found - trip_time) <= tolerance * trip_time:
            return problem.advise(value, *planned, policy_step, certify)
        fine[value] = found
        offset = found - _nearest(known, value)
    value = _bisect(problem, trip_time, start_gear, tolerance)
    return problem.solve(value, start_gear, policy_step, certify)


def _nearest(known: dict[float, float], value: float) -> float:
    """Trip time at `value`, from the times known: interpolated in log of the time value."""
    values = np.array(sorted(known))
    return float(np.interp(np.log1p(value), np.log1p(values), [known[v] for v in values]))


def _time_value(
    problem: "_Problem", trip_time: float, start_gear: int | None, known: dict[float, float], tolerance: float
) -> float:
    """Time value at which `problem` takes about `trip_time` s; `known` (time value -> s) is used and filled.

    The time falls in steps as the time value rises: across a step the search ends at 0.2 % of the time value.
    """
    for value in (0.0, 20_000.0, 80_000.0, 500_000.0):
        if value not in known:
            known[value] = problem.trip_time(value, start_gear)
        if known[value] <= trip_time:
            break
    for round_ in range(14):
        values = sorted(known)
        slower = [v for v in values if known[v] > trip_time]
        faster = [v for v in values if known[v] <= trip_time]
        if not slower or not faster:
            return faster[0] if faster else slower[-1]
        low, high = slower[-1], faster[0]
        share = (1.0 / trip_time - 1.0 / known[low]) / (1.0 / known[high] - 1.0 / known[low])
        value = low + (0.5 if round_ % 3 == 2 else min(max(share, 0.05), 0.95)) * (high - low)
        if min(known[low] - trip_time, trip_time - known[high]) <= tolerance * trip_time or high - low < 2e-3 * high:
            return low + min(max(share, 0.0), 1.0) * (high - low)
        known[value] = problem.trip_time(value, start_gear)
    return value


def _bisect(problem: "_Problem", trip_time: float, start_gear: int | None, tolerance: float) -> float:
    """Time value found on the fine grid alone: slow and sure. Raises BadInput with the nearest feasible time."""
    low, high = 0.0, 500_000.0
    slow, fast = problem.trip_time(low, start_gear), problem.trip_time(high, start_gear)
    if not fast * (1.0 - tolerance) <= trip_time <= slow * (1.0 + tolerance):
        nearest = fast if trip_time < fast else slow
        raise BadInput("trip time", f"{trip_time:.1f} s", f"nearest feasible is {nearest:.1f} s")
    value, found = (low, slow) if abs(slow - trip_time) < abs(fast - trip_time) else (high, fast)
    for _ in range(50):
        if abs(found - trip_time) <= tolerance * trip_time or high - low < 1e-7 * high:
            break
        value = 0.5 * (low + high)
        found = problem.trip_time(value, start_gear)
        if found > trip_time:
            low = value
        else:
            high = value
    return value


@dataclass(frozen=True)
class _Problem:
    """A road, a table and boundary conditions, ready to be swept for any time value."""

    stages: Stages
    table: DriveTable
    car: Car
    comfort: Comfort
    count: NDArray[np.int64]
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
        return _Problem(stages, table, car, comfort or Comfort(), count, start_speed, end_speed, price)

    def arguments(self, time_value: float, value: NDArray[np.float64]) -> tuple:
        """What every kernel takes, in its order."""
        t, c, st = self.table, self.comfort, self.stages
        return (
            st.ds, st.grade_force, st.top, self.count, st.slow_speed, t.energy_step,
            self.car.air_density * self.car.drag_area, t.mass, t.fuel, t.force_low, t.force_high, t.coast_force,
            t.coast_fuel, t.coast_mass, time_value, c.shift_energy + c.shift_time * time_value, c.restart_energy,
            c.dawdle_power, c.acceleration, c.braking, value,
        )  # fmt: skip

    def value_function(self, time_value: float) -> NDArray[np.float64]:
        """Sweep backwards: V (K+1, G+1, n), J."""
        stages, table = self.stages, self.table
        value = np.full((len(stages.s), len(table.mass) + 1, table.nodes), BIG)
        last = self.count[-1]
        if self.end_speed is None:
            energy = np.arange(last) * table.energy_step
            energy[-1] = stages.top[-1]
            value[-1, :, :last] = -self.end_price * self.car.accelerated_mass * energy
        else:
            value[-1, :, last - 1] = 0.0
            if self.end_speed == 0.0:
                value[-1, :, :last] = 0.0
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
                table, stages, found, car.air_density * car.drag_area, time_value, self.comfort.acceleration
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
