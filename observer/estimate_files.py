"""`estimate.parquet`: one row per 10 Hz instant, and in each row the measurements that had come in by then."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from observer.estimate import STATES, Estimate
from vehicle_model.car.errors import BadInput

_BLOCKS = ("state", "variance", "smoothed", "smoothed_variance")
"""Fields of `Estimate` of shape (n, 17): column `thrust.smoothed` is `Estimate.smoothed[:, STATES.index("thrust")]`."""


def write_estimate(estimate: Estimate, path: Path) -> None:
    """Write `estimate` as Parquet, aside and renamed; the same estimate gives the same bytes.

    Columns: `time` (s), then `<state>.<block>` for the 17 states and the four blocks, then `records`, a list of
    structs: the measurements that came in since the row before. A list rather than a second table keeps
    the estimate one file, and keeps the records in the order in which the filter saw them.
    """
    columns: dict[str, pa.Array] = {"time": pa.array(estimate.time)}
    for block in _BLOCKS:
        values = getattr(estimate, block)
        columns |= {f"{name}.{block}": pa.array(np.ascontiguousarray(values[:, i])) for i, name in enumerate(STATES)}
    columns["records"] = _records_by_row(estimate.time, estimate.records)
    metadata = {
        "origin": json.dumps(estimate.origin),
        "learnt": json.dumps(estimate.learnt, sort_keys=True),
        "record_types": json.dumps(estimate.records.dtype.descr),
    }
    aside = path.with_name(path.name + ".part")
    pq.write_table(pa.table(columns).replace_schema_metadata(metadata), aside, compression="zstd")
    aside.replace(path)


def read_estimate(path: Path) -> Estimate:
    """Read what `write_estimate` wrote. Raises `BadInput` where the file is missing or is no estimate."""
    try:
        table = pq.read_table(path)
        metadata = {
            key.decode(): json.loads(value) for key, value in table.schema.metadata.items() if key != b"ARROW:schema"
        }
        blocks = {block: np.column_stack([table[f"{name}.{block}"].to_numpy() for name in STATES]) for block in _BLOCKS}
        flat = table["records"].combine_chunks().flatten()
        dtype = np.dtype([(name, kind) for name, kind in metadata["record_types"]])
        records = np.empty(len(flat), dtype)
        for name in dtype.names or ():
            records[name] = flat.field(name).to_numpy(zero_copy_only=False)
        return Estimate(
            time=table["time"].to_numpy(),
            records=records,
            origin=tuple(metadata["origin"]),
            learnt=metadata["learnt"],
            **blocks,
        )
    except FileNotFoundError as error:
        raise BadInput(path, "", "an estimate (estimate.parquet), but there is no such file") from error
    except (pa.ArrowException, KeyError, AttributeError, ValueError) as error:
        raise BadInput(path, "", f"an estimate as `rollingroad observe` writes it ({error})") from error


def _records_by_row(time: NDArray[np.float64], records: NDArray) -> pa.ListArray:
    """Cut the records, in their order, into one list per instant of `time`; latecomers go with their neighbours."""
    arrived = np.maximum.accumulate(records["t"]) if len(records) else np.empty(0)
    ends = np.searchsorted(arrived, time, side="right")
    if len(ends):
        ends[-1] = len(records)
    offsets = pa.array(np.concatenate([[0], ends]).astype(np.int32))
    fields = [_column(records[name]) for name in records.dtype.names or ()]
    return pa.ListArray.from_arrays(offsets, pa.StructArray.from_arrays(fields, names=records.dtype.names))


def _column(values: NDArray) -> pa.Array:
    text = values.dtype.kind in "US"
    return pa.array(values.astype(str).astype(object) if text else np.ascontiguousarray(values))
