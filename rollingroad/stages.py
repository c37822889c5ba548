"""The arrows one at a time, from files to files in a run folder: what `run` does at once, in pieces."""

import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from controller.advice_files import write_advice
from observer.estimate_files import read_estimate, write_estimate
from observer.mapping import read as read_map
from observer.mapping import write as write_map
from observer.observe import observe
from rollingroad.arrows import (
    drive_scenario,
    first_prices,
    follow_as_oracle,
    follow_what_was_learnt,
    map_found,
    plan_drive,
    sense,
    sensed_card,
)
from rollingroad.arrows import fitted as fit_map
from rollingroad.folder import Stopwatch, whole_folder, write_json
from rollingroad.products import Products, judged_map, write_products
from rollingroad.task import Task, described
from rollingroad.workers import executor
from scenarios.files import parse
from sensors.packets import read_log, write_log
from sensors.roadmap import RoadMap
from sim.full_load import enriched
from sim.network import build
from sim.road_ahead import road_ahead
from sim.route import true_route
from sim.true_efficiency import true_efficiency
from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car, write_car
from vehicle_model.car.trip import Trip


def read_task(run: Path) -> Task:
    """The task of a run folder. Raises BadInput where run.json or car.xml is missing or damaged."""
    place = run / "run.json"
    try:
        kept = json.loads(place.read_text())["task"]
        scenario = parse(kept["scenario"], Path(kept["source"]))
        return Task(scenario, read_car(run / "car.xml"), int(kept["seed"]))
    except FileNotFoundError:
        raise BadInput(place, "", "expected a run folder, which `rollingroad drive` or `run` makes") from None
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(place, "task", f"expected what `rollingroad drive` or `run` writes ({error})") from None


def begin(task: Task, folder: Path) -> None:
    """The arrow `drive`: begin a run folder with the truth, the car and the road map."""
    with tempfile.TemporaryDirectory(prefix="rollingroad-") as scratch, whole_folder(folder) as part:
        driven = drive_scenario(task, build(task.scenario, Path(scratch)))
        write_car(task.car, part / "car.xml")
        driven.trip.write(part / "truth.parquet")
        sense(task, driven).road_map.write(part / "road")
        write_json(part / "run.json", {"task": described(task)})


def sense_run(run: Path) -> None:
    """The arrow `sense`: truth.parquet to log.dat."""
    task = read_task(run)
    write_log(run / "log.dat", sensed_card(task, Trip.read(_needed(run, "truth.parquet", "drive"))))


def observe_run(run: Path) -> None:
    """The arrow `observe`: log.dat, car.xml and road/ to estimate.parquet."""
    log = read_log(_needed(run, "log.dat", "sense"))
    road_map = RoadMap.read(run / "road") if (run / "road").is_dir() else None
    write_estimate(observe(log, read_car(_needed(run, "car.xml", "drive")), road_map), run / "estimate.parquet")


def map_runs(runs: Sequence[Path], out: Path) -> dict[str, Any]:
    """The arrow `map`: the estimates of one or more runs of one car to map.json and map.parquet in `out`.

    Returns the `map` object of `run --json`; errors are None where a run holds no truth (a real car's).
    """
    car = read_car(_needed(runs[0], "car.xml", "drive"))
    estimates = []
    for run in runs:
        other = read_car(_needed(run, "car.xml", "drive"))
        if (other.engine, other.gear_ratios) != (car.engine, car.gear_ratios):
            raise BadInput(run, "car.xml", f"expected the car of {runs[0]}: maps of different engines do not merge")
        estimates.append(read_estimate(_needed(run, "estimate.parquet", "observe")))
    learnt = map_found(estimates, car)
    write_map(learnt.efficiency_map, out, dict(learnt.fits))
    truths = [run / "truth.parquet" for run in runs]
    if not all(path.is_file() for path in truths):
        return judged_map(learnt, None)
    settings = read_task(runs[0]).plant_settings
    return judged_map(learnt, true_efficiency(car, settings, [Trip.read(path) for path in truths]))


def plan_run(run: Path) -> None:
    """The arrow `plan`: the run's map and road to advice.parquet."""
    task = read_task(run)
    _needed(run, "map.json", "map")
    trip = Trip.read(_needed(run, "truth.parquet", "drive"))
    table = fit_map(read_map(run), task.car).fuel_map
    with tempfile.TemporaryDirectory(prefix="rollingroad-") as scratch:
        route = true_route(build(task.scenario, Path(scratch)))
    road = road_ahead(route, RoadMap.read(run / "road"))
    price, _ = first_prices(road, table, task.car, trip)
    advice = plan_drive(road, enriched(table), task.car, trip, price)
    write_advice(advice, run / "advice.parquet")


def compare_run(
    run: Path, *, workers: int | None = None, tell: Callable[[str], None] = lambda text: None
) -> dict[str, Any]:
    """The arrow `compare`: drive again with advice on the run's own estimate, and complete the folder.

    Returns the object of `run --json`. The baseline is driven once more: same seed, same bits.
    """
    watch = Stopwatch()
    task = read_task(run)
    estimate_file, log_file = _needed(run, "estimate.parquet", "observe"), _needed(run, "log.dat", "sense")
    _needed(run, "map.json", "map")
    with tempfile.TemporaryDirectory(prefix="rollingroad-") as scratch, executor(workers) as pool:
        network = build(task.scenario, Path(scratch))
        tell("driving, as the baseline driver does")
        baseline = pool.submit(drive_scenario, task, network).result()
        began = perf_counter()
        sensed = sense(task, baseline, card=log_file.read_bytes())
        estimate = read_estimate(estimate_file)
        learnt = fit_map(read_map(run), task.car)
        observe_s = perf_counter() - began
        road = road_ahead(baseline.route, sensed.road_map)
        prices = first_prices(road, learnt.fuel_map, task.car, baseline.trip)
        tell("driving again, with advice")
        advised = follow_what_was_learnt(pool, task, network, baseline, road, estimate, learnt.fuel_map, prices)
        tell("driving again, as the oracle would")
        oracle = follow_as_oracle(task, network, baseline)
        watch.lap("drive")
        products = Products(task, network, baseline, sensed, estimate, learnt, road, advised, oracle, observe_s)
        with whole_folder(run) as part:
            return write_products(products, part, run, watch, 0.0, pool)


def _needed(run: Path, name: str, arrow: str) -> Path:
    path = run / name
    if not path.is_file():
        raise BadInput(path, "", f"expected the file that `rollingroad {arrow}` writes")
    return path
