"""Compiled map matching: several hypotheses of where the car is on the road network, moved by the odometer, weighed by
GPS fixes. Flat arrays in, flat arrays out; `sensors.matching` is the readable side.

A hypothesis is a link, a direction along it and a distance `u` travelled on it. The odometer moves all of them; at a
junction each branches into every road that leaves it; a fix corrects `u` by a scalar Kalman update and weighs the
hypothesis by its distance across the road and by its heading. What is passed is told only while one place is clearly
the likeliest, which in a tunnel is until the way forks.
"""

import math

import numpy as np
from numba import njit

ODOMETER, FIX = 0, 1
MOST = 12
# Columns of a hypothesis.
LINK, BACKWARDS, U, VARIANCE, WEIGHT, NEXT, COST, FIXES = range(8)
HYPOTHESIS = 8
# Places in the state vector.
COUNT, LAST_T, LAST_D, SPEED, OFFSET, OFFSET_T, RING_AT, LAST_LINK, LAST_POINT, LAST_SPAWN, LAST_U = range(11)
FIX_NORTH, FIX_EAST, FIX_D = 11, 12, 13
STATE = 16
STUCK = 3.0
"""m driven since a fix that is only told again: its receiver is stuck."""
RING = 256
OUTPUT = 11
# What compiles fast matters: the first run waits for it. INNER has no way in from Python, where calling it would crash.
ENTRY = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
INNER = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True}


@njit(**INNER)
def _copy(hyp, source, target):
    for column in range(HYPOTHESIS):
        hyp[target, column] = hyp[source, column]


@njit(**INNER)
def _segment(link, s, start, ps):
    """Index of the point at which the segment that holds `s` begins."""
    low, high = start[link], start[link + 1] - 2
    while low < high:
        middle = (low + high + 1) // 2
        if ps[middle] <= s:
            low = middle
        else:
            high = middle - 1
    return low


@njit(**INNER)
def _point(link, backwards, u, start, pn, pe, ps, place):
    """Put north, east and the unit vector of travel at `u` on `link` into `place` (4,); straight on beyond ends."""
    length = ps[start[link + 1] - 1]
    s = length - u if backwards > 0 else u
    i = _segment(link, s, start, ps)
    d = max(ps[i + 1] - ps[i], 1e-9)
    tn, te = (pn[i + 1] - pn[i]) / d, (pe[i + 1] - pe[i]) / d
    place[0] = pn[i] + tn * (s - ps[i])
    place[1] = pe[i] + te * (s - ps[i])
    sign = -1.0 if backwards > 0 else 1.0
    place[2], place[3] = sign * tn, sign * te


@njit(**INNER)
def _first_ahead(link, backwards, u, ostart, os, length):
    """Number of observation points of `link`, in the order of travel, that lie at or behind `u`."""
    count = 0
    for k in range(ostart[link], ostart[link + 1]):
        s = length - os[k] if backwards > 0 else os[k]
        if s <= u:
            count += 1
    return count


@njit(**INNER)
def _add(hyp, count, link, backwards, u, variance, weight, passed, cost, fixes):
    """Add a hypothesis, in the place of the least likely one if need be; return the new count."""
    slot = count
    if count == MOST:
        slot = 0
        for k in range(1, MOST):
            if hyp[k, WEIGHT] < hyp[slot, WEIGHT]:
                slot = k
        if hyp[slot, WEIGHT] >= weight:
            return count
    else:
        count += 1
    hyp[slot, LINK] = link
    hyp[slot, BACKWARDS] = backwards
    hyp[slot, U] = u
    hyp[slot, VARIANCE] = variance
    hyp[slot, WEIGHT] = weight
    hyp[slot, NEXT] = passed
    hyp[slot, COST] = cost
    hyp[slot, FIXES] = fixes
    return count


