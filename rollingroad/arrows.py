"""The arrows of the chain: each is a function that takes data and returns data (`chain` joins them)."""

import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controller.advice import Advice, RoadAhead
from controller.route import plan_route, plan_route_in_time
from observer.efficiency_map import EfficiencyMap, FuelMap
from observer.estimate import Estimate
from observer.fit_form import Fit
from observer.fits import fit_all, planner_fit
from observer.mapping import fuel_map, map_engine
from rollingroad.evaluation.compare import Comparison, Consumption, compare, search_bracket
from rollingroad.task import Task
from rollingroad.workers import Inline
from sensors.box import box_settings, record
from sensors.log import SensorLog
from sensors.packets import decode
from sensors.roadmap import RoadMap, from_route
from sim.advisor import DELAY, AdviceFollower
from sim.drive import drive
from sim.drive_record import Drive
from sim.full_load import enriched
from sim.network import Network
from sim.road_ahead import road_ahead
from sim.shift_habit import gears_are_worth_telling
from sim.truth import true_fuel_map
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car
from vehicle_model.car.trip import Trip

ADVICE_BEGINS = 50.0
"""m: silent before, so that both drives can be shown to be one and the same until advice is given."""
PLAN_STEP = 10.0
"""m between the places of the plan and of the policy around it."""
HASTE = 10.0
"""Ratio of the first two prices of time that are driven at."""
FIRST_PRICE = 8_000.0
"""W: a price of time to begin with where the plan gives none."""


@dataclass(frozen=True)
class Sensed:
    """A trip as the box saw it: the card's bytes, what the reader makes of them, and the road map on board."""

    card: bytes
    log: SensorLog
    road_map: RoadMap


@dataclass(frozen=True)
class Mapped:
    """What was learnt of the engine."""

    efficiency_map: EfficiencyMap
    fits: Mapping[str, Fit]
    fuel_map: FuelMap


@dataclass(frozen=True)
class Followed:
    """Drives with advice at several prices of time, and how they compare with the baseline."""

    drives: Sequence[Drive]
    advices: Sequence[Advice]
    comparison: Comparison
    gears_told: bool = True
    """Whether the driver was told gears too."""


def drive_scenario(
    task: Task, network: Network, advice: Advice | None = None, *, perfect: bool = False, tells_gears: bool = True
) -> Drive:
    """The arrow `drive`: the task's car in the task's traffic, with or without advice. Runs in a worker."""
    advisor = (
        None
        if advice is None
        else AdviceFollower(advice, begin=ADVICE_BEGINS, delay=0.0 if perfect else DELAY, tells_gears=tells_gears)
    )
    return drive(task.scenario, task.car, task.seed, advisor=advisor, network=network, perfect=perfect)


def sensed_card(task: Task, trip: Trip) -> bytes:
    """What the logger writes on its card during `trip`."""
    return record(trip, task.car, box_settings(task.scenario.sensors, task.settings), task.seed)


def sense(task: Task, truth: Drive, card: bytes | None = None) -> Sensed:
    """The arrow `sense`: what the logger writes on its card (or wrote: `card`), and what the reader makes of it."""
    card = sensed_card(task, truth.trip) if card is None else card
    return Sensed(card, decode(card), road_map_on_board(task, truth))


def road_map_on_board(task: Task, truth: Drive) -> RoadMap:
    """The map of the route as the quad-tile files hold it, rounding and all: a run folder gives the same bits."""
    road_map = from_route(truth.route, task.seed, box_settings(task.scenario.sensors, task.settings))
    with tempfile.TemporaryDirectory(prefix="rollingroad-") as folder:
        road_map.write(Path(folder))
        return RoadMap.read(Path(folder))


def map_found(estimates: Sequence[Estimate], car: Car) -> Mapped:
    """The arrow `map_engine`: the grid, its fits, and the planner's table, of one or more trips."""
    return fitted(map_engine(estimates, car), car)


def fitted(found: EfficiencyMap, car: Car) -> Mapped:
    """A grid with its fits and the planner's table."""
    fits = fit_all(found, car)
    return Mapped(found, fits, fuel_map(found, car, planner_fit(fits)))


def consumption(truth: Drive, car: Car, price: float = 0.0) -> Consumption:
    """What a drive cost, by the truth."""
    c = truth.trip.channels
    return Consumption(
        fuel=float(c["fuel_energy"][-1] - c["fuel_energy"][0]),
        time=float(c["time"][-1] - c["time"][0]) - truth.parked_s,
        distance=float(c["distance"][-1] - c["distance"][0]),
        end_energy=0.5 * car.accelerated_mass * float(c["speed"][-1]) ** 2,
        price=price,
    )


