"""Layouts of real logs: which column is what, in which unit. One TOML file each, also for a layout of one's own."""

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from sensors.log import STREAMS
from vehicle_model.car.errors import BadInput

UNITS: dict[str, tuple[str, float]] = {
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "min": ("s", 60.0),
    "m/s": ("m/s", 1.0), "km/h": ("m/s", 1.0 / 3.6), "mph": ("m/s", 0.44704), "knot": ("m/s", 1852.0 / 3600.0),
    "m/s2": ("m/s2", 1.0), "g": ("m/s2", 9.80665), "mg": ("m/s2", 9.80665e-3),
    "rad": ("rad", 1.0), "rad/s": ("rad/s", 1.0), "deg/s": ("rad/s", float(np.pi / 180.0)),
    "rpm": ("rad/s", float(np.pi / 30.0)), "deg": ("deg", 1.0), "m": ("m", 1.0), "ft": ("m", 0.3048), "1": ("1", 1.0),
    "W": ("W", 1.0), "kW": ("W", 1e3), "cc/s": ("m3/s", 1e-6), "l/h": ("m3/s", 1e-3 / 3600.0), "l/s": ("m3/s", 1e-3),
    "gal/h": ("m3/s", 3.785411784e-3 / 3600.0), "g/s": ("kg/s", 1e-3), "kg/h": ("kg/s", 1.0 / 3600.0),
    "g/s air": ("kg/s air", 1e-3), "kg/h air": ("kg/s air", 1.0 / 3600.0),
}  # fmt: skip
"""Unit: (its SI unit, factor)."""

FIELD_UNITS: dict[tuple[str, str], tuple[str, ...]] = {
    ("accelerometer", "xyz"): ("m/s2",),
    ("gyroscope", "xyz"): ("rad/s",),
    ("compass", "heading"): ("rad", "deg"),
    ("speed", "speed"): ("m/s",),
    ("engine_speed", "speed"): ("rad/s",),
    ("fuel", "power"): ("W", "m3/s", "kg/s", "kg/s air"),
    ("injector", "width"): ("s",),
    ("skew", "gained"): ("s",),
}
_GPS_UNITS = {
    "utc": ("s",), "latitude": ("deg",), "longitude": ("deg",), "altitude": ("m",), "hdop": ("1",), "quality": ("1",),
    "satellites": ("1",), "speed": ("m/s",), "course": ("rad", "deg"),
}  # fmt: skip


def allowed_units(stream: str, column: str) -> tuple[str, ...]:
    """SI units that fit a column of a stream; empty where there is no such column."""
    if stream.startswith("gps"):
        return _GPS_UNITS.get(column, ())
    for (name, columns), units in FIELD_UNITS.items():
        if name == stream and (column == columns or (columns == "xyz" and column in columns)):
            return units
    return ()


def needed(stream: str) -> list[str]:
    """Columns without which a stream says nothing."""
    if stream.startswith("gps"):
        return []
    return [name for name in STREAMS[stream].names or () if name not in ("order", "t", "saturated")]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Column(_Strict):
    """Where a column of a stream comes from."""

    source: str | list[str] = Field(description="column title (csv; the first that is there) or file (numpy)")
    unit: str
    index: int = Field(0, ge=0, description="column of a two-dimensional array")
    factor: float = 1.0
    offset: float = Field(0.0, description="added after factor and unit, SI")
    required: bool = True

    @field_validator("unit")
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in UNITS:
            raise ValueError(f"unit {value!r} is none of {', '.join(UNITS)}")
        return value


class Stream(_Strict):
    """One stream of the log."""

    stream: str
    time: str | list[str]
    time_unit: str = "s"
    lag: float = Field(0.0, description="s by which the stamps come late; taken off")
    required: bool = True
    columns: dict[str, Column] = Field(default_factory=dict)

    @field_validator("stream")
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in STREAMS:
            raise ValueError(f"stream {value!r} is none of {', '.join(STREAMS)}")
        return value


class Fuel(_Strict):
    """What volumes and masses of fuel are turned into power with."""

    density: float = Field(745.0, gt=500.0, lt=1200.0, description="kg/m3")
    heating_value: float = Field(43.0e6, gt=1e7, lt=2e8, description="J/kg")
    air_ratio: float = Field(14.6, gt=5.0, lt=20.0, description="kg of air to 1 kg of fuel, stoichiometric")


class Layout(_Strict):
    """A layout: what a file of real measurements holds."""

    name: str
    description: str = ""
    format: Literal["csv", "numpy", "packets", "can"]
    delimiter: str = Field(",", min_length=1, max_length=1)
    decimal: Literal[".", ","] = "."
    skip_rows: int = Field(0, ge=0, description="lines before the titles")
    fuel: Fuel = Field(default_factory=lambda: Fuel.model_validate({}))
    database: str = Field("", description="can: a DBC file; empty for the shipped one")
    stream: list[Stream] = Field(default_factory=list)


def shipped() -> list[str]:
    """Names of the layouts that ship."""
    return sorted(entry.name[:-5] for entry in files(__name__).iterdir() if entry.name.endswith(".toml"))


def load(name_or_file: str | Path) -> Layout:
    """Return a shipped layout by name, or one from a TOML file. Raises BadInput, naming file and place."""
    path = Path(name_or_file)
    if str(name_or_file) in shipped():
        source, text = str(name_or_file), files(__name__).joinpath(f"{name_or_file}.toml").read_bytes()
    else:
        source = str(path)
        try:
            text = path.read_bytes()
        except OSError as error:
            expected = f"a layout file, or one of {', '.join(shipped())} ({error.strerror or error})"
            raise BadInput(source, "", expected) from error
    try:
        layout = Layout.model_validate(tomllib.loads(text.decode()))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(source, "", f"a TOML file ({error})") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise BadInput(source, place, first["msg"].removeprefix("Value error, ")) from error
    _check_columns(source, layout)
    return layout


def _check_columns(source: str, layout: Layout) -> None:
    if layout.format in ("csv", "numpy") and not layout.stream:
        raise BadInput(source, "stream", "at least one [[stream]]")
    for number, part in enumerate(layout.stream):
        place = f"stream.{number} ({part.stream})"
        if part.time_unit not in UNITS or UNITS[part.time_unit][0] != "s":
            raise BadInput(source, f"{place}.time_unit", f"a unit of time, not {part.time_unit!r}")
        if not part.time or any(not where.source for where in part.columns.values()):
            raise BadInput(source, place, "a name or more for the time and for each column")
        for column, where in part.columns.items():
            allowed = allowed_units(part.stream, column)
            if not allowed:
                known = [name for name in STREAMS[part.stream].names or () if name not in ("order", "t")]
                raise BadInput(source, f"{place}.columns.{column}", f"one of {', '.join(known)}")
            if UNITS[where.unit][0] not in allowed:
                expected = f"a unit of {' or '.join(allowed)}, not {where.unit!r}"
                raise BadInput(source, f"{place}.columns.{column}.unit", expected)
        if part.stream.startswith("gps") and not part.columns:
            raise BadInput(source, f"{place}.columns", "at least one column")
        missing = [name for name in needed(part.stream) if name not in part.columns]
        if layout.format in ("csv", "numpy") and missing:
            raise BadInput(source, f"{place}.columns.{missing[0]}", "where the column comes from: the stream needs it")
