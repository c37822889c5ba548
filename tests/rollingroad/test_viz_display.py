"""The driver's display says what the plan wants, on loopback only."""

import dataclasses
import json
import threading
import urllib.error
import urllib.request

import numpy as np
import pytest
from browser import CHROMIUM, visit
from synthetic_run import drive, plan, road

from rollingroad.viz.display import FULL_ARROW, display_server, frames, replay, replay_server
from vehicle_model.car.errors import BadInput


@pytest.fixture(scope="module")
def advice():
    return plan(road())


@pytest.fixture(scope="module")
def shown(advice):
    return frames(drive(road(), 0.86), advice)


@pytest.fixture
def server(shown):
    server = display_server(lambda: shown[:50])
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server
    server.shutdown()
    server.server_close()


def test_the_arrow_points_where_the_plan_is(advice):
    """GIVEN a drive faster than the plan, THEN down; slower, THEN up; FULL_ARROW off, THEN at its brightest."""
    trip = drive(road(), 0.86)
    wanted = np.interp(trip.distance, advice.s, advice.speed)
    for error, arrow in ((FULL_ARROW / 2, -0.5), (-FULL_ARROW / 2, 0.5), (2 * FULL_ARROW, -1.0)):
        off = dataclasses.replace(trip, channels=trip.channels | {"speed": wanted + error})
        assert np.allclose([frame.arrow for frame in frames(off, advice)], arrow)


def test_a_driver_who_is_told_no_gears_is_shown_none(advice):
    trip = drive(road(), 0.86)
    assert any(frame.advised_gear for frame in frames(trip, advice))
    assert not any(frame.advised_gear for frame in frames(trip, advice, gears=False))


def test_efficiency_is_the_engine_s_and_zero_while_the_fuel_is_cut(advice):
    trip = drive(road(), 0.86)
    cut = frames(dataclasses.replace(trip, channels=trip.channels | {"fuel_power": 0 * trip.time}), advice)
    assert {frame.efficiency for frame in cut} == {0.0}
    doubled = dataclasses.replace(trip, channels=trip.channels | {"fuel_power": 2 * trip.thrust * trip.speed})
    assert max(frame.efficiency for frame in frames(doubled, advice)) == pytest.approx(50.0)


def test_frames_come_five_times_a_second_and_a_fast_replay_is_fast(shown):
    assert np.allclose(np.diff([frame.time for frame in shown]), 0.2)
    assert list(replay(shown[:20], pace=1000.0)) == shown[:20]


def test_only_this_machine_can_see_it(server):
    assert server.server_address[0] == "127.0.0.1"
    with urllib.request.urlopen(f"http://127.0.0.1:{server.server_port}/frames") as reply:
        events = reply.read().decode().split("\n\n")
    assert json.loads(events[0].removeprefix("data: "))["time"] == 0.0
    assert events[-2].startswith("event: end")
    with pytest.raises(urllib.error.HTTPError):
        urllib.request.urlopen(f"http://127.0.0.1:{server.server_port}/etc/passwd")


def test_a_folder_without_an_advised_drive_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match=r"advised/truth\.parquet"):
        replay_server(tmp_path)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_the_page_shows_the_frames(server, shown, tmp_path):
    ask = ["document.getElementById('foot').textContent", "document.documentElement.scrollWidth"]
    url = f"http://127.0.0.1:{server.server_port}/"
    seen = visit(
        url, tmp_path, 360, 740, ready="document.getElementById('foot').textContent.includes('arrived')", ask=ask
    )
    assert seen.errors == []
    assert seen.answers == [f"{shown[49].distance:.2f} km, {shown[49].time:.0f} s, arrived", 360]
