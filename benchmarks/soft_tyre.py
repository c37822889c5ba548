"""A soft tyre, called from fuel and wheel pulses: distance to the call, and false calls, replayed without SUMO.

`python -m benchmarks.soft_tyre [--kilometres 15000] [--workers 2] [--keep FILE]`: a car drives WLTC-like trips over
hilly roads, each with its own wind, payload, rain and warmth, through plant, box, causal filter and a map learnt once.
No trip is used twice: after every `BETWEEN` sound ones the tyre loses 0.6 bar for `SOFT_TRIPS`, and is pumped up again.
`--keep` adds each trip's figures to a file as it ends, and goes on where that file stops.
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline

from observer import kernel
from observer.by_products import (
    LEARNING,
    SOFT_RADIUS,
    SOFT_ROLLING,
    Trend,
    TripCar,
    fuel_table,
    trip_car,
    tyre_score,
    watch,
)
from observer.estimate import Estimate
from observer.events import prepare
from observer.fits import default_fit, fit_all
from observer.mapping import map_engine
from observer.observe import hindsight, observe, records_from, start
from observer.settings import DEFAULT
from sensors.box import record
from sensors.log import SensorLog
from sensors.packets import decode
from vehicle_model.car.files import read_car
from vehicle_model.car.randomness import generator
from vehicle_model.plant.cycle import Cycle, read_cycle, run_cycle

CAR = read_car("smart")
FIRST = 1000
"""Seed of the first trip, in each hundred thousand; below are those that the map is learnt from."""
LEAST_SPREAD = 0.5
"""Standard deviations of `tyre_score`."""
BETWEEN, SOFT_TRIPS = 20, 5
"""Trips, sound and with the soft tyre in turn; 23 km each, so that the first four count as within 100 km."""


def drive(seed: int, soft: bool, calm: bool = False) -> Estimate:
    """One trip of about 23 km on a day of its own, seen by the box (`calm`: the nominal car, to learn the map)."""
    rng = generator(seed, "soft tyre: day")
    cycle = read_cycle("WLTC")
    t = np.arange(0.0, cycle.time[-1], 0.2)
    speed = np.interp(t, cycle.time, cycle.speed) * rng.uniform(0.88, 1.05)
    s = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.2)])
    waves = [(rng.uniform(0.005, 0.02), rng.uniform(300.0, 3000.0), rng.uniform(0, 2 * np.pi)) for _ in range(5)]
    grade = sum(size * np.sin(2 * np.pi * s / length + phase) for size, length, phase in waves)
    wind, rain = rng.rayleigh(2.5), rng.uniform() < 0.2
    day = {
        "head_wind.speed": wind,
        "head_wind.from": rng.uniform(0.0, 2.0 * np.pi),
        "mass.factor": 1.0 + rng.uniform(0.0, 120.0) / CAR.mass,
        "air_density.factor": rng.uniform(0.96, 1.04),
        "rolling_resistance.factor": rng.uniform(0.97, 1.03) * (1.08 if rain else 1.0) * (1 + SOFT_ROLLING * soft),
        "wheel_radius.change": rng.normal(0.0, 0.0002) + SOFT_RADIUS * soft,
    }
    trip, _ = run_cycle(CAR, Cycle("trip", t, speed, np.asarray(grade)), {} if calm else day)
    log = decode(record(trip, CAR, seed=seed))
    return observe(log, CAR) if calm else filtered(log)


def filtered(log: SensorLog) -> Estimate:
    """The filter's states alone, where `observe` gives the smoother's too: a third of its time, and enough for a trend.

    It is told when the fuel changed, as the smoother's forward pass is.
    """
    packets, _ = prepare(log)
    back = hindsight(packets, start(CAR, DEFAULT, None, float(packets[0, 0])))
    time = back.events[back.events[:, 1] == kernel.GRID, 0]
    state, variance = back.filter.grid_x[:, :17], back.filter.grid_P[:, :17]
    return Estimate(time, state, variance, state, variance, records_from(np.empty((0, 7))), (0.0, 0.0, 0.0), {})


def figures(arguments: tuple[int, bool, RectBivariateSpline]) -> tuple[int, bool, TripCar]:
    """What one trip says of the car, behind its seed and whether the tyre was soft."""
    seed, soft, engine = arguments
    return seed, soft, trip_car(drive(seed, soft), CAR, engine)


def is_soft(number: int) -> bool:
    """Whether trip `number` of a car (from 0) has the soft tyre."""
    return number % (BETWEEN + SOFT_TRIPS) >= BETWEEN


def kept(file: Path | None) -> dict[int, tuple[bool, TripCar]]:
    """By seed, what `keep` has written to `file`."""
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file and file.exists() else []
    return {seed: (soft, TripCar(np.array(change), np.array(covariance), radius, distance))
            for seed, soft, change, covariance, radius, distance in rows}  # fmt: skip


def keep(file: Path, seed: int, soft: bool, trip: TripCar) -> None:
    """Add a line to `file`."""
    with file.open("a") as lines:
        row = [seed, soft, trip.change.tolist(), trip.covariance.tolist(), trip.radius, trip.distance]
        lines.write(json.dumps(row) + "\n")


def replay(trips: list[tuple[bool, TripCar]]) -> tuple[list[float], int, float]:
    """One car over `trips` (soft tyre or not) in their order, each once.

    Returns the distances (m) from the loss of air to the call (inf: not before it was pumped up), the number of
    false calls, and the m watched with sound tyres. The first `LEARNING` sound trips say what is usual; each call,
    and each visit to the pump, begins the sums anew.
    """
    trend, distances, false_calls, watched, driven, called = Trend(), [], 0, 0.0, 0.0, False
    ends = [soft and (k + 1 == len(trips) or not trips[k + 1][0]) for k, (soft, _) in enumerate(trips)]
    for (soft, trip), last in zip(trips, ends, strict=True):
        if soft and trend.trips < LEARNING:
            continue
        driven += trip.distance
        if not soft:
            watched += trip.distance if trend.trips >= LEARNING else 0.0
        if not called:
            trend = watch(trend, tyre_score(trip, CAR), least_spread=LEAST_SPREAD)
        if trend.alarm > 0 and not soft:
            false_calls += 1
            trend = Trend(trend.usual, trend.spread, trend.trips)
        if soft and trend.alarm > 0 and not called:
            called = True
            distances.append(driven)
        if last and not called:
            distances.append(float("inf"))
        if last:
            trend = Trend(trend.usual, trend.spread, trend.trips)
        if last or not soft:
            driven, called = 0.0, False
    return distances, false_calls, watched


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kilometres", type=float, default=15_000.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    base = 100_000 * options.seed
    found = kept(options.keep)
    trips = max(int(options.kilometres / 23.0), 40)
    first = base + FIRST
    wanted = [(first + n, is_soft(n)) for n in range(trips) if first + n not in found]
    if wanted:
        learnt = map_engine([drive(base + n, False, calm=True) for n in range(6)], CAR)
        engine = fuel_table(default_fit(fit_all(learnt, CAR)), CAR)
        with ProcessPoolExecutor(options.workers) as pool:
            for seed, soft, trip in pool.map(figures, [(*one, engine) for one in wanted]):
                found[seed] = (soft, trip)
                if options.keep:
                    keep(options.keep, seed, soft, trip)
    sound, softened = ([trip for soft, trip in found.values() if soft == wished] for wished in (False, True))
    for name, group in (("sound", sound), ("soft", softened)):
        scores = np.array([tyre_score(trip, CAR) for trip in group])
        radius, rolling = (np.array(part) for part in zip(*((t.radius, t.change[1]) for t in group), strict=True))
        print(
            f"{name:6} {len(group):5d} trips {sum(t.distance for t in group) / 1e3:8.0f} km: "
            f"radius {1e4 * radius.mean():+.1f} +- {1e4 * radius.std():.1f} e-4, "
            f"C_rr {1e5 * rolling.mean():+.0f} +- {1e5 * rolling.std():.0f} e-5, "
            f"score {scores.mean():+.2f} +- {scores.std():.2f}"
        )
    distances, false_calls, watched = replay([found[seed] for seed in sorted(found)])
    called = np.array(distances) / 1e3
    print(f"called within 100 km: {np.sum(called <= 100.0)} of {len(called)}; "
          f"median {np.median(called):.0f}, longest {called.max():.0f} km")  # fmt: skip
    print(f"false calls: {false_calls} in {watched / 1e3:.0f} km = {false_calls / (watched / 3e6):.2f} per 3,000 km")


if __name__ == "__main__":
    main()
