"""Given a sweep file, then every point of the grid is run once, under its own settings, and what is wrong is told."""

from pathlib import Path

import pytest

from rollingroad.evaluation.store import Store
from rollingroad.evaluation.sweep import Sweep, command_line, points, read_sweep, run_sweep
from vehicle_model.car.errors import BadInput

CYCLE = """
command = "cycle"
arguments = ["US06"]
[grid]
"mass.factor" = [1.0, 1.1]
"--car" = ["smart"]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "sweep.toml"
    path.write_text(text)
    return path


def test_the_grid_times_the_seeds() -> None:
    sweep = Sweep(command="run", seeds=2, grid={"mass.factor": (1.0, 1.1), "--car": ("smart", "peugeot")})
    found = points(sweep)
    assert len(found) == 8 and len({tuple(point.items()) for point in found}) == 8
    assert command_line(sweep, found[-1]) == [
        "run", "--set", "mass.factor=1.1000000000000001", "--car", "peugeot", "--seed", "1"
    ]  # fmt: skip


def test_a_heavier_car_burns_more_and_a_second_sweep_runs_nothing(tmp_path: Path, monkeypatch) -> None:
    sweep, store = read_sweep(written(tmp_path, CYCLE)), Store(tmp_path / "units")
    found = run_sweep(sweep, store, workers=0)
    light, heavy = (row["output"]["fuel_J"] for row in found["rows"])
    assert found["failed"] == [] and heavy > 1.02 * light
    monkeypatch.setattr("subprocess.run", None)
    assert run_sweep(sweep, store, workers=0) == found


def test_a_point_that_fails_is_told_with_the_commands_own_line(tmp_path: Path) -> None:
    sweep = Sweep(command="cycle", arguments=("NO_SUCH_CYCLE",), grid={"mass.factor": (1.0,)})
    found = run_sweep(sweep, Store(tmp_path), workers=0)
    assert found["rows"] == []
    (entry,) = found["failed"]
    assert entry["settings"] == {"mass.factor": 1.0} and "no_such_cycle" in entry["error"].lower()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('command = "rm"\n[grid]\n', "command"),
        ('command = "cycle"\n[grid]\n"mass.factr" = [1.0]\n', "mass.factr"),
        ('command = "cycle"\n[grid]\n"mass.factor" = [9.0]\n', "outside"),
        ('command = "cycle"\n[grid]\n"mass.factor" = ["much"]\n', "expected numbers"),
        ('command = "cycle"\n[grid]\n"mass.factor" = []\n', "at least one value"),
        ('command = "cycle"\nseeds = 3\n[grid]\n', "takes no seed"),
        ('command = "cycle"\nsedes = 3\n[grid]\n', "sedes"),
        ("command = ", "expected TOML"),
    ],
)
def test_what_is_wrong_in_the_file_is_told_with_its_place(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(BadInput, match=told):
        read_sweep(written(tmp_path, text))


def test_too_many_points_are_refused() -> None:
    many = tuple(float(i) for i in range(1000))
    with pytest.raises(BadInput, match="at most"):
        points(Sweep(command="run", grid={"mass.factor": many, "drag_area.factor": many}))
