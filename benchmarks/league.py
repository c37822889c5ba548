"""The league: every filter of the family on the same faults, error and cost; docs/league.json and docs/league.md.

By hand: `python -m benchmarks.league` (some ten minutes a seed on one core). A fault is a change of the box, of the
log, or of the drive; the clean drive is the same for all. Error: thrust, as a share of its rms, engine driving, from
20 s on; its 95 % interval by bootstrap over blocks of 10 s. Cost: processor seconds for an hour of driving.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.drives import Saved, saved_drive
from observer import kernel
from observer.events import prepare, with_grid
from observer.family import FAMILY, run_family
from observer.instants import instants
from observer.model import F
from observer.observe import hindsight, start
from observer.settings import DEFAULT, ObserverSettings
from observer.tunings import printed_in_our_filter
from rollingroad.evaluation.scores import at, driving
from sensors.box import record
from sensors.log import SensorLog
from sensors.matching import observations
from sensors.packets import decode
from sensors.roadmap import RoadMap, from_route
from sensors.settings import Fault
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator
from vehicle_model.car.trip import Trip

FILE = Path(__file__).parents[1] / "docs" / "league.json"
PAGE = FILE.with_suffix(".md")
SCENARIO = "mixed"
SEEDS = (100, 101)
"""Drives of the league: no setting was chosen on them."""
SHORT, LONG, STAND = 120.0, 720.0, 600.0
"""s of the drive that are used: for most faults, for the long outage; s of standstill put in."""
GOING_ON = 60.0
"""s that are driven on after the standstill."""
SETTLED, BLOCK = 20.0, 10.0
"""s before which no error counts; s of a block of the bootstrap."""
LOST = 10.0
"""Share of the thrust's rms beyond which (or not a number) a filter is said to be lost."""

Log = Callable[[SensorLog, np.random.Generator], SensorLog]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """One fault."""

    box: dict[str, Any] = field(default_factory=dict)
    """Fields of the box that differ."""
    log: Log | None = None
    """What becomes of the log."""
    duration: float = SHORT
    stand: bool = False
    wrong_heading: bool = False


def _moved(metres: float) -> Log:
    """The receiver jumps north by `metres` from 60 s to 75 s."""

    def change(log: SensorLog, rng: np.random.Generator) -> SensorLog:
        gps = log["gps"].copy()
        begin = gps["t"][0] if len(gps) else 0.0
        gps["latitude"][(gps["t"] > begin + 60.0) & (gps["t"] < begin + 75.0)] += metres / 111_200.0
        return SensorLog({**log.streams, "gps": gps})

    return change


def _spiking(log: SensorLog, rng: np.random.Generator) -> SensorLog:
    acc = log["accelerometer"].copy()
    hit = rng.random(len(acc)) < 0.02
    for axis in "xyz":
        acc[axis][hit] = rng.uniform(-20.0, 20.0, int(hit.sum()))
    return SensorLog({**log.streams, "accelerometer": acc})


def _pulses_lost(log: SensorLog, rng: np.random.Generator) -> SensorLog:
    wheel = log["wheel"]
    return SensorLog({**log.streams, "wheel": wheel[rng.random(len(wheel)) > 0.02]})


def _pulses_doubled(log: SensorLog, rng: np.random.Generator) -> SensorLog:
    injector = log["injector"]
    twice = np.sort(np.concatenate([np.arange(len(injector)), np.flatnonzero(rng.random(len(injector)) < 0.02)]))
    return SensorLog({**log.streams, "injector": injector[twice]})


def _fault(sensor: str, kind: str, begin: float, end: float) -> dict[str, Any]:
    return {"faults": (Fault(sensor, kind, begin, end),)}


CASES: dict[str, Case] = {
    "clean": Case(),
    "GPS out 30 s": Case(_fault("gps", "off", 60.0, 90.0)),
    "GPS out 10 min": Case(_fault("gps", "off", 60.0, 660.0), duration=LONG),
    "GPS out from the start": Case(_fault("gps", "off", 0.0, 1e6)),
    "GPS jumps 20 m": Case(log=_moved(20.0)),
    "GPS jumps 500 m": Case(log=_moved(500.0)),
    "GPS stuck 60 s": Case(_fault("gps", "stuck", 60.0, 120.0)),
    "accelerometer off 60 s": Case(_fault("accelerometer", "off", 60.0, 120.0)),
    "accelerometer spikes": Case(log=_spiking),
    "accelerometer rotated 3 degrees": Case({"accelerometer_mount_pitch": float(np.radians(3.0))}),
    "wheel pulses lost": Case(log=_pulses_lost),
    "injector pulses doubled": Case(log=_pulses_doubled),
    "clock 200 ppm off": Case({"clock_skew": 200e-6}),
    "begins with a wrong heading": Case(wrong_heading=True),
    "ten minutes at standstill": Case(stand=True),
    "road map shifted 15 m": Case({"road_map_shift": 15.0}),
}
"""What is done to the drive; 2 % of readings or pulses where a share is meant."""


