"""What a run leaves behind: the figures of `run --json`, and the files of the run folder."""

import platform
from collections.abc import Callable
from concurrent.futures import Executor, wait
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.advice import RoadAhead
from controller.advice_files import write_advice
from observer.efficiency_map import EfficiencyMap
from observer.estimate import Estimate
from observer.estimate_files import write_estimate
from observer.fit_form import Fit
from observer.fits import default_fit
from observer.mapping import fit_error, map_error
from observer.mapping import write as write_map
from observer.observe import observe
from rollingroad.arrows import Followed, Mapped, Sensed, consumption, map_found, sense
from rollingroad.evaluation.scores import observer_scores, outage_seconds
from rollingroad.folder import Stopwatch, write_json
from rollingroad.run import Run
from rollingroad.task import Task, described
from sensors.kml import write_kml
from sensors.packets import write_log
from sim.drive_record import Drive
from sim.network import Network
from sim.true_efficiency import true_efficiency
from vehicle_model.car.files import write_car
from vehicle_model.car.route import TUNNEL


@dataclass(frozen=True)
class Products:
    """All that one run made."""

    task: Task
    network: Network
    baseline: Drive
    sensed: Sensed
    estimate: Estimate
    learnt: Mapped
    road: RoadAhead
    advised: Followed
    oracle: Followed
    observe_s: float
    """Wall time of the observer, without compilation."""

    @property
    def events(self) -> int:
        """Packets that the observer was given."""
        streams = self.sensed.log.streams
        return sum(len(streams[name]) for name in streams)


def write_products(
    products: Products, part: Path, folder: Path, watch: Stopwatch, compiled: float, pool: Executor
) -> dict[str, Any]:
    """Write every file of the run into `part` (which becomes `folder`) and return the object of `run --json`.

    The second drive's files and the recording are written in `pool`, beside the report.
    `compiled` s of the wall time went into loading and compiling kernels; drives go on meanwhile, so it is not taken
    out of the real-time factor, which a first run therefore understates.
    """
    # Imported here: the drives need not wait for it.
    from rollingroad.viz.report import write_report

    task, learnt = products.task, products.learnt
    nearest = products.advised.comparison.nearest
    advised, advice = products.advised.drives[nearest], products.advised.advices[nearest]
    beside = [pool.submit(write_advised, task, advised, part / "advised")]
    try:
        write_car(task.car, part / "car.xml")
        products.sensed.road_map.write(part / "road")
        products.baseline.trip.write(part / "truth.parquet")
        write_log(part / "log.dat", products.sensed.card)
        write_estimate(products.estimate, part / "estimate.parquet")
        write_map(learnt.efficiency_map, part, dict(learnt.fits))
        write_advice(advice, part / "advice.parquet")
        write_kml(products.baseline.trip, part / "trip.kml")

        results = figures(products, folder, watch, compiled)
        found = learnt.efficiency_map
        truth = true_efficiency(task.car, task.plant_settings, [products.baseline.trip])
        omega, torque = np.meshgrid(found.engine_speed, found.torque, indexing="ij")
        run = Run(
            results=results,
            car=task.car,
            route=products.baseline.route,
            baseline=products.baseline.trip,
            advised=advised.trip,
            log=products.sensed.log,
            estimate=products.estimate,
            efficiency_map=found,
            fits=learnt.fits,
            advice=advice,
            true_efficiency=truth(omega, torque),
            road_ahead=products.road,
            folder=part,
        )
        beside.append(pool.submit(record_run, run, part / "run.rrd"))
        write_report(run, part / "report.html")
        for written in beside:
            written.result()
    finally:
        wait(beside)  # on a failure `part` is removed: nobody may still be writing there
    watch.lap("report")
    final = figures(products, folder, watch, compiled)
    write_json(part / "run.json", final)
    return final


