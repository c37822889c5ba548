"""The recording: complete, on two timelines, quick to write, and readable back."""

import functools
import io
import socket
import subprocess
import threading
import time
import urllib.parse
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
import rerun_cli
from browser import CHROMIUM, visit
from PIL import Image
from rerun.chunk import RrdReader
from synthetic_run import synthetic_run

from rollingroad.viz import charts
from rollingroad.viz.blueprint import blueprint
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


class _Shelf(SimpleHTTPRequestHandler):
    """Hands files to the web viewer, which comes from another port."""

    def end_headers(self):
        self.send_header("Access-Control-Allow-Origin", "*")
        super().end_headers()

    def log_message(self, format, *args):
        pass


@pytest.fixture(scope="module")
def shelf(recording):
    """Address of a server of the recording's folder, with a layout over distance beside it."""
    blueprint("distance").save("rollingroad", str(recording.with_name("distance.rbl")))
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Shelf, directory=str(recording.parent)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    recording.with_name("distance.rbl").unlink()


@pytest.fixture(scope="module")
def web_viewer(tmp_path_factory):
    """Address of rerun's web viewer, served from the package, nothing from the net."""

    def free():
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            return probe.getsockname()[1]

    port = free()
    program = Path(rerun_cli.__file__).with_name("rerun")
    place = ["--bind", "127.0.0.1", "--web-viewer-port", str(port), "--port", str(free())]
    process = subprocess.Popen(
        [program, "--serve-web", *place], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        cwd=tmp_path_factory.mktemp("viewer"),
    )  # fmt: skip
    for _ in range(200):
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
            break
        except OSError:
            time.sleep(0.1)
    yield f"http://127.0.0.1:{port}"
    process.terminate()
    process.wait(10)


def pixels_of(picture, colour):
    """How many pixels of a PNG are of `colour`, nearly."""
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)
    wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return int((np.abs(pixels - wanted).max(axis=2) < 16).sum())


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
@pytest.mark.parametrize("over", ["time", "distance"])
def test_the_web_viewer_draws_both_drives_the_advice_and_the_faults(web_viewer, shelf, tmp_path, over):
    """GIVEN the recording in rerun's own web viewer, WHEN photographed, THEN baseline, advised, advice are drawn."""
    files = ["run.rrd"] + ([f"{over}.rbl"] if over != "time" else [])
    query = [("renderer", "webgl"), *(("url", f"{shelf}/{name}") for name in files)]

    def shows(picture):
        return all(pixels_of(picture, c) > 300 for c in (charts.BASELINE, charts.ADVISED, charts.ADVICE))

    seen = visit(
        f"{web_viewer}/?{urllib.parse.urlencode(query)}", tmp_path, 1400, 900, graphics=True, patience=240.0,
        ready="!!document.querySelector('canvas')", settle=2.0, until=shows,
    )  # fmt: skip
    assert shows(seen.picture)
    assert not [error for error in seen.errors if "panicked" in error]