@njit(**ENTRY)
def nearby(north, east, radius, grid, gstart, gseg, seg_link, start, pn, pe, ps, found, limit):
    """Find, for each link with a point within `radius` of a place, its nearest one.

    `grid`: north and east of the corner, cell size, rows, columns. Fills rows of `found` (limit, 4): link, s,
    distance, heading of the link there. Returns how many, at most `limit` (the first found are kept).
    """
    count = 0
    size = grid[2]
    rows, columns = int(grid[3]), int(grid[4])
    reach = int(radius / size) + 1
    row0, column0 = math.floor((north - grid[0]) / size), math.floor((east - grid[1]) / size)
    for row in range(max(0, row0 - reach), min(rows, row0 + reach + 1)):
        for column in range(max(0, column0 - reach), min(columns, column0 + reach + 1)):
            cell = row * columns + column
            for g in range(gstart[cell], gstart[cell + 1]):
                i = gseg[g]
                dn, de = pn[i + 1] - pn[i], pe[i + 1] - pe[i]
                d2 = max(dn * dn + de * de, 1e-12)
                f = ((north - pn[i]) * dn + (east - pe[i]) * de) / d2
                f = min(max(f, 0.0), 1.0)
                distance = math.hypot(north - pn[i] - f * dn, east - pe[i] - f * de)
                if distance > radius:
                    continue
                link = seg_link[i]
                slot = -1
                for k in range(count):
                    if found[k, 0] == link:
                        slot = k
                if slot < 0:
                    if count == limit:
                        continue
                    slot = count
                    count += 1
                elif found[slot, 2] <= distance:
                    continue
                found[slot, 0] = link
                found[slot, 1] = ps[i] + f * math.sqrt(d2)
                found[slot, 2] = distance
                found[slot, 3] = math.atan2(de, dn)
    return count


