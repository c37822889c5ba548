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
    meta = {key.decode(errors="replace"): value.decode(errors="replace")
            for key, value in (table.schema.metadata or {}).items()}  # fmt: skip
    if meta.get("rollingroad") != "SensorLog" or "stream" not in table.column_names:
        raise BadInput(path, "metadata", "a SensorLog in Parquet form, as `rollingroad import` writes it")
    stream = np.array(table["stream"].to_pylist(), dtype=object) if table.num_rows else np.empty(0, object)
    unknown = {str(name) for name in set(stream.tolist())} - set(STREAMS)
    if unknown:
        raise BadInput(path, "column stream", f"one of {', '.join(STREAMS)}, not {sorted(unknown)[0]!r}")
    columns = {name: table[name].combine_chunks() for name in table.column_names if name != "stream"}
    streams = {name: _rows(path, columns, name, np.flatnonzero(stream == name)) for name in STREAMS}
    try:
        damage = {str(kind): int(count) for kind, count in json.loads(meta.get("damage", "{}")).items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise BadInput(path, "metadata damage", "counts by kind, as a JSON object") from error
    return SensorLog(streams, damage, meta.get("name", path.name))


def _rows(path: Path, columns: dict[str, pa.Array], name: str, chosen: np.ndarray) -> np.ndarray:
    """The rows `chosen` of the table as stream `name`. Raises BadInput for a missing column or one without numbers."""
    rows = np.empty(chosen.size, dtype=STREAMS[name])
    for column in rows.dtype.names or () if chosen.size else ():
        if column not in columns:
            raise BadInput(path, f"column {column}", f"a column that stream {name} needs")
        try:
            rows[column] = columns[column].take(pa.array(chosen)).to_numpy(zero_copy_only=False)
        except (ValueError, TypeError) as error:
            raise BadInput(path, f"column {column}", f"numbers in each row of stream {name}") from error
    if chosen.size and not np.isfinite(rows["t"]).all():
        raise BadInput(path, "column t", f"a time in each row of stream {name}")
    return rows


def read_any(path: Path) -> SensorLog:
    """Read a log in either form: the card's packets, or Parquet. Raises BadInput."""
    return read_parquet(path) if path.suffix == ".parquet" else read_log(path)
