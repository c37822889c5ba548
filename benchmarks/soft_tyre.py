"""A soft tyre, called from fuel and wheel pulses: distance to the call, and false calls, replayed without SUMO.

`python -m benchmarks.soft_tyre [--kilometres 15000] [--workers 2] [--keep FILE]`: a car drives WLTC-like trips over
hilly roads, each with its own wind, payload, rain and warmth, through plant, box, observer and a map learnt once. The
trips' figures are then put together into cars' histories: sound ones for the false calls, others whose tyre loses
0.6 bar at one trip. `--keep` adds each trip's figures to a file as it ends, and goes on where that file stops.
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from observer.by_products import (
    LEARNING,
    SOFT_RADIUS,
    SOFT_ROLLING,
    Trend,
    TripCar,
    trip_car,
    tyre_score,
    watch,
)
from observer.estimate import Estimate
from observer.fit_form import Fit
from observer.fits import default_fit, fit_all
from observer.mapping import map_engine
from observer.observe import observe
from sensors.box import record
from sensors.packets import decode
from vehicle_model.car.files import read_car
from vehicle_model.car.randomness import generator
from vehicle_model.plant.cycle import Cycle, read_cycle, run_cycle

CAR = read_car("smart")
LEAST_SPREAD = 0.5
"""Standard deviations of `tyre_score`."""


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
    return observe(decode(record(trip, CAR, seed=seed)), CAR)


def figures(arguments: tuple[int, bool, Fit]) -> tuple[int, bool, TripCar]:
    """What one trip says of the car, behind its seed and whether the tyre was soft."""
    seed, soft, fit = arguments
    return seed, soft, trip_car(drive(seed, soft), CAR, fit)


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


def histories(sound: list[TripCar], soft: list[TripCar], runs: int, seed: int) -> tuple[list[float], int, float]:
    """Distances (m) to the call after the tyre lost its air (inf: never), number of false calls, m watched."""
    rng = generator(seed, "soft tyre: histories")
    distances, false_calls, watched = [], 0, 0.0
    for _ in range(runs):
        trend = Trend()
        for number in rng.permutation(len(sound))[:60]:
            trip = sound[number]
            trend = watch(trend, tyre_score(trip, CAR), least_spread=LEAST_SPREAD)
            watched += trip.distance if trend.trips > LEARNING else 0.0
            if trend.alarm > 0:
                false_calls += 1
                trend = Trend(trend.usual, trend.spread, trend.trips)
        driven = 0.0
        for number in rng.permutation(len(soft)):
            trend = watch(trend, tyre_score(soft[number], CAR), least_spread=LEAST_SPREAD)
            driven += soft[number].distance
            if trend.alarm > 0:
                break
        distances.append(driven if trend.alarm > 0 else float("inf"))
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
    wanted = [(seed, seed % 5 == 4) for seed in range(base + 1000, base + 1000 + trips) if seed not in found]
    if wanted:
        fit = default_fit(fit_all(map_engine([drive(base + n, False, calm=True) for n in range(6)], CAR), CAR))
        with ProcessPoolExecutor(options.workers) as pool:
            for seed, soft, trip in pool.map(figures, [(*one, fit) for one in wanted]):
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
    distances, false_calls, watched = histories(sound, softened, 200, options.seed)
    called = np.array(distances) / 1e3
    print(f"called within 100 km: {np.mean(called <= 100.0):.3f} of 200 histories; median {np.median(called):.0f} km")
    print(f"false calls: {false_calls} in {watched / 1e3:.0f} km = {false_calls / (watched / 3e6):.2f} per 3,000 km")


if __name__ == "__main__":
    main()
