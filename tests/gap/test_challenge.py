"""The blind set: apart from the plant, sealed before it is made, the same under the same seed."""

import ast
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import rollingroad.gap.challenge as challenge
from rollingroad.gap.challenge import cars, effects, limits, routes, truth
from rollingroad.gap.challenge.make import _plan, make
from rollingroad.gap.challenge.run import run
from rollingroad.gap.challenge.score import score
from vehicle_model.car.errors import BadInput

GENERATOR = ("box.py", "cars.py", "effects.py", "limits.py", "make.py", "routes.py", "truth.py")


@pytest.fixture(scope="module")
def drive():
    """A car, a road and the car's neutral drive over it."""
    rng = np.random.default_rng(3)
    car = cars.draw(rng)
    road = routes.draw(rng, 5000, {"town": 0.4, "rural": 0.6, "motorway": 0.0})
    driver = {"accel": 1.6, "decel": 1.3, "up_rpm": 2800, "down_rpm": 1500, "speed_factor": 1.0, "shift_time": 0.5,
              "gain": 0.6, "launch_speed": 150, "lift_time": 5}  # fmt: skip
    still = np.zeros(3000)
    return car, road, driver, truth.simulate(car.true, car.ratios, driver, road, {}, still + 1.0, still)


def test_the_generator_imports_nothing_of_the_plant() -> None:
    """Given the generator's files, then none imports the product's plant, replay or diagnosis."""
    folder = Path(challenge.__file__).parent
    for name in GENERATOR:
        for node in ast.walk(ast.parse((folder / name).read_text())):
            modules = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            modules += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for module in modules:
                assert not module.startswith("vehicle_model.plant"), f"{name}: {module}"
                own = module.startswith("rollingroad.gap.challenge")
                assert own or not module.startswith("rollingroad.gap"), f"{name}: {module}"


def test_energy_of_the_drive_closes(drive) -> None:
    """Given a drive, then thrust less brakes less resistance is the change of kinetic energy (rectangles of 0.1 s: 3
    %)."""
    car, _, _, d = drive
    inertia = car.true["mass"] + car.true["wheel_inertia_mass"]
    work = np.sum((d["thrust"] - d["brake"]) * d["speed"]) * 0.1
    drag = np.sum(0.5 * car.true["rho"] * car.true["cd_a"] * d["speed"] ** 3) * 0.1
    roll = np.sum(car.true["mass"] * 9.805 * car.true["c_rr"] * np.cos(d["pitch"]) * d["speed"]) * 0.1
    climb = car.true["mass"] * 9.805 * (d["altitude"][-1] - d["altitude"][0])
    kinetic = 0.5 * inertia * (d["speed"][-1] ** 2 - d["speed"][0] ** 2)
    assert work == pytest.approx(
        drag + roll + climb + kinetic, abs=0.03 * np.sum(np.abs(d["thrust"]) * d["speed"]) * 0.1
    )


def test_sealed_before_and_the_same_under_the_same_seed(tmp_path: Path) -> None:
    """Given a seed, then a second making gives the same bytes, but another salt; the manifest's hash is the key's."""
    for name in ("a", "b"):
        make(2, 7, tmp_path / name, workers=1)
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert any(f.suffix == ".dat" for f in files)
    for name in files:
        if name.name not in ("manifest.json", "salt"):
            assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    commitments = [json.loads((tmp_path / n / "manifest.json").read_text())["key_sha256"] for n in ("a", "b")]
    assert commitments[0] != commitments[1]
    key = tmp_path / "a" / "key"
    assert (key.stat().st_mode & 0o077) == 0
    body, salt = (key / "key.json").read_text(), (key / "salt").read_text()
    assert hashlib.sha256((salt + body).encode()).hexdigest() == commitments[0]
    (key / "key.json").chmod(0o600)
    (key / "key.json").write_text(body.replace("case_0000", "case_0001", 1))
    with pytest.raises(BadInput, match="committed"):
        score(tmp_path / "a")
    with pytest.raises(BadInput, match="new or empty"):
        make(1, 7, tmp_path / "a", workers=1)


