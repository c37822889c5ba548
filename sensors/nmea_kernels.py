"""Compiled writing and reading of NMEA sentences GGA, RMC and GSA. Flat arrays in, flat arrays out.

`sensors.nmea` is the readable side; pynmeagps is the reference that the tests hold these kernels to.
"""

import numpy as np
from numba import njit

GGA, RMC = 0, 1
GOOD, UNSURE = 0, 1
LONGEST = 120
MAX_FIELDS = 24
DOLLAR, STAR, COMMA, POINT, ZERO = 36, 42, 44, 46, 48
KNOT = 1852.0 / 3600.0
DAY = 86400.0


@njit(cache=True, error_model="numpy")
def _put(out, at, value, width):
    """Write the digits of a non-negative integer, padded with zeros to `width`; return the next place."""
    digits = 1
    power = np.int64(10)
    while value >= power:
        digits += 1
        power *= 10
    size = max(digits, width)
    for i in range(size):
        out[at + size - 1 - i] = ZERO + value % 10
        value //= 10
    return at + size


@njit(cache=True, error_model="numpy")
def _put_decimal(out, at, value, width, decimals):
    """Write `value` with `decimals` digits behind the point and at least `width` before it."""
    if value < 0:
        out[at] = 45
        at += 1
        value = -value
    scale = np.int64(100) if decimals == 2 else np.int64(10)
    scaled = np.int64(np.floor(value * scale + 0.5))
    at = _put(out, at, scaled // scale, width)
    out[at] = POINT
    return _put(out, at + 1, scaled % scale, decimals)


@njit(cache=True, error_model="numpy")
def _put_text(out, at, text, begin, end):
    for i in range(begin, end):
        out[at + i - begin] = text[i]
    return at + end - begin


@njit(cache=True, error_model="numpy")
def _put_angle(out, at, value, width, positive, negative):
    """Write an angle in degrees as ddmm.mmmmm,N,"""
    side = positive if value >= 0 else negative
    units = np.int64(np.floor(abs(value) * 6_000_000.0 + 0.5))
    at = _put(out, at, units // 6_000_000, width)
    minutes = units % 6_000_000
    at = _put(out, at, minutes // 100_000, 2)
    out[at] = POINT
    at = _put(out, at + 1, minutes % 100_000, 5)
    out[at] = COMMA
    out[at + 1] = side
    out[at + 2] = COMMA
    return at + 3


@njit(cache=True, error_model="numpy")
def _put_time(out, at, hundredths):
    seconds = hundredths // 100
    at = _put(out, at, seconds // 3600, 2)
    at = _put(out, at, seconds // 60 % 60, 2)
    at = _put(out, at, seconds % 60, 2)
    out[at] = POINT
    at = _put(out, at + 1, hundredths % 100, 2)
    out[at] = COMMA
    return at + 1


@njit(cache=True, error_model="numpy")
def _close(out, begin, at):
    """Write the sentence's check and line end behind [begin, at)."""
    check = 0
    for i in range(begin + 1, at):
        check ^= out[i]
    out[at] = STAR
    for i in range(2):
        digit = (check >> 4) if i == 0 else (check & 15)
        out[at + 1 + i] = ZERO + digit if digit < 10 else 55 + digit
    out[at + 3] = 13
    out[at + 4] = 10
    return at + 5


@njit(cache=True, error_model="numpy")
def write_epochs(hundredths, date, latitude, longitude, altitude, hdop, quality, satellites, speed, course, gsa, heads,
                 cuts, out, ends):  # fmt: skip
    """Write GGA and RMC (and GSA where `gsa`) of every epoch into `out`; `ends[i]` is where epoch i ends.

    `hundredths` of a second of the day (int64), `date` as ddmmyy (int64), deg, m, speed m/s, course deg; quality 0
    leaves the fields empty. `heads` (uint8): the fixed texts of the sentences, cut at `cuts`. Returns the length.
    """
    at = 0
    for i in range(hundredths.size):
        fix = quality[i] > 0
        begin = at
        at = _put_text(out, at, heads, cuts[0], cuts[1])
        at = _put_time(out, at, hundredths[i])
        if fix:
            at = _put_angle(out, at, latitude[i], 2, 78, 83)
            at = _put_angle(out, at, longitude[i], 3, 69, 87)
            at = _put(out, at, quality[i], 1)
            out[at] = COMMA
            at = _put(out, at + 1, satellites[i], 2)
            out[at] = COMMA
            at = _put_decimal(out, at + 1, hdop[i], 1, 1)
            out[at] = COMMA
            at = _put_decimal(out, at + 1, altitude[i], 1, 1)
            at = _put_text(out, at, heads, cuts[1], cuts[2])
        else:
            at = _put_text(out, at, heads, cuts[2], cuts[3])
        at = _close(out, begin, at)
        if gsa[i]:
            begin = at
            at = _put_text(out, at, heads, cuts[3], cuts[4])
            out[at] = ZERO + (3 if fix else 1)
            out[at + 1] = COMMA
            at += 2
            for k in range(12):
                if fix and k < satellites[i]:
                    at = _put(out, at, 2 * k + 1, 2)
                out[at] = COMMA
                at += 1
            for k in range(3):
                at = _put_decimal(out, at, hdop[i] * (1.6 - 0.6 * k + 0.425 * k * (k - 1)), 1, 1)
                if k < 2:
                    out[at] = COMMA
                    at += 1
            at = _close(out, begin, at)
        begin = at
        at = _put_text(out, at, heads, cuts[4], cuts[5])
        at = _put_time(out, at, hundredths[i])
        if fix:
            out[at] = 65
            out[at + 1] = COMMA
            at = _put_angle(out, at + 2, latitude[i], 2, 78, 83)
            at = _put_angle(out, at, longitude[i], 3, 69, 87)
            at = _put_decimal(out, at, speed[i] / KNOT, 1, 2)
            out[at] = COMMA
            at = _put_decimal(out, at + 1, course[i], 1, 2)
            out[at] = COMMA
            at = _put(out, at + 1, date[i], 6)
            at = _put_text(out, at, heads, cuts[5], cuts[6])
        else:
            at = _put_text(out, at, heads, cuts[6], cuts[7])
            at = _put(out, at, date[i], 6)
            at = _put_text(out, at, heads, cuts[7], cuts[8])
        at = _close(out, begin, at)
        ends[i] = at
    return at


@njit(cache=True, error_model="numpy")
def _hex(byte):
    if 48 <= byte <= 57:
        return byte - 48
    if 65 <= byte <= 70:
        return byte - 55
    if 97 <= byte <= 102:
        return byte - 87
    return -1


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _clock(text, begin, end):
    """Return (seconds of the day, well formed) of hhmmss.ss."""
    value, good = _number(text, begin, end)
    hours = np.floor(value / 10_000.0)
    minutes = np.floor((value - hours * 10_000.0) / 100.0)
    seconds = value - hours * 10_000.0 - minutes * 100.0
    good = good and end - begin >= 6 and value >= 0 and hours < 24 and minutes < 60 and seconds < 61
    return hours * 3600.0 + minutes * 60.0 + np.round(seconds * 1000.0) / 1000.0, good


@njit(cache=True, error_model="numpy")
def _days(day, month, year):
    """Days from 1970-01-01 to a date of the Gregorian calendar."""
    if month <= 2:
        year -= 1
        month += 12
    era_days = 365 * year + year // 4 - year // 100 + year // 400
    return era_days + (153 * (month - 3) + 2) // 5 + day - 1 - 719468


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def join_epochs(kind, values, places, count, final, state, out, out_places):
    """Join the GGA and the RMC of one epoch to one fix.

    `places[i]` is an opaque index of the sentence's end (int64). `state` (float64, 24) carries the unfinished epoch:
    0 has GGA, 1 has RMC, 2 place, 3 last day (-1: none yet), 4 last time of day, 5 undated fixes lost,
    6.. the nine values of GGA, 15.. those of RMC. Fills `out` (float64, n x 9): utc, latitude, longitude, altitude,
    hdop, quality, satellites, speed, course. Returns the number of fixes.
    """
    found = 0
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


@njit(cache=True, error_model="numpy")
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
