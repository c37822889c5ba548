"""The CAN bus of table D.4, and the trip as KML."""

import xml.etree.ElementTree as ElementTree

import can
import numpy as np
import pytest
from trips import drive, drive_along, winding_route

from sensors import kml
from sensors.can import database, frames, read_can_log, write_can_log
from sensors.importing import import_logs
from sensors.log_files import read_parquet
from sensors.projection import to_geodetic
from vehicle_model.car.errors import BadInput

NAMESPACE = {"k": "http://www.opengis.net/kml/2.2"}


def test_bytes_stand_where_the_table_puts_them():
    table = database()
    data = table.get_message_by_name("WheelSpeed").encode(
        {"FrontRight": 0x0102 / 100, "FrontLeft": 0x0304 / 100, "RearRight": 0x0506 / 100, "RearLeft": 0x0708 / 100}
    )
    assert data == bytes([1, 2, 3, 4, 5, 6, 7, 8]), "high bytes first, right before left, front before rear"
    assert table.get_message_by_name("WheelSpeed").frame_id == 128
    assert table.decode_message(768, bytes([0, 0x10, 0x20, 3, 0, 0, 0, 0]))["EngineSpeedFine"] == 0x1020 * 0.25
    assert table.decode_message(144, bytes([0, 0, 0, 0, 0, 0x34, 0x12, 0]))["CarSpeed"] == pytest.approx(0x1234 * 0.01)
    assert table.decode_message(194, bytes([0xFE, 0xFF, 0, 0, 0, 0, 0, 0]))["SteeringAngle"] == pytest.approx(-0.2)


@pytest.mark.parametrize("suffix", [".blf", ".asc"])
def test_a_trip_goes_over_the_bus_and_comes_back(tmp_path, car, suffix):
    trip = drive(25.0)
    path = tmp_path / f"trip{suffix}"
    write_can_log(trip, car, path)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    ((target, _),) = import_logs([path], "smart_can", tmp_path / "out")
    log = read_parquet(target)
    first = next(iter(frames(trip, car))).timestamp
    speed = log["speed"]
    assert speed["speed"] == pytest.approx(np.interp(speed["t"] + first, trip.time, trip.speed), abs=0.02)
    engine = log["engine_speed"]
    assert engine["speed"] == pytest.approx(np.interp(engine["t"] + first, trip.time, trip.engine_speed), abs=0.3)
    assert log.damage == {}


def test_unknown_frames_are_counted_and_no_log_is_told(tmp_path):
    path = tmp_path / "odd.asc"
    with can.Logger(str(path)) as log:
        for number, data in ((1999, b"12345678"), (128, b"\x01\x02"), (128, bytes(8))):
            log.on_message_received(can.Message(timestamp=1.0, arbitration_id=number, data=data, is_extended_id=False))
    assert read_can_log(path).damage == {"unknown_frame": 1, "bad_frame": 1}
    with pytest.raises(BadInput):
        read_can_log(tmp_path / "none.blf")


def test_jet_is_matlabs():
    import matplotlib

    share = np.linspace(0, 1, 30)
    ours, theirs = kml.jet(share) / 255.0, matplotlib.colormaps["jet"](share)[:, :3]
    assert np.abs(ours - theirs).max() < 0.15
    assert kml.jet(np.array([0.0]))[0].tolist() == [0, 0, 128]
    assert kml.jet(np.array([1.0]))[0].tolist() == [128, 0, 0]


def test_the_map_shows_start_stop_times_and_speed(tmp_path):
    trip = drive_along(winding_route(4000.0))
    kml.write_kml(trip, tmp_path / "trip.kml")
    root = ElementTree.parse(tmp_path / "trip.kml").getroot()
    places = {mark.findtext("k:name", "", NAMESPACE): mark for mark in root.iter(f"{{{NAMESPACE['k']}}}Placemark")}
    assert {"Start", "Stop", "60", "120"} <= set(places)

    def place(name):
        return [float(x) for x in places[name].findtext(".//k:coordinates", "", NAMESPACE).split(",")][:2]

    for name, when in (("Start", 0.0), ("60", 60.0)):
        north, east = (np.interp(when, trip.time, getattr(trip, key)) for key in ("north", "east"))
        latitude, longitude = to_geodetic(north, east, trip.origin)
        assert place(name) == pytest.approx([float(longitude), float(latitude)], abs=1e-6)
    lines = root.findall(".//k:LineString/k:coordinates", NAMESPACE)
    assert sum(len(line.text.split()) - 1 for line in lines) == int(trip.duration)
    colours = {
        style.get("id"): style.findtext("k:LineStyle/k:color", "", NAMESPACE)
        for style in root.iter(f"{{{NAMESPACE['k']}}}Style")
    }
    assert colours["speed0"] == "ff870000", "a stopped car is dark blue (KML writes alpha, blue, green, red)"
