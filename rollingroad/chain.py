"""The chain, readable from top to bottom: drive, sense, observe, map, plan, drive again with advice, compare."""

import tempfile
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from queue import SimpleQueue
from time import perf_counter
from typing import Any

from observer.observe import observe
from rollingroad.arrows import drive_scenario, first_prices, follow_as_oracle, follow_what_was_learnt, map_found, sense
from rollingroad.folder import Stopwatch, whole_folder
from rollingroad.products import Products, write_products
from rollingroad.task import Task
from rollingroad.warm_up import warm_up_observer, warm_up_planner
from rollingroad.workers import executor
from sim.network import build
from sim.road_ahead import road_ahead


def run_chain(
    task: Task, folder: Path, *, workers: int | None = None, tell: Callable[[str], None] = lambda text: None
) -> dict[str, Any]:
    """Join all arrows once, write the run folder, and return the object of `run --json`.

    Drives run in `workers` processes (one per core by default; 0: in this one). Raises BadInput; on any failure
    nothing is left at `folder`.
    """
    watch = Stopwatch()
    with tempfile.TemporaryDirectory(prefix="rollingroad-") as scratch, executor(workers) as pool:
        tell("building the road")
        network = build(task.scenario, Path(scratch))
        tell("driving, as the baseline driver does")
        pending = pool.submit(drive_scenario, task, network)
        # The oracle waits for nothing but the baseline: it drives while the kernels compile here.
        oracle_started: SimpleQueue[Future] = SimpleQueue()

        def start_oracle(done: Future) -> None:
            if not done.exception():
                oracle_started.put(pool.submit(follow_as_oracle, task, network, done.result()))

        pending.add_done_callback(start_oracle)
        pool.submit(warm_up_planner)
        warm_up_observer()
        compiled = watch.total
        baseline = pending.result()
        watch.lap("drive")

        tell("sensing and observing")
        sensed = sense(task, baseline)
        began = perf_counter()
        estimate = observe(sensed.log, task.car, sensed.road_map)
        observe_s = perf_counter() - began
        watch.lap("observe")

        tell("mapping the engine and planning")
        learnt = map_found([estimate], task.car)
        road = road_ahead(baseline.route, sensed.road_map)
        prices = first_prices(road, learnt.fuel_map, task.car, baseline.trip)
        watch.lap("plan")

        tell("driving again, with advice")
        advised = follow_what_was_learnt(pool, task, network, baseline, road, estimate, learnt.fuel_map, prices)
        tell("driving again, as the oracle would")
        oracle = oracle_started.get().result()
        watch.lap("drive")

        tell("writing the report and the recording")
        products = Products(task, network, baseline, sensed, estimate, learnt, road, advised, oracle, observe_s)
        with whole_folder(folder) as part:
            results = write_products(products, part, folder, watch, compiled, pool)
    return results
