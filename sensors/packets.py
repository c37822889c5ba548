"""The packets on the card (seed 004, C.1.4 and C.1.5): writing them, and reading whatever a card can contain.

A packet: 0xFF, type, length, payload, check; little-endian; length = payload bytes + 1; check = (length + payload
bytes) mod 256 (CLI.md, "At the door"; C.1.4 leaves the byte order open). Types 6 and 7, for the gyroscope and the
compass that 2.3 note 5 foresees, are ours. Packets are cut into 512-byte blocks; the file is preallocated with zeros.

The reader accepts a packet when head, length and check are right and what follows looks like a packet, zeros or the
end. After damage it searches byte by byte, so that it loses only what was damaged. One card in very many can be read in
two ways: a packet of 14 bytes whose last 9 or 10 are a packet too. The shorter is taken, for such a head is what damage
leaves behind (`packet_kernels._ends_alike`); the box's own readings never hold one in its first 18 hours.
What the reader skipped it counts by kind:

bad_preamble, unknown_type, bad_length, bad_check, false_packet (a check right by accident), zero_run (a block that
was never written), truncated (the file ends within a packet): one for each interruption; bytes_skipped: all of them.
bad_sentence, undated_fix: NMEA text lost behind intact packets. error_message: what the box itself complained of.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from sensors import nmea
from sensors import packet_kernels as kernels
from sensors.log import STREAMS, SensorLog
from vehicle_model.car.errors import BadInput

ERROR, ACCELEROMETER, GPS, WHEEL, INJECTOR, SKEW, GYROSCOPE, COMPASS = range(8)
"""Packet types."""

BLOCK = 512
STANDARD_GRAVITY = 9.80665
"""m/s2 in 1000 mg."""
INJECTOR_TICK = 250e-9
WHEEL_TICK = 125e-6
SATURATED = 0xFFFF

LAYOUT: dict[int, np.dtype] = {
    ACCELEROMETER: np.dtype([("ms", "<u4"), ("x", "<i2"), ("y", "<i2"), ("z", "<i2")]),  # mg
    WHEEL: np.dtype([("ms", "<u4"), ("sub", "u1")]),  # 125 us
    INJECTOR: np.dtype([("ms", "<u4"), ("width", "<u2")]),  # 250 ns
    SKEW: np.dtype([("ms", "<u4"), ("gained", "i1")]),  # ms
    GYROSCOPE: np.dtype([("ms", "<u4"), ("x", "<i2"), ("y", "<i2"), ("z", "<i2")]),  # 1/100 deg/s
    COMPASS: np.dtype([("ms", "<u4"), ("heading", "<u2")]),  # 1/100 deg
}
"""Payloads, packed, little-endian. GPS (2) and error (0) packets are text."""

STREAM_OF = {
    ACCELEROMETER: "accelerometer",
    WHEEL: "wheel",
    INJECTOR: "injector",
    SKEW: "skew",
    GYROSCOPE: "gyroscope",
    COMPASS: "compass",
}


@dataclass(frozen=True)
class Packets:
    """Packets of one type, before they are woven together."""

    kind: int
    key: NDArray[np.float64]
    """(n,) when each was written, any clock common to all: the order on the card."""
    payload: NDArray[np.uint8]
    """All payloads, one behind the other."""
    lengths: NDArray[np.int64]
    """(n,) bytes of each payload, 1 to 254."""

    @staticmethod
    def of(kind: int, key: NDArray[np.float64], rows: NDArray) -> "Packets":
        """Packets of fixed size from structured `rows` (n,) of LAYOUT[kind]."""
        size = LAYOUT[kind].itemsize
        payload = np.ascontiguousarray(rows).view(np.uint8).reshape(-1)
        return Packets(kind, key, payload, np.full(rows.size, size, dtype=np.int64))


def encode(groups: Iterable[Packets]) -> bytes:
    """Weave packets together in the order of their keys (ties: order of `groups`) and return the card's bytes."""
    groups = list(groups)
    if not groups:
        return b""
    lengths = np.concatenate([group.lengths for group in groups])
    block = np.repeat(np.arange(len(groups)), [group.lengths.size for group in groups])
    row = np.concatenate([np.cumsum(group.lengths) - group.lengths for group in groups])
    payload = np.concatenate([group.payload for group in groups])
    starts = np.cumsum([0] + [group.payload.size for group in groups[:-1]])
    kinds = np.array([group.kind for group in groups], dtype=np.uint8)
    sequence = np.argsort(np.concatenate([group.key for group in groups]), kind="stable")
    out = np.empty(int(lengths.sum()) + 4 * lengths.size, dtype=np.uint8)
    kernels.pack(sequence, block, row, kinds, starts.astype(np.int64), lengths, payload, out)
    return out.tobytes()