def figures(products: Products, folder: Path, watch: Stopwatch, compiled: float) -> dict[str, Any]:
    """The object of `run --json` (CLI.md); keys that do not apply are None."""
    task, baseline, advised = products.task, products.baseline, products.advised
    cost, compared = consumption(baseline, task.car), advised.comparison
    drives = [baseline, *advised.drives, *products.oracle.drives]
    simulated = sum(drive.simulated_s for drive in drives)
    total = watch.total
    nearest = advised.drives[compared.nearest]
    return {
        "scenario": task.scenario.name,
        "car": task.car.name,
        "seed": task.seed,
        "distance_m": cost.distance,
        "vehicles": round(baseline.vehicles),
        "baseline": {"fuel_J": cost.fuel, "time_s": cost.time},
        "advised": {
            "fuel_J": compared.fuel,
            "time_s": cost.time if compared.fuel is not None else consumption(nearest, task.car).time,
            "gears_told": products.advised.gears_told,
        },
        "saving_percent": compared.saving_percent,
        "saving_ci95": None,
        "time_difference_percent": compared.time_difference_percent,
        "naive_saving_percent": compared.naive_saving_percent,
        "oracle_saving_percent": products.oracle.comparison.saving_percent,
        "observer": observer_figures(products),
        "map": map_figures(products),
        "wall_s": {**watch.stages, "compile": compiled, "total": total},
        "real_time_factor": simulated / max(total, 1e-9),
        "files": {
            "report": str(folder / "report.html"),
            "recording": str(folder / "run.rrd"),
            "track": str(folder / "trip.kml"),
        },
        "settings": dict(task.settings),
        "log_damage": dict(products.sensed.log.damage),
        "notes": list(dict.fromkeys([*products.network.notes, *baseline.notes])),
        "versions": versions(),
        "task": described(task),
    }


def record_run(run: Run, path: Path) -> None:
    """Write the recording of `run`."""
    from rollingroad.viz.recording import write_recording

    write_recording(run, path)


def write_advised(task: Task, advised: Drive, folder: Path) -> None:
    """Write the second drive's files: its truth, its log, what the observer and the map make of it."""
    folder.mkdir()
    sensed = sense(task, advised)
    estimate = observe(sensed.log, task.car, sensed.road_map)
    learnt = map_found([estimate], task.car)
    advised.trip.write(folder / "truth.parquet")
    write_log(folder / "log.dat", sensed.card)
    write_estimate(estimate, folder / "estimate.parquet")
    write_map(learnt.efficiency_map, folder, dict(learnt.fits))


def observer_figures(products: Products) -> dict[str, Any]:
    """The "observer" part of the results: errors against the truth, consistency, cost."""
    estimate, trip = products.estimate, products.baseline.trip
    records = estimate.records
    fused = records[records["fused"]]
    kinds, lost = np.unique(records["kind"][~records["fused"]], return_counts=True)
    return {
        "events": products.events,
        **observer_scores(estimate, trip),
        "nis_mean_per_dof": float(np.mean(fused["nis"])) if len(fused) else None,
        "microseconds_per_event": 1e6 * products.observe_s / max(products.events, 1),
        "gps_outage_s": outage_seconds(trip, TUNNEL),
        "rejected": {str(kind): int(count) for kind, count in zip(kinds, lost, strict=True)},
    }


def map_figures(products: Products) -> dict[str, Any]:
    """The "map" part of the results, judged against the true map of the same trip."""
    truth = true_efficiency(products.task.car, products.task.plant_settings, [products.baseline.trip])
    return judged_map(products.learnt, truth)


def judged_map(learnt: Mapped, truth: Callable[[NDArray, NDArray], NDArray] | None) -> dict[str, Any]:
    """The "map" object of `run --json`; errors are None without a truth (a real car's logs)."""
    found, fit = learnt.efficiency_map, default_fit(dict(learnt.fits))
    cells = int(found.valid.sum())
    known = truth if cells else None
    return {
        "cells": cells,
        "fuel_share": found.fuel_share,
        "rmse": None if known is None else map_error(found, known),
        "fit": fit.name,
        "fit_rmse": None if known is None else fit_error(found, fit, known),
        "r2": fit.r2,
        "peak_value_error": None if known is None else peak_value_error(found, fit, known),
    }


def peak_value_error(found: EfficiencyMap, fit: Fit, truth: Callable[[NDArray, NDArray], NDArray]) -> float:
    """Efficiency found minus true efficiency, both at the place of the found peak (valid cells, by the fit)."""
    omega, torque = np.meshgrid(found.engine_speed, found.torque, indexing="ij")
    omega, torque = omega[found.valid], torque[found.valid]
    value = fit.efficiency(omega, torque)
    peak = int(np.argmax(value))
    return float(value[peak] - truth(omega[peak : peak + 1], torque[peak : peak + 1])[0])


def versions() -> dict[str, str]:
    """Versions of what the result depends on."""
    names = ("rollingroad", "libsumo", "numpy", "scipy", "numba")
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in names}}
