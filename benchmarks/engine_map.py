"""The engine map found in an hour of mixed driving, judged: errors, share, intervals, regret, dynamometer, scale.

`python -m benchmarks.engine_map [--first 0] [--hours 10] [--car smart] [--workers 2]`. An hour is four trips over
`mixed` (town, rural, motorway) with seeds of their own, default box, biases not carried over. Regret:
`benchmarks.regret`; the hours' is that of the planner's fit.
"""

import argparse
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.regret import END_SPEED, regret
from controller.advice import RoadAhead
from controller.route import plan_route_in_time
from observer.estimate import Estimate
from observer.fit_form import Fit
from observer.fit_willans import KernelFit
from observer.fits import default_fit, fit_all, planner_fit
from observer.mapping import centres, fit_error, fuel_map, map_engine, map_error
from observer.observe import observe
from rollingroad.arrows import drive_scenario, sense
from rollingroad.evaluation.dyno import compare_with_dyno
from rollingroad.task import make_task
from sim.bench_stand import dynamometer
from sim.network import build
from sim.road_ahead import road_ahead
from sim.true_efficiency import gear_shares, true_efficiency
from sim.truth import true_fuel_map
from vehicle_model.car.parameters import Car
from vehicle_model.car.trip import Trip

TRIPS = 4
RPM = np.pi / 30.0
SHOWN = ("eta total 2", "eta total 4", "eta full 2", "eta full 3", "eta full 4", "eta full 4 border", "eta full 4 cut",
         "eta printed 3", "phi total 2", "phi full 2", "phi full 4", "phi printed 4", "P_in total 2", "P_in full 2",
         "P_in full 3", "P_in full 4", "P_in printed 4", "P_in willans", "P_in willans+kernel",
         "P_in smooth", "P_in average")  # fmt: skip


def hour(arguments: tuple[str, int, bool]) -> tuple[list[Trip], list[Estimate], list[Estimate], RoadAhead]:
    """Four trips and their estimates; if wished, the first one's by car files 10 % off in C_rr, C_d A, or 2 % in the
    injectors."""
    car, number, by_wrong_files = arguments
    trips, estimates, wrong = [], [], []
    road: RoadAhead | None = None
    for seed in range(TRIPS * number, TRIPS * number + TRIPS):
        task = make_task("mixed", car=car, seed=seed)
        with tempfile.TemporaryDirectory() as folder:
            driven = drive_scenario(task, build(task.scenario, Path(folder)))
        seen = sense(task, driven)
        trips.append(driven.trip)
        estimates.append(observe(seen.log, task.car, seen.road_map))
        if road is None:
            road = road_ahead(driven.route, seen.road_map)
            files = wrong_cars(task.car) if by_wrong_files else []
            wrong = [observe(seen.log, other, seen.road_map) for other in files]
    assert road is not None
    return trips, estimates, wrong, road


def wrong_cars(car: Car) -> list[Car]:
    """Car files with the errors of 3.3.5."""
    injector = replace(car.injector, flow=1.02 * car.injector.flow)
    return [
        replace(car, rolling_resistance=1.1 * car.rolling_resistance),
        replace(car, drag_coefficient=1.1 * car.drag_coefficient),
        replace(car, injector=injector),
    ]


def regrets(fits: dict[str, Fit], found, car: Car, road: RoadAhead, time: float) -> dict[str, float | None]:
    """Relative regret of each of `fits`, None where the plan cannot be made.

    At the price of time at which the plan on the true map takes `time` s.
    """
    truth = true_fuel_map(car)
    ends = {"start_speed": END_SPEED, "end_speed": END_SPEED, "trip_time": time, "certify": False}
    price = plan_route_in_time(road, truth, car, **ends).time_value
    result: dict[str, float | None] = {}
    for name, fit in fits.items():
        try:
            result[name] = regret(fuel_map(found, car, fit), truth, road, car, price)
        except Exception as error:  # a form may make the plan impossible: that is its result
            print(f"  {name}: {error}")
            result[name] = None
    return result


