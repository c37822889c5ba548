"""What belongs to `bench --long`: how cost grows with the size of the task; a campaign against the reader."""

import time

import numpy as np

from benchmarks.fuzz_reader import a_card, lost_packets, mutate, starts_of
from benchmarks.timing import Row, least, row
from observer.observe import observe
from sensors.box import record
from sensors.packets import decode
from vehicle_model.car.files import read_car
from vehicle_model.plant.cycle import Cycle, read_cycle, run_cycle

MINUTES = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
FUZZED = 1_000_000
"""Mutated cards: about six minutes on one core."""


def exponent(sizes: list[float], seconds: list[float]) -> float:
    """Slope of log time over log size, by least squares over the larger half: fixed costs hide in the smaller."""
    half = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[half:]), np.log(seconds[half:]), 1)[0])


def observer_growth() -> list[Row]:
    """Exponent of the observer's time over the trip's length, 1 minute to 5 hours; reference: linear."""
    car, cycle = read_car("smart"), read_cycle("UDDS")
    sizes, seconds = [], []
    for minutes in MINUTES:
        time_ = np.arange(0.0, 60.0 * minutes, float(cycle.time[1]))
        speed = np.interp(time_ % cycle.time[-1], cycle.time, cycle.speed)
        trip, _ = run_cycle(car, Cycle("long", time_, speed, np.zeros_like(time_)))
        log = decode(record(trip, car))
        del trip
        sizes.append(float(sum(len(stream) for stream in log.streams.values())))
        seconds.append(least(lambda log=log: observe(log, car), 3 if minutes < 20.0 else 1))
    return [row("observer_growth", exponent(sizes, seconds), "exponent", "linear", 1.0)]


def fuzz_reader() -> list[Row]:
    """Mutated cards through the reader: undamaged packets that it lost, which must be none; reference: packets tried.

    `ratio` has no meaning here.
    """
    lost, total, began = 0, 0, time.perf_counter()
    for number in range(FUZZED):
        rng = np.random.default_rng((0, number))
        if number % 50 == 0:
            card = a_card(rng)
            starts = starts_of(card)
            ends = np.append(starts[1:], card.size)
        lost += lost_packets(*mutate(card, rng), starts, ends)
        total += starts.size
    spent = time.perf_counter() - began
    return [
        {
            "name": "fuzz_reader",
            "value": float(lost),
            "unit": "packets lost",
            "reference": f"packets tried in {spent:.0f} s",
            "reference_value": float(total),
            "ratio": None,
        }
    ]


LONG = {"observer_growth": observer_growth, "fuzz_reader": fuzz_reader}
"""Name of `rollingroad bench --long` -> the function that measures it."""
