"""The recording: complete, on two timelines, quick to write, and readable back."""

import numpy as np
import pytest
from rerun.chunk import RrdReader
from synthetic_run import synthetic_run

from rollingroad.viz.recording import view, write_recording
from vehicle_model.car.errors import BadInput
from vehicle_model.car.route import TUNNEL


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return synthetic_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def recording(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    write_recording(run, path)
    return path


@pytest.fixture(scope="module")
def store(recording):
    return RrdReader(recording).store()


@pytest.fixture(scope="module")
def paths(store):
    return {str(path) for path in store.schema().entity_paths()}


def column(store, entity, name):
    """The rows of one component of one entity, in the order of the file."""
    tables = [chunk.to_record_batch() for chunk in store.stream() if str(chunk.entity_path) == entity]
    return np.concatenate(
        [table.column(name).to_numpy(zero_copy_only=False) for table in tables if name in table.schema.names]
    )


def test_every_signal_that_was_promised_is_there(paths):
    promised = {
        "/plan/road", "/plan/gps/fixes", "/plan/estimate", "/plan/car/baseline", "/plan/car/advised", "/map/road",
        "/speed/baseline", "/speed/advised", "/speed/advice", "/speed/limit", "/road/altitude", "/road/grade",
        "/observer/pitch/filter", "/observer/thrust/true", "/observer/thrust/low", "/observer/thrust/high",
        "/observer/thrust/smoothed", "/engine_map/found", "/engine_map/now", "/innovation/gps_north",
        "/rejected/gps_north", "/fuel/burnt/baseline", "/fuel/burnt/advised", "/faults/gps", "/faults/sky",
    }  # fmt: skip
    assert promised <= paths
    assert len(paths) >= 25


def test_what_is_played_back_is_what_was_driven(run, store):
    """The advised speed at 10 Hz, against the trip itself, on both timelines."""
    speed = np.array([row[0] for row in column(store, "/speed/advised", "Scalars:scalars")])
    time = column(store, "/speed/advised", "time").astype("timedelta64[ns]").astype(float) / 1e9
    place = column(store, "/speed/advised", "distance").astype(float)
    trip = run.advised
    assert np.median(np.diff(time)) == pytest.approx(0.1, abs=1e-6)
    assert np.allclose(speed, 3.6 * np.interp(time, trip.time, trip.speed), atol=0.01)
    assert np.abs(place - np.interp(time, trip.time, trip.distance)).max() <= 0.51


def test_an_outage_is_marked_where_the_tunnel_is(run, store):
    labels = [row[0] for row in column(store, "/faults/gps", "StateChange:state")]
    times = column(store, "/faults/gps", "time").astype("timedelta64[ns]").astype(float) / 1e9
    inside = run.baseline.time[run.baseline.sky == TUNNEL]
    assert labels == ["fixes", "outage", "fixes"]
    assert times[1] == pytest.approx(inside[0], abs=0.5) and times[2] == pytest.approx(inside[-1], abs=0.5)


def test_the_layout_is_in_the_file(recording):
    assert len(RrdReader(recording).blueprints()) == 1


def test_nothing_is_left_beside_the_recording(recording):
    assert [path.name for path in recording.parent.iterdir()] == ["run.rrd"]


def test_viewing_a_folder_without_a_recording_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match=r"run\.rrd"):
        view(tmp_path)
