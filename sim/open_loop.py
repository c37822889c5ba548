"""Open-loop checks of the planner: plans driven by the plant alone, without traffic, driver or feedback.

A drive cycle becomes a road whose limit is the fastest that the cycle goes within 150 m; between two of its stops the
plan has the cycle's distance and the cycle's time. A real road is planned in the time of a driver who goes by limits
and bends. Plan and reference are both tracked by the plant's own trace driver, on the true grades, and the fuel is the
plant's. The planner is given the true map: what is checked is the plan, not the map.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from controller.advice import Advice, RoadAhead
from controller.route import plan_route_in_time
from observer.efficiency_map import FuelMap
from sensors.roadmap import RoadMap
from sim.caution import SPEEDOMETER, speed_cap
from sim.road_ahead import road_ahead
from sim.truth import true_fuel_map
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car
from vehicle_model.car.route import Route
from vehicle_model.plant.cycle import Cycle, replay
from vehicle_model.plant.parameters import plant_parameters

Array = NDArray[np.float64]
AROUND = 150.0
"""m before and behind a place of a cycle within which its fastest speed is the limit there."""
GRID = 5.0
"""m between the places of a cycle's road."""
SHORTEST = 60.0
"""m: shorter moves of a cycle stay as they are."""
STILL = 0.05
"""m/s below which a cycle stands."""
TICK = 0.1
"""s between the samples of a trace."""
LAUNCH, COMFORT = 1.2, 1.8
"""m/s2 by which the reference driver of a road gains speed, and that he takes sideways in bends."""


@dataclass(frozen=True)
class OpenLoop:
    """A reference and a plan, equal in distance and time, both driven by the plant."""

    name: str
    distance: float
    """m."""
    time: float
    """s."""
    reference_fuel: float
    """J, in the gears of the plant's own schedule."""
    planned_fuel: float
    """J, at the planned speeds in the planned gears."""
    planned_speed_fuel: float
    """J, at the planned speeds in the gears of the plant's own schedule."""
    distance_difference: float
    """Relative, planned against reference, as driven: where the car is too weak for a trace it falls behind, and
    catches up with its speed only."""
    kept: int
    """Moves of a cycle that no plan could make in their time, or that were too short: driven as they are."""

    @property
    def saving_percent(self) -> float:
        """Of the reference's fuel."""
        return 100.0 * (1.0 - self.planned_fuel / self.reference_fuel)

    @property
    def by_speed_percent(self) -> float:
        """What the planned speeds save without the planned gears."""
        return 100.0 * (1.0 - self.planned_speed_fuel / self.reference_fuel)


@dataclass(frozen=True)
class _Trace:
    time: Array
    speed: Array
    gear: Array


def cycle_check(cycle: Cycle, car: Car, fuel_map: FuelMap | None = None) -> OpenLoop:
    """Plan every move of `cycle` from stop to stop and drive both; `fuel_map` None: the true one. Flat cycles only.

    Raises BadInput for a cycle with grades.
    """
    if np.any(cycle.grade != 0.0):
        raise BadInput(cycle.name, "grade", "a flat cycle")
    known = true_fuel_map(car) if fuel_map is None else fuel_map
    pieces: list[_Trace] = []
    kept, stands_from = 0, 0
    for first, last in _moves(cycle.speed):
        pieces.append(_standing(cycle.time[stands_from], cycle.time[first]))
        t, v = cycle.time[first : last + 1], cycle.speed[first : last + 1]
        try:
            pieces.append(_planned_move(t, v, known, car))
        except BadInput:
            pieces.append(_Trace(t, v, np.full(len(t), np.nan)))
            kept += 1
        stands_from = last
    pieces.append(_standing(cycle.time[stands_from], cycle.time[-1]))
    pieces = [piece for piece in pieces if len(piece.time)]
    plan = _Trace(*(np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("time", "speed", "gear")))
    return _compared(cycle.name, car, _Trace(cycle.time, cycle.speed, np.empty(0)), plan, None, kept)


def road_check(name: str, route: Route, road_map: RoadMap, car: Car, fuel_map: FuelMap | None = None) -> OpenLoop:
    """Plan `route` in the time of a driver who goes by limits and bends, from a standstill to one, and drive both."""
    known = true_fuel_map(car) if fuel_map is None else fuel_map
    road = road_ahead(route, road_map)
    reference = _by_limits(route, float(road.s[-1]))
    duration = float(reference.time[-1])
    advice = plan_route_in_time(
        road, known, car, start_speed=0.0, end_speed=0.0, trip_time=duration, step=10.0, policy_step=50.0, certify=False
    )
    return _compared(name, car, reference, _sampled(advice, 0.0, duration), route, 0)


