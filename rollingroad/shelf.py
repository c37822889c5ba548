"""What lies at hand: scenarios, cars, road extracts, logs; and whether a file is what it should be."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rollingroad.catalogue import check_settings
from scenarios.files import load, names
from sensors.log import SensorLog
from sensors.log_files import read_parquet
from sensors.packets import read_log
from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car, shipped_cars

CITIES = ("luxembourg", "monaco")
"""Extracts that are test data, not part of the product."""


def shelf() -> dict[str, Any]:
    """Scenarios with titles, cars, and the real cities with their extract or the reason why they are skipped."""
    roads = os.environ.get("ROLLINGROAD_ROADS")
    cities: dict[str, str] = {}
    for city in CITIES:
        extract = Path(roads) / city / "network.osm" if roads else None
        found = extract is not None and extract.is_file()
        cities[city] = str(extract) if found else "skipped: no extract (give --osm, or set ROLLINGROAD_ROADS)"
    return {
        "scenarios": {name: load(name).title for name in names()},
        "cars": shipped_cars(),
        "cities": cities,
    }


def check_file(path: Path) -> str | None:
    """None if `path` is a valid scenario (TOML) or car file (XML, or TOML with a car in it); else what is wrong."""
    try:
        if not path.is_file():
            raise BadInput(path, "", "expected a file, but there is none")
        if path.suffix == ".xml" or "[engine" in path.read_text(errors="replace"):
            read_car(path)
        else:
            check_settings(load(path).effects, str(path))
    except BadInput as fault:
        return str(fault)
    return None


def logs_in(places: Sequence[Path]) -> Iterator[SensorLog]:
    """Read each log: `*.dat` packets and `*.parquet` from import, files or all those in a folder, by name."""
    for place in places:
        files = sorted([*place.glob("*.dat"), *place.glob("*.parquet")]) if place.is_dir() else [place]
        if not files:
            raise BadInput(place, "", "expected *.dat or *.parquet logs in the folder")
        for path in files:
            if not path.is_file():
                raise BadInput(path, "", "expected a log, but there is no such file")
            yield read_parquet(path) if path.suffix == ".parquet" else read_log(path)
