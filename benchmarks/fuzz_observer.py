"""A campaign against the observer: packets of the fuzzer's choosing, then clean ones; what it must survive and how.

`python -m benchmarks.fuzz_observer [events] [honest]` (honest: without false stamps).
Between 60 s and 120 s of a drive any packet may be changed: values that
are not numbers, absurd or merely wrong, stamps likewise, packets lost, doubled, out of order or repeated. Asserted are
finite states, a positive covariance at every second, and, from 30 s after the last bad packet on, an error of at most
twice that of the clean log.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer import kernel
from observer.events import prepare, with_grid
from observer.model import F, V
from observer.observe import start
from observer.settings import DEFAULT
from rollingroad.evaluation.scores import at, driving, rms
from sensors.box import record
from sensors.log import SensorLog
from sensors.packets import decode
from vehicle_model.car.files import read_car
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator
from vehicle_model.car.trip import Trip
from vehicle_model.plant.cycle import Cycle, read_cycle, run_cycle

BAD, CLEAN, DURATION = (60.0, 120.0), 150.0, 240.0
"""s: when packets are tampered with; from when the error counts; length of the drive."""
FLOOR = {"speed": 0.02, "thrust": 30.0}
"""Errors below which nobody asks for half (m/s, N): the clean error of one short stretch is partly luck."""
WAYS = ("nan", "infinite", "absurd", "wrong", "lost", "doubled", "stamp", "repeated", "shuffled")
HONEST_STAMPS = tuple(way for way in WAYS if way not in ("stamp", "shuffled"))
"""Without false stamps."""


@dataclass(frozen=True)
class Subject:
    """A drive, what its box logged, and the clean errors."""

    car: Car
    trip: Trip
    log: SensorLog
    end: float
    """s, time of its last packet."""
    speed: float
    thrust: float


@dataclass(frozen=True)
class Outcome:
    """What one log did to the observer."""

    events: int
    finite: bool
    positive: bool
    speed: float
    """m/s, rms error once recovered."""
    thrust: float
    """N."""


def subject() -> Subject:
    """A city drive with stops, and its clean errors."""
    car, cycle = read_car("smart"), read_cycle("UDDS")
    keep = cycle.time <= DURATION
    speed = cycle.speed[keep]
    trip, _ = run_cycle(car, Cycle("fuzzed", cycle.time[keep], speed, np.zeros_like(speed)))
    log = decode(record(trip, car))
    end = float(prepare(log)[0][-1, 0])
    clean = survive(log, car, trip, end)
    return Subject(car, trip, log, end, clean.speed, clean.thrust)


def survive(log: SensorLog, car: Car, trip: Trip, end: float) -> Outcome:
    """Run the live filter over `log`, looking at it every second.

    Bad stamps that agree with each other are taken for a clock that was set anew: the estimate's clock then stands
    off for good, by as much as the last packet, a good one, lies from `end` (s), its time in the clean log.
    """
    packets, _ = prepare(log)
    events = with_grid(packets)
    on_grid = events[:, 1] == kernel.GRID
    lines = int(np.count_nonzero(on_grid))
    f = start(car, DEFAULT, None, float(events[0, 0]))
    f = f._replace(grid_x=np.empty((lines, kernel.NX)), grid_P=np.empty((lines, kernel.NX)))
    finite = positive = True
    done = 0
    for upto in np.append(np.flatnonzero(on_grid)[9::10] + 1, len(events)):
        kernel.advance(events, done, int(upto), f)
        done = int(upto)
        finite = finite and bool(np.isfinite(f.x).all() and np.isfinite(f.P).all())
        if finite:
            scale = np.sqrt(np.maximum(np.diag(f.P), 1e-300))
            least = np.linalg.eigvalsh(f.P / np.outer(scale, scale))[0]
            positive = positive and bool((np.diag(f.P) > 0.0).all() and least > -1e-9)
    time = events[on_grid, 0] - (packets[-1, 0] - end)
    late = driving(trip, time) & (time > CLEAN)
    errors = [rms(f.grid_x[late, place] - at(trip, name, time[late])) for name, place in (("speed", V), ("thrust", F))]
    return Outcome(len(events), finite, positive, errors[0], errors[1])


def tampered(log: SensorLog, rng: np.random.Generator, ways: Sequence[str] = WAYS) -> SensorLog:
    """`log` with a share of the packets of some streams changed while `BAD` lasts."""
    streams = dict(log.streams)
    for name, packets in log.streams.items():
        inside = np.flatnonzero((packets["t"] > BAD[0]) & (packets["t"] < BAD[1]))
        if not len(inside) or rng.random() < 0.3:
            continue
        packets = packets.copy()
        share = rng.choice([0.01, 0.1, 0.5])
        way = ways[int(rng.integers(len(ways)))]
        hit = inside[rng.random(len(inside)) < share]
        if way == "lost":
            packets = np.delete(packets, hit)
        elif way == "doubled":
            packets = packets[np.sort(np.concatenate([np.arange(len(packets)), hit]))]
        elif way == "repeated":
            order = packets["order"].copy()
            packets[inside] = packets[inside[0]]
            packets["order"] = order
        elif way == "shuffled":
            order = packets["order"].copy()
            packets[hit] = packets[rng.permutation(hit)]
            packets["order"] = order
        elif way == "stamp":
            packets["t"][hit] = rng.choice([np.nan, np.inf, -1.0, 1e9, 1e300, 90.0], len(hit))
        else:
            _spoil(packets, hit, way, rng)
        streams[name] = packets
    return SensorLog(streams, name=log.name)


def _spoil(packets: NDArray, hit: NDArray[np.intp], way: str, rng: np.random.Generator) -> None:
    for column in packets.dtype.names or ():
        if column in ("t", "order") or packets.dtype[column].kind != "f":
            continue
        values = packets[column]
        if way == "nan":
            values[hit] = np.nan
        elif way == "infinite":
            values[hit] = rng.choice([np.inf, -np.inf], len(hit))
        elif way == "absurd":
            values[hit] = rng.choice([-1.0, 1.0], len(hit)) * 10.0 ** rng.uniform(3.0, 300.0, len(hit))
        else:
            values[hit] = values[hit] * rng.uniform(0.0, 3.0, len(hit))


def failures(found: Outcome, clean: Subject) -> list[str]:
    """What the outcome breaks of what is asserted; empty: nothing."""
    broken = [name for name, holds in (("not finite", found.finite), ("not positive", found.positive)) if not holds]
    for name, error, usual in (("speed", found.speed, clean.speed), ("thrust", found.thrust, clean.thrust)):
        if not error <= 2.0 * max(usual, FLOOR[name]):
            broken.append(f"{name} {error:.3g} against {usual:.3g}")
    return broken


def campaign(events: int, ways: Sequence[str] = WAYS) -> tuple[int, int, list[tuple[int, list[str]]]]:
    """Tamper with logs until `events` events went through. Returns events, logs and what failed: (number, what)."""
    clean = subject()
    done, number, broken = 0, 0, []
    while done < events:
        found = survive(tampered(clean.log, generator(number, "fuzz_observer"), ways), clean.car, clean.trip, clean.end)
        done += found.events
        if why := failures(found, clean):
            broken.append((number, why))
        number += 1
    return done, number, broken


if __name__ == "__main__":
    chosen = HONEST_STAMPS if "honest" in sys.argv else WAYS
    done, logs, broken = campaign(int(float(sys.argv[1])) if len(sys.argv) > 1 else 10_000_000, chosen)
    print(f"{done} events, {logs} logs, {len(broken)} failed")
    for number, why in broken:
        print(number, "; ".join(why))
