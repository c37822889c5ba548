"""Real logs in the SensorLog form: CSV, numpy folders and the box's own packets, by a layout.

Strict about what cannot be guessed: a missing column, a number that is none, a decimal comma where none was declared,
a unit that the numbers contradict, end the import. Time stamps that repeat or go back are left out and jumps are kept;
each is told in `SensorLog.damage` and in the notes, with its line. Nothing is repaired in silence.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
from numpy.typing import NDArray

from sensors.layouts import UNITS, Column, Layout, Stream, load
from sensors.log import STREAMS, SensorLog
from sensors.log_files import write_parquet
from sensors.packets import read_log
from vehicle_model.car.errors import BadInput

RANGES = {
    "m/s": (-5.0, 90.0), "m/s2": (-160.0, 160.0), "rad/s": (-1500.0, 1500.0), "W": (-1.0, 1.5e6),
    "m": (-1000.0, 9000.0), "deg": (-360.0, 360.0),
}  # fmt: skip
"""What a number of a unit can be on the road; beyond it the unit in the layout is wrong."""
JUMP = 10.0
"""Median steps that make a jump, and at least 1 s."""


@dataclass
class Imported:
    """A log and what has to be told of it."""

    log: SensorLog
    notes: list[str] = field(default_factory=list)


def import_logs(files: Sequence[Path], layout: str | Path | Layout, out: Path) -> list[tuple[Path, list[str]]]:
    """Read each of `files` (a trip each) by `layout`, write `out`/NAME.parquet; return those paths and their notes.

    Raises BadInput, naming file, line or column and what was expected; nothing is written for a file that fails.
    """
    chosen = layout if isinstance(layout, Layout) else load(layout)
    results = []
    names: dict[str, Path] = {}
    for path in files:
        name = path.resolve().name if path.is_dir() else path.stem
        if name in names:
            raise BadInput(path, "", f"another name than {names[name]}: both would become {name}.parquet")
        names[name] = path
    for name, path in names.items():
        imported = read_foreign(path, chosen)
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInput(out, "", f"a folder to write to ({error.strerror or error})") from error
        target = out / f"{name}.parquet"
        write_parquet(imported.log, target)
        results.append((target, imported.notes))
    return results


def read_foreign(path: Path, layout: Layout) -> Imported:
    """Read one file or folder by `layout`. Raises BadInput."""
    if layout.format == "packets":
        return Imported(read_log(path))
    if layout.format == "can":
        from sensors.can import read_can_log

        return Imported(read_can_log(path, layout.database))
    if not path.exists():
        raise BadInput(path, "", "an existing file" if layout.format == "csv" else "an existing folder")
    source = _Csv(path, layout) if layout.format == "csv" else _Arrays(path)
    found = Imported(SensorLog({}, {}, path.name))
    streams: dict[str, NDArray] = {}
    for part in layout.stream:
        if part.stream in streams:
            continue
        rows = _read_stream(source, part, layout, found)
        if rows is not None:
            streams[part.stream] = rows
    _set_order(streams)
    empty = {name: np.empty(0, dtype=dtype) for name, dtype in STREAMS.items()}
    found.log = SensorLog(empty | streams, found.log.damage, path.name)
    _look(path, streams, found.notes)
    return found


def _set_order(streams: dict[str, NDArray]) -> None:
    """Number all rows by time, as if they had come to one card."""
    if not streams:
        return
    times = np.concatenate([rows["t"] for rows in streams.values()])
    place = np.empty(times.size, dtype=np.int64)
    place[np.argsort(times, kind="stable")] = np.arange(times.size)
    at = 0
    for rows in streams.values():
        rows["order"] = place[at : at + rows.size]
        at += rows.size


class _Csv:
    """Columns of a CSV file, by title."""

    def __init__(self, path: Path, layout: Layout) -> None:
        self.path, self.layout = path, layout
        if path.is_dir():
            raise BadInput(path, "", "a CSV file, not a folder")
        self.first_line = layout.skip_rows + 2
        try:
            # Titles first: everything is read as text, so that each number can be judged where it stands.
            with path.open("rb") as file:
                for _ in range(layout.skip_rows):
                    file.readline()
                head = file.readline().decode("utf-8-sig").strip("\r\n")
        except (OSError, UnicodeDecodeError) as error:
            raise BadInput(path, "", f"a readable CSV file in UTF-8 ({error})") from error
        self.titles = [part.strip().strip('"').strip() for part in head.split(layout.delimiter)]
        if len(self.titles) < 2:
            raise BadInput(
                path, f"line {layout.skip_rows + 1}", f"titles separated by {layout.delimiter!r}, not {head[:60]!r}"
            )
        repeated = {title for title in self.titles if self.titles.count(title) > 1}
        if repeated:
            raise BadInput(path, f"line {layout.skip_rows + 1}", f"each title once; {sorted(repeated)[0]!r} repeats")
        try:
            self.table = pacsv.read_csv(
                path,
                pacsv.ReadOptions(skip_rows=layout.skip_rows + 1, column_names=self.titles, encoding="utf8"),
                pacsv.ParseOptions(delimiter=layout.delimiter, ignore_empty_lines=False),
                pacsv.ConvertOptions(column_types=dict.fromkeys(self.titles, pa.string()), strings_can_be_null=False),
            )
        except pa.ArrowInvalid as error:
            said = "".join(part if part.isprintable() else "?" for part in str(error).splitlines()[0][:120])
            raise BadInput(path, "", f"a regular CSV file with {len(self.titles)} columns ({said})") from error
        if self.table.num_rows == 0:
            raise BadInput(path, f"line {self.first_line}", "at least one row of data")

    def values(self, source: str, index: int) -> NDArray[np.float64] | None:
        """Numbers of the column titled `source`, NaN where a cell is empty; None where there is no such column."""
        if source not in self.titles:
            return None
        text = self.table[source].combine_chunks()
        cells = np.char.strip(np.asarray(text.to_pylist(), dtype=str))
        plain = cells
        if self.layout.decimal == ",":
            pointed = np.char.find(cells, ".") >= 0
            if pointed.any():
                self._refuse(cells, int(np.argmax(pointed)), source, "a decimal comma, as the layout says")
            plain = np.char.replace(cells, ",", ".")
        plain = np.where(plain == "", "nan", plain)
        # Python reads 1_000 as a number; a log does not mean one.
        spaced = np.char.find(plain, "_") >= 0
        if spaced.any():
            self._refuse(cells, int(np.argmax(spaced)), source, "a number")
        try:
            return plain.astype(np.float64)
        except ValueError:
            for row, cell in enumerate(plain):
                try:
                    float(cell)
                except ValueError:
                    hint = '; for decimal commas say decimal = "," in the layout' if "," in cells[row] else ""
                    self._refuse(cells, row, source, f"a number{hint}")
        return None

    def _refuse(self, cells, row: int, source: str, expected: str) -> None:
        raise BadInput(
            self.path, f"line {row + self.first_line}, column {source!r}", f"{expected}, not {str(cells[row])!r}"
        )

    def place(self, row: int) -> str:
        return f"line {row + self.first_line}"

    def missing(self) -> str:
        return f"it has {', '.join(repr(title) for title in self.titles)}"


class _Arrays:
    """numpy arrays in a folder, by path within it."""

    def __init__(self, path: Path) -> None:
        if not path.is_dir():
            raise BadInput(path, "", "a folder of numpy arrays")
        self.path = path

    def values(self, source: str, index: int) -> NDArray[np.float64] | None:
        file = self.path / source
        if not file.is_file():
            return None
        try:
            array = np.load(file, allow_pickle=False)
        except (OSError, ValueError) as error:
            raise BadInput(file, "", f"a numpy array ({error})") from error
        if array.ndim == 1:
            array = array[:, None]
        if array.ndim != 2 or index >= array.shape[1] or array.dtype.kind not in "fiu":
            raise BadInput(file, f"shape {array.shape}", f"numbers with a column {index}")
        return array[:, index].astype(np.float64)

    def place(self, row: int) -> str:
        return f"row {row}"

    def missing(self) -> str:
        return "there is no such file in the folder"


def _first(
    source: _Csv | _Arrays, names: str | Iterable[str], index: int = 0
) -> tuple[str, NDArray[np.float64] | None]:
    names = [names] if isinstance(names, str) else list(names)
    for name in names:
        values = source.values(name, index)
        if values is not None:
            return name, values
    return names[0], None


def _read_stream(source: _Csv | _Arrays, part: Stream, layout: Layout, found: Imported) -> NDArray | None:
    """Read one stream; None where it is not required and not there."""
    title, stamps = _first(source, part.time)
    columns: dict[str, tuple[str, Column, NDArray[np.float64]]] = {}
    absent = None if stamps is not None else title
    for name, column in part.columns.items():
        where, values = _first(source, column.source, column.index)
        if values is not None:
            columns[name] = (where, column, values)
        elif column.required and absent is None:
            absent = where
    if absent is not None or stamps is None:
        if part.required:
            raise BadInput(source.path, f"column {absent!r}", f"a column for {part.stream}; {source.missing()}")
        found.notes.append(f"{part.stream}: not in this file (no {absent!r})")
        return None
    t = stamps * UNITS[part.time_unit][1] - part.lag
    for where, _, values in columns.values():
        if values.size != t.size:
            raise BadInput(source.path, where, f"as many rows as its time stamps, {t.size}, not {values.size}")
    keep = _judge_times(source, part, title, t, found)
    rows = np.zeros(t.size, dtype=STREAMS[part.stream])
    rows["t"] = t
    if part.stream.startswith("gps"):
        for name in ("utc", "latitude", "longitude", "altitude", "hdop", "speed", "course"):
            rows[name] = np.nan
        rows["quality"] = 1
    empty = np.zeros(t.size, dtype=bool)
    for name, (where, column, values) in columns.items():
        rows[name] = _to_si(source, layout, part.stream, name, where, column, values)
        empty |= np.isnan(values) if column.required else False
    if np.any(empty & keep):
        count = int(np.sum(empty & keep))
        _tell(found, part.stream, "empty_cell", count, source.place(int(np.flatnonzero(empty & keep)[0])), "left out")
    keep &= ~empty
    if part.stream.startswith("gps"):
        rows["quality"][~np.isfinite(rows["latitude"])] = 0
    return rows[keep]


def _tell(found: Imported, stream: str, kind: str, count: int, place: str, what: str) -> None:
    found.log.damage[kind] = found.log.damage.get(kind, 0) + count
    found.notes.append(f"{stream}: {count} x {kind.replace('_', ' ')}, first at {place}: {what}")


def _judge_times(source, part: Stream, title: str, t: NDArray[np.float64], found: Imported) -> NDArray[np.bool_]:
    """Which rows have a stamp that can be used; the others, and jumps, are told."""
    name = part.stream
    keep = np.isfinite(t)
    if not keep.all():
        _tell(found, name, "empty_stamp", int((~keep).sum()), source.place(int(np.argmin(keep))), "left out")
    if not keep.any():
        raise BadInput(source.path, f"column {title!r}", "at least one time stamp")
    index = np.flatnonzero(keep)
    newest = np.maximum.accumulate(t[index])
    before = np.concatenate(([-np.inf], newest[:-1]))
    repeated, back = t[index] == before, t[index] < before
    for kind, bad in (("repeated_stamp", repeated), ("backward_stamp", back)):
        if bad.any():
            _tell(found, name, kind, int(bad.sum()), source.place(int(index[np.argmax(bad)])), "left out")
    keep[index[repeated | back]] = False
    good = np.flatnonzero(keep)
    if good.size > 2:
        step = np.diff(t[good])
        median = float(np.median(step))
        if median > 60.0 or median < 1e-4:
            raise BadInput(
                source.path,
                f"column {title!r}",
                f"time in {part.time_unit}; a step of {median:g} s suggests another unit",
            )
        jumps = step > max(JUMP * median, 1.0)
        if jumps.any():
            where = int(np.argmax(jumps))
            what = f"a hole of {step[where]:.3g} s, kept"
            _tell(found, name, "jump", int(jumps.sum()), source.place(int(good[where + 1])), what)
    return keep


def _to_si(source, layout: Layout, stream: str, name: str, where: str, column: Column, values) -> NDArray[np.float64]:
    unit, factor = UNITS[column.unit]
    out = values * (factor * column.factor)
    if stream == "fuel" and name == "power":
        fuel = layout.fuel
        per = {"W": 1.0, "m3/s": fuel.density * fuel.heating_value, "kg/s": fuel.heating_value}
        out = out * per.get(unit, fuel.heating_value / fuel.air_ratio)
        unit = "W"
    if unit == "deg" and (name in ("course", "heading")):
        out, unit = np.radians(out), "rad"
    out = out + column.offset
    if unit in RANGES:
        low, high = RANGES[unit]
        if name == "latitude":
            low, high = -90.0, 90.0
        wrong = (out < low) | (out > high)
        if wrong.any():
            row = int(np.argmax(wrong))
            place = f"{source.place(row)}, column {where!r}"
            expected = (
                f"{low:g} to {high:g} {unit} (the layout says {column.unit}), not {out[row]:g} {unit}: another unit?"
            )
            raise BadInput(source.path, place, expected)
    return out


def _look(path: Path, streams: dict[str, NDArray], notes: list[str]) -> None:
    """Tell where numbers look as if their unit were another, though each is possible."""
    speed = streams.get("speed")
    if speed is None or speed.size < 10:
        return
    step = np.maximum(np.diff(speed["t"]), 1e-3)
    slow = step < 5.0
    if slow.any():
        window = max(1, round(1.0 / float(np.median(step))))
        change = np.abs(speed["speed"][window:] - speed["speed"][:-window])
        span = speed["t"][window:] - speed["t"][:-window]
        steep = float(np.quantile(change / np.maximum(span, 0.5), 0.995)) if change.size else 0.0
        if steep > 8.0:
            notes.append(f"speed: changes by {steep:.1f} m/s2; by the look of it the unit is another")
    distance = float(np.sum(0.5 * (speed["speed"][1:] + speed["speed"][:-1]) * step))
    if speed["speed"].max() < 0.5:
        notes.append("speed: the car never moves; is the unit right?")
    fuel = streams.get("fuel")
    if fuel is not None and fuel.size > 10 and distance > 1000.0:
        energy = float(np.sum(0.5 * (fuel["power"][1:] + fuel["power"][:-1]) * np.diff(fuel["t"])))
        litres = energy / 32.0e6 / (distance / 1e5)
        if not 1.0 < litres < 60.0:
            notes.append(f"fuel: {litres:.3g} l/100 km; by the look of it the unit is another")
