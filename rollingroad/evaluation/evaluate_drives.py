"""The units of an evaluation: one drive each, pure, JSON in and JSON out (`engine.run_units` runs them anywhere).

A unit's arguments hold the scenario itself, not its name, and a digest of what else it reads: they are its address.
What is learnt from the baseline's drive (the map) is not passed along but made again in each process that needs it,
once per seed: a tenth of a megabyte per unit is dearer than a drive per process.
"""

import hashlib
import json
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from controller.advice import Advice
from controller.drive_table import fuel_power
from controller.route import Comfort
from observer.efficiency_map import FuelMap
from observer.observe import observe
from rollingroad.arrows import (
    ADVICE_BEGINS,
    Mapped,
    assert_same_until_advice,
    consumption,
    first_prices,
    fitted,
    map_found,
    sense,
    trip_efficiency,
)
from rollingroad.evaluation.evaluate_advisors import advisor, at_price, plan
from rollingroad.task import Task
from scenarios.files import parse
from sim.advisor import Advisor, Context
from sim.drive import drive
from sim.drive_record import Drive
from sim.full_load import enriched
from sim.network import build
from sim.road_ahead import road_ahead
from sim.shift_habit import gears_are_worth_telling
from sim.true_efficiency import true_efficiency
from sim.truth import true_fuel_map
from vehicle_model.car.files import read_car
from vehicle_model.car.parameters import Car
from vehicle_model.car.trip import Trip

Arguments = dict[str, Any]
SLOWED = 3.0
"""Times the price of the plan to begin the search with: traffic makes every drive slower than its plan."""
KEPT = 64
"""Seeds whose baseline a process keeps in mind."""


def arguments(task: Task, car: str, baseline: str) -> Arguments:
    """What a unit needs to know of `task`, driven by the baseline driver `baseline`; `car` is its name or file."""
    scenario = task.scenario.model_copy(
        update={"driver": task.scenario.driver.model_copy(update={"kind": baseline}), "car": car}
    )
    return {
        "scenario": scenario.model_dump(mode="json", by_alias=True, exclude={"source"}, exclude_none=True),
        "source": str(scenario.source or scenario.name),
        "car": car,
        "seed": task.seed,
        "files": {path: _digest(path) for path in (car, scenario.road.osm or "") if Path(path).is_file()},
    }


def baseline_drive(task: Arguments) -> dict[str, Any]:
    """The baseline driver alone. Returns the account of `account`, and the price of time (W) to begin with."""
    before = _known(json.dumps(task, sort_keys=True))
    return before.account | {"first_price": before.first_price}


def advised_drive(task: Arguments, advisor_name: str, knowledge: str, price: float, perfect: bool) -> dict[str, Any]:
    """The same driver in the same traffic with advice at `price` (W); returns the account of `account`.

    `knowledge` "estimated" (the map found from the baseline's own drive) or "true"; `perfect`: he follows exactly.
    Raises AssertionError where the two drives differ before the first advice.
    """
    before = _known(json.dumps(task, sort_keys=True))
    known = at_price(before.knowledge, price)
    if knowledge == "true":
        known = replace(known, fuel_map=before.true_map)
    if perfect:  # one who does at once what he is told is told everything
        known = replace(known, delay=0.0, tells_gears=True)
    driven = _drive(before.task, advisor(advisor_name, known), perfect)
    assert_same_until_advice(before.baseline, driven)
    return account(driven, before.task.car)


def planned_losses(task: Arguments, price: float) -> dict[str, float]:
    """What map and planner lose on the empty road at `price` (W), J: `estimation`, `fit` and `optimiser`.

    Each is the difference in fuel + price x time, both by the true map, between two plans: with the estimated map and
    with the true values in the same cells under the same form of fit (estimation); that and the true map (fit); the
    true map on the planner's grid and on one with half the step and twice the speeds (optimiser). At one price that is
    the fuel lost at equal time, to first order in the difference of time.
    """
    before = _known(json.dumps(task, sort_keys=True))
    truth, known = before.true_map, at_price(before.knowledge, price)

    def cost(fuel_map: FuelMap, fine: bool = False) -> float:
        found = plan(replace(known, fuel_map=fuel_map), fine=fine)
        return true_fuel(found, truth, known.car) + price * found.trip_time

    estimated, through_fit = cost(known.fuel_map), cost(before.map_of_the_truth)
    true, best = cost(truth), cost(truth, fine=True)
    return {"estimation": estimated - through_fit, "fit": through_fit - true, "optimiser": true - best}


