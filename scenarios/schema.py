"""What a scenario file may say: one TOML table per part, unknown keys refused, units and ranges at each field."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

DriverKind = Literal["good", "eidm", "alert", "krauss", "soft", "brisk"]
Latitude = Annotated[float, Field(ge=-90.0, le=90.0)]
Longitude = Annotated[float, Field(ge=-180.0, le=180.0)]


class _Part(BaseModel):
    # Strict: "12" is not 12. Frozen: a scenario is a value; drives of it must agree.
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, populate_by_name=True)


class Road(_Part):
    """The road: one that ships, or an OpenStreetMap extract."""

    name: str | None = Field(None, description="a road of scenarios/roads, such as mixed")
    section: str = Field("whole", description="which stretch of it, as its road.toml names them")
    osm: str | None = Field(
        None, description="path of an OpenStreetMap extract; relative paths count from the scenario file"
    )
    start: tuple[Latitude, Longitude] | None = Field(None, alias="from", description="latitude, longitude, deg")
    end: tuple[Latitude, Longitude] | None = Field(None, alias="to", description="latitude, longitude, deg")

    @model_validator(mode="after")
    def _one_source(self) -> "Road":
        if (self.name is None) == (self.osm is None):
            raise ValueError("expected exactly one of name (a built-in road) and osm (an extract)")
        if (self.start is None) != (self.end is None):
            raise ValueError("expected both from and to, or neither")
        if self.start is not None and self.osm is None:
            raise ValueError("from and to belong to an osm road; a built-in one has sections")
        return self


class Traffic(_Part):
    """Everybody else."""

    vehicles: int = Field(60, ge=0, le=400, description="mean number in the network at a time")
    trucks: float = Field(0.08, ge=0.0, le=1.0, description="share of lorries")
    model: Literal["Krauss", "IDM", "EIDM"] = Field("Krauss", description="SUMO's car-following model of the others")
    imperfection: float = Field(0.3, ge=0.0, le=1.0, description="sigma of the Krauss model")
    speed_spread: float = Field(0.08, ge=0.0, le=0.3, description="deviation of the drivers' speed factors")
    corridor: float = Field(
        3.0, ge=0.0, le=50.0, description="how much more likely a journey is for each share of the ego's route in it"
    )
    signals_tell: float = Field(
        0.0, ge=0.0, le=2000.0, description="m from which signals tell a car's device when they turn; 0: they do not"
    )


class Driver(_Part):
    """Who drives, and how well he follows advice."""

    kind: DriverKind = Field("good", description="baseline style")
    reaction_time: float = Field(0.4, ge=0.0, le=3.0, description="s until a changed wish reaches the pedal")
    pedal_step: float = Field(0.02, ge=0.0, le=0.2, description="quantization of the pedal, share of full force")
    advice_delay: float = Field(0.8, ge=0.0, le=5.0, description="s until new advice is acted upon")
    tracking_error: float = Field(0.08, ge=0.0, le=1.0, description="m/s2 rms by which advice is missed")
    glance: float = Field(0.6, ge=0.0, le=3.0, description="s of looking at a display that changed, foot at rest")
    refusal: float = Field(0.03, ge=0.0, le=1.0, description="share of the time in which advice is ignored")
    lateral_comfort: float = Field(2.2, ge=0.5, le=6.0, description="m/s2 sideways that he accepts in bends")


class Sensors(_Part):
    """The logger in the car."""

    box: dict[str, float | int | bool | str] = Field(
        default_factory=dict, description="departures from the default box, by its field names"
    )
    faults: list[dict[str, float | int | bool | str]] = Field(
        default_factory=list,
        description="timeline of faults: sensor, kind, start and end in s, and the fault's own keys",
    )


class Expectations(_Part):
    """What must hold of a run; checked by the regression suite."""

    vehicles: tuple[float, float] | None = Field(None, description="mean number in the network, least and most")
    distance_km: tuple[float, float] | None = Field(None, description="least and most")
    time_s: tuple[float, float] | None = Field(None, description="baseline's trip time, least and most")
    fuel_l_per_100km: tuple[float, float] | None = Field(None, description="baseline's, least and most")
    thrust_error: float | None = Field(None, gt=0.0, description="filter's thrust error / rms, at most")
    map_rmse: float | None = Field(None, gt=0.0, description="at most, fraction of 1")
    map_fuel_share: float | None = Field(None, gt=0.0, le=1.0, description="at least")
    gps_outage_s: tuple[float, float] | None = Field(None, description="least and most")


class Scenario(_Part):
    """One scenario: a whole world to drive in, and what is expected of it."""

    title: str = Field(min_length=1)
    description: str = ""
    road: Road
    traffic: Traffic = Field(default_factory=Traffic)
    car: str = Field("smart", description="a car that ships, or a car file")
    driver: Driver = Field(default_factory=Driver)
    sensors: Sensors = Field(default_factory=Sensors)
    effects: dict[str, float] = Field(default_factory=dict, description="effect.parameter = value (EFFECTS)")
    seed: int = Field(0, ge=0, description="used when the command gives none")
    expectations: Expectations = Field(default_factory=Expectations)
    source: Path | None = Field(None, exclude=True, description="set by the loader")

    @property
    def name(self) -> str:
        """Short name: that of the file it came from, or of the extract."""
        if self.source is not None:
            return self.source.stem
        return self.road.name or Path(self.road.osm or "").parent.name or "osm"