def write_log(path: Path, packets: bytes, preallocated: int = 0) -> None:
    """Write the card's file: whole 512-byte blocks, zeros to at least `preallocated` bytes; aside, then renamed."""
    size = max(preallocated, -(-len(packets) // BLOCK) * BLOCK)
    aside = path.with_name(path.name + ".part")
    try:
        with aside.open("wb") as file:
            file.write(packets)
            file.truncate(size)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


@dataclass
class Decoder:
    """Reads a card's bytes as they come, in memory bounded by the piece given. One object per log."""

    damage: dict[str, int] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)
    """The box's own error messages (the newest 100)."""
    _rest: NDArray[np.uint8] = field(default_factory=lambda: np.empty(0, np.uint8))
    _in_step: bool = True
    _zeros: int = 0
    _order: int = 0
    _stamp: float = 0.0
    _counters: NDArray[np.int64] = field(default_factory=lambda: np.zeros(kernels.COUNTERS, np.int64))
    _text: nmea.Reader = field(default_factory=nmea.Reader)
    _fix_stamps: dict[int, float] = field(default_factory=dict)

    def feed(self, data: bytes | NDArray[np.uint8], final: bool = False) -> dict[str, NDArray]:
        """Return the streams (of STREAMS) that `data` completes; `final`: nothing follows."""
        piece = np.frombuffer(data, dtype=np.uint8) if isinstance(data, bytes | bytearray | memoryview) else data
        buffer = (np.concatenate((self._rest, piece)) if self._rest.size else piece).view()
        buffer.flags.writeable = False  # as a file's bytes are: one type for the kernels, compiled once
        starts = np.empty(buffer.size // 5 + 1, dtype=np.int64)
        count, used, self._in_step, self._zeros = kernels.scan(
            buffer, final, self._in_step, self._zeros, starts, self._counters
        )
        starts = starts[:count]
        kinds = buffer[starts + 1]
        streams: dict[str, NDArray] = {}
        stamps = np.full(count, -np.inf)
        for kind, name in STREAM_OF.items():
            chosen = np.flatnonzero(kinds == kind)
            if chosen.size == 0:
                continue
            layout = LAYOUT[kind]
            raw = sliding_window_view(buffer, layout.itemsize)[starts[chosen] + 3]
            rows = raw.view(layout).reshape(-1)
            streams[name] = _to_stream(kind, rows, chosen + self._order)
            stamps[chosen] = streams[name]["t"]
        self._read_text(buffer, starts, kinds, stamps, streams, final)
        self._order += count
        self._rest = buffer[used:].copy()
        self._note_damage()
        return streams

    def _read_text(self, buffer, starts, kinds, stamps, streams, final) -> None:
        """Read GPS and error packets; `stamps` (n,) holds the logger time of stamped packets, else -inf."""
        errors = np.flatnonzero(kinds == ERROR)
        for row in errors:
            begin = starts[row] + 3
            text = buffer[begin : begin + buffer[begin - 1] - 1].tobytes()
            self.messages = [*self.messages, text.decode("ascii", "replace").strip()][-100:]
        if errors.size:
            self.damage["error_message"] = self.damage.get("error_message", 0) + int(errors.size)
        chosen = np.flatnonzero(kinds == GPS)
        newest = _newest_stamp(stamps, self._stamp)
        if newest.size:
            self._stamp = float(newest[-1])
        text = np.empty(int(254 * chosen.size), dtype=np.uint8)
        ends = np.empty(chosen.size, dtype=np.int64)
        length = kernels.gather_text(buffer, starts, chosen, text, ends)
        # An epoch may be given out later than its last sentence came: its place and stamp wait with it.
        stamp_of = self._fix_stamps
        fixes, places = self._text.feed(text[:length], ends, chosen + self._order, final)
        if fixes.size:
            rows = np.empty(fixes.size, dtype=STREAMS["gps"])
            rows["order"] = places
            for name in nmea.FIX.names or ():
                rows[name] = fixes[name]
            local = places - self._order
            known = local >= 0
            rows["t"][known] = newest[local[known]]
            rows["t"][~known] = [stamp_of.get(int(place), 0.0) for place in places[~known]]
            streams["gps"] = rows
        if chosen.size:
            self._fix_stamps = {int(row + self._order): float(newest[row]) for row in chosen[-2 * 64 :]}

    def _note_damage(self) -> None:
        names = ("bad_preamble", "unknown_type", "bad_length", "bad_check", "false_packet", "zero_run", "truncated")
        for name, count in zip((*names, "bytes_skipped"), self._counters, strict=True):
            if count:
                self.damage[name] = int(count)
        for name, count in self._text.damage.items():
            if count:
                self.damage[name] = count


def _newest_stamp(stamps: NDArray[np.float64], before: float) -> NDArray[np.float64]:
    """Return for each packet the logger time of the newest stamped packet up to it; `before`: from earlier pieces."""
    if stamps.size == 0:
        return stamps
    place = np.where(np.isfinite(stamps), np.arange(stamps.size), -1)
    place = np.maximum.accumulate(place)
    return np.where(place >= 0, stamps[place], before)


def _to_stream(kind: int, rows: NDArray, order: NDArray[np.int64]) -> NDArray:
    """Turn the payloads `rows` of one type into SI."""
    out = np.empty(rows.size, dtype=STREAMS[STREAM_OF[kind]])
    out["order"] = order
    out["t"] = rows["ms"] * 1e-3
    if kind == ACCELEROMETER:
        for axis in "xyz":
            out[axis] = rows[axis] * (1e-3 * STANDARD_GRAVITY)
    elif kind == WHEEL:
        out["t"] += rows["sub"] * WHEEL_TICK
    elif kind == INJECTOR:
        out["width"] = rows["width"] * INJECTOR_TICK
        out["saturated"] = rows["width"] == SATURATED
    elif kind == SKEW:
        out["gained"] = rows["gained"] * 1e-3
    elif kind == GYROSCOPE:
        for axis in "xyz":
            out[axis] = np.radians(rows[axis] * 0.01)
    elif kind == COMPASS:
        out["heading"] = np.radians(rows["heading"] * 0.01)
    return out


def stream(chunks: Iterable[bytes], damage: dict[str, int] | None = None) -> Iterator[dict[str, NDArray]]:
    """Read a log piece by piece in bounded memory: yields the streams (of STREAMS) that each piece completed.

    Joined together they are what `decode` returns, bit for bit. `damage`, where given, is kept up to date.
    """
    decoder = Decoder(damage={} if damage is None else damage)
    for chunk in chunks:
        yield decoder.feed(chunk)
    yield decoder.feed(b"", final=True)


def decode(data: bytes | NDArray[np.uint8], name: str = "") -> SensorLog:
    """Read a whole log from memory. Never fails: what cannot be read is counted in `SensorLog.damage`."""
    decoder = Decoder()
    streams = decoder.feed(data, final=True)
    empty = {stream: np.empty(0, dtype=kind) for stream, kind in STREAMS.items()}
    return SensorLog(empty | streams, dict(decoder.damage), name)


def nmea_text(data: bytes | NDArray[np.uint8]) -> bytes:
    """Return the receiver's text as it stands in the GPS packets of a whole log, joined (C.1.3, gps.txt)."""
    buffer = np.frombuffer(data, dtype=np.uint8) if not isinstance(data, np.ndarray) else data
    starts = np.empty(buffer.size // 5 + 1, dtype=np.int64)
    count, _, _, _ = kernels.scan(buffer, True, True, 0, starts, np.zeros(kernels.COUNTERS, np.int64))
    chosen = np.flatnonzero(buffer[starts[:count] + 1] == GPS)
    text = np.empty(254 * chosen.size, dtype=np.uint8)
    length = kernels.gather_text(buffer, starts, chosen, text, np.empty(chosen.size, dtype=np.int64))
    return text[:length].tobytes()


def read_log(path: Path) -> SensorLog:
    """Read the card's file `path`. Raises BadInput where it is missing, unreadable or holds not one packet."""
    try:
        size = path.stat().st_size
        data = np.memmap(path, dtype=np.uint8, mode="r") if size else np.empty(0, np.uint8)
        log = decode(np.asarray(data), path.name)
    except OSError as error:
        raise BadInput(path, "", f"a readable log file ({error.strerror or error})") from error
    if not any(len(rows) for rows in log.streams.values()):
        raise BadInput(path, f"{size} bytes", "at least one packet of the box (0xFF, type, length, payload, check)")
    return log