def shortened(trip: Trip, duration: float) -> Trip:
    """The first `duration` s of `trip`."""
    count = min(round(duration / trip.step), len(trip.channels["time"]))
    return replace(trip, channels={name: values[:count] for name, values in trip.channels.items()})


def first_stand(trip: Trip) -> int:
    """The first sample after 20 s at which the car stands; the last one where it never does."""
    c = trip.channels
    still = np.flatnonzero((c["speed"] < 1e-3) & (c["time"] - c["time"][0] > SETTLED))
    return int(still[0]) if len(still) else len(c["time"]) - 1


def standing(trip: Trip, seconds: float) -> Trip:
    """`trip` with `seconds` more at standstill, engine idling, where it first stands after 20 s."""
    c, k = trip.channels, first_stand(trip)
    count = round(seconds / trip.step)
    idle = c["speed"] < 1e-3
    power = float(np.median(c["fuel_power"][idle])) if idle.any() else 5e3
    rates = {"time": 1.0, "fuel_energy": power, "engine_angle": float(c["engine_speed"][k])}
    held = {"speed": 0.0, "acceleration": 0.0, "thrust": 0.0, "fuel_power": power}
    out = {}
    for name, values in c.items():
        rate = rates.get(name, 0.0)
        middle = held.get(name, values[k]) + rate * trip.step * np.arange(1, count + 1)
        out[name] = np.concatenate([values[: k + 1], middle, values[k + 1 :] + rate * trip.step * count])
    return replace(trip, channels=out)


def compiled(
    log: SensorLog, car: Car, road: RoadMap, settings: ObserverSettings, heading: float | None, smooth: bool
) -> tuple[Array, Array]:
    """Times (n,) and states (n, 17) of the compiled observer, live or smoothed; `heading` believed at the start."""
    passages = observations(log, road, car.metres_per_tick, settings.gps_lag)
    packets, _ = prepare(log, passages)

    def fresh() -> kernel.Filter:
        f = start(car, settings, None, float(packets[0, 0]))
        if heading is not None:
            f.x[kernel.HEADING], f.P[kernel.HEADING, kernel.HEADING] = heading, 0.01
            f.memory[kernel.M_HEADING_SET] = 1.0
        return f

    if not smooth:
        events = with_grid(packets)
        on_grid = events[:, 1] == kernel.GRID
        lines = int(np.count_nonzero(on_grid))
        f = fresh()._replace(grid_x=np.empty((lines, kernel.NX)), grid_P=np.empty((lines, kernel.NX)))
        kernel.advance(events, 0, len(events), f)
        return events[on_grid, 0], f.grid_x[:, :17]
    back = hindsight(packets, fresh())
    x, P = back.filter.grid_x.copy(), back.filter.grid_P.copy()
    adjoint, information = np.zeros(kernel.NX), np.zeros((kernel.NX, kernel.NX))
    for number in range(len(back.checkpoints) - 1, -1, -1):
        f = back.tape(number)
        kernel.retreat(f, 0, f.counts[kernel.TAPE_LINES], -1, adjoint, information, x, P)
    return back.events[back.events[:, 1] == kernel.GRID, 0], x[:, :17]


COMPILED = {
    "default observer, live": (DEFAULT, False),
    "default observer, smoothed": (DEFAULT, True),
    "default observer, printed tuning, live": (printed_in_our_filter(), False),
}
FILTERS = (*COMPILED, *FAMILY)


def misses(trip: Trip, when: Array, thrust: Array) -> tuple[Array, Array, Array]:
    """Squared errors and squared true thrust of the samples that count, and the block each lies in."""
    use = driving(trip, when) & (when - when[0] > SETTLED)
    true = at(trip, "thrust", when)
    return (thrust - true)[use] ** 2, true[use] ** 2, np.floor(when[use] / BLOCK)


def share(squares: list[tuple[Array, Array, Array]]) -> dict[str, float | None]:
    """Thrust error over all seeds with its 95 % interval; None where the filter was lost."""
    wrong, right = [], []
    for error, true, block in squares:
        for k in np.unique(block):
            wrong.append(float(np.sum(error[block == k])))
            right.append(float(np.sum(true[block == k])))
    wrong_, right_ = np.array(wrong), np.array(right)
    value = float(np.sqrt(wrong_.sum() / right_.sum()))
    if not value < LOST:
        return {"thrust": None, "low": None, "high": None}
    drawn = np.random.default_rng(0).integers(0, len(wrong_), (1000, len(wrong_)))
    spread = np.sqrt(wrong_[drawn].sum(axis=1) / right_[drawn].sum(axis=1))
    low, high = np.quantile(spread, (0.025, 0.975))
    return {"thrust": value, "low": float(low), "high": float(high)}