def account(driven: Drive, car: Car) -> dict[str, Any]:
    """What a drive cost (J, s, m) and how safe it was. Raises RuntimeError where it did not arrive."""
    if not driven.arrived:
        raise RuntimeError(f"did not arrive within {driven.simulated_s:.0f} s of simulation")
    cost = consumption(driven, car)
    ttc = driven.min_time_to_collision
    return {
        "fuel": cost.fuel,
        "time": cost.time,
        "distance": cost.distance,
        "end_energy": cost.end_energy,
        "efficiency": trip_efficiency(driven.trip),
        "limit_violations": driven.limit_violations,
        "min_time_to_collision": ttc if math.isfinite(ttc) else None,
        "harsh_braking": driven.harsh_braking,
        "collisions": driven.collisions,
        "red_lights_run": driven.red_lights_run,
        "advised_share": driven.advised_share,
        "simulated_s": driven.simulated_s,
    }


@dataclass(frozen=True)
class _Before:
    """What a baseline drive leaves behind for the advised ones."""

    task: Task
    account: dict[str, Any]
    baseline: Drive
    """Without its trip, which is large."""
    knowledge: Context
    """With the map found."""
    true_map: FuelMap
    map_of_the_truth: FuelMap
    """The true efficiency in the cells that were found, through the same fit."""
    first_price: float


@lru_cache(maxsize=KEPT)
def _known(key: str) -> _Before:
    asked = json.loads(key)
    task = Task(parse(asked["scenario"], Path(asked["source"])), read_car(asked["car"]), asked["seed"])
    baseline = _drive(task, None, False)
    cost = account(baseline, task.car)
    sensed = sense(task, baseline)
    estimate = observe(sensed.log, task.car, sensed.road_map)
    learnt = map_found([estimate], task.car)
    road = road_ahead(baseline.route, sensed.road_map)
    speeds = baseline.trip.channels["speed"]
    known = Context(
        road=road,
        fuel_map=enriched(learnt.fuel_map),
        car=task.car,
        start_speed=float(speeds[0]),
        end_speed=float(speeds[-1]),
        begin=ADVICE_BEGINS,
        tells_gears=gears_are_worth_telling(estimate, learnt.fuel_map, task.car),
    )
    price, _ = first_prices(road, learnt.fuel_map, task.car, baseline.trip)
    return _Before(
        task=task,
        account=cost,
        baseline=replace(baseline, trip=None),  # type: ignore[arg-type]
        knowledge=known,
        true_map=true_fuel_map(task.car, task.plant_settings),
        map_of_the_truth=enriched(map_of_the_truth(learnt, [baseline.trip], task).fuel_map),
        first_price=SLOWED * price,
    )


def _drive(task: Task, advisor: Advisor | None, perfect: bool) -> Drive:
    with tempfile.TemporaryDirectory(prefix="evaluate-") as folder:
        network = build(task.scenario, Path(folder))
        return drive(task.scenario, task.car, task.seed, advisor=advisor, network=network, perfect=perfect)


def map_of_the_truth(learnt: Mapped, trips: Sequence[Trip], task: Task) -> Mapped:
    """`learnt` with the true efficiency (gears weighted by `trips`) in its valid cells, through the same fit."""
    found = learnt.efficiency_map
    truth = true_efficiency(task.car, task.plant_settings, trips)
    values = truth(*np.meshgrid(found.engine_speed, found.torque, indexing="ij"))
    use = found.valid & np.isfinite(values)
    return fitted(replace(found, mean=np.where(use, values, found.mean)), task.car)


def true_fuel(advice: Advice, truth: FuelMap, car: Car) -> float:
    """J that the plan burns on the true map: each stage at its mean speed, gear changes as the planner prices them."""
    ratio = np.array([0.0, *car.gear_ratios]) / car.wheel_radius
    gear, torque, off = advice.gear[:-1], advice.torque[:-1], advice.coasting[:-1]
    speed = 0.5 * (advice.speed[1:] + advice.speed[:-1])
    omega = np.clip(ratio[gear] * speed, truth.idle_speed, truth.engine_speed[-1])
    overrun = np.interp(omega, truth.engine_speed, truth.overrun_torque)
    driving = fuel_power(truth, omega, np.maximum(torque, overrun), overrun)
    power = np.where(gear == 0, truth.idle_power, np.where(off, 0.0, driving))
    on = gear[(gear > 0) & ~off]
    changes = int(np.count_nonzero(on[1:] != on[:-1]))
    return float(np.sum(power * np.diff(advice.time))) + Comfort().shift_energy * changes


def _digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]
