"""Logs that others recorded: layouts, what is refused, what is told, and what inspection finds in them."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trips import drive, smart

from sensors.box import BoxSettings, record
from sensors.importing import import_logs
from sensors.inspect import inspect
from sensors.layouts import load, shipped
from sensors.log import STREAMS
from sensors.log_files import read_any, read_parquet, write_parquet
from sensors.packets import decode
from vehicle_model.car.errors import BadInput

DATA = Path(__file__).parents[2] / ".." / "shared" / "data"
DYNO = pytest.mark.skipif(not (DATA / "fastsim_dyno").is_dir(), reason="the dynamometer files are not at hand")
COMMA = pytest.mark.skipif(not (DATA / "comma2k19").is_dir(), reason="the comma2k19 segment is not at hand")

LAYOUT = """
name = "mine"
format = "csv"
[[stream]]
stream = "speed"
time = "t"
columns.speed = { source = "v", unit = "km/h" }
"""


def bring(tmp_path: Path, text: str, layout: str = LAYOUT):
    (tmp_path / "trip.csv").write_text(text)
    (tmp_path / "layout.toml").write_text(layout)
    ((path, notes),) = import_logs([tmp_path / "trip.csv"], tmp_path / "layout.toml", tmp_path / "out")
    return read_parquet(path), notes


def rows(count: int = 30, **changed: str) -> str:
    lines = [f"{i},{36 + i % 7}" for i in range(count)]
    for key, line in changed.items():
        lines[int(key.removeprefix("row"))] = line
    return "\n".join(["t,v", *lines]) + "\n"


def test_a_log_written_as_parquet_is_the_same_log(tmp_path, card):
    log = decode(card, "log.dat")
    write_parquet(log, tmp_path / "log.parquet")
    back = read_any(tmp_path / "log.parquet")
    for name in STREAMS:
        assert back[name].tobytes() == log[name].tobytes(), name
    assert (back.damage, back.name) == (log.damage, "log.dat")


def test_another_kind_of_file_is_told(tmp_path):
    (tmp_path / "x.parquet").write_text("hello")
    with pytest.raises(BadInput, match="SensorLog"):
        read_parquet(tmp_path / "x.parquet")


def test_units_become_si(tmp_path):
    log, notes = bring(tmp_path, rows())
    assert log["speed"]["speed"][0] == pytest.approx(10.0)
    assert notes == []


def test_stamps_that_repeat_or_go_back_are_left_out_and_told_with_their_line(tmp_path):
    log, notes = bring(tmp_path, rows(row5="4,50", row9="2,50"))
    assert log["speed"].size == 28
    assert log.damage == {"repeated_stamp": 1, "backward_stamp": 1}
    assert any("line 7" in note and "repeated" in note for note in notes)
    assert any("line 11" in note and "backward" in note for note in notes)


def test_a_jump_is_kept_and_told(tmp_path):
    log, notes = bring(tmp_path, rows(20) + "500,30\n501,30\n")
    assert log["speed"].size == 22
    assert log.damage == {"jump": 1}
    assert "481" in notes[0]


def test_an_empty_cell_is_left_out_and_told(tmp_path):
    log, notes = bring(tmp_path, rows(row3="3,"))
    assert log["speed"].size == 29
    assert log.damage == {"empty_cell": 1}
    assert "line 5" in notes[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (rows().replace("t,v", "t,w"), "column 'v'"),
        (rows(row4="4,abc"), "line 6"),
        (rows(row4="4,5,6"), "regular CSV"),
        (rows(row4="4,900"), "another unit"),
        ("t,v\n" + "".join(f"{1000 * i},50\n" for i in range(20)), "another unit"),
        ("t,v\n", "at least one row"),
        ("t;v\n1;2\n", "titles separated"),
    ],
)
def test_what_cannot_be_guessed_is_refused_in_one_line(tmp_path, text, said):
    with pytest.raises(BadInput) as caught:
        bring(tmp_path, text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_decimal_commas_are_read_where_declared_and_refused_where_not(tmp_path):
    text = "t;v\n" + "".join(f"{i};36,5\n" for i in range(10))
    layout = LAYOUT.replace('format = "csv"', 'format = "csv"\ndelimiter = ";"')
    with pytest.raises(BadInput, match="decimal"):
        bring(tmp_path, text, layout)
    log, _ = bring(tmp_path, text, layout.replace('delimiter = ";"', 'delimiter = ";"\ndecimal = ","'))
    assert log["speed"]["speed"][0] == pytest.approx(36.5 / 3.6)


def test_a_speed_that_changes_too_fast_is_told_as_a_doubtful_unit(tmp_path):
    text = "t,v\n" + "".join(f"{i},{60 + 40 * np.sin(i):.2f}\n" for i in range(60))
    assert any("unit" in note for note in bring(tmp_path, text)[1])


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('unit = "km/h"', 'unit = "furlong"', "unit"),
        ('unit = "km/h"', 'unit = "deg"', "unit"),
        ('stream = "speed"', 'stream = "sped"', "stream"),
        ("columns.speed", "columns.velocity", "velocity"),
        ('name = "mine"', 'nme = "mine"', "name"),
        ('format = "csv"', 'format = "xls"', "format"),
        ("[[stream]]", "[[stream", ""),
    ],
)
def test_a_wrong_layout_is_refused_with_its_place(tmp_path, old, new, place):
    (tmp_path / "layout.toml").write_text(LAYOUT.replace(old, new))
    with pytest.raises(BadInput) as caught:
        load(tmp_path / "layout.toml")
    assert place in str(caught.value)


def test_the_layouts_that_ship_are_valid():
    assert {"fastsim_dyno", "comma2k19", "obd_csv"} <= set(shipped())
    for name in shipped():
        assert load(name).name == name


def test_fuel_from_air_mass_where_no_rate_is_logged(tmp_path):
    text = "Time (s),Vehicle speed (km/h),MAF air flow rate (g/s)\n" + "".join(f"{i},50,7.3\n" for i in range(40))
    (tmp_path / "trip.csv").write_text(text)
    ((path, notes),) = import_logs([tmp_path / "trip.csv"], "obd_csv", tmp_path / "out")
    power = read_parquet(path)["fuel"]["power"]
    assert power == pytest.approx(7.3e-3 / 14.6 * 43.0e6)
    assert any("gps" in note for note in notes)


@DYNO
def test_the_camrys_consumption_is_the_one_published(tmp_path):
    done = import_logs(sorted((DATA / "fastsim_dyno").glob("*.csv")), "fastsim_dyno", tmp_path)
    published = {"61811011": 6.43, "61811012": 6.09, "61811013": 4.15, "61811014": 6.99}
    for path, notes in done:
        assert notes == []
        log = read_parquet(path)
        litres = log["fuel"]["power"].sum() / 42.67e6 / 743.0 * 1e3
        assert litres / (log["speed"]["speed"].sum() / 1e5) == pytest.approx(published[path.stem], rel=0.02)


@COMMA
def test_inspection_finds_the_rav4s_sensors(tmp_path):
    ((path, _),) = import_logs([DATA / "comma2k19" / "segment_40"], "comma2k19", tmp_path)
    found = inspect(read_parquet(path))
    first, second = found["receivers"]["gps"], found["receivers"]["gps_second"]
    known = [(first["lag_s"], 0.16), (first["scale"], 1.012), (second["lag_s"], 1.48),
             (found["accelerometer"]["offset_mps2"], -0.6)]  # fmt: skip
    for figure, value in known:
        assert figure["ci95"][0] <= value <= figure["ci95"][1]
    assert first["lag_s"]["sd"] < 0.05
    assert first["scale"]["sd"] < 0.005
    assert found["accelerometer"]["offset_mps2"]["sd"] < 0.2
    low, middle, high = found["streams"]["speed"]["interval_percentiles_s"]
    assert (low, middle, high) == pytest.approx((0.003, 0.011, 0.023), abs=0.002)


def test_inspection_finds_what_was_put_into_a_simulated_box():
    car = smart()
    box = BoxSettings(gps_lag=0.6, clock_skew=300e-6, clock_rate_error=0.0, wheel_radius_change=0.01)
    found = inspect(decode(record(drive(900.0, step=0.02), car, box)), car)
    receiver = found["receivers"]["gps"]
    # The filter's lag and on average 132 ms until the stamp after which the sentence stood on the card.
    assert receiver["lag_s"]["value"] == pytest.approx(0.6 + 0.132, abs=0.03)
    assert receiver["scale"]["value"] == pytest.approx(car.metres_per_tick * 1.01, rel=0.003)
    assert found["clock"]["rate"]["value"] == pytest.approx(300e-6, abs=3e-6)
    assert found["clock"]["rate"]["ci95"][0] <= 300e-6 <= found["clock"]["rate"]["ci95"][1]
    assert found["streams"]["accelerometer"]["rate_hz"] == pytest.approx(40.0, abs=0.05)


def test_inspection_says_what_it_cannot_find():
    log = decode(b"")
    found = inspect(log)
    assert found["streams"] == {}
    assert found["accelerometer"] is None


@pytest.mark.parametrize(
    ("columns", "place"),
    [
        ({"order": ["a", "b"]}, "column order"),
        ({"t": [None, 2.0]}, "column t"),
        ({"t": [[1.0], [2.0]]}, "column t"),
        ({"stream": ["speed", "velocity"]}, "column stream"),
    ],
)
def test_a_parquet_file_with_other_columns_is_told(tmp_path, columns, place):
    good = {"stream": ["speed", "speed"], "order": [0, 1], "t": [1.0, 2.0], "speed": [1.0, 2.0]}
    path = tmp_path / "x.parquet"
    pq.write_table(pa.table(good | columns).replace_schema_metadata({"rollingroad": "SensorLog"}), path)
    with pytest.raises(BadInput, match=place):
        read_parquet(path)


@pytest.mark.parametrize("damage", ["{bad", "[1, 2]", '{"bad_check": "many"}'])
def test_a_parquet_file_with_damaged_metadata_is_told(tmp_path, damage):
    table = pa.table({"stream": ["speed"], "order": [0], "t": [1.0], "speed": [1.0]})
    path = tmp_path / "x.parquet"
    pq.write_table(table.replace_schema_metadata({"rollingroad": "SensorLog", "damage": damage}), path)
    with pytest.raises(BadInput, match="metadata"):
        read_parquet(path)


@pytest.mark.parametrize(
    "text",
    [
        '[[stream]]\nstream = "speed"\ntime = "time"\n',
        '[[stream]]\nstream = "speed"\ntime = []\n[stream.columns]\nspeed = { source = "v", unit = "m/s" }\n',
        '[[stream]]\nstream = "speed"\ntime = "t"\nlag = nan\ncolumns.speed = { source = "v", unit = "m/s" }\n',
    ],
)
def test_a_layout_that_says_too_little_is_refused(tmp_path, text):
    """Without its column a stream would be read as zeros."""
    path = tmp_path / "layout.toml"
    path.write_text(f'name = "x"\nformat = "csv"\n{text}')
    with pytest.raises(BadInput, match="stream"):
        load(path)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from([1, 3, 4, 5]), st.integers(0, 2**32 - 1), st.binary(min_size=6, max_size=6)),
        min_size=100,
        max_size=300,
    )
)
def test_inspection_survives_stamps_and_values_of_any_kind(rows):
    size = {1: 10, 3: 5, 4: 6, 5: 5}
    card = b""
    for kind, ms, rest in rows:
        body = (ms.to_bytes(4, "little") + rest)[: size[kind]]
        card += bytes([255, kind, len(body) + 1]) + body + bytes([(len(body) + 1 + sum(body)) % 256])
    json.dumps(inspect(decode(card)), allow_nan=False)
