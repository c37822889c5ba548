"""The SensorLog as a Parquet file: the form that `rollingroad import` writes. One row per packet, in their order."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from sensors.log import STREAMS, SensorLog
from sensors.packets import read_log
from vehicle_model.car.errors import BadInput


def _columns() -> dict[str, pa.DataType]:
    """Every column that some stream has, with its type; of two types the wider."""
    found: dict[str, pa.DataType] = {}
    for dtype in STREAMS.values():
        for name in dtype.names or ():
            found[name] = pa.from_numpy_dtype(dtype[name])
    return found


def write_parquet(log: SensorLog, path: Path) -> None:
    """Write `log` as Parquet, aside and then renamed: columns `stream`, `order`, `t` and those of the streams, null
    where a stream has none; `damage` and `name` in the metadata."""
    names = [name for name in STREAMS if len(log[name])]
    rows = [log[name] for name in names]
    total = sum(len(part) for part in rows)
    order = np.concatenate([part["order"] for part in rows]) if rows else np.empty(0, np.int64)
    sequence = np.argsort(order, kind="stable")
    index = np.repeat(np.arange(len(names), dtype=np.int8), [len(part) for part in rows])[sequence]
    columns: dict[str, pa.Array] = {
        "stream": pa.DictionaryArray.from_arrays(pa.array(index), pa.array(names, pa.string()))
    }
    for name, kind in _columns().items():
        values = np.zeros(total, dtype=kind.to_pandas_dtype())
        missing = np.ones(total, dtype=bool)
        at = 0
        for part in rows:
            if name in (part.dtype.names or ()):
                values[at : at + len(part)] = part[name]
                missing[at : at + len(part)] = False
            at += len(part)
        if total == 0 or not missing.all():
            columns[name] = pa.array(values[sequence], type=kind, mask=missing[sequence])
    meta = {"rollingroad": "SensorLog", "damage": json.dumps(log.damage, sort_keys=True), "name": log.name}
    aside = path.with_name(path.name + ".part")
    try:
        pq.write_table(pa.table(columns).replace_schema_metadata(meta), aside, compression="zstd")
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def read_parquet(path: Path) -> SensorLog:
    """Read what `write_parquet` wrote. Raises BadInput for a missing file, another kind of file or missing columns."""
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise BadInput(path, "", f"a SensorLog in Parquet form ({str(error).splitlines()[0][:80]})") from error
    meta = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}
    if meta.get("rollingroad") != "SensorLog" or "stream" not in table.column_names:
        raise BadInput(path, "metadata", "a SensorLog in Parquet form, as `rollingroad import` writes it")
    stream = np.array(table["stream"].to_pylist(), dtype=object) if table.num_rows else np.empty(0, object)
    streams = {}
    columns = {name: table[name].combine_chunks() for name in table.column_names if name != "stream"}
    for name, dtype in STREAMS.items():
        chosen = np.flatnonzero(stream == name)
        rows = np.empty(chosen.size, dtype=dtype)
        for column in dtype.names or ():
            if chosen.size == 0:
                continue
            if column not in columns:
                raise BadInput(path, f"column {column}", f"a column that stream {name} needs")
            rows[column] = columns[column].take(pa.array(chosen)).to_numpy(zero_copy_only=False)
        streams[name] = rows
    return SensorLog(streams, json.loads(meta.get("damage", "{}")), meta.get("name", path.name))


def read_any(path: Path) -> SensorLog:
    """Read a log in either form: the card's packets, or Parquet. Raises BadInput."""
    return read_parquet(path) if path.suffix == ".parquet" else read_log(path)
