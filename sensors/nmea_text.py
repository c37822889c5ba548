"""Writing NMEA sentences GGA, GSA and RMC as a table of characters: a row per epoch, a column per place in the text.

A sentence is a list of pieces, each some columns of characters and which of them an epoch says; joining the rows
leaves out what is not said. `sensors.nmea_kernels` reads; pynmeagps is the reference that the tests hold both to.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensors.nmea_kernels import KNOT

Piece = tuple[NDArray[np.uint8], NDArray[np.bool_]]
"""Characters (n, width) and which of them stand, (n, width)."""
_ROWS = 4096
"""Epochs at a time: keeps the tables small."""


def write_epochs(
    hundredths: NDArray[np.int64],
    date: NDArray[np.int64],
    latitude: NDArray[np.float64],
    longitude: NDArray[np.float64],
    altitude: NDArray[np.float64],
    hdop: NDArray[np.float64],
    quality: NDArray[np.int64],
    satellites: NDArray[np.int64],
    speed: NDArray[np.float64],
    course: NDArray[np.float64],
    gsa: NDArray[np.bool_],
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Write GGA and RMC (and GSA between them where `gsa`) of every epoch; all arguments (n,).

    `hundredths` of a second of the day, `date` as the number ddmmyy, deg, m, speed m/s, course deg; quality 0 leaves
    the fields empty. Returns the text (uint8) and where each epoch ends in it.
    """
    every = (hundredths, date, latitude, longitude, altitude, hdop, quality, satellites, speed, course, gsa)
    texts, ends, length = [], [], 0
    for begin in range(0, hundredths.size, _ROWS):
        characters, said = _table(*(values[begin : begin + _ROWS] for values in every))
        texts.append(characters[said])
        ends.append(length + np.cumsum(said.sum(axis=1)))
        length += texts[-1].size
    if not texts:
        return np.empty(0, np.uint8), np.empty(0, np.int64)
    return np.concatenate(texts), np.concatenate(ends).astype(np.int64)


def _table(hundredths, date, latitude, longitude, altitude, hdop, quality, satellites, speed, course, gsa) -> Piece:
    """The three sentences of some epochs, one behind the other."""
    n, fix = hundredths.size, quality > 0
    comma, clock = _text(n, ","), _clock(hundredths)
    place = [*_angle(latitude, 2, "N", "S"), *_angle(longitude, 3, "E", "W")]
    gga = _join(
        *_where(fix, *place, _digits(quality, 1), comma, _digits(satellites, 2), comma, *_decimal(hdop, 1), comma),
        *_where(fix, *_decimal(altitude, 1), _text(n, ",M,47.0,M,,")),
        *_where(~fix, _text(n, ",,,,0,00,99.9,,,,,,")),
    )
    seen: list[Piece] = []
    for k in range(12):
        seen += [*_where(fix & (k < satellites), _text(n, f"{2 * k + 1:02d}")), comma]
    dilutions = [_decimal(hdop * (1.6 - 0.6 * k + 0.425 * k * (k - 1)), 1) for k in range(3)]
    mode = _digits(np.where(fix, 3, 1), 1)
    active = _join(mode, comma, *seen, *dilutions[0], comma, *dilutions[1], comma, *dilutions[2])
    rmc = _join(
        *_where(fix, _text(n, "A,"), *place, *_decimal(speed / KNOT, 2), comma, *_decimal(course, 2), comma),
        *_where(~fix, _text(n, "V,,,,,,,")),
        _digits(date, 6),
        *_where(fix, _text(n, ",,,A")),
        *_where(~fix, _text(n, ",,,N")),
    )
    return _join(
        _sentence(_text(n, "GPGGA,"), *clock, gga),
        *_where(gsa, _sentence(_text(n, "GPGSA,A,"), active)),
        _sentence(_text(n, "GPRMC,"), *clock, rmc),
    )


def _join(*pieces: Piece) -> Piece:
    return np.hstack([piece[0] for piece in pieces]), np.hstack([piece[1] for piece in pieces])


def _where(said: NDArray[np.bool_], *pieces: Piece) -> list[Piece]:
    """The pieces, in the rows `said` (n,) only."""
    return [(characters, kept & said[:, None]) for characters, kept in pieces]


def _text(n: int, text: str) -> Piece:
    columns = np.frombuffer(text.encode("ascii"), np.uint8)
    return np.broadcast_to(columns, (n, columns.size)), np.ones((n, columns.size), bool)


def _digits(value: ArrayLike, least: int) -> Piece:
    """Digits of non-negative integers, padded with zeros to `least`."""
    rest = np.asarray(value)
    most = int(rest.max(initial=0))
    rest = rest.astype(np.int32 if most < 2**31 else np.int64)
    width = max(least, len(str(most)))
    characters, kept = np.empty((rest.size, width), np.uint8), np.ones((rest.size, width), bool)
    for column in range(width - 1, -1, -1):
        if column < width - least:
            kept[:, column] = rest > 0
        tens = rest // 10
        characters[:, column] = 48 + rest - 10 * tens
        rest = tens
    return characters, kept


def _decimal(value: NDArray[np.float64], decimals: int) -> list[Piece]:
    """Numbers with `decimals` digits behind the point."""
    scale = 10**decimals
    scaled = np.floor(np.abs(value) * scale + 0.5).astype(np.int64)
    point = _text(value.size, ".")
    return [
        *_where(value < 0, _text(value.size, "-")),
        _digits(scaled // scale, 1),
        point,
        _digits(scaled % scale, decimals),
    ]


def _angle(value: NDArray[np.float64], width: int, positive: str, negative: str) -> list[Piece]:
    """Angles in degrees as ddmm.mmmmm,N,"""
    units = np.floor(np.abs(value) * 6_000_000.0 + 0.5).astype(np.int64)
    minutes = units % 6_000_000
    side = np.where(value >= 0, ord(positive), ord(negative)).astype(np.uint8)[:, None]
    comma = _text(value.size, ",")
    return [
        _digits(units // 6_000_000, width),
        _digits(minutes // 100_000, 2),
        _text(value.size, "."),
        _digits(minutes % 100_000, 5),
        comma,
        (side, np.ones(side.shape, bool)),
        comma,
    ]


def _clock(hundredths: NDArray[np.int64]) -> list[Piece]:
    """Times of the day as hhmmss.ss,"""
    seconds = hundredths // 100
    n = hundredths.size
    return [
        _digits(seconds // 3600, 2),
        _digits(seconds // 60 % 60, 2),
        _digits(seconds % 60, 2),
        _text(n, "."),
        _digits(hundredths % 100, 2),
        _text(n, ","),
    ]


def _sentence(*body: Piece) -> Piece:
    """The body between its $ and its check, which is the exclusive or of its characters."""
    characters, said = _join(*body)
    n = len(characters)
    check = np.bitwise_xor.reduce(np.where(said, characters, 0), axis=1)
    hexadecimal = np.frombuffer(b"0123456789ABCDEF", np.uint8)
    checks = np.column_stack([hexadecimal[check >> 4], hexadecimal[check & 15]])
    return _join(
        _text(n, "$"), (characters, said), _text(n, "*"), (checks, np.ones(checks.shape, bool)), _text(n, "\r\n")
    )
