"""Given a short scenario, the whole chain runs from the drive to the report, honestly and repeatably."""

import json
from pathlib import Path

import numpy as np
import pytest

from observer.estimate_files import read_estimate
from rollingroad.arrows import assert_same_until_advice, drive_scenario
from rollingroad.chain import run_chain
from rollingroad.folder import whole_folder
from rollingroad.stages import begin, compare_run, map_runs, observe_run, plan_run, sense_run
from rollingroad.task import make_task
from sensors.packets import read_log
from sim.network import build
from vehicle_model.car.errors import BadInput
from vehicle_model.car.trip import Trip

SAME_BYTES = ("truth.parquet", "log.dat", "estimate.parquet", "map.json", "map.parquet", "advice.parquet")
SHORT = """
title = "Two kilometres"
[road]
name = "mixed"
section = "town"
[traffic]
vehicles = 30
"""

pytestmark = pytest.mark.xdist_group("chain")


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "short.toml"
    path.write_text(SHORT)
    return path


@pytest.fixture(scope="module")
def finished(scenario: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("runs") / "at-once"
    return folder, run_chain(make_task(scenario), folder, workers=2)


@pytest.fixture(scope="module")
def in_pieces(scenario: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("runs") / "in-pieces"
    begin(make_task(scenario), folder)
    sense_run(folder)
    observe_run(folder)
    return folder, map_runs([folder], folder)


def test_a_run_folder_holds_every_product_and_nothing_half_written(finished):
    folder, _ = finished
    for name in (*SAME_BYTES, "run.json", "car.xml", "road", "advised", "report.html", "run.rrd", "trip.kml"):
        assert (folder / name).exists(), name
    assert not list(folder.parent.glob(".*")) and not list(folder.rglob("*.part"))


def test_run_json_is_what_the_command_prints(finished):
    folder, results = finished
    kept = json.loads((folder / "run.json").read_text())
    assert kept["baseline"] == results["baseline"] and kept["map"]["cells"] == results["map"]["cells"]


def test_the_estimate_is_close_to_the_truth_and_the_saving_is_bounded_by_physics(finished):
    _, results = finished
    observer, found = results["observer"], results["map"]
    assert observer["thrust_rmse_N"] < 0.12 * observer["thrust_rms_N"]
    assert observer["thrust_rmse_smoothed_N"] < observer["thrust_rmse_N"]
    assert found["cells"] > 20 and found["rmse"] < 0.015
    # No advice makes a petrol car drive for half the fuel in the same time.
    assert results["saving_percent"] is None or -20.0 < results["saving_percent"] < 40.0


def test_the_arrows_one_by_one_give_the_same_bytes_as_the_run_at_once(finished, in_pieces):
    whole, (pieces, _) = finished[0], in_pieces
    for name in ("truth.parquet", "log.dat", "estimate.parquet", "map.json", "map.parquet"):
        assert (whole / name).read_bytes() == (pieces / name).read_bytes(), name


def test_the_observer_sees_no_more_than_log_car_and_road(finished, tmp_path):
    # Given the run folder without its truth, then the observer still says the same, bit by bit.
    whole, _ = finished
    blind = tmp_path / "blind"
    blind.mkdir()
    for name in ("log.dat", "car.xml"):
        (blind / name).write_bytes((whole / name).read_bytes())
    (blind / "road").mkdir()
    for part in (whole / "road").iterdir():
        (blind / "road" / part.name).write_bytes(part.read_bytes())
    observe_run(blind)
    assert (blind / "estimate.parquet").read_bytes() == (whole / "estimate.parquet").read_bytes()
    assert map_runs([blind], blind)["rmse"] is None


def test_a_plan_can_be_made_of_the_pieces(in_pieces):
    folder, _ = in_pieces
    plan_run(folder)
    assert (folder / "advice.parquet").stat().st_size > 1000


def test_a_damaged_log_is_read_around_the_damage(finished, tmp_path):
    whole, _ = finished
    data = bytearray((whole / "log.dat").read_bytes())
    middle = len(data) // 2
    data[middle : middle + 2000] = bytes(np.random.default_rng(0).integers(0, 256, 2000, dtype=np.uint8))
    (tmp_path / "log.dat").write_bytes(data)
    damaged, sound = read_log(tmp_path / "log.dat"), read_log(whole / "log.dat")
    assert sum(damaged.damage.values()) > 0
    lost = len(sound["wheel"]) - len(damaged["wheel"])
    assert 0 < lost < 400


def test_both_drives_are_one_until_the_first_advice_and_differ_after_it(finished):
    folder, _ = finished
    first, second = Trip.read(folder / "truth.parquet"), Trip.read(folder / "advised" / "truth.parquet")
    early = first.channels["distance"] < 40.0
    count = int(np.count_nonzero(early))
    for name in ("speed", "fuel_energy", "engine_speed"):
        assert np.array_equal(first.channels[name][:count], second.channels[name][:count])
    assert len(first.channels["time"]) != len(second.channels["time"])


def test_a_departure_before_any_advice_is_refused(scenario, tmp_path):
    # Given another seed's traffic posing as the advised drive, then nothing is compared.
    one, other = (make_task(scenario, seed=seed) for seed in (0, 1))
    network = build(one.scenario, tmp_path)
    with pytest.raises(AssertionError, match="before any advice"):
        assert_same_until_advice(drive_scenario(one, network), drive_scenario(other, network))


def test_merging_trips_of_another_car_is_refused(in_pieces, scenario, tmp_path):
    other = tmp_path / "other"
    begin(make_task(scenario, car="peugeot"), other)
    with pytest.raises(BadInput, match=r"car\.xml: expected the car of"):
        map_runs([in_pieces[0], other], tmp_path)


def test_an_arrow_without_its_input_names_the_file_and_the_arrow_that_writes_it(tmp_path):
    with pytest.raises(BadInput, match=r"log\.dat: expected the file that `rollingroad sense` writes"):
        observe_run(tmp_path)
    with pytest.raises(BadInput, match=r"run\.json: expected a run folder"):
        compare_run(tmp_path)


def test_a_failing_run_leaves_nothing_and_an_earlier_run_untouched(tmp_path):
    kept = tmp_path / "run"
    kept.mkdir()
    (kept / "run.json").write_text("{}")
    with pytest.raises(RuntimeError), whole_folder(kept) as part:
        (part / "half").write_text("written")
        raise RuntimeError("the disk is full")
    assert [path.name for path in tmp_path.iterdir()] == ["run"] and (kept / "run.json").read_text() == "{}"


def test_a_folder_that_holds_something_else_is_never_replaced(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(FileExistsError), whole_folder(tmp_path):
        pass
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_the_estimate_can_be_read_back(finished):
    folder, _ = finished
    estimate = read_estimate(folder / "estimate.parquet")
    assert estimate.time[1] - estimate.time[0] == pytest.approx(0.1)
    assert np.all(estimate.smoothed_variance[:, 2] > 0.0)
