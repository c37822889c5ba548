"""What belongs to `bench --long`: how cost grows with the size of the task; campaigns against reader and observer."""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks import fuzz_observer as observer_campaign
from benchmarks.controller import _car, _road, _willans
from benchmarks.fuzz_reader import a_card, lost_packets, mutate, starts_of
from benchmarks.timing import Row, least
from controller.route import plan_route
from observer.observe import observe
from rollingroad.gap.diagnose import diagnose
from scenarios.files import load
from sensors.box import record
from sensors.packets import decode, write_log
from sim.envs.eco_drive import EcoDrive
from vehicle_model.car.files import read_car, write_car
from vehicle_model.plant.cycle import Cycle, read_cycle, run_cycle
from vehicle_model.plant.effects import EFFECTS

MINUTES = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
VEHICLES = (10, 30, 100, 300, 1000)
ROADS = (2_500.0, 5_000.0, 10_000.0, 20_000.0, 40_000.0)
"""m: each place of the plan is a column of some 200 cells of speed and 7 of gear."""
HIDDEN = (30, 24, 16, 8, 0)
"""Effects that the diagnosis is not to think of."""
FUZZED = 1_000_000
"""Mutated cards: about six minutes on one core."""
FUZZED_EVENTS = 10_000_000
"""Events through the observer, some of them tampered with: minutes to a quarter of an hour."""


def exponent(sizes: list[float], seconds: list[float]) -> float:
    """Slope of log time over log size, by least squares over the larger half: fixed costs hide in the smaller."""
    half = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[half:]), np.log(seconds[half:]), 1)[0])


def _growth(name: str, sizes: list[float], seconds: list[float]) -> Row:
    """A row of growth, beside linear growth; a ratio of exponents would mean nothing."""
    return {
        "name": name,
        "value": exponent(sizes, seconds),
        "unit": "exponent",
        "reference": f"linear; {sizes[-1]:.4g} took {seconds[-1]:.3g} s",
        "reference_value": 1.0,
        "ratio": None,
    }


def long_cycle(minutes: float) -> Cycle:
    """UDDS, over and over, for so long."""
    cycle = read_cycle("UDDS")
    time_ = np.arange(0.0, 60.0 * minutes, float(cycle.time[1]))
    speed = np.interp(time_ % cycle.time[-1], cycle.time, cycle.speed)
    return Cycle("long", time_, speed, np.zeros_like(time_))


def observer_growth(sizes: Sequence[float] = MINUTES) -> list[Row]:
    """Exponent of the observer's time over the trip's length, 1 minute to 5 hours; reference: linear."""
    car = read_car("smart")
    events, seconds = [], []
    for minutes in sizes:
        trip, _ = run_cycle(car, long_cycle(minutes))
        log = decode(record(trip, car))
        del trip
        events.append(float(sum(len(stream) for stream in log.streams.values())))
        seconds.append(least(lambda log=log: observe(log, car), 3 if minutes < 20.0 else 1))
    return [_growth("observer_growth", events, seconds)]


def vehicles_growth(sizes: Sequence[int] = VEHICLES, seconds: int = 60) -> list[Row]:
    """Exponent of the time that a minute in traffic takes, SUMO's own included, over the vehicles in the network.

    Those that are there, not those asked for: a thousand do not find room at once.
    """
    scenario = load("mixed")
    present, spent = [], []
    for vehicles in sizes:
        crowded = scenario.model_copy(update={"traffic": scenario.traffic.model_copy(update={"vehicles": vehicles})})
        env = EcoDrive(crowded)
        try:
            env.reset(seed=0)
            present.append(float(_vehicles_now()))
            began = time.perf_counter()
            for _ in range(seconds):
                env.step(np.array([0.6], np.float32))
            spent.append(time.perf_counter() - began)
        finally:
            env.close()
    return [_growth("vehicles_growth", present, spent)]


def _vehicles_now() -> int:
    import libsumo

    return libsumo.vehicle.getIDCount()


def cells_growth(sizes: Sequence[float] = ROADS) -> list[Row]:
    """Exponent of the planner's time over the cells of its grid (road times speed times gear); reference: linear."""
    seconds = []
    for length in sizes:
        road = _road(length)

        def plan(road=road) -> None:
            plan_route(road, _willans(), _car(), start_speed=0.0, end_speed=0.0, time_value=8e3, certify=False)

        plan()
        seconds.append(least(plan, 3))
    return [_growth("cells_growth", list(sizes), seconds)]


def effects_growth(hidden: Sequence[int] = HIDDEN) -> list[Row]:
    """Exponent of the diagnosis' time over the effects that it weighs, singly and in pairs; reference: linear.

    Effects that it is not to think of are simulated all the same: what grows is the weighing.
    """
    car, cycle = read_car("smart"), read_cycle("UDDS")
    names = [effect.id for effect in EFFECTS]
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        root = Path(folder)
        write_car(car, root / "car.xml")
        for role, seeds in (("reference", (0, 1)), ("logs", (2, 3))):
            (root / role).mkdir()
            for seed in seeds:
                trip, _ = run_cycle(car, cycle)
                write_log(root / role / f"{seed}.dat", record(trip, car, seed=seed))
        sizes, seconds = [], []
        for count in hidden:
            some = names[: min(count, len(names) - 2)]

            def ask(some=some) -> None:
                diagnose(root / "car.xml", root / "logs", root / "reference", hide=some)

            if not sizes:
                ask()  # for what is compiled on the way
            sizes.append(float(len(names) - len(some)))
            seconds.append(least(ask, 2))
    return [_growth("effects_growth", sizes, seconds)]


def fuzz_reader(cards: int = FUZZED) -> list[Row]:
    """Mutated cards through the reader: undamaged packets that it lost, which must be none; reference: packets tried.

    `ratio` has no meaning here.
    """
    lost, total, began = 0, 0, time.perf_counter()
    for number in range(cards):
        rng = np.random.default_rng((0, number))
        if number % 50 == 0:
            card = a_card(rng)
            starts = starts_of(card)
            ends = np.append(starts[1:], card.size)
        lost += lost_packets(*mutate(card, rng), starts, ends)
        total += starts.size
    spent = time.perf_counter() - began
    return [_campaign("fuzz_reader", lost, "packets lost", f"packets tried in {spent:.0f} s", total)]


def fuzz_observer(events: int = FUZZED_EVENTS) -> list[Row]:
    """Logs with tampered packets through the observer: those after which it was not whole again, which must be none.

    Stamps are honest here (`benchmarks.fuzz_observer` tells why); reference: events tried.
    """
    began = time.perf_counter()
    done, logs, broken = observer_campaign.campaign(events, observer_campaign.HONEST_STAMPS)
    spent = time.perf_counter() - began
    return [_campaign("fuzz_observer", len(broken), f"of {logs} logs failed", f"events tried in {spent:.0f} s", done)]


def _campaign(name: str, failed: int, unit: str, reference: str, tried: int) -> Row:
    """A row of a campaign: what failed, beside what was tried; a ratio would mean nothing."""
    return {
        "name": name,
        "value": float(failed),
        "unit": unit,
        "reference": reference,
        "reference_value": float(tried),
        "ratio": None,
    }


LONG = {
    "observer_growth": observer_growth,
    "vehicles_growth": vehicles_growth,
    "cells_growth": cells_growth,
    "effects_growth": effects_growth,
    "fuzz_reader": fuzz_reader,
    "fuzz_observer": fuzz_observer,
}
"""Name of `rollingroad bench --long` -> the function that measures it."""
