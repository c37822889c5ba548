"""Estimates and advice survive the disk, bit for bit, and the same data makes the same bytes."""

import dataclasses

import numpy as np
import pyarrow.parquet as pq
import pytest
from synthetic_run import drive, observe, plan, road

from controller.advice_files import read_advice, write_advice
from observer.estimate_files import read_estimate, write_estimate
from vehicle_model.car.errors import BadInput


@pytest.fixture(scope="module")
def estimate():
    return observe(drive(road(), 0.9), np.random.default_rng(5))


@pytest.fixture(scope="module")
def advice():
    return plan(road())


CASES = [("estimate", write_estimate, read_estimate), ("advice", write_advice, read_advice)]


@pytest.mark.parametrize(("name", "write", "read"), CASES)
def test_what_is_read_is_what_was_written(name, write, read, tmp_path, request):
    data = request.getfixturevalue(name)
    write(data, tmp_path / "a.parquet")
    back = read(tmp_path / "a.parquet")
    for field in dataclasses.fields(data):
        was, now = getattr(data, field.name), getattr(back, field.name)
        if isinstance(was, np.ndarray):
            assert was.dtype == now.dtype and was.shape == now.shape, field.name
            assert was.tobytes() == now.tobytes(), field.name
        else:
            assert was == now, field.name


@pytest.mark.parametrize(("name", "write", "read"), CASES)
def test_writing_twice_gives_the_same_bytes_and_leaves_nothing_beside_them(name, write, read, tmp_path, request):
    data = request.getfixturevalue(name)
    write(data, tmp_path / "a.parquet")
    write(data, tmp_path / "b.parquet")
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.parquet", "b.parquet"]


def test_records_that_arrive_late_keep_the_filter_s_order(estimate, tmp_path):
    """GIVEN a fix of an earlier time behind a newer pulse, WHEN written and read, THEN the order is the filter's."""
    records = estimate.records.copy()
    records["t"][100:200] = records["t"][100:200][::-1]
    shuffled = dataclasses.replace(estimate, records=records)
    write_estimate(shuffled, tmp_path / "a.parquet")
    assert read_estimate(tmp_path / "a.parquet").records.tobytes() == records.tobytes()


def test_each_row_holds_the_measurements_that_had_come_in_by_then(estimate, tmp_path):
    write_estimate(estimate, tmp_path / "a.parquet")
    rows = pq.read_table(tmp_path / "a.parquet", columns=["time", "records"]).to_pylist()
    for before, row in zip([{"time": -1.0}, *rows[:-2]], rows[:-1], strict=True):
        assert all(before["time"] < record["t"] <= row["time"] for record in row["records"])


@pytest.mark.parametrize(("name", "write", "read"), CASES)
def test_a_missing_or_foreign_file_is_bad_input_that_names_it(name, write, read, tmp_path):
    with pytest.raises(BadInput, match=r"absent\.parquet"):
        read(tmp_path / "absent.parquet")
    (tmp_path / "foreign.parquet").write_bytes(b"PAR1 no, not really")
    with pytest.raises(BadInput, match=r"foreign\.parquet"):
        read(tmp_path / "foreign.parquet")
