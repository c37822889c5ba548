"""What a command is asked to do: scenario, car, seed and departures from neutral, checked before anything runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rollingroad.catalogue import check_settings, plant_keys, read_settings
from scenarios.files import from_osm, load
from scenarios.schema import Scenario, Traffic
from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car
from vehicle_model.car.parameters import Car


@dataclass(frozen=True)
class Task:
    """One scenario, one car, one seed; the command's settings are among the scenario's effects."""

    scenario: Scenario
    car: Car
    seed: int

    @property
    def settings(self) -> Mapping[str, float]:
        """Every effect parameter that is set, by key."""
        return self.scenario.effects

    @property
    def plant_settings(self) -> dict[str, float]:
        """The settings that the plant takes."""
        keys = plant_keys()
        return {key: value for key, value in self.settings.items() if key in keys}


def make_task(
    scenario: str | Path,
    *,
    car: str | None = None,
    seed: int | None = None,
    settings: Sequence[str] = (),
    osm: Path | None = None,
    start: str | None = None,
    end: str | None = None,
) -> Task:
    """Read the scenario (or make one of an OpenStreetMap extract) and the car, and check the settings.

    `settings` are `effect.parameter=value` strings; `start` and `end` are "lat,lon" in degrees. Raises BadInput.
    """
    read = load(scenario) if osm is None else from_osm(osm, *_ends(start, end))
    if osm is None and (start or end):
        raise BadInput("--from/--to", "", "expected together with --osm")
    effects = check_settings(read.effects, str(read.source or read.name)) | read_settings(settings)
    scenario_set = read.model_copy(update={"effects": effects})
    return Task(scenario_set, read_car(car or read.car), read.seed if seed is None else seed)


def telling(task: Task, reach: float | None) -> Task:
    """`task` with signals that tell from `reach` m when they turn; None: as its scenario has it. Raises BadInput."""
    if reach is None:
        return task
    try:
        traffic = Traffic(**(task.scenario.traffic.model_dump() | {"signals_tell": reach}))
    except ValidationError:
        raise BadInput("--signals-tell", f"{reach:g}", "expected 0 to 2000 m") from None
    return replace(task, scenario=task.scenario.model_copy(update={"traffic": traffic}))


def described(task: Task) -> dict[str, Any]:
    """`task` as `run.json` keeps it, so that later arrows know what was asked."""
    scenario = task.scenario
    return {
        "scenario": scenario.model_dump(mode="json", by_alias=True, exclude={"source"}, exclude_none=True),
        "source": str(scenario.source or scenario.name),
        "seed": task.seed,
    }


def _ends(start: str | None, end: str | None) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
    return (
        None if start is None else _place("--from", start),
        None if end is None else _place("--to", end),
    )


def _place(option: str, text: str) -> tuple[float, float]:
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        raise BadInput(option, text, "expected LAT,LON in degrees, such as 49.61,6.13") from None
    if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 180.0):
        raise BadInput(option, text, "expected a latitude in -90 to 90 and a longitude in -180 to 180 degrees")
    return latitude, longitude
