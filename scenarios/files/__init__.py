"""Scenario files: finding, reading, checking."""

import os
import tomllib
from importlib import resources
from pathlib import Path

from pydantic import ValidationError

from scenarios.schema import Scenario
from vehicle_model.car.errors import BadInput

FOLDER = Path(str(resources.files(__package__)))
ROADS = FOLDER.parent / "roads"
CITIES = ("luxembourg", "monaco")
"""Scenarios on real roads; their extracts do not ship."""


def names() -> list[str]:
    """Names of the scenarios that ship."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def city_extract(city: str) -> Path:
    """The extract <city>/network.osm in the folder that ROLLINGROAD_ROADS names. Raises BadInput: why it is skipped."""
    folder = os.environ.get("ROLLINGROAD_ROADS")
    if not folder:
        raise BadInput(city, "", "skipped: no extract (give --osm, or set ROLLINGROAD_ROADS)")
    extract = Path(folder) / city / "network.osm"
    if not extract.is_file():
        raise BadInput(city, "", f"skipped: no extract {extract} (ROLLINGROAD_ROADS)")
    return extract


def load(name_or_path: str | Path) -> Scenario:
    """Load a shipped scenario or a city by name, or a file.

    Raises BadInput naming file, key and what was expected; for a city whose extract is not at hand, the reason.
    """
    text = str(name_or_path)
    if text in CITIES and not Path(text).is_file():
        return from_osm(city_extract(text))
    path = FOLDER / f"{text}.toml"
    if not path.is_file():
        path = Path(text)
        if not path.is_file():
            raise BadInput(text, "", f"no such scenario; expected a file or one of {', '.join(names())}")
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise BadInput(path, f"byte {error.start}", "expected text in UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise BadInput(path, "", f"expected TOML: {error}") from None
    except OSError as error:
        raise BadInput(path, "", f"cannot be read: {error.strerror}") from None
    return parse(values, path)


def parse(values: dict, source: Path) -> Scenario:
    """Build a scenario from the tables of a TOML file. Raises BadInput for the first thing that is wrong."""
    if "source" in values:
        raise BadInput(source, "source", "no such key")
    try:
        # TOML knows only arrays where the schema says tuples; from JSON, strict mode takes them.
        scenario = Scenario.model_validate(_tuples(values))
    except ValidationError as error:
        raise _bad_input(error, source) from None
    road = scenario.road
    if road.osm is not None:
        extract = Path(road.osm)
        extract = extract if extract.is_absolute() else (source.parent / extract)
        road = road.model_copy(update={"osm": str(extract)})
    elif not (ROADS / str(road.name) / "road.toml").is_file():
        known = ", ".join(sorted(folder.parent.name for folder in ROADS.glob("*/road.toml")))
        raise BadInput(source, "road.name", f"no such road: {road.name}; expected one of {known}")
    return scenario.model_copy(update={"source": source, "road": road})


def check(path: str | Path) -> Scenario:
    """Like `load`: return the valid scenario or raise BadInput."""
    return load(path)


def from_osm(
    extract: Path, start: tuple[float, float] | None = None, end: tuple[float, float] | None = None
) -> Scenario:
    """Return the default scenario on an OpenStreetMap extract, from and to (latitude, longitude) where given.

    Raises BadInput if the extract is missing or one of the two ends is.
    """
    if not extract.is_file():
        raise BadInput(extract, "", "no such file; expected an OpenStreetMap extract")
    name = extract.parent.name if extract.stem == "network" else extract.stem
    road: dict[str, object] = {"osm": str(extract.resolve())}
    road |= {"from": start} if start else {}
    road |= {"to": end} if end else {}
    values = {"title": f"The roads of {extract.name}", "road": road}
    return parse(values, Path(name or "osm"))


def _tuples(value: object) -> object:
    if isinstance(value, dict):
        return {key: _tuples(part) if key != "faults" else part for key, part in value.items()}
    return tuple(_tuples(part) for part in value) if isinstance(value, list) else value


def _bad_input(error: ValidationError, source: Path) -> BadInput:
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return BadInput(source, place, "no such key")
    message = first["msg"].removeprefix("Value error, ")
    found = "" if first["type"] in ("missing", "value_error") else f", not {first['input']!r}"
    description = _description(first["loc"])
    return BadInput(source, place, f"{message}{found}" + (f" ({description})" if description else ""))


def _description(location: tuple) -> str:
    model: type | None = Scenario
    text = ""
    for part in location:
        fields = getattr(model, "model_fields", None)
        if not fields:
            break
        known = {field.alias or name: field for name, field in fields.items()} | dict(fields)
        if part not in known:
            return ""
        text, model = known[part].description or "", known[part].annotation
    return text