def test_a_set_is_run_without_its_key_and_taken_up_again(tmp_path: Path) -> None:
    """Given a set whose key has been carried away, then it is diagnosed; run again, its answers come from the store."""
    make(1, 7, tmp_path / "set", workers=1)
    (tmp_path / "set" / "key").rename(tmp_path / "elsewhere")
    first, failed = run(tmp_path / "set", workers=0)
    assert not failed
    assert first[0]["verdict"] in ("no_gap", "named", "class", "outside_catalogue")
    answer = tmp_path / "set" / "case_0000" / "result.json"
    answer.unlink()
    again, _ = run(tmp_path / "set", workers=0)
    assert again == first  # the time it took included: nothing was done again
    assert json.loads(answer.read_text()) == first[0]


def test_a_hidden_effect_is_hidden_with_its_twins() -> None:
    """Given cases whose effect is taken out of the catalogue, then all that may stand for it at class level are too."""
    plans = [_plan(number, "hidden", 7) for number in range(6)]
    for plan in plans:
        for part in plan.key.parts:
            twins = {e.id for e in effects.EFFECTS if effects.same_class(e.id, part.effect)}
            assert twins <= set(plan.hide)
    assert any(plan.hide for plan in plans)


def test_what_could_stand_for_an_effect_depends_on_its_size(drive) -> None:
    """Given fuel at idle at twice its limit, then a constant accessory could stand for it on these drives; at ten times
    that size it could not, since it would burn while driving too; a wind, whose signs and places differ, never could.
    """
    car, _, _, d = drive
    shown = limits.bound(car, [d], [d])
    idle = effects.BY_ID["idle_fuel"]
    size = 2.0 * shown.limit(idle, False, 1)
    rivals = [effects.BY_ID[name] for name in ("accessory_load", "head_wind", "drag_area")]
    assert shown.twins(idle, False, 1, size, rivals) == ["accessory_load"]
    assert shown.twins(idle, False, 1, 10.0 * size, rivals) == []
    assert shown.twins(idle, False, 1, -size, rivals) == []  # nothing that only burns more can stand for less


def test_an_unknown_map_raises_the_limit(drive) -> None:
    """Given an engine that nobody has disclosed, then an effect on its fuel must be larger to be seen than with the map
    known, and more reference trips bring the two together."""
    car, _, _, d = drive
    for name in ("driveline_loss", "accessory_load", "map_drift"):
        effect = effects.BY_ID[name]
        known = limits.detection_limit(effect, False, 1, car, [d, d])
        few = limits.detection_limit(effect, False, 1, car, [d, d], [d])
        many = limits.detection_limit(effect, False, 1, car, [d, d], [d] * 6)
        assert known < many < few


def test_where_an_effect_is_loud(drive) -> None:
    """Given lost fuel cut-off, idle fuel and a drag, then most of the signal lies where physics puts it."""
    car, _, _, d = drive
    shown = limits.bound(car, [d])
    loud = {name: shown.regimes(effects.BY_ID[name], False, 1)[0] for name in ("fuel_cutoff", "idle_fuel", "drag_area")}
    assert loud["fuel_cutoff"]["deceleration"] > 0.5
    assert loud["idle_fuel"]["idle"] > 0.5
    assert loud["drag_area"]["idle"] < 0.01
    for shares in loud.values():
        assert sum(shares.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["drag_area", "accessory_load", "gps_lag", "wheel_radius"])
def test_more_trips_lower_the_limit(drive, name: str) -> None:
    """Given more of the same trips, then the detection limit does not rise."""
    car, _, _, d = drive
    effect = effects.BY_ID[name]
    one = limits.detection_limit(effect, False, 1, car, [d])
    assert 0.0 < limits.detection_limit(effect, False, 1, car, [d, d, d]) <= one * 1.0001


def test_along_gives_the_drives_own_fuel(drive) -> None:
    """Given the drive's own motion, when solved for itself, then the fuel in gear is the forward drive's within 3 %."""
    car, _, _, d = drive
    fuel, _ = truth.along(car.true, car.ratios, {}, d)
    steady = (d["clutch"] == 1) & (d["burnt"] > 0) & (d["thrust"] > 50)
    assert fuel[steady].sum() == pytest.approx(d["burnt"][steady].sum(), rel=0.03)
