"""Scenario files: what ships is valid; what is wrong is refused in one line that names the place."""

from pathlib import Path

import pytest

from rollingroad.catalogue import check_settings
from scenarios import files
from scenarios.effects import EFFECTS
from scenarios.schema import Scenario
from vehicle_model.car.errors import BadInput

PROMISED = [
    "mixed",
    "town",
    "green_wave",
    "hills",
    "motorway",
    "jam",
    "night",
    "headwind",
    "winter",
    "school_run",
    "commute",
    "mountain",
]
VALID = 'title = "t"\n[road]\nname = "mixed"\n'


def test_all_promised_scenarios_ship() -> None:
    assert set(PROMISED) <= set(files.names())


@pytest.mark.parametrize("name", PROMISED)
def test_a_shipped_scenario_is_valid_with_known_effects_in_range(name: str) -> None:
    scenario = files.load(name)
    assert scenario.name == name
    assert scenario.expectations.time_s is not None and scenario.expectations.vehicles is not None
    check_settings(scenario.effects, name)


@pytest.mark.parametrize(
    ("text", "place", "expected"),
    [
        ('title = "t"\n[road]\nname = "mixed"\nlanes = 3\n', "road.lanes", "no such key"),
        (VALID + "[driver]\nreaction_time = 9.0\n", "driver.reaction_time", "less than or equal to 3"),
        (VALID + '[driver]\nreaction_time = "0.4 s"\n', "driver.reaction_time", "valid number"),
        (VALID + '[driver]\nkind = "lazy"\n', "driver.kind", "'good'"),
        (VALID + "[traffic]\nvehicles = 60.5\n", "traffic.vehicles", "integer"),
        ('title = "t"\n', "road", "required"),
        ('title = "t"\n[road]\n', "road", "exactly one"),
        ('title = "t"\n[road]\nname = "moon"\n', "road.name", "expected one of"),
        ('title = "t"\n[road]\nosm = "a.osm"\nfrom = [49.0, 6.0]\n', "road", "both from and to"),
        ('title = "t"\n[road]\nosm = "a.osm"\nfrom = [99.0, 6.0]\nto = [49.0, 6.0]\n', "road.from.0", "equal to 90"),
        ('title = "t\n', "", "TOML"),
        (VALID + "seed = -1\n", "road.seed", "no such key"),
    ],
)
def test_what_is_wrong_is_named(text: str, place: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(BadInput) as refusal:
        files.check(path)
    message = str(refusal.value)
    assert message.startswith(f"{path}: {place}" if place else f"{path}: ")
    assert expected in message and "\n" not in message


def test_a_file_that_is_not_there_or_not_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no such scenario"):
        files.load(tmp_path / "nowhere.toml")
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInput, match="UTF-8"):
        files.load(path)
    with pytest.raises(BadInput, match="no such file"):
        files.from_osm(tmp_path / "nowhere.osm")


def test_an_extract_beside_the_file_is_found(tmp_path: Path) -> None:
    path = tmp_path / "here.toml"
    path.write_text('title = "t"\n[road]\nosm = "town.osm"\nfrom = [49.6, 6.1]\nto = [49.7, 6.2]\n')
    scenario = files.load(path)
    assert scenario.road.osm == str(tmp_path / "town.osm")
    assert scenario.road.start == (49.6, 6.1) and scenario.name == "here"


def test_every_field_says_its_unit_or_meaning() -> None:
    """Each number of the schema has a description and bounds."""

    def numbers(model: type) -> list[tuple[str, object]]:
        found = []
        for name, field in model.model_fields.items():  # type: ignore[attr-defined]
            if field.annotation in (int, float):
                found.append((f"{model.__name__}.{name}", field))
            elif hasattr(field.annotation, "model_fields"):
                found += numbers(field.annotation)
        return found

    for name, field in numbers(Scenario):
        assert field.description and field.metadata, name


def test_driver_and_traffic_rows_of_the_catalogue_are_neutral_by_default() -> None:
    assert {effect.id for effect in EFFECTS} == {"driver_lag", "traffic_actuation"}
    for effect in EFFECTS:
        for parameter in effect.parameters:
            assert parameter.low <= parameter.neutral <= parameter.high


def test_a_city_is_skipped_with_the_reason_until_its_extract_is_at_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROLLINGROAD_ROADS", raising=False)
    with pytest.raises(BadInput, match="skipped: no extract"):
        files.load("monaco")
    monkeypatch.setenv("ROLLINGROAD_ROADS", str(tmp_path))
    with pytest.raises(BadInput, match=r"skipped: no extract .*monaco"):
        files.load("monaco")
    (tmp_path / "monaco").mkdir()
    (tmp_path / "monaco" / "network.osm").write_text("<osm/>")
    city = files.load("monaco")
    assert city.name == "monaco" and city.road.osm == str(tmp_path / "monaco" / "network.osm")
    assert "monaco" not in files.names(), "a city belongs to no list of what ships"
