"""What lies at hand: scenarios, cars, road extracts, logs; and whether a file is what it should be."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rollingroad.catalogue import check_settings
from scenarios.files import CITIES, city_extract, load, names
from sensors.log import SensorLog
from sensors.log_files import read_any
from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car, shipped_cars


def shelf() -> dict[str, Any]:
    """Scenarios with titles, cars, and the real cities with their extract or the reason why they are skipped."""
    return {
        "scenarios": {name: load(name).title for name in names()},
        "cars": shipped_cars(),
        "cities": {city: _extract_or_reason(city) for city in CITIES},
    }


def _extract_or_reason(city: str) -> str:
    try:
        return str(city_extract(city))
    except BadInput as fault:
        return fault.expected


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
            yield read_any(path)
