"""The route planner's problem on its grid: the road in stages, the car's table, and the sweep for any price of time."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from controller.advice import RoadAhead
from controller.drive_table import DriveTable, drive_table
from controller.plan_certificate import Path, Stages
from controller.route_kernel import BIG, IMPOSSIBLE, act, sweep
from observer.efficiency_map import FuelMap
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

CREEP = 1.0
"""Lowest limit on the way, m/s: a stop on the way is passed at a walk, the safety rules of traffic do the rest."""


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


@dataclass(frozen=True)
class RouteProblem:
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
    ) -> "RouteProblem":
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
        return RouteProblem(stages, table, car, comfort, count, none, count, start_speed, end_speed, price)

    def around(self, s: NDArray[np.float64], energy: NDArray[np.float64], width: float) -> "RouteProblem":
        """The same in a corridor of `width` m2/s2 to both sides of `energy` (places `s`, m) and of what is next to it.

        The end is kept whole where its speed is given.
        """
        near = int(np.ceil(np.max(np.diff(s)) / self.stages.ds[0]))
        path = np.interp(self.stages.s, s, energy)
        return self.between(minimum_filter1d(path, 2 * near + 1) - width, maximum_filter1d(path, 2 * near + 1) + width)

    def within_reach(self, slack: float) -> "RouteProblem":
        """The same without the speeds that comfort cannot bring about from those within `slack` m/s of the start's."""
        v, s = self.start_speed, self.stages.s - self.stages.s[0]
        slowest, fastest = max(v - slack, 0.0), v + slack
        return self.between(
            0.5 * slowest**2 - self.comfort.braking * s, 0.5 * fastest**2 + self.comfort.acceleration * s
        )

    def between(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> "RouteProblem":
        """The same in the corridor from `low` to `high` (K+1,), m2/s2, widened to nodes."""
        first = np.floor(low / self.table.energy_step).astype(np.int64)
        last = np.ceil(high / self.table.energy_step).astype(np.int64) + 2
        lowest = np.clip(first, 0, np.maximum(self.count - 3, 0))
        beyond = np.clip(last, lowest + 2, self.count)
        beyond = np.where(beyond >= self.count - 1, self.count, beyond)
        if self.end_speed is not None:
            beyond[-1] = self.count[-1]
        return replace(self, lowest=lowest, beyond=beyond)

    def rough(self, road: RoadAhead, fuel_map: FuelMap, step: float, nodes: int) -> "RouteProblem":
        """The same on a grid three times as long in distance and half as fine in energy."""
        return RouteProblem.build(
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
        return (
            (first, width, *(part[:, :0].copy() for part in rest)) if self.comfort.pulse_and_glide else self.table.hold
        )

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

    def rolling_gear(self, speed: NDArray[np.float64]) -> NDArray[np.int64]:
        """Gear in which the car rolls off the throttle at `speed`, 0 with the clutch open."""
        row = np.clip(np.rint(speed**2 / self.table.energy_step).astype(int), 0, len(self.table.coast_gear) - 1)
        return self.table.coast_gear[row]
