"""Compiled scanning and packing of the box's packets (seed 004, C.1.4). Flat arrays in, flat arrays out.

`sensors.packets` is the readable side; `sensors.packet_reference` is `scan` in plain Python, for the tests. What
compiles fast matters here: the first run waits for it. So names with an underscore have no way in from Python, where
calling them would crash, and counters begin as int64, not as the literal 0, which would compile their users once more.
"""

import numpy as np
from numba import njit

PREAMBLE = 0xFF
KINDS = 8
# Payload bytes of each packet type; 0: text of any length from 1 to 254.
PAYLOAD = np.array([0, 10, 0, 5, 6, 5, 10, 6], dtype=np.int64)

# Places in the damage counters of `scan`.
BAD_PREAMBLE, UNKNOWN_TYPE, BAD_LENGTH, BAD_CHECK, FALSE_PACKET, ZERO_RUN, TRUNCATED, BYTES_SKIPPED = range(8)
COUNTERS = 8
ENTRY = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
INNER = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True}


@njit(**INNER)
def _header(data, at):
    """Return 0 where a packet's head stands whole and legal at `at`, else 1 + the kind of damage."""
    if data[at] != PREAMBLE:
        return 1 + BAD_PREAMBLE
    if data[at + 1] >= KINDS:
        return 1 + UNKNOWN_TYPE
    size = PAYLOAD[data[at + 1]]
    if size == 0:
        if data[at + 2] < 2:
            return 1 + BAD_LENGTH
    elif data[at + 2] != size + 1:
        return 1 + BAD_LENGTH
    return 0


@njit(**INNER)
def _check(data, at):
    """Tell whether the check byte of the packet at `at` is right: (length + payload bytes) mod 256."""
    end = at + 2 + data[at + 2]
    total = np.int64(0)
    for i in range(at + 2, end):
        total += data[i]
    return (total & 0xFF) == data[end]


@njit(**INNER)
def _follows(data, at, stop):
    """Tell whether `at` looks like what stands after a packet: a legal head, unwritten zeros or the end."""
    if at >= stop or data[at] == 0:
        return True
    return at + 3 <= stop and _header(data, at) == 0


@njit(**INNER)
def _reads_as_text(data, at):
    """Tell whether the text packet at `at` holds only 7-bit characters, as NMEA does."""
    highest = 0
    for i in range(at + 3, at + 2 + data[at + 2]):
        highest = max(highest, data[i])
    return highest < 128


@njit(**INNER)
def _ends_alike(data, at, end):
    """Tell whether a packet of fixed size inside the one at `at` ends where it ends: one check byte, right for both.

    Random payloads hold such a packet once in 2^30; damage that ends just before a good packet leaves such a head more
    often. The box's own readings cannot hold one in the first 18 hours of its clock, which is their first field.
    """
    for other in range(at + 4, end - 8):
        if _header(data, other) == 0 and other + 3 + data[other + 2] == end and _check(data, other):
            return True
    return False


@njit(**INNER)
def _better(data, at, end, stop):
    """Tell whether valid packets that begin inside [at + 1, end) explain the bytes better than the one at `at`.

    Then what begins at `at` is damage whose check came out right by accident (1 in 256), and must not swallow good
    packets: when one or several in a row reach beyond `end` while no packet's head follows `end`; when a text, whose
    length can be anything, holds a whole packet (NMEA never holds 0xFF); and when a packet inside ends in the same
    byte, so that `at` may be the torn head of another that was lost before it.
    """
    text = PAYLOAD[data[at + 1]] == 0
    if not text and _ends_alike(data, at, end):
        return True
    if not text and (end >= stop or (end + 3 <= stop and _header(data, end) == 0)):
        return False
    for other in range(at + 1, end - 1):
        if other + 3 > stop or _header(data, other) != 0:
            continue
        reach = other + 3 + data[other + 2]
        if reach > stop or not _check(data, other):
            continue
        if text:
            return True
        # Several in a row may lead beyond the end.
        while reach < end and reach + 3 <= stop and _header(data, reach) == 0:
            after = reach + 3 + data[reach + 2]
            if after > stop or not _check(data, reach):
                break
            reach = after
        # A text is a right check alone, 1 in 256: it must read as one, and what follows it must be legal too.
        if reach > end and (
            PAYLOAD[data[other + 1]] > 0 or (_reads_as_text(data, other) and _follows(data, reach, stop))
        ):
            return True
    return False


