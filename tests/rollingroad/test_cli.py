"""The command's promises to other programs: exit status, one JSON object, bad input in one line, never a traceback."""

import json
import sys
from pathlib import Path

import pytest

from rollingroad.cli import main

OSM_WITHOUT_ROADS = '<?xml version="1.0"?><osm version="0.6"><node id="1" lat="49.6" lon="6.1"/></osm>'


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["rollingroad", *map(str, arguments)])
        monkeypatch.delenv("ROLLINGROAD_TRACEBACK", raising=False)
        with pytest.raises(SystemExit) as stop:
            main()
        told = capsys.readouterr()
        return int(stop.value.code or 0), told.out, told.err

    return run


def test_json_is_one_object_and_nothing_else(command):
    status, out, err = command("cycle", "HWFET", "--json")
    account = json.loads(out)
    assert status == 0 and err == ""
    assert account["fuel_J"] == pytest.approx(sum(account["account_J"].values()), rel=1e-6)


def test_the_same_command_prints_the_same_bytes(command):
    assert command("dyno", "--json") == command("dyno", "--json")


def test_an_effect_changes_the_fuel_in_its_own_direction(command):
    calm = json.loads(command("cycle", "HWFET", "--json")[1])
    windy = json.loads(command("cycle", "HWFET", "--set", "head_wind.speed=4", "--json")[1])
    assert windy["fuel_J"] > 1.03 * calm["fuel_J"]


def test_solve_agrees_with_itself_by_several_methods(command):
    status, out, _ = command("solve", "six-speed-free", "--method", "indirect,dp", "--json")
    answers = {row["method"]: row["J"] for row in json.loads(out)["solutions"]}
    assert status == 0
    assert answers["indirect"] == pytest.approx(answers["dp"], rel=0.005)
    assert answers["indirect"] == pytest.approx(989.23e3, rel=0.002)


def bad_files(folder: Path) -> dict[str, Path]:
    texts = {
        "unknown_key.toml": 'title = "x"\nspeling = 1\n[road]\nname = "mixed"\n',
        "wrong_type.toml": 'title = "x"\n[road]\nname = "mixed"\n[traffic]\nvehicles = "sixty"\n',
        "out_of_range.toml": 'title = "x"\n[road]\nname = "mixed"\n[driver]\nreaction_time = -1.0\n',
        "not.toml": "this is = = not toml",
        "car.xml": "<ponthy_config><engine><type/></engine><wings/></ponthy_config>",
        "bomb.xml": '<!DOCTYPE a [<!ENTITY b "bbbb">]><ponthy_config>&b;</ponthy_config>',
        "empty.osm": OSM_WITHOUT_ROADS,
        "not.osm": "no XML at all",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    return {name: folder / name for name in texts}


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("run", "{unknown_key.toml}"), "speling"),
        (("run", "{wrong_type.toml}"), "traffic.vehicles"),
        (("run", "{out_of_range.toml}"), "driver.reaction_time"),
        (("run", "{not.toml}"), "not.toml"),
        (("run", "nowhere"), "no such scenario"),
        (("run", "town", "--car", "{car.xml}"), "wings"),
        (("run", "town", "--car", "{bomb.xml}"), "bomb.xml"),
        (("run", "town", "--car", "trabant"), "shipped car"),
        (("run", "town", "--set", "head_wind.sped=4"), "head_wind.speed"),
        (("run", "town", "--seed", "-1"), "seed"),
        (("run", "--osm", "{empty.osm}"), "empty.osm"),
        (("run", "--osm", "{not.osm}"), "not.osm"),
        (("run", "--osm", "nowhere.osm"), "nowhere.osm"),
        (("run", "town", "--from", "49.6,6.1"), "--osm"),
        (("observe", "nowhere"), "nowhere"),
        (("map", "nowhere"), "nowhere"),
        (("cycle", "nowhere"), "nowhere"),
        (("solve", "nowhere"), "nowhere"),
        (("solve", "six-speed-free", "--method", "guess"), "guess"),
        (("inspect", "nowhere.dat"), "nowhere.dat"),
        (("import", "nowhere.csv", "--layout", "obd_csv", "--out", "x"), "nowhere.csv"),
        (("view", "nowhere"), "nowhere"),
        (("display", "nowhere"), "nowhere"),
        (("fly",), "fly"),
    ],
)
def test_bad_input_is_one_line_that_names_the_place_with_status_2(command, tmp_path, monkeypatch, arguments, told):
    files = bad_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    given = [str(files[word[1:-1]]) if word.startswith("{") else word for word in arguments]
    status, out, err = command(*given)
    assert status == 2
    assert out == ""
    assert err.count("\n") == 1 and told in err
    assert "Traceback" not in err and "internal error" not in err
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_check_tells_each_file_and_fails_if_one_is_bad(command, tmp_path):
    files = bad_files(tmp_path)
    status, out, _ = command("scenarios", "check", files["unknown_key.toml"], files["car.xml"], "--json")
    verdicts = json.loads(out)["files"]
    assert status == 2 and all(verdicts.values())


def test_every_command_has_help_that_answers(command):
    status, out, _ = command("--help")
    assert status == 0
    for name in ("run", "cycle", "dyno", "drive", "sense", "observe", "map", "plan", "compare", "solve", "inspect"):
        assert name in out