@njit(**INNER)
def _wrap(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@njit(**INNER)
def _move(hyp, count, distance, start, ps, link_ends, jstart, jlink, jend):
    """Move all hypotheses on by `distance`; branch at junctions. Returns the new count."""
    for k in range(count):
        hyp[k, U] += distance
        # Odometer: 0.5 % of the way that was gone, as if independent every 50 m.
        hyp[k, VARIANCE] += 0.00125 * distance
    k = np.int64(0)
    guard = 0
    while k < count and guard < 200:
        guard += 1
        link = int(hyp[k, LINK])
        length = ps[start[link + 1] - 1]
        if hyp[k, U] <= length:
            k += 1
            continue
        backwards = hyp[k, BACKWARDS] > 0
        junction = link_ends[link, 0] if backwards else link_ends[link, 1]
        rest, variance = hyp[k, U] - length, hyp[k, VARIANCE]
        weight, cost, fixes = hyp[k, WEIGHT], hyp[k, COST], hyp[k, FIXES]
        here = 1 if not backwards else 0
        ways = 0
        for j in range(jstart[junction], jstart[junction + 1]):
            if not (jlink[j] == link and jend[j] == here):
                ways += 1
        if ways == 0:
            # A dead end of the map: wait there for a while, then the fixes will say that it was left.
            if rest > 200.0:
                count -= 1
                _copy(hyp, count, k)
            else:
                k += 1
            continue
        first = True
        for j in range(jstart[junction], jstart[junction + 1]):
            if jlink[j] == link and jend[j] == here:
                continue
            onward = 1.0 if jend[j] == 1 else 0.0
            if first:
                hyp[k, LINK], hyp[k, BACKWARDS], hyp[k, U] = jlink[j], onward, rest
                hyp[k, NEXT] = 0
                first = False
            else:
                count = _add(hyp, count, jlink[j], onward, rest, variance, weight, 0.0, cost, fixes)
    return count


@njit(**INNER)
def _prune(hyp, count):
    """Drop hypotheses that are far less likely than the best, and copies; returns (count, best)."""
    if count == 0:
        return 0, -1
    best = np.int64(0)
    for k in range(1, count):
        if hyp[k, WEIGHT] > hyp[best, WEIGHT]:
            best = k
    top = hyp[best, WEIGHT]
    keep = np.int64(0)
    for k in range(count):
        good = hyp[k, WEIGHT] > top - 6.0
        if good:
            for m in range(keep):
                same = hyp[m, LINK] == hyp[k, LINK] and hyp[m, BACKWARDS] == hyp[k, BACKWARDS]
                if same and abs(hyp[m, U] - hyp[k, U]) < 15.0:
                    good = False
                    if hyp[k, WEIGHT] > hyp[m, WEIGHT]:
                        _copy(hyp, k, m)
                    break
        if good:
            if keep != k:
                _copy(hyp, k, keep)
            keep += 1
    best = np.int64(0)
    for k in range(keep):
        hyp[k, WEIGHT] -= top
        if hyp[k, WEIGHT] > hyp[best, WEIGHT]:
            best = k
    return keep, best


@njit(**INNER)
def _share(hyp, count, best, start, pn, pe, ps, place, other):
    """Probability of the best hypothesis, with those that mean the same place and direction."""
    _point(int(hyp[best, LINK]), hyp[best, BACKWARDS], hyp[best, U], start, pn, pe, ps, place)
    total, agreed = 0.0, 0.0
    for k in range(count):
        weight = math.exp(hyp[k, WEIGHT] - hyp[best, WEIGHT])
        total += weight
        if k != best:
            _point(int(hyp[k, LINK]), hyp[k, BACKWARDS], hyp[k, U], start, pn, pe, ps, other)
            near = math.hypot(place[0] - other[0], place[1] - other[1]) < 12.0
            if not (near and place[2] * other[2] + place[3] * other[3] > 0.87):
                continue
        agreed += weight
    return agreed / total


@njit(**ENTRY)
def match(events, state, hyp, ring, start, pn, pe, ps, seg_link, link_ends, jstart, jlink, jend, ostart, os, oheading,
          oaltitude, ostraight, ograde, osigma, grid, gstart, gseg, lag, altitude_sigma, out):  # fmt: skip
    """Follow `events` (n, 8), in the order of arrival, and write what is passed into `out` (m, OUTPUT).

    A row of `events`: t of arrival (logger, s), kind, then ODOMETER: cumulative distance m; or FIX: north, east m,
    utc s, speed m/s, course rad (NaN if unsaid), hdop. `state`, `hyp`, `ring` carry over from call to call.
    A row of `out`: t, heading, its deviation, altitude, its deviation, straightness, its deviation, north, east,
    link, number of the event. Returns the rows written.
    """
    place, other = np.empty(4), np.empty(4)
    found = np.empty((MOST, 4))
    written = 0
    count = int(state[COUNT])
    for e in range(events.shape[0]):
        t = events[e, 0]
        if events[e, 1] == ODOMETER:
            distance = events[e, 2] - state[LAST_D]
            elapsed = t - state[LAST_T]
            if distance > 0.0 and elapsed > 0.0:
                if elapsed < 2.0:
                    state[SPEED] += 0.3 * (distance / elapsed - state[SPEED])
                count = _move(hyp, count, distance, start, ps, link_ends, jstart, jlink, jend)
            state[LAST_D] = events[e, 2]
            state[LAST_T] = t
            at = int(state[RING_AT])
            ring[at, 0], ring[at, 1] = t, events[e, 2]
            state[RING_AT] = (at + 1) % RING
            if count == 0:
                continue
            if count > 1:
                count, best = _prune(hyp, count)
        else:
            north, east, utc = events[e, 2], events[e, 3], events[e, 4]
            speed, course, hdop = events[e, 5], events[e, 6], events[e, 7]
            if north != state[FIX_NORTH] or east != state[FIX_EAST]:
                state[FIX_NORTH], state[FIX_EAST], state[FIX_D] = north, east, state[LAST_D]
            elif state[LAST_D] - state[FIX_D] > STUCK:
                continue
            # The clocks' offset is the least of arrival - utc so far; it may creep by 50 ppm.
            offset = t - utc
            crept = state[OFFSET] + 50e-6 * max(0.0, t - state[OFFSET_T])
            if not (crept < offset) or state[OFFSET_T] == 0.0:
                state[OFFSET], state[OFFSET_T] = offset, t
            epoch = utc + state[OFFSET] + 50e-6 * max(0.0, t - state[OFFSET_T]) - 0.045
            moving = not math.isnan(course) and not math.isnan(speed) and speed > 2.0
            # Since that epoch the car has gone on: what the odometer says, and the receiver's own lag.
            gone = state[LAST_D] - _distance_at(ring, int(state[RING_AT]), epoch, state[LAST_D])
            if moving:
                ahead = min(max(gone, 0.0), speed) + speed * lag
                north += ahead * math.cos(course)
                east += ahead * math.sin(course)
            sigma = 4.0 * max(1.0, hdop) if hdop == hdop else 8.0
            along = 4.0 * sigma * sigma
            for k in range(count):
                _point(int(hyp[k, LINK]), hyp[k, BACKWARDS], hyp[k, U], start, pn, pe, ps, place)
                dn, de = north - place[0], east - place[1]
                forward = dn * place[2] + de * place[3]
                across = -dn * place[3] + de * place[2]
                cost = min(across * across / (sigma * sigma), 16.0)
                total = hyp[k, VARIANCE] + along
                cost += min(forward * forward / total, 16.0)
                if moving:
                    turn = _wrap(course - math.atan2(place[3], place[2])) / 0.35
                    cost += min(turn * turn, 16.0)
                hyp[k, COST] += 0.1 * (cost - hyp[k, COST])
                hyp[k, WEIGHT] = 0.97 * hyp[k, WEIGHT] - 0.1 * cost
                hyp[k, FIXES] += 1.0
                gain = hyp[k, VARIANCE] / total
                step = min(max(forward, -3.0 * math.sqrt(total)), 3.0 * math.sqrt(total))
                hyp[k, U] = max(hyp[k, U] + gain * step, 0.0)
                hyp[k, VARIANCE] = max((1.0 - gain) * hyp[k, VARIANCE], 1.0)
            keep = np.int64(0)
            for k in range(count):
                if hyp[k, COST] < 14.0:
                    if keep != k:
                        _copy(hyp, k, keep)
                    keep += 1
            count = keep
            count = _move(hyp, count, 0.0, start, ps, link_ends, jstart, jlink, jend)
            count, best = _prune(hyp, count)
            doubtful = count == 0 or (hyp[best, COST] > 5.0 and t - state[LAST_SPAWN] > 3.0)
            if doubtful and moving:
                state[LAST_SPAWN] = t
                fresh = nearby(
                    north,
                    east,
                    max(35.0, 4.0 * sigma),
                    grid,
                    gstart,
                    gseg,
                    seg_link,
                    start,
                    pn,
                    pe,
                    ps,
                    found,
                    np.int64(MOST),
                )
                for k in range(fresh):
                    link = int(found[k, 0])
                    ahead = _wrap(course - found[k, 3])
                    backwards = 1.0 if abs(ahead) > 0.5 * math.pi else 0.0
                    off = math.pi - abs(ahead) if backwards > 0 else abs(ahead)
                    if off > 0.8:
                        continue
                    length = ps[start[link + 1] - 1]
                    u = length - found[k, 1] if backwards > 0 else found[k, 1]
                    weight = -0.5 * (found[k, 2] / sigma) ** 2 - (3.0 if count > 0 else 0.0)
                    passed = float(_first_ahead(link, backwards, u, ostart, os, length))
                    count = _add(hyp, count, link, backwards, u, along, weight, passed, 2.0, 0.0)
                count, best = _prune(hyp, count)
            if count == 0:
                continue
        # What has been passed?
        best = np.int64(0)
        for k in range(1, count):
            if hyp[k, WEIGHT] > hyp[best, WEIGHT]:
                best = k
        for k in range(count):
            link = int(hyp[k, LINK])
            first, points = ostart[link], ostart[link + 1] - ostart[link]
            length = ps[start[link + 1] - 1]
            while hyp[k, NEXT] < points:
                n = int(hyp[k, NEXT])
                o = first + points - 1 - n if hyp[k, BACKWARDS] > 0 else first + n
                s = length - os[o] if hyp[k, BACKWARDS] > 0 else os[o]
                if s > hyp[k, U]:
                    break
                hyp[k, NEXT] += 1.0
                if k != best or hyp[k, FIXES] < 10 or hyp[k, COST] > 8.0 or hyp[k, VARIANCE] > 900.0:
                    continue
                if state[SPEED] < 0.5 or (
                    state[LAST_LINK] == link and state[LAST_POINT] == o and abs(state[LAST_U] - state[LAST_D]) < 100.0
                ):
                    continue
                if _share(hyp, count, best, start, pn, pe, ps, place, other) < 0.85:
                    continue
                state[LAST_LINK], state[LAST_POINT], state[LAST_U] = link, o, state[LAST_D]
                _point(link, hyp[k, BACKWARDS], s, start, pn, pe, ps, place)
                back = hyp[k, BACKWARDS] > 0
                doubt = math.sqrt(hyp[k, VARIANCE])
                out[written, 0] = t - min((hyp[k, U] - s) / state[SPEED], 1.0)
                out[written, 1] = (oheading[o] + (math.pi if back else 0.0)) % (2.0 * math.pi)
                out[written, 2] = math.hypot(osigma[o], ostraight[o] * doubt)
                out[written, 3] = oaltitude[o]
                out[written, 4] = math.hypot(altitude_sigma, ograde[o] * doubt)
                out[written, 5] = -ostraight[o] if back else ostraight[o]
                out[written, 6] = 0.003 + 0.7 * abs(ostraight[o])
                out[written, 7], out[written, 8] = place[0], place[1]
                out[written, 9], out[written, 10] = link, e
                written += 1
                if written == out.shape[0]:
                    state[COUNT] = count
                    return written
    state[COUNT] = count
    return written


@njit(**INNER)
def _distance_at(ring, at, t, newest):
    """Odometer's distance at logger time `t` from the ring of its newest readings; `newest` where it is not known."""
    later_t, later_d = math.nan, newest
    for back in range(1, RING + 1):
        i = (at - back) % RING
        if math.isnan(ring[i, 0]):
            return later_d
        if ring[i, 0] <= t:
            if math.isnan(later_t) or later_t <= ring[i, 0]:
                return ring[i, 1]
            f = (t - ring[i, 0]) / (later_t - ring[i, 0])
            return ring[i, 1] + f * (later_d - ring[i, 1])
        later_t, later_d = ring[i, 0], ring[i, 1]
    return later_d


@njit(**ENTRY)
def fill_grid(segments, pn, pe, grid, counts, gstart, gseg):
    """Sort segments into the cells that their boxes touch. First pass (gseg empty): counts; second: fills."""
    size, rows, columns = grid[2], int(grid[3]), int(grid[4])
    for k in range(segments.size):
        i = segments[k]
        r0 = int((min(pn[i], pn[i + 1]) - grid[0]) / size)
        r1 = int((max(pn[i], pn[i + 1]) - grid[0]) / size)
        c0 = int((min(pe[i], pe[i + 1]) - grid[1]) / size)
        c1 = int((max(pe[i], pe[i + 1]) - grid[1]) / size)
        for r in range(r0, min(r1, rows - 1) + 1):
            for c in range(c0, min(c1, columns - 1) + 1):
                cell = r * columns + c
                if gseg.size:
                    gseg[gstart[cell] + counts[cell]] = i
                counts[cell] += 1
