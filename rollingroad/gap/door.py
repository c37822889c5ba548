"""What stands at the door: folders of logs, and roads (CLI.md, "At the door")."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rollingroad.gap.road import Road, road_of
from sensors import roadmap
from sensors.importing import load, read_foreign
from sensors.log import SensorLog
from sensors.log_files import read_parquet
from sensors.packets import read_log
from vehicle_model.car.errors import BadInput


def read_trips(folder: Path) -> tuple[list[SensorLog], list[str]]:
    """Return the trips of `folder` in order of name, and what was ignored. Raises BadInput without any trip."""
    if not folder.is_dir():
        raise BadInput(folder, "", "a folder of logs")
    trips, notes = [], []
    for path in sorted(folder.iterdir()):
        if path.suffix == ".dat":
            log = read_log(path)
            trips.append(log)
            lost = {kind: n for kind, n in log.damage.items() if n}
            if lost:
                notes.append(f"{path.name}: damaged, lost {', '.join(f'{n} {kind}' for kind, n in lost.items())}")
        elif path.suffix == ".parquet":
            trips.append(read_parquet(path))
        elif path.suffix == ".csv":
            trips.append(_read_csv(path))
        elif path.suffix not in (".osm", ".toml", ".xml"):
            notes.append(f"{path.name}: ignored")
    if not trips:
        raise BadInput(folder, "", "at least one *.dat, *.parquet or *.csv trip")
    return trips, notes


SOAK = 180.0
"""s at a standstill without fuel after which the next start is a trip of its own."""


def split_restarts(log: SensorLog) -> list[tuple[float, SensorLog]]:
    """Cut a log of speed and fuel columns where the engine stood still for SOAK: (s of rest before it, piece)."""
    speed, fuel = log["speed"], log["fuel"]
    if len(speed) < 100 or len(fuel) < 100:
        return [(0.0, log)]
    burnt = np.interp(speed["t"], fuel["t"], fuel["power"])
    awake = np.flatnonzero((speed["speed"] > 0.5) | (burnt > 0.02 * max(float(np.mean(burnt)), 1.0)))
    if not len(awake):
        return [(0.0, log)]
    gap = np.diff(speed["t"][awake])
    cuts = np.flatnonzero(gap > SOAK)
    starts = [float(speed["t"][0]), *(float(speed["t"][awake[i + 1]]) - 1.0 for i in cuts)]
    ends = [*(float(speed["t"][awake[i]]) + 5.0 for i in cuts), float(speed["t"][-1]) + 1.0]
    rests = [0.0, *(float(gap[i]) for i in cuts)]
    pieces = []
    for number, (a, b, rest) in enumerate(zip(starts, ends, rests, strict=True)):
        rows = {name: part[(part["t"] >= a) & (part["t"] < b)] for name, part in log.streams.items()}
        name = log.name if number == 0 else f"{log.name} (start {number + 1})"
        pieces.append((rest, SensorLog(rows, log.damage, name)))
    return pieces


def _read_csv(path: Path) -> SensorLog:
    layout = path.with_name("layout.toml")
    if not layout.exists():
        raise BadInput(path, "", "a layout.toml beside a CSV log")
    return read_foreign(path, load(layout)).log


def read_road(road: Path | None, folders: Sequence[Path]) -> tuple[Road | None, list[str]]:
    """Return the road: `--road`, else `road.osm` where present, else all `*.osm` of the folders, else none."""
    if road is not None:
        return road_of([roadmap.read_road(Path(road))]), []
    for folder in folders:
        if (folder / "road.osm").exists():
            return road_of([roadmap.read_road(folder / "road.osm")]), []
    files = sorted({path for folder in folders for path in folder.glob("*.osm")})
    if files:
        return road_of([roadmap.read_road(path) for path in files]), []
    return None, ["no road map"]