@njit(**INNER)
def _shares_its_check(data, end, stop):
    """Tell whether the check at `end - 1` is also the preamble of a packet whose own preamble was lost.

    Then both are good: the one was never damaged, and of the other all that counts is there.
    """
    if end >= stop or end + 2 > stop or _header(data, end - 1) != 0:
        return False
    if end + 3 <= stop and _header(data, end) == 0:
        return False
    reach = end + 2 + data[end + 1]
    return reach <= stop and _check(data, end - 1) and (PAYLOAD[data[end]] > 0 or _follows(data, reach, stop))


@njit(**ENTRY)
def scan(data, final, in_step, zeros, starts, counters):
    """Find the packets in `data` (uint8, n).

    `final`: nothing follows these bytes. `in_step` and `zeros` are what the previous call returned (True, 0 at
    first): whether the last packet ended just before `data`, and how many zero bytes stood there.
    Fills `starts` (int64, at least n // 5 + 1) with the places of preambles and adds to `counters` (int64,
    COUNTERS). Returns (packets, bytes used, in_step, zeros); bytes not used must be given again with what follows.
    """
    stop = data.size
    at = np.int64(0)
    found = np.int64(0)
    while at < stop:
        if data[at] == 0:
            # Perhaps the unwritten tail of the file: damage only if something stands behind it.
            zeros += 1
            at += 1
            continue
        damage = 0
        if stop - at < 3:
            if not final:
                break
            damage = 1 + TRUNCATED
        else:
            damage = _header(data, at)
        if damage == 0:
            end = at + 3 + data[at + 2]
            if not final and end + 261 > stop:
                break
            if end > stop:
                damage = 1 + TRUNCATED
            elif not _check(data, at):
                damage = 1 + BAD_CHECK
            elif _better(data, at, end, stop):
                damage = 1 + FALSE_PACKET
            else:
                if zeros > 0:
                    counters[BYTES_SKIPPED] += zeros
                    if in_step:
                        counters[ZERO_RUN] += 1
                    zeros = 0
                starts[found] = at
                found += 1
                in_step = True
                at = end
                if _shares_its_check(data, end, stop):
                    counters[BAD_PREAMBLE] += 1
                    at = end - 1
                continue
        if zeros > 0:
            counters[BYTES_SKIPPED] += zeros
            if in_step:
                counters[ZERO_RUN] += 1
            zeros = 0
            in_step = False
        if in_step:
            counters[damage - 1] += 1
            in_step = False
        counters[BYTES_SKIPPED] += 1
        at += 1
    return found, at, in_step, zeros


@njit(**ENTRY)
def gather_text(data, starts, chosen, out, ends):
    """Join the texts of the packets `starts[chosen]` in `out`; `ends[i]` is where the i-th ends. Returns the length."""
    length = np.int64(0)
    for row in range(chosen.size):
        at = starts[chosen[row]]
        size = np.int64(data[at + 2]) - 1
        for i in range(size):
            out[length + i] = data[at + 3 + i]
        length += size
        ends[row] = length
    return length


@njit(**ENTRY)
def pack(sequence, block, row, block_kind, block_start, lengths, payload, out):
    """Write packets into `out` (uint8) in the order of `sequence` (int64, n); return the bytes written.

    Packet i: type `block_kind[block[i]]`, payload `payload[row[i] : row[i] + lengths[i]]` behind
    `block_start[block[i]]`.
    """
    at = np.int64(0)
    for place in range(sequence.size):
        i = sequence[place]
        size = lengths[i]
        source = block_start[block[i]] + row[i]
        total = size + 1
        out[at] = PREAMBLE
        out[at + 1] = block_kind[block[i]]
        out[at + 2] = size + 1
        for j in range(size):
            byte = payload[source + j]
            out[at + 3 + j] = byte
            total += byte
        out[at + 3 + size] = total & 0xFF
        at += size + 4
    return at
