"""How good the default observer is on drives that it was never tuned on: docs/observer_accuracy.json.

By hand: `python -m benchmarks.accuracy` (half an hour on one core); `--print` turns the file into the tables of
docs/observer.md. Errors are those of `rollingroad.evaluation.scores`; figures are root mean squares over seeds.
"""

import argparse
import json
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.drives import HELD_OUT, Saved, saved_drive
from observer.earlier_trips import carried_over
from observer.estimate import STATES, Estimate
from observer.fixed_lag import observe_lagged
from observer.observe import observe
from observer.settings import DEFAULT, ObserverSettings
from observer.tunings import printed_in_our_filter
from rollingroad.evaluation.scores import at, driving, rms
from sensors.log import SensorLog
from vehicle_model.car.trip import Trip

FILE = Path(__file__).parents[1] / "docs" / "observer_accuracy.json"
SCENARIOS = ("mixed", "town", "hills", "motorway")
SETS = ("all sensors", "no road map", "neither map nor GPS, biases known")
LAG = 1.0
"""s."""
EARLIER = 5
"""Trips that the biases are carried over from. Each trip adds a change of its own: one trip's word is half luck."""
ASKED = {
    "all sensors": {"live": (0.085, 0.037), "lag": (0.045, 0.020), "smoothed": (0.03, 0.014)},
    "no road map": {"live": (0.105, None), "lag": (0.06, None), "smoothed": (0.04, None)},
    "neither map nor GPS, biases known": {"live": (0.095, None), "lag": (0.06, None), "smoothed": (0.04, None)},
}
"""Thrust (share of its rms) and efficiency that the observer is meant to reach."""
NEES = ("speed", "thrust", "pitch")


def errors(trip: Trip, time: NDArray[np.float64], state: NDArray[np.float64]) -> dict[str, float]:
    """Thrust error as a share of the thrust's rms, and efficiency's, of `state` (n, 17) at `time` (n,), s.

    An efficiency outside 0 to 1 is no claim: then the whole of the true one is the error.
    """
    use = driving(trip, time)
    true = {name: at(trip, name, time) for name in ("thrust", "speed", "engine_speed", "fuel_power")}
    found = {name: state[:, STATES.index(name)] for name in ("thrust", "speed", "fuel_power")}
    with np.errstate(divide="ignore", invalid="ignore"):
        torque = true["thrust"] * true["speed"] / true["engine_speed"]
        efficiency = true["thrust"] * true["speed"] / true["fuel_power"]
        claimed = found["thrust"] * found["speed"] / found["fuel_power"]
    claimed = np.where((claimed > 0.0) & (claimed < 1.0), claimed, 0.0)
    hard = use & (torque > 10.0) & (true["engine_speed"] > 1500.0 * np.pi / 30.0)
    return {
        "thrust": rms((found["thrust"] - true["thrust"])[use]) / rms(true["thrust"][use]),
        "efficiency": rms((claimed - efficiency)[hard]),
    }


def consistency(trip: Trip, estimate: Estimate) -> dict[str, float]:
    """NEES of the live speed, thrust and pitch while the engine drives."""
    use = driving(trip, estimate.time)
    return {
        name: float(
            np.mean(
                (estimate.column(name) - at(trip, name, estimate.time))[use] ** 2
                / estimate.variance[use, STATES.index(name)]
            )
        )
        for name in NEES
    }


def innovations(estimate: Estimate) -> dict[str, tuple[float, float]]:
    """Mean NIS of what was fused, and the share that was turned away, of each kind of measurement."""
    records = estimate.records
    found = {}
    for kind in np.unique(records["kind"]):
        mine = records[records["kind"] == kind]
        told = mine["fused"] & np.isfinite(mine["nis"])
        refused = np.isin(mine["reason"], ("gate", "stuck", "poor", "not_finite"))
        found[str(kind)] = (float(np.mean(mine["nis"][told])) if told.any() else float("nan"), float(refused.mean()))
    return found


def deaf(log: SensorLog) -> SensorLog:
    """`log` without what the receiver told."""
    return SensorLog({**log.streams, "gps": log["gps"][:0]})


def judged(drive: Saved, learnt: Mapping[str, float], settings: ObserverSettings, lag: bool) -> dict[str, dict]:
    """All figures of one drive: by set of sensors, by live / lag / smoothed."""
    log, road = drive.log(), drive.road_map()
    found: dict[str, dict] = {}
    for name, packets, known, earlier in (
        (SETS[0], log, road, None),
        (SETS[1], log, None, None),
        (SETS[2], deaf(log), None, learnt),
    ):
        estimate = observe(packets, drive.car, known, earlier, settings)
        row = {
            "live": errors(drive.trip, estimate.time, estimate.state),
            "smoothed": errors(drive.trip, estimate.time, estimate.smoothed),
            "nees": consistency(drive.trip, estimate),
            "nis": innovations(estimate),
        }
        if lag:
            time, state, _ = observe_lagged(packets, drive.car, LAG, known, earlier, settings)
            row["lag"] = errors(drive.trip, time, state)
        found[name] = row
    return found


