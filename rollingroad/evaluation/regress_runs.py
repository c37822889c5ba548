"""The regression suite's unit: one scenario through the chain, once with advice at the plan's own price of time."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from observer.observe import observe
from rollingroad.arrows import (
    assert_same_until_advice,
    consumption,
    drive_scenario,
    first_prices,
    map_found,
    plan_drive,
    sense,
)
from rollingroad.evaluation.scores import observer_scores, outage_seconds
from rollingroad.products import judged_map
from rollingroad.task import make_task
from scenarios.schema import Expectations
from sim.network import build
from sim.road_ahead import road_ahead
from sim.true_efficiency import true_efficiency
from vehicle_model.car.route import TUNNEL

LITRE_100KM = 1e5
"""m."""


def _share(part: float | None, whole: float | None) -> float | None:
    return None if part is None or not whole else part / whole


def regression_run(scenario: str) -> dict[str, Any]:
    """Run the scenario (name or file) under its own seed. Returns `metrics`, and the `broken` expectations.

    Two drives rather than the dozen of `run`: equal time is `evaluate`'s business, a change of behaviour shows in one.
    """
    task = make_task(scenario)
    with tempfile.TemporaryDirectory(prefix="regress-") as scratch:
        network = build(task.scenario, Path(scratch))
        baseline = drive_scenario(task, network)
        sensed = sense(task, baseline)
        estimate = observe(sensed.log, task.car, sensed.road_map)
        learnt = map_found([estimate], task.car)
        road = road_ahead(baseline.route, sensed.road_map)
        price, _ = first_prices(road, learnt.fuel_map, task.car, baseline.trip)
        plan = plan_drive(road, learnt.fuel_map, task.car, baseline.trip, price, certify=False)
        advised = drive_scenario(task, network, plan)
    assert_same_until_advice(baseline, advised)
    cost, with_advice = consumption(baseline, task.car), consumption(advised, task.car)
    scores = observer_scores(estimate, baseline.trip)
    rms = scores["thrust_rms_N"]
    found = judged_map(learnt, true_efficiency(task.car, task.plant_settings, [baseline.trip]))
    fused = estimate.records[estimate.records["fused"]]
    litre = 1e-3 * task.car.fuel.density * task.car.fuel.heating_value
    metrics = {
        "time_s": cost.time,
        "fuel_MJ": cost.fuel / 1e6,
        "distance_km": cost.distance / 1e3,
        "vehicles": baseline.vehicles,
        "thrust_error": _share(scores["thrust_rmse_N"], rms),
        "thrust_error_smoothed": _share(scores["thrust_rmse_smoothed_N"], rms),
        "efficiency_rmse": scores["efficiency_rmse"],
        "nis_per_dof": float(np.mean(fused["nis"])) if len(fused) else None,
        "events": sum(len(stream) for stream in sensed.log.streams.values()),
        "map_rmse": found["rmse"],
        "fit_rmse": found["fit_rmse"],
        "map_fuel_share": found["fuel_share"],
        "advised_time_s": with_advice.time,
        "advised_fuel_MJ": with_advice.fuel / 1e6,
        "planned_fuel_MJ": plan.trip_fuel / 1e6,
    }
    seen = metrics | {
        "fuel_l_per_100km": cost.fuel / litre / cost.distance * LITRE_100KM,
        "gps_outage_s": outage_seconds(baseline.trip, TUNNEL),
    }
    return {"metrics": metrics, "broken": broken(task.scenario.expectations, seen)}


def broken(expected: Expectations, seen: dict[str, Any]) -> list[dict[str, Any]]:
    """Expectations of the scenario file that `seen` does not meet: `metric`, the bound that `was` set, what `is`."""
    at_least, at_most = ("map_fuel_share",), ("thrust_error", "map_rmse")
    found = []
    for name in type(expected).model_fields:
        bound, value = getattr(expected, name), seen.get(name)
        if bound is None:
            continue
        low = bound if name in at_least else bound[0] if isinstance(bound, tuple) else None
        high = bound if name in at_most else bound[1] if isinstance(bound, tuple) else None
        missed = low if low is not None and (value is None or value < low) else None
        if missed is None and high is not None and (value is None or value > high):
            missed = high
        if missed is not None:
            found.append({"metric": f"expected {name}", "was": missed, "is": value})
    return found
