"""Fuzz the card's reader: mutated logs, and every packet that was not damaged must be recovered.

    python benchmarks/fuzz_reader.py [LOGS] [SEED]

Mutations: flipped bytes, zeroed blocks, lost and inserted bytes, pieces copied elsewhere, a cut end. Prints one line;
exit status 1 and the seed of the first failing log if a packet was lost. A million logs of 1.5 kB take minutes.
"""

import sys
import time

import numpy as np

from sensors import packet_kernels as kernels
from sensors.packets import LAYOUT, Packets, decode, encode


def a_card(rng: np.random.Generator, packets: int = 120) -> np.ndarray:
    """A short card with every type of packet, contents at random."""
    groups = []
    for kind, layout in LAYOUT.items():
        count = int(rng.integers(5, packets // 4))
        rows = np.frombuffer(rng.bytes(count * layout.itemsize), dtype=layout)
        groups.append(Packets.of(kind, rng.uniform(0, 1, count), rows))
    lengths = rng.integers(1, 90, 15)
    text = np.frombuffer(rng.bytes(int(lengths.sum())), np.uint8) & 0x7F
    groups.append(Packets(2, rng.uniform(0, 1, lengths.size), text, lengths.astype(np.int64)))
    return np.frombuffer(encode(groups), np.uint8)


def starts_of(data: np.ndarray) -> np.ndarray:
    """Where the reader finds packets."""
    starts = np.empty(data.size // 5 + 1, dtype=np.int64)
    count, _, _, _ = kernels.scan(data, True, True, 0, starts, np.zeros(kernels.COUNTERS, np.int64))
    return starts[:count]


def mutate(data: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a mutated copy and, for each byte, where it came from (-1: new or changed)."""
    data, source = data.copy(), np.arange(data.size)
    for _ in range(int(rng.integers(1, 5))):
        kind, at = rng.integers(0, 6), int(rng.integers(0, max(data.size, 1)))
        size = int(rng.geometric(0.02))
        if kind == 0:
            places = rng.integers(0, data.size, min(size, 20)) if data.size else np.empty(0, int)
            data[places] ^= rng.integers(1, 256, places.size).astype(np.uint8)
            source[places] = -1
        elif kind == 1:
            data[at : at + size] = 0
            source[at : at + size] = -1
        elif kind == 2:
            data, source = np.delete(data, slice(at, at + size)), np.delete(source, slice(at, at + size))
        elif kind == 3:
            extra = np.frombuffer(rng.bytes(size), np.uint8)
            data, source = np.insert(data, at, extra), np.insert(source, at, np.full(size, -1))
        elif kind == 4 and data.size > size:
            begin = int(rng.integers(0, data.size - size))
            data, source = np.insert(data, at, data[begin : begin + size]), np.insert(source, at, np.full(size, -1))
        elif kind == 5 and rng.uniform() < 0.2:
            data, source = data[:at], source[:at]
    return data, source


def lost_packets(data: np.ndarray, source: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> int:
    """How many packets whose bytes are all there, in a row and unchanged, the reader did not find."""
    place = np.full(int(ends[-1]) + 1, -1)
    place[source[source >= 0]] = np.flatnonzero(source >= 0)
    first, last = place[starts], place[ends - 1]
    whole = (first >= 0) & (last - first == ends - 1 - starts)
    runs = np.concatenate(([0], np.cumsum(np.diff(source, prepend=-2) != 1)))
    for i in np.flatnonzero(whole):
        if runs[last[i] + 1] != runs[first[i] + 1]:
            whole[i] = False
    return int((~np.isin(first[whole], starts_of(data))).sum())


def main() -> int:
    logs = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    begun, lost, failing, total = time.perf_counter(), 0, None, 0
    for number in range(logs):
        rng = np.random.default_rng((seed, number))
        if number % 50 == 0:
            card = a_card(rng)
            starts = starts_of(card)
            ends = np.append(starts[1:], card.size)
        data, source = mutate(card, rng)
        missing = lost_packets(data, source, starts, ends)
        if number % 20 == 0:
            decode(data)
        total += starts.size
        if missing and failing is None:
            failing = number
        lost += missing
    spent = time.perf_counter() - begun
    print(f"{logs} logs, {total} packets, {lost} undamaged ones lost, {spent:.0f} s, seed {seed}; first: {failing}")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
