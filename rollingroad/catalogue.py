"""The catalogue of effects, gathered from the rooms that declare them, and the reading of `--set`."""

from collections.abc import Mapping, Sequence

from scenarios.effects import EFFECTS as TRAFFIC_EFFECTS
from sensors.effects import EFFECTS as SENSOR_EFFECTS
from vehicle_model.car.effects import Effect, Parameter
from vehicle_model.car.errors import BadInput
from vehicle_model.plant.effects import EFFECTS as PLANT_EFFECTS


def catalogue() -> dict[str, Effect]:
    """Every effect by its id, in the order of the rooms."""
    return {effect.id: effect for effect in (*PLANT_EFFECTS, *SENSOR_EFFECTS, *TRAFFIC_EFFECTS)}


def parameters() -> dict[str, Parameter]:
    """Every parameter by its key, `effect.parameter`."""
    return {
        f"{effect.id}.{parameter.name}": parameter for effect in catalogue().values() for parameter in effect.parameters
    }


def plant_keys() -> frozenset[str]:
    """The keys that the plant takes; the others are the sensors' and the driver's."""
    return frozenset(f"{effect.id}.{parameter.name}" for effect in PLANT_EFFECTS for parameter in effect.parameters)


def read_settings(assignments: Sequence[str], source: str = "--set") -> dict[str, float]:
    """Parse `effect.parameter=value` strings. Raises BadInput with the nearest key or the range."""
    return check_settings(dict(_parse(text, source) for text in assignments), source)


def _parse(text: str, source: str) -> tuple[str, float]:
    key, equals, value = text.partition("=")
    try:
        return key.strip(), float(value if equals else "?")
    except ValueError:
        raise BadInput(source, text, "expected EFFECT.PARAMETER=NUMBER, such as head_wind.speed=4") from None


def check_settings(settings: Mapping[str, float], source: str) -> dict[str, float]:
    """Return `settings` if each key is known and each value inside its plausible range (BadInput otherwise)."""
    known = parameters()
    for key, value in settings.items():
        if key not in known:
            raise BadInput(source, key, f"no such effect parameter; {_suggest(key, known)}")
        parameter = known[key]
        inside = parameter.low <= value <= parameter.high or value == parameter.neutral
        if not inside:
            raise BadInput(
                source, key, f"{value:g} is outside {parameter.low:g} to {parameter.high:g} {parameter.unit}".rstrip()
            )
    return dict(settings)


def _suggest(key: str, known: Mapping[str, Parameter]) -> str:
    from difflib import get_close_matches

    same_effect = [name for name in known if name.startswith(key.partition(".")[0] + ".")]
    close = same_effect or get_close_matches(key, list(known), n=3, cutoff=0.3) or sorted(known)[:3]
    return "expected one like " + ", ".join(close)