def table(bench: dict[str, Any]) -> NDArray[np.float64]:
    """Efficiency of a dynamometer run, (n, m), NaN beyond full load."""
    return np.array([[np.nan if value is None else value for value in row] for row in bench["efficiency"]])


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--hours", type=int, default=10)
    parser.add_argument("--car", default="smart")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    car = make_task("mixed", car=options.car).car
    bench = dynamometer(options.car)
    steps = np.array(bench["rpm"]) * RPM, np.array(bench["torque_N_m"])
    on_bench = table(bench)
    in_each_gear = np.stack([table(dynamometer(options.car, gear + 1)) for gear in range(len(car.gear_ratios))])
    truth_map = true_fuel_map(car)
    rows = []
    with ProcessPoolExecutor(options.workers) as pool:
        for number, (trips, estimates, wrong, road) in enumerate(
            pool.map(hour, [(options.car, options.first + n, n == 0) for n in range(options.hours)])
        ):
            found = map_engine(estimates, car)
            fits = fit_all(found, car)
            fit = default_fit(fits)
            truth = true_efficiency(car, {}, trips)
            omega, torque = centres(found)
            true = truth(omega, torque)
            own = np.abs(found.mean[found.valid] - true) < 1.645 * found.standard_error[found.valid]
            every, load = (
                axis.ravel() for axis in np.meshgrid(truth_map.engine_speed, truth_map.torque[2:], indexing="ij")
            )
            can = load <= np.interp(every, truth_map.engine_speed, truth_map.torque_max)
            best_true = float(truth(every[can], load[can]).max())
            one_gear = compare_with_dyno(found, fit, *steps, on_bench)
            versus = compare_with_dyno(found, fit, *steps, in_each_gear, gear_shares(car, trips))
            assert isinstance(fit, KernelFit)
            missed = np.abs(fit.efficiency(omega, torque) - true)
            fit_holds = float(np.mean(missed < 1.645 * fit.deviation(omega, torque)))
            chosen = planner_fit(fits)
            judged = {name: fits[name] for name in (SHOWN if number == 0 else (fit.name, chosen.name))}
            # the quickest of its trips: the others wait at signals, which no plan on the empty road can take as long as
            quickest = min(trip.duration for trip in trips)
            cost = regrets(judged, found, car, road, 1.05 * quickest)
            price = cost[chosen.name]
            rows.append(
                (
                    found.fuel_share,
                    map_error(found, truth),
                    fit_error(found, fit, truth),
                    float(np.mean(own)),
                    float(fit.efficiency(omega, torque).max()) - best_true,
                    fit_holds,
                    one_gear.rmse,
                    one_gear.fit_rmse,
                    versus.rmse,
                    versus.fit_rmse,
                    float("nan") if price is None else price,
                )
            )
            print(
                "hour {:2d}: share {:.3f} rms {:.4f} fit {:.4f} in 90 % {:.3f} peak {:+.4f} "
                "fit's {:.3f} "
                "one gear's dyno {:.4f} fit {:.4f} the road's gears' {:.4f} fit {:.4f} regret {:.2%}".format(
                    number, *rows[-1]
                ),
                flush=True,
            )
            if number == 0:
                print("fit                       R2       R2 of eta  rms     regret")
                for name in SHOWN:
                    share = "impossible" if cost[name] is None else f"{cost[name]:7.2%}"
                    form = fits[name]
                    error = fit_error(found, form, truth)
                    print(f"{name:24} {form.r2:8.4f} {form.r2_efficiency:8.4f} {error:8.4f} {share}")
                usual = map_engine(estimates[:1], car)
                for label, other, estimate in zip(
                    ("C_rr +10 %", "C_d A +10 %", "injectors +2 %"), wrong_cars(car), wrong, strict=True
                ):
                    moved = map_engine([estimate], other)
                    both = usual.valid & moved.valid
                    ratio = moved.mean[both] / usual.mean[both]
                    shape = np.corrcoef(moved.mean[both], usual.mean[both])[0, 1]
                    print(
                        f"{label:15} eta x {ratio.mean():.4f} +- {ratio.std():.4f}, correlation of the form {shape:.4f}"
                    )
    hours = np.array(rows)
    print("mean     " + " ".join(f"{value:.4f}" for value in hours.mean(axis=0)))
    print("smallest " + " ".join(f"{value:.4f}" for value in hours.min(axis=0)))
    print("largest  " + " ".join(f"{value:.4f}" for value in hours.max(axis=0)))


if __name__ == "__main__":
    main()
