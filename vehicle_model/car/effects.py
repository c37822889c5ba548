"""The catalogue of effects as data: what a simulator usually leaves out, row by row (ids of the catalogue EFFECTS).

An effect is a set of physical parameters, each with the value that the nominal car declares for it (its *neutral*).
Switching an effect on is setting a parameter away from neutral; nothing ever asks which effect is on.
Each room declares its own rows with these classes; `rollingroad` gathers them.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from vehicle_model.car.errors import BadInput

SUBSYSTEMS = (
    "driver",
    "road_load",
    "driveline",
    "engine_fuel",
    "accessory",
    "gps",
    "accelerometer",
    "wheel",
    "injector",
    "clock",
    "road_map",
    "traffic",
)


@dataclass(frozen=True)
class Parameter:
    """One physical number of an effect."""

    name: str
    unit: str
    neutral: float
    """The nominal car's declared value."""
    low: float
    high: float
    """Plausible range, `low` to `high`, neutral inside it."""
    source: str
    """Where the range comes from."""
    primary: bool = True
    """False for a parameter of shape (a time constant, a bearing), idle while the primary ones are neutral."""

    @property
    def middle(self) -> float:
        """Middle of the range's longer side: the size at which an effect is described."""
        up, down = self.high - self.neutral, self.neutral - self.low
        return self.neutral + 0.5 * up if up >= down else self.neutral - 0.5 * down


@dataclass(frozen=True)
class Effect:
    """One row of the catalogue."""

    id: str
    subsystem: str
    """One of `SUBSYSTEMS`."""
    title: str
    parameters: tuple[Parameter, ...]
    channels: tuple[str, ...] = ()
    """What it changes first; a change of these carries on through the plant's own feedback."""
    confusers: tuple[str, ...] = ()
    """Effects that look like it."""

    def __post_init__(self) -> None:
        if self.subsystem not in SUBSYSTEMS:
            raise ValueError(f"{self.id}: subsystem {self.subsystem!r} is none of {SUBSYSTEMS}")
        for parameter in self.parameters:
            if not parameter.low <= parameter.neutral <= parameter.high:
                raise ValueError(f"{self.id}.{parameter.name}: neutral {parameter.neutral} outside its range")


def neutral_settings(effects: Iterable[Effect]) -> dict[str, float]:
    """Return {"effect.parameter": neutral value} of all rows."""
    return {f"{effect.id}.{part.name}": part.neutral for effect in effects for part in effect.parameters}


def complete_settings(
    settings: Mapping[str, float], effects: Iterable[Effect], source: object = "--set"
) -> dict[str, float]:
    """Return neutral settings with `settings` put in; unknown keys and values out of range raise `BadInput`.

    The range of the catalogue is where an effect is plausible; a departure as large again is still accepted, for the
    tails of a search, where it stays on the parameter's physical side (a factor or a time is never negative).
    """
    rows = {f"{effect.id}.{part.name}": part for effect in effects for part in effect.parameters}
    complete = {key: part.neutral for key, part in rows.items()}
    for key, value in settings.items():
        if key not in rows:
            raise BadInput(source, key, f"is no parameter of the catalogue; known: {', '.join(sorted(rows))}")
        part = rows[key]
        width = part.high - part.low
        low = part.low - width if part.low < 0.0 else min(part.low, 0.0) if part.neutral == 0.0 else 0.5 * part.low
        high = part.high + width
        if not low <= value <= high:
            unit = f" {part.unit}" if part.unit else ""
            raise BadInput(source, key, f"{value:g} is outside {low:g} to {high:g}{unit}")
        complete[key] = float(value)
    return complete