def prepared(case: Case, drive: Saved) -> tuple[Trip, SensorLog, RoadMap]:
    """The drive with the fault: truth, log and road map."""
    duration = case.duration
    if case.stand:
        duration = max(duration, first_stand(drive.trip) * drive.trip.step + GOING_ON)
    trip = shortened(drive.trip, duration)
    if case.stand:
        trip = standing(trip, STAND)
    box = replace(drive.box, **case.box)
    log = decode(record(trip, drive.car, box, drive.seed))
    if case.log is not None:
        log = case.log(log, generator(drive.seed, "league"))
    return trip, log, from_route(drive.route, drive.seed, box)


def play(
    names: Sequence[str], cases: Sequence[str], seeds: Sequence[int], folder: Path
) -> dict[str, dict[str, dict[str, float | None]]]:
    """Let the filters `names` of `FILTERS` play `cases` on `seeds`: filter -> fault -> thrust, low, high, cost."""
    found: dict[str, dict[str, dict[str, float | None]]] = {name: {} for name in names}
    for title in cases:
        case = CASES[title]
        squares: dict[str, list] = {name: [] for name in names}
        spent: dict[str, float] = dict.fromkeys(names, 0.0)
        driven = 0.0
        for seed in seeds:
            drive = saved_drive(SCENARIO, seed, folder)
            trip, log, road = prepared(case, drive)
            heading = float(trip.channels["heading"][0]) + np.pi if case.wrong_heading else None
            told, _ = instants(log, drive.car, road)
            driven += trip.duration
            for name in names:
                began = time.process_time()
                if name in COMPILED:
                    settings, smooth = COMPILED[name]
                    when, state = compiled(log, drive.car, road, settings, heading, smooth)
                else:
                    when, state, _ = run_family(name, told, drive.car, heading)
                spent[name] += time.process_time() - began
                squares[name].append(misses(trip, when, state[:, F]))
        for name in names:
            found[name][title] = share(squares[name]) | {"cost": spent[name] / driven * 3600.0}
        print(title, *(f"{name} {found[name][title]['thrust']}" for name in names), flush=True)
    return found


def page(found: dict[str, Any]) -> str:
    """docs/league.md of docs/league.json: filter -> seeds, faults."""
    names = [name for name in FILTERS if name in found]
    lines = [
        "<!-- Generated: python -m benchmarks.league -->",
        "# The league of filters",
        "",
        "The compiled observer, and filters of `observer.family`, under one fault at a time, on held-out seeds of the"
        f" scenario `{SCENARIO}`: the first {SHORT:.0f} s, {LONG:.0f} s for the long outage; where it first stands,"
        f" ten minutes of standstill are put in, and {GOING_ON:.0f} s follow.",
        "Thrust error in per cent of the thrust's rms, while the engine drives, from 20 s on, with its 95 % interval by"
        " bootstrap over blocks of 10 s. *Lost*: not a number, or more than ten times the thrust. Cost: processor"
        " seconds for an hour of driving, median over the faults, on a machine that did other work too.",
        "",
        "The readable filters are fed ten instants a second, share one noise and one gate, and know nothing of the"
        " fuel's link with thrust: they are references, not rivals. Every filter starts without knowing the biases.",
        "",
        "| | " + " | ".join(names) + " |",
        "|---|" + "---|" * len(names),
        "| seeds | " + " | ".join(str(len(found[name]["seeds"])) for name in names) + " |",
    ]
    cost = [float(np.median([row["cost"] for row in found[name]["faults"].values()])) for name in names]
    lines.append("| cost, s/h | " + " | ".join(f"{value:.1f}" for value in cost) + " |")
    for title in CASES:
        cells = []
        for name in names:
            row = found[name]["faults"][title]
            if row["thrust"] is None:
                cells.append("lost")
            else:
                cells.append(f"{100 * row['thrust']:.1f} ({100 * row['low']:.1f} - {100 * row['high']:.1f})")
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=Path, default=Path(tempfile.gettempdir()) / "rollingroad-drives")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--filters", nargs="+", default=list(FILTERS), help="the others keep what the file says")
    parser.add_argument("--faults", nargs="+", default=list(CASES), help="likewise")
    options = parser.parse_args()
    chosen = SEEDS[: options.seeds]
    for name in options.filters:
        if name in COMPILED:  # compile first: cost is that of filtering
            play([name], ["clean"], chosen[:1], options.drives)
        results = play([name], options.faults, chosen, options.drives)
        kept = json.loads(FILE.read_text()) if FILE.exists() else {}
        before = kept.get(name, {"seeds": list(chosen), "faults": {}})
        if before["seeds"] != list(chosen) and set(options.faults) != set(CASES):
            parser.error(f"{name}: the file holds seeds {before['seeds']}; all faults must be played on others")
        kept[name] = {"seeds": list(chosen), "faults": before["faults"] | results[name]}
        FILE.write_text(json.dumps(kept, indent=1) + "\n")
        PAGE.write_text(page(kept))
