"""NMEA 0183 as the receiver speaks it: GGA, GSA and RMC (seed 004, C.1.5.3).

Compiled kernels read the sentences that make up nearly all of a log; whatever does not look exactly like them is given
to pynmeagps, which is also what the tests compare writer and kernels with.
"""

import datetime
from dataclasses import dataclass, field

import numpy as np
import pynmeagps
from numpy.typing import NDArray

from sensors import nmea_kernels as kernels
from sensors.nmea_text import write_epochs

FIX = np.dtype(
    [
        ("utc", "f8"),
        ("latitude", "f8"),
        ("longitude", "f8"),
        ("altitude", "f8"),
        ("hdop", "f8"),
        ("quality", "f8"),
        ("satellites", "f8"),
        ("speed", "f8"),
        ("course", "f8"),
    ]
)
"""A fix: s since 1970; deg; m above sea level; speed m/s; course rad. NaN where the receiver said nothing."""


def write(fixes: NDArray, gsa: NDArray[np.bool_]) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Write one GGA and one RMC per fix, and a GSA between them where `gsa` (n,) says so.

    Parameters: `fixes` (n,) of FIX; quality 0 means no fix. Returns the text (uint8) and where each epoch ends in it.
    """
    hundredths = np.round(fixes["utc"] * 100.0).astype(np.int64)
    days = (hundredths // 8_640_000).astype("datetime64[D]")
    months = days.astype("datetime64[M]")
    year = days.astype("datetime64[Y]").astype(np.int64) + 1970
    month = months.astype(np.int64) % 12 + 1
    day = (days - months.astype("datetime64[D]")).astype(np.int64) + 1
    date = day * 10_000 + month * 100 + year % 100
    latitude, longitude, altitude, hdop = (
        np.nan_to_num(fixes[name].astype(np.float64)) for name in ("latitude", "longitude", "altitude", "hdop")
    )
    course = np.degrees(np.nan_to_num(fixes["course"])) % 360.0
    return write_epochs(
        hundredths % 8_640_000, date, latitude, longitude, altitude, hdop,
        fixes["quality"].astype(np.int64), fixes["satellites"].astype(np.int64),
        np.nan_to_num(fixes["speed"].astype(np.float64)), course, gsa,
    )  # fmt: skip


def _fresh_state() -> NDArray[np.float64]:
    state = np.zeros(24)
    state[3] = -1.0
    return state


@dataclass
class Reader:
    """Reads text that arrives in pieces; what is unfinished waits for the next piece. One object per stream."""

    damage: dict[str, int] = field(default_factory=lambda: {"bad_sentence": 0, "undated_fix": 0})
    _rest: NDArray[np.uint8] = field(default_factory=lambda: np.empty(0, np.uint8))
    _state: NDArray[np.float64] = field(default_factory=_fresh_state)
    _in_rubbish: bool = False

    def feed(
        self, text: NDArray[np.uint8], ends: NDArray[np.int64], places: NDArray[np.int64], final: bool = False
    ) -> tuple[NDArray, NDArray[np.int64]]:
        """Return the fixes (of FIX) that `text` completes and the place of each one's last byte.

        Parameters: `text` (uint8) in pieces; piece i ends at `ends[i]` and stood at `places[i]` (any numbering).
        """
        kept = self._rest.size
        text = np.concatenate((self._rest, text)) if kept else text
        room = text.size // 7 + 2
        begins, stops = np.empty(room, np.int64), np.empty(room, np.int64)
        counters = np.array([0, self._in_rubbish], np.int64)
        count, used = kernels.find_sentences(text, final, begins, stops, counters)
        kind, status = np.empty(count, np.int64), np.empty(count, np.int64)
        values = np.empty((count, 9))
        kernels.read_sentences(text, begins, stops, count, kind, status, values)
        for row in np.flatnonzero(status == kernels.UNSURE):
            if not _read_with_library(text[begins[row] : stops[row]].tobytes(), values[row]):
                kind[row] = -1
                counters[0] += 1
        piece = np.searchsorted(ends + kept, stops[:count], side="left")
        sentence_place = places[piece] if piece.size else np.empty(0, np.int64)
        out, out_place = np.empty((count + 2, 9)), np.empty(count + 2, np.int64)
        found = kernels.join_epochs(kind, values, sentence_place, count, final, self._state, out, out_place)
        self._rest, self._in_rubbish = text[used:].copy(), bool(counters[1])
        self.damage["bad_sentence"] += int(counters[0])
        self.damage["undated_fix"] = int(self._state[5])
        return out[:found].view(FIX).reshape(-1), out_place[:found]


def _read_with_library(sentence: bytes, values: NDArray[np.float64]) -> bool:
    """Read one sentence with pynmeagps into the row `values`; tell whether it could."""
    try:
        message = pynmeagps.NMEAReader.parse(sentence + b"\r\n")
    except (pynmeagps.NMEAParseError, pynmeagps.NMEAStreamError, pynmeagps.NMEAMessageError, pynmeagps.NMEATypeError):
        return False
    except (ValueError, TypeError, IndexError):
        return False
    if not isinstance(message, pynmeagps.NMEAMessage) or message.msgID not in ("GGA", "RMC"):
        return False

    def number(name: str) -> float:
        value = getattr(message, name, "")
        return float(value) if isinstance(value, int | float) else np.nan

    clock = getattr(message, "time", "")
    if not isinstance(clock, datetime.time):
        return False
    values[:] = np.nan
    values[0] = clock.hour * 3600.0 + clock.minute * 60.0 + clock.second + clock.microsecond * 1e-6
    values[1], values[2] = number("lat"), number("lon")
    if message.msgID == "GGA":
        values[3], values[4], values[5] = number("alt"), number("HDOP"), np.nan_to_num(number("quality"))
        values[6] = np.nan_to_num(number("numSV"))
        return True
    date = getattr(message, "date", "")
    if not isinstance(date, datetime.date):
        return False
    values[5] = 1.0 if getattr(message, "status", "V") == "A" else 0.0
    values[6] = date.toordinal() - 719163
    values[7], values[8] = number("spd") * kernels.KNOT, np.radians(number("cog"))
    return True
