"""Memory of a process through which ten hours of driving stream, card to estimate: python -m benchmarks.memory [HOURS]

Imports what such a process needs and no more.
"""

import json
import multiprocessing
import re
import resource
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.timing import Row, row
from observer.stream import Observer
from sensors.packets import stream
from vehicle_model.car.files import read_car

HOURS = 10.0
SHORT = 0.05
"""h."""
MEGABYTE = 2**20
PIECE = 1 << 16
"""Bytes of the card that are read at a time."""


def memory_10h(hours: float = HOURS) -> list[Row]:
    """Most memory of a process that reads and observes a log of ten hours, MB; reference: the same with three minutes.

    The difference is what the hours cost; the rest is Python, its packages and the compiled kernels.
    """
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        short, long = Path(folder) / "short.dat", Path(folder) / "long.dat"
        for path, length in ((short, SHORT), (long, hours)):
            _apart(_write, path, length)
        _apart(_observe, short)  # what is compiled is in the cache from here on
        few, many = _apart(_observe, short), _apart(_observe, long)
    reference = f"{few['hours']:.2f} h instead of {many['hours']:.2f} h"
    return [row("memory_10h", many["megabytes"], "MB", reference, few["megabytes"])]


def _apart(work: Any, *arguments: Any) -> Any:
    """The value of `work` in a process of its own, whose memory is its own too."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def _write(path: Path, hours: float) -> None:
    from benchmarks.growth import long_cycle
    from sensors.box import record
    from vehicle_model.plant.cycle import run_cycle

    car = read_car("smart")
    trip, _ = run_cycle(car, long_cycle(60.0 * hours))
    path.write_bytes(record(trip, car))


def _observe(path: Path) -> dict[str, float]:
    """Read the card piece by piece, observe packet by packet in the card's order, keep nothing."""
    observer, lines = Observer(read_car("smart")), 0
    with path.open("rb") as card:
        for streams in stream(iter(lambda: card.read(PIECE), b"")):
            for name, packet in _in_order(streams):
                lines += len(observer.update(name, packet).time)
    lines += len(observer.finish().time)
    return {"megabytes": peak_memory() / MEGABYTE, "hours": lines / 36_000.0}


def _in_order(streams: dict[str, np.ndarray]) -> Any:
    """Each packet, (stream, array of one), in the order of the card."""
    names = list(streams)
    if names:
        order = np.concatenate([streams[name]["order"] for name in names])
        of = np.repeat(np.arange(len(names)), [len(streams[name]) for name in names])
        place = np.concatenate([np.arange(len(streams[name])) for name in names])
        for packet in np.argsort(order, kind="stable"):
            yield names[of[packet]], streams[names[of[packet]]][place[packet] : place[packet] + 1]


def peak_memory() -> float:
    """Bytes that this process had in memory at most. The kernel's other figure begins with the parent's."""
    status = Path("/proc/self/status")
    if status.is_file() and (found := re.search(r"VmHWM:\s+(\d+) kB", status.read_text())):
        return 1024.0 * float(found[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1.0 if sys.platform == "darwin" else 1024.0)


LONG = {"memory_10h": memory_10h}
"""Name of `rollingroad bench --long` -> the function that measures it."""

if __name__ == "__main__":
    for measured in memory_10h(float(sys.argv[1]) if len(sys.argv) > 1 else HOURS):
        print(json.dumps(measured))
