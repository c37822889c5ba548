"""Compiled reading of NMEA sentences GGA and RMC. Flat arrays in, flat arrays out.

`sensors.nmea` is the readable side; pynmeagps is the reference that the tests hold these kernels to. What compiles fast
matters here: the first run waits for it. So names with an underscore have no way in from Python, where calling them
would crash, and counters begin as int64, not as the literal 0, which would compile their users once more.
"""

import numpy as np
from numba import njit

GGA, RMC = 0, 1
GOOD, UNSURE = 0, 1
LONGEST = 120
MAX_FIELDS = 24
DOLLAR, STAR, COMMA, POINT = 36, 42, 44, 46
KNOT = 1852.0 / 3600.0
DAY = 86400.0
ENTRY = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
INNER = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True}


@njit(**INNER)
def _hex(byte):
    if 48 <= byte <= 57:
        return byte - 48
    if 65 <= byte <= 70:
        return byte - 55
    if 97 <= byte <= 102:
        return byte - 87
    return -1


@njit(**ENTRY)
def find_sentences(text, final, begins, ends, counters):
    """Find checked sentences in `text` (uint8): `begins[i]` is its $, `ends[i]` lies behind its check.

    Adds to `counters[0]` (int64, 2) the sentences that were damaged; `counters[1]` tells whether the bytes before were
    rubbish already counted, from call to call. Returns (sentences, bytes used).
    """
    at = 0
    found = 0
    rubbish = counters[1] != 0
    stop = text.size
    while at < stop:
        byte = text[at]
        if byte != DOLLAR:
            if byte != 13 and byte != 10 and not rubbish:
                rubbish = True
                counters[0] += 1
            at += 1
            continue
        rubbish = False
        check = 0
        i = at + 1
        while i < stop and i - at < LONGEST and text[i] != STAR and text[i] != DOLLAR and text[i] != 10:
            check ^= text[i]
            i += 1
        if i - at < LONGEST and (i == stop or (text[i] == STAR and i + 2 >= stop)) and not final:
            break
        whole = i + 2 < stop and text[i] == STAR
        if whole and _hex(text[i + 1]) * 16 + _hex(text[i + 2]) == check and _hex(text[i + 2]) >= 0:
            begins[found] = at
            ends[found] = i + 3
            found += 1
            at = i + 3
        else:
            counters[0] += 1
            rubbish = True
            at += 1
    counters[1] = rubbish
    return found, at


@njit(**INNER)
def _number(text, begin, end):
    """Return (value, well formed) of a decimal number without exponent."""
    value = 0.0
    scale = 1.0
    point = False
    sign = 1.0
    if begin < end and text[begin] == 45:
        sign = -1.0
        begin += 1
    if begin == end:
        return 0.0, False
    for i in range(begin, end):
        if text[i] == POINT and not point:
            point = True
        elif 48 <= text[i] <= 57:
            value = value * 10.0 + (text[i] - 48)
            if point:
                scale *= 10.0
        else:
            return 0.0, False
    return sign * value / scale, True


@njit(**INNER)
def _angle(text, begin, end, side):
    """Return (degrees, well formed) of ddmm.mmmm and its hemisphere."""
    value, good = _number(text, begin, end)
    degrees = np.floor(value / 100.0)
    minutes = value - 100.0 * degrees
    if not good or minutes >= 60.0 or value < 0:
        return 0.0, False
    angle = degrees + minutes / 60.0
    if side == 83 or side == 87:
        return -angle, angle <= 180.0
    return angle, (side == 78 or side == 69) and angle <= 180.0


@njit(**INNER)
def _clock(text, begin, end):
    """Return (seconds of the day, well formed) of hhmmss.ss."""
    value, good = _number(text, begin, end)
    hours = np.floor(value / 10_000.0)
    minutes = np.floor((value - hours * 10_000.0) / 100.0)
    seconds = value - hours * 10_000.0 - minutes * 100.0
    good = good and end - begin >= 6 and value >= 0 and hours < 24 and minutes < 60 and seconds < 61
    return hours * 3600.0 + minutes * 60.0 + np.floor(seconds * 1000.0 + 0.5) / 1000.0, good


@njit(**INNER)
def _days(day, month, year):
    """Days from 1970-01-01 to a date of the Gregorian calendar."""
    if month <= 2:
        year -= 1
        month += 12
    era_days = 365 * year + year // 4 - year // 100 + year // 400
    return era_days + (153 * (month - 3) + 2) // 5 + day - 1 - 719468