def _moves(speed: Array) -> list[tuple[int, int]]:
    """First and last sample (both standing) of every move."""
    moving = np.concatenate([[False], speed > STILL, [False]])
    begins, ends = np.flatnonzero(moving[1:] & ~moving[:-1]), np.flatnonzero(~moving[1:] & moving[:-1])
    return [(max(int(a) - 1, 0), min(int(b), len(speed) - 1)) for a, b in zip(begins, ends, strict=True)]


def _planned_move(time: Array, speed: Array, known: FuelMap, car: Car) -> _Trace:
    s = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))])
    if s[-1] < SHORTEST:
        raise BadInput("move", f"{s[-1]:.0f} m", "long enough to plan")
    grid = np.linspace(0.0, s[-1], max(round(s[-1] / GRID), 4) + 1)
    limit = maximum_filter1d(np.interp(grid, s, speed), 2 * round(AROUND / GRID) + 1, mode="nearest")
    road = RoadAhead(grid, np.zeros_like(grid), limit, np.zeros_like(grid))
    duration = float(time[-1] - time[0])
    advice = plan_route_in_time(
        road, known, car, start_speed=0.0, end_speed=0.0, trip_time=duration, step=2.0 * GRID, policy_step=50.0,
        certify=False,
    )  # fmt: skip
    return _sampled(advice, float(time[0]), duration)


def _sampled(advice: Advice, begin: float, duration: float) -> _Trace:
    """The plan over time. The energy is linear over a stage, so the speed is linear in time."""
    at = np.arange(0.0, duration, TICK)
    # The plan's time is within a thousandth of what was asked for.
    plan_time = (advice.time - advice.time[0]) * duration / advice.trip_time
    held = np.clip(np.searchsorted(plan_time, at, side="right") - 1, 0, len(plan_time) - 1)
    speed = np.interp(at, plan_time, advice.speed) * advice.trip_time / duration
    return _Trace(begin + at, speed, np.maximum(advice.gear[held], 1).astype(float))


def _standing(begin: float, end: float) -> _Trace:
    at = np.arange(begin, end, TICK)
    return _Trace(at, np.zeros(len(at)), np.zeros(len(at)))


def _by_limits(route: Route, length: float) -> _Trace:
    """A driver who launches at 1.2 m/s2, holds the limit on his dial or what bends allow, and brakes in time."""
    s = route.s - route.s[0]
    square = speed_cap(replace(route, speed_limit=route.speed_limit / SPEEDOMETER), COMFORT, LAUNCH) ** 2
    square = np.minimum(square, 2.0 * LAUNCH * np.maximum(length - s, 0.0))
    square[0] = 0.0
    for i in range(1, len(s)):
        square[i] = min(square[i], square[i - 1] + 2.0 * LAUNCH * (s[i] - s[i - 1]))
    use = s <= length
    s, v = np.append(s[use], length), np.append(np.sqrt(square[use]), 0.0)
    mean = np.maximum(0.5 * (v[1:] + v[:-1]), 1e-3)
    time = np.concatenate([[0.0], np.cumsum(np.diff(s) / mean)])
    at = np.arange(0.0, time[-1], TICK)
    return _Trace(np.append(at, time[-1]), np.interp(np.append(at, time[-1]), time, v), np.empty(0))


def _compared(name: str, car: Car, reference: _Trace, plan: _Trace, route: Route | None, kept: int) -> OpenLoop:
    parameters = plant_parameters(car, {})

    def driven(trace: _Trace, gear: Array | None) -> dict[str, Array]:
        at = np.arange(0.0, trace.time[-1] - trace.time[0], TICK)
        speed = np.interp(at, trace.time - trace.time[0], trace.speed)
        pitch = None
        if route is not None:
            pitch = np.interp(route.s[0] + np.cumsum(speed) * TICK, route.s, route.pitch)
        return replay(parameters, at, speed, gear, pitch, every=1)

    def spent(channels: dict[str, Array], name: str) -> float:
        return float(channels[name][-1] - channels[name][0])

    own, by_speed = driven(reference, None), driven(plan, None)
    at = np.arange(0.0, plan.time[-1] - plan.time[0], TICK)
    held = np.clip(np.searchsorted(plan.time - plan.time[0], at + 1e-9, side="right") - 1, 0, len(plan.time) - 1)
    gears = plan.gear[held]
    as_before = own["gear"][np.clip(np.searchsorted(own["time"], at), 0, len(own["time"]) - 1)]
    planned = driven(plan, np.where(np.isnan(gears), as_before, gears))
    return OpenLoop(
        name=name,
        distance=spent(own, "distance"),
        time=spent(own, "time"),
        reference_fuel=spent(own, "fuel_energy"),
        planned_fuel=spent(planned, "fuel_energy"),
        planned_speed_fuel=spent(by_speed, "fuel_energy"),
        distance_difference=spent(planned, "distance") / spent(own, "distance") - 1.0,
        kept=kept,
    )
