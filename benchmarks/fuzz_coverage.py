"""Coverage-guided fuzzing of the card's reader, with atheris (libFuzzer): `pip install rollingroad[fuzz]`.

    python -m benchmarks.fuzz_coverage [CORPUS FOLDER] [-max_total_time=60] [-seed=1]

The compiled kernels run uncompiled here, so that libFuzzer sees each of their branches. What must hold of any bytes: no
crash; the reader finds the packets that its readable twin finds; every byte is in a packet, skipped and counted, or an
unwritten zero; and a stream in two pieces gives the same bits and the same counts as the whole. Half of the mutations
mend the packets' checks, which chance would not. The corpus begins with a short card, whole and damaged.
"""

import os
import struct
import sys
import tempfile
from pathlib import Path
from types import ModuleType

os.environ["NUMBA_DISABLE_JIT"] = "1"

import atheris  # type: ignore[import-not-found]  # an optional extra
import numpy as np

with atheris.instrument_imports(include=["sensors.packets", "sensors.packet_kernels", "sensors.nmea"]):
    from sensors import packet_kernels as kernels
    from sensors.packets import decode, stream
from sensors import nmea, nmea_kernels, packet_reference
from sensors.log import STREAMS


def widen(module: ModuleType, name: str) -> None:
    """Let an uncompiled kernel count in whole numbers: compiled, a byte grows as it must; in numpy it overflows."""
    kernel = getattr(module, name)
    setattr(module, name, lambda data, *rest: kernel(data.astype(np.int64), *rest))


def packet(kind: int, payload: bytes) -> bytes:
    """A whole packet."""
    length = len(payload) + 1
    return bytes([0xFF, kind, length]) + payload + bytes([(length + sum(payload)) % 256])


def a_card() -> bytes:
    """A short card with each type of packet."""
    fix = np.zeros(1, nmea.FIX)
    fix["utc"], fix["latitude"], fix["longitude"], fix["quality"], fix["satellites"] = 1.6e9, 49.6, 6.1, 1, 8
    text = nmea.write(fix, np.ones(1, bool))[0].tobytes()
    packets = [packet(1, struct.pack("<Ihhh", 1000, 10, -20, 1000)), packet(3, struct.pack("<IB", 1001, 7))]
    packets += [packet(2, text[begin : begin + 64]) for begin in range(0, len(text), 64)]
    packets += [packet(4, struct.pack("<IH", 1002, 12_000)), packet(5, struct.pack("<Ib", 10_000, -2))]
    packets += [packet(6, struct.pack("<Ihhh", 1003, 1, 2, 3)), packet(7, struct.pack("<IH", 1004, 9000))]
    return b"".join([*packets, packet(0, b"SD card slow\n")])


def check(data: bytes) -> None:
    """Raise where the reader breaks one of its promises on `data`."""
    buffer = np.frombuffer(data, np.uint8)
    starts = np.empty(buffer.size // 5 + 1, np.int64)
    counters = np.zeros(kernels.COUNTERS, np.int64)
    count, used, _, zeros = kernels.scan(buffer, True, True, 0, starts, counters)
    found = starts[:count].tolist()
    assert found == packet_reference.scan(data), "the two readers disagree"
    covered = np.zeros(buffer.size, bool)
    for start in found:
        covered[start : start + 3 + data[start + 2]] = True
    assert used == buffer.size
    assert covered.sum() + counters[kernels.BYTES_SKIPPED] + zeros == buffer.size, "a byte is not accounted for"
    whole, damage = decode(data), {}
    cut = len(data) * 2 // 3
    parts = list(stream([data[:cut], data[cut:]], damage))
    for name, kind in STREAMS.items():
        pieces = [part[name] for part in parts if name in part]
        joined = np.concatenate(pieces) if pieces else np.empty(0, kind)
        assert joined.tobytes() == whole[name].tobytes(), f"{name}: pieces and whole differ"
    assert damage == whole.damage, "pieces and whole count differently"


def mutated(data: bytes, max_size: int, seed: int) -> bytes:
    """libFuzzer's mutation; every other time the checks behind legal heads are mended."""
    data = bytearray(atheris.Mutate(data, max_size))
    if seed % 2:
        for at in range(len(data) - 3):
            end = at + 2 + data[at + 2]
            if packet_reference.is_head(data, at) and end < len(data):
                data[end] = sum(data[at + 2 : end]) & 0xFF
    return bytes(data)


def main() -> None:
    """Fuzz until libFuzzer's limits are met or a promise is broken."""
    arguments = list(sys.argv)
    if not any(not word.startswith("-") for word in arguments[1:]):
        arguments.append(tempfile.mkdtemp())
    folder = Path(next(word for word in arguments[1:] if not word.startswith("-")))
    folder.mkdir(parents=True, exist_ok=True)
    card = a_card()
    (folder / "whole").write_bytes(card)
    (folder / "hole").write_bytes(card[:60] + bytes(40) + card[80:])
    (folder / "torn").write_bytes(card[:20] + b"\xff\x06\x0b\x01" + card[24:])
    widen(kernels, "scan")
    widen(nmea_kernels, "find_sentences")
    widen(nmea_kernels, "read_sentences")
    atheris.Setup([*arguments, "-max_len=600"], check, custom_mutator=mutated)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