@njit(**ENTRY)
def read_sentences(text, begins, ends, count, kind, status, values):
    """Read the GGA and RMC among `count` sentences. Row i of `values` (float64, n x 9) becomes

    time of day s, latitude deg, longitude deg, altitude m, hdop, quality, satellites, speed m/s, course rad for GGA
    and RMC alike, NaN where unsaid; an RMC has its days since 1970 in the place of the satellites.
    `kind[i]` becomes GGA, RMC or -1 (not used); `status[i]` GOOD or UNSURE (let the library read it).
    """
    comma = np.empty(MAX_FIELDS, np.int64)
    for row in range(count):
        begin, end = begins[row], ends[row] - 3
        kind[row] = -1
        status[row] = GOOD
        if end - begin < 7 or text[begin + 6] != COMMA:
            continue
        a, b, c = text[begin + 3], text[begin + 4], text[begin + 5]
        if a == 71 and b == 71 and c == 65:
            kind[row] = GGA
        elif a == 82 and b == 77 and c == 67:
            kind[row] = RMC
        else:
            continue
        fields = 0
        for i in range(begin, end):
            if text[i] == COMMA and fields < MAX_FIELDS - 1:
                comma[fields] = i
                fields += 1
        comma[fields] = end
        for place in range(9):
            values[row, place] = np.nan
        good = fields >= (14 if kind[row] == GGA else 9)
        if not good:
            status[row] = UNSURE
            continue
        values[row, 0], fine = _clock(text, comma[0] + 1, comma[1])
        good = good and fine
        first = 1 if kind[row] == GGA else 2
        if comma[first + 1] > comma[first] + 1:
            side = text[comma[first + 1] + 1]
            values[row, 1], fine = _angle(text, comma[first] + 1, comma[first + 1], side)
            good = good and fine
            side = text[comma[first + 3] + 1]
            values[row, 2], fine = _angle(text, comma[first + 2] + 1, comma[first + 3], side)
            good = good and fine
        if kind[row] == GGA:
            values[row, 5], fine = _number(text, comma[5] + 1, comma[6])
            good = good and fine
            values[row, 6] = 0.0
            for field in range(6, 9):
                # satellites, HDOP, altitude
                place = 6 if field == 6 else 11 - field
                if comma[field + 1] > comma[field] + 1:
                    values[row, place], fine = _number(text, comma[field] + 1, comma[field + 1])
                    good = good and fine
        else:
            values[row, 5] = 1.0 if text[comma[1] + 1] == 65 else 0.0
            if comma[7] > comma[6] + 1:
                values[row, 7], fine = _number(text, comma[6] + 1, comma[7])
                values[row, 7] *= KNOT
                good = good and fine
            if comma[8] > comma[7] + 1:
                values[row, 8], fine = _number(text, comma[7] + 1, comma[8])
                values[row, 8] = np.radians(values[row, 8])
                good = good and fine
            stamp, fine = _number(text, comma[8] + 1, comma[9])
            good = good and fine and comma[9] - comma[8] == 7
            number = np.int64(stamp)
            values[row, 6] = _days(number // 10_000, number // 100 % 100, 2000 + number % 100)
        if not good:
            status[row] = UNSURE


@njit(**ENTRY)
def join_epochs(kind, values, places, count, final, state, out, out_places):
    """Join the GGA and the RMC of one epoch to one fix.

    `places[i]` is an opaque index of the sentence's end (int64). `state` (float64, 24) carries the unfinished epoch:
    0 has GGA, 1 has RMC, 2 place, 3 last day (-1: none yet), 4 last time of day, 5 undated fixes lost,
    6.. the nine values of GGA, 15.. those of RMC. Fills `out` (float64, n x 9): utc, latitude, longitude, altitude,
    hdop, quality, satellites, speed, course. Returns the number of fixes.
    """
    found = np.int64(0)
    for row in range(count + 1):
        last = row == count
        if last and not final:
            break
        waiting = state[0] + state[1] > 0
        if not last and kind[row] < 0:
            continue
        if waiting:
            time = state[6] if state[0] > 0 else state[15]
            if last or values[row, 0] != time or state[kind[row]] > 0:
                found += _emit(state, out, out_places, found)
        if last:
            break
        state[kind[row]] = 1.0
        state[2] = places[row]
        base = 6 if kind[row] == GGA else 15
        for j in range(9):
            state[base + j] = values[row, j]
        if state[0] > 0 and state[1] > 0:
            found += _emit(state, out, out_places, found)
    return found


@njit(**INNER)
def _emit(state, out, out_places, found):
    """Write the waiting epoch as fix `found` and clear it; return 1, or 0 where no date is known yet."""
    has_gga, has_rmc = state[0] > 0, state[1] > 0
    state[0] = 0.0
    state[1] = 0.0
    base = 6 if has_gga else 15
    time = state[base]
    if has_rmc:
        state[3] = state[21]
    elif state[3] >= 0 and time < state[4] - DAY / 2:
        state[3] += 1.0
    state[4] = time
    if state[3] < 0:
        state[5] += 1.0
        return 0
    out[found, 0] = state[3] * DAY + time
    for j in range(1, 7):
        out[found, j] = state[base + j]
    if not has_gga:
        out[found, 6] = 0.0
    out[found, 7] = state[22] if has_rmc else np.nan
    out[found, 8] = state[23] if has_rmc else np.nan
    out_places[found] = np.int64(state[2])
    return 1