def trip_efficiency(trip: Trip) -> float:
    """Work done by the engine at the wheels over fuel burnt: what a joule stored in the car is worth in fuel."""
    c = trip.channels
    work = float(np.sum(np.maximum(c["thrust"] * c["speed"], 0.0)) * trip.step)
    return work / float(c["fuel_energy"][-1] - c["fuel_energy"][0])


def plan_drive(
    road: RoadAhead, table: FuelMap, car: Car, baseline: Trip, price: float, *, certify: bool = True
) -> Advice:
    """The arrow `plan`: the optimal drive from the first to the last speed of `baseline`, a second worth `price`, W."""
    speeds = baseline.channels["speed"]
    return plan_route(
        road,
        table,
        car,
        start_speed=float(speeds[0]),
        end_speed=float(speeds[-1]),
        time_value=price,
        step=PLAN_STEP,
        policy_step=PLAN_STEP,
        certify=certify,
    )


def first_prices(road: RoadAhead, table: FuelMap, car: Car, baseline: Trip) -> tuple[float, float]:
    """Two prices of time, W: the one at which the plan takes as long as the baseline was on the move, and a high one.

    Traffic makes every drive slower than its plan, so the price that holds the baseline's time lies above the first.
    """
    c = baseline.channels
    moving = float(np.count_nonzero(c["speed"] > 0.3) * baseline.step)
    start, end = float(c["speed"][0]), float(c["speed"][-1])
    try:
        plan = plan_route_in_time(
            road, table, car, start_speed=start, end_speed=end, trip_time=moving, policy_step=None, certify=False
        )
        price = plan.time_value
    except BadInput:  # the baseline was faster or slower than the plan can be
        price = FIRST_PRICE
    return price, HASTE * price


def follow(
    pool: Executor,
    task: Task,
    network: Network,
    baseline: Drive,
    road: RoadAhead,
    table: FuelMap,
    prices: tuple[float, float],
    *,
    perfect: bool = False,
    tells_gears: bool = True,
) -> Followed:
    """The arrows `plan` and `drive` again, at prices of time that bracket the baseline's trip time, then `compare`.

    `tells_gears`: whether the driver is told gears too (`sim.shift_habit.gears_are_worth_telling`).
    """
    cost = consumption(baseline, task.car)
    drives: list[Drive] = []
    advices: list[Advice] = []

    def at(prices: Sequence[float]) -> list[Consumption]:
        plans = [plan_drive(road, table, task.car, baseline.trip, price) for price in prices]
        pending = [
            pool.submit(drive_scenario, task, network, plan, perfect=perfect, tells_gears=tells_gears) for plan in plans
        ]
        done = [future.result() for future in pending]
        for advised in done:
            assert_same_until_advice(baseline, advised)
        drives.extend(done)
        advices.extend(plans)
        return [consumption(advised, task.car, price) for advised, price in zip(done, prices, strict=True)]

    costs = search_bracket(at, cost.time, prices)
    return Followed(drives, advices, compare(cost, costs, trip_efficiency(baseline.trip)), tells_gears)


def follow_what_was_learnt(
    pool: Executor,
    task: Task,
    network: Network,
    baseline: Drive,
    road: RoadAhead,
    estimate: Estimate,
    found: FuelMap,
    prices: tuple[float, float],
) -> Followed:
    """`follow` on the map `found`, rich near full load; gears are told where the drive of `estimate` wasted by them."""
    told = gears_are_worth_telling(estimate, found, task.car)
    return follow(pool, task, network, baseline, road, enriched(found), prices, tells_gears=told)


def assert_same_until_advice(baseline: Drive, advised: Drive) -> None:
    """Both drives are one and the same, bit by bit, until the first advice is given: else nothing is compared."""
    first = len(advised.step_hashes) if advised.first_advice_step is None else advised.first_advice_step
    if not np.array_equal(baseline.step_hashes[:first], advised.step_hashes[:first]):
        raise AssertionError("the advised drive departed from the baseline's before any advice was given")


def follow_as_oracle(task: Task, network: Network, baseline: Drive) -> Followed:
    """`follow` on the true map with a perfect driver, all in this process: it needs nothing of what is observed."""
    table = true_fuel_map(task.car, task.plant_settings)
    road = road_ahead(baseline.route, road_map_on_board(task, baseline))
    prices = first_prices(road, table, task.car, baseline.trip)
    return follow(Inline(), task, network, baseline, road, table, prices, perfect=True)
