"""Injectors that foul, followed on the road: the efficiency map's nodes adapt online to drives through SUMO.

`python -m benchmarks.fouling [--trips 4] [--lost 0.06] [--car smart]`: a map is learnt from four trips over `mixed`; in
the trips after them the injectors have lost a share of their flow, so that they open longer for the same fuel and the
logger sees 1 / (1 - lost) as much. The nodes follow from trip to trip; the same trips with clean injectors beside them.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from observer.estimate import Estimate
from observer.fits import default_fit, fit_all
from observer.map_adaptation import AdaptedMap, adapt, fresh_map
from observer.mapping import map_engine
from observer.observe import observe
from rollingroad.arrows import drive_scenario, sense
from rollingroad.task import make_task
from sim.network import build

LEARNT = 4
KNOWN = 0.015
"""Standard deviation below which a node counts as known."""


def seen(car: str, seed: int, losses: tuple[float, ...]) -> list[Estimate]:
    """One drive over `mixed`, observed once for each share of the flow lost."""
    tasks = [make_task("mixed", car=car, seed=seed, settings=[f"injector_fouling.flow_lost={lost}"]) for lost in losses]
    with tempfile.TemporaryDirectory() as folder:
        driven = drive_scenario(tasks[0], build(tasks[0].scenario, Path(folder)))
    logs = [sense(task, driven) for task in tasks]
    return [observe(log.log, tasks[0].car, log.road_map) for log in logs]


def told(adapted: AdaptedMap, truth: float) -> str:
    """Mean of the known nodes, their rms error, and how many they are."""
    known = adapted.deviation < KNOWN
    if not known.any():
        return "no node is known yet"
    found = adapted.correction[known]
    error = np.sqrt(np.mean((found - truth) ** 2))
    return f"{found.mean():+.4f} (true {truth:+.4f}), rms error {error:.4f} over {known.sum()} nodes"


def main() -> None:
    """Print a line for each trip."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trips", type=int, default=4)
    parser.add_argument("--lost", type=float, default=0.06)
    parser.add_argument("--car", default="smart")
    options = parser.parse_args()
    car = make_task("mixed", car=options.car).car
    known = [seen(options.car, seed, (0.0,))[0] for seed in range(LEARNT)]
    fit = default_fit(fit_all(map_engine(known, car), car))
    clean = fouled = fresh_map(car)
    truth = 1.0 / (1.0 - options.lost) - 1.0
    for number in range(options.trips):
        first, second = seen(options.car, LEARNT + number, (0.0, options.lost))
        clean, fouled = adapt(clean, first, car, fit), adapt(fouled, second, car, fit)
        print(f"after trip {number + 1}: fouled {told(fouled, truth)}; clean {told(clean, 0.0)}", flush=True)


if __name__ == "__main__":
    main()