def measure(scenarios: Iterable[str], seeds: Sequence[int], folder: Path) -> Iterator[dict]:
    """Yield one row per seed and scenario; biases come from the `EARLIER` seeds before (other trips, same box)."""
    thesis = printed_in_our_filter()
    learnt: dict[tuple[str, int], tuple[dict[str, float], dict[str, float]]] = {}
    for seed, scenario in product(seeds, scenarios):
        for earlier in range(seed - EARLIER, seed):
            if (scenario, earlier) not in learnt:
                before = saved_drive(scenario, earlier, folder)
                log, road = before.log(), before.road_map()
                learnt[scenario, earlier] = (
                    observe(log, before.car, road).learnt,
                    observe(log, before.car, road, None, thesis).learnt,
                )
        trips = [learnt[scenario, earlier] for earlier in range(seed - EARLIER, seed)]
        drive = saved_drive(scenario, seed, folder)
        ours = judged(drive, carried_over([own for own, _ in trips]), DEFAULT, lag=True)
        printed = judged(drive, carried_over([printed for _, printed in trips], thesis), thesis, lag=False)
        yield {"scenario": scenario, "seed": seed, "ours": ours, "thesis": printed}


def rounded(value: Any) -> Any:
    """`value` with four significant digits."""
    if isinstance(value, float):
        return float(f"{value:.4g}")
    if isinstance(value, Mapping):
        return {key: rounded(each) for key, each in value.items()}
    return [rounded(each) for each in value] if isinstance(value, list | tuple) else value


def pooled(rows: list[dict], tuning: str, sensors: str, when: str, figure: str) -> tuple[float, float, float]:
    """Root mean square over the rows, and its 95 % interval by bootstrap over them."""
    squares = np.array([row[tuning][sensors][when][figure] ** 2 for row in rows])
    rng = np.random.default_rng(0)
    drawn = np.sqrt(squares[rng.integers(0, len(squares), (2000, len(squares)))].mean(axis=1))
    low, high = np.quantile(drawn, (0.025, 0.975))
    return float(np.sqrt(squares.mean())), float(low), float(high)


def tables(rows: list[dict]) -> str:
    """The tables of docs/observer.md, Markdown."""
    lines = [
        "| sensors | estimate | thrust % | asked | efficiency | asked | printed tuning: thrust % | efficiency |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for sensors in SETS:
        for when in ("live", "lag", "smoothed"):
            thrust, low, high = pooled(rows, "ours", sensors, when, "thrust")
            efficiency = pooled(rows, "ours", sensors, when, "efficiency")
            asked, asked_efficiency = ASKED[sensors][when]
            cells = [
                sensors,
                f"lag {LAG:g} s" if when == "lag" else when,
                f"{100 * thrust:.1f} ({100 * low:.1f} - {100 * high:.1f})",
                f"{100 * asked:.1f}",
                f"{efficiency[0]:.3f} ({efficiency[1]:.3f} - {efficiency[2]:.3f})",
                "" if asked_efficiency is None else f"{asked_efficiency:.3f}",
            ]
            if when == "lag":
                cells += ["", ""]
            else:
                printed = [pooled(rows, "thesis", sensors, when, figure)[0] for figure in ("thrust", "efficiency")]
                cells += [f"{100 * printed[0]:.1f}", f"{printed[1]:.3f}"]
            lines.append("| " + " | ".join(cells) + " |")
    lines += ["", "| scenario | " + " | ".join(f"{s}: live / lag / smoothed" for s in SETS) + " |", "|---|---|---|---|"]
    for scenario in dict.fromkeys(row["scenario"] for row in rows):
        mine = [row for row in rows if row["scenario"] == scenario]
        cells = [
            " / ".join(f"{100 * pooled(mine, 'ours', s, w, 'thrust')[0]:.1f}" for w in ("live", "lag", "smoothed"))
            for s in SETS
        ]
        lines.append(f"| {scenario} | " + " | ".join(cells) + " |")
    lines += ["", "| NEES | " + " | ".join(SETS) + " |", "|---|---|---|---|"]
    for name in NEES:
        means = [np.mean([row["ours"][sensors]["nees"][name] for row in rows]) for sensors in SETS]
        lines.append(f"| {name} | " + " | ".join(f"{value:.2f}" for value in means) + " |")
    lines += ["", "| measurement | mean NIS | turned away % |", "|---|---|---|"]
    kinds = sorted({kind for row in rows for kind in row["ours"][SETS[0]]["nis"]})
    for kind in kinds:
        told = [row["ours"][SETS[0]]["nis"][kind] for row in rows if kind in row["ours"][SETS[0]]["nis"]]
        nis, refused = np.nanmean([value[0] for value in told]), np.mean([value[1] for value in told])
        lines.append(f"| `{kind}` | {nis:.2f} | {100 * refused:.1f} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--print", action="store_true", help="only print the tables of the file")
    parser.add_argument("--drives", type=Path, default=Path(tempfile.gettempdir()) / "rollingroad-drives")
    parser.add_argument("--scenarios", nargs="+", default=list(SCENARIOS))
    parser.add_argument("--seeds", type=int, default=len(HELD_OUT))
    parser.add_argument("--out", type=Path, default=FILE)
    options = parser.parse_args()
    if not options.print:
        rows = []
        for row in measure(options.scenarios, HELD_OUT[: options.seeds], options.drives):
            rows.append(row)
            told = row["ours"][SETS[0]]
            print(row["scenario"], row["seed"], *(f"{told[w]['thrust']:.4f}" for w in ("live", "lag", "smoothed")))
            text = json.dumps(rounded({"rows": rows}), separators=(",", ":")).replace('{"scenario"', '\n{"scenario"')
            options.out.write_text(text + "\n")
    print(tables(json.loads(options.out.read_text())["rows"]))
