"""The driver's display (seed 004, 5.1.3) as a page on loopback: arrow, worth of speed, engine efficiency, gear."""

import json
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path

import numpy as np

from controller.advice import Advice
from controller.advice_files import read_advice
from rollingroad.run import gears_told
from rollingroad.run_files import read_results
from vehicle_model.car.errors import BadInput
from vehicle_model.car.trip import Trip

FULL_ARROW = 15.0 / 3.6
"""m/s too slow or too fast at which the arrow shines at its brightest."""
RATE = 5.0
"""Frames a second."""


@dataclass(frozen=True)
class Frame:
    """What the display shows at one instant; human units, as it is the edge."""

    time: float
    """s."""
    distance: float
    """km."""
    speed: float
    """km/h."""
    advised_speed: float
    arrow: float
    """-1 (much too fast: down) to 1 (much too slow: up); its size is the intensity."""
    gear: int
    advised_gear: int
    """0 where none is told."""
    costate: float
    """kJ per m/s: the worth of speed."""
    costate_share: float
    """0 to 1: of the largest on this road."""
    efficiency: float
    """%, of the fuel's power at the wheels: engine efficiency, not distance per litre; 0 where the fuel is cut."""


def frames(trip: Trip, advice: Advice, *, gears: bool = True) -> list[Frame]:
    """What the display would have shown along `trip`, RATE times a second; no gears to a driver who is told none.

    5.1.3 asks for the error against the setpoint as an arrow, for the costate, and for the engine's efficiency rather
    than fuel per distance, which would punish a driver for storing energy in speed and height.
    """
    rows = np.arange(0, len(trip.time), max(round(1.0 / RATE / trip.step), 1))
    wanted = np.interp(trip.distance[rows], advice.s, advice.speed)
    costate = np.interp(trip.distance[rows], advice.s, advice.costate)
    gear = advice.gear[np.clip(np.searchsorted(advice.s, trip.distance[rows], side="right") - 1, 0, len(advice.s) - 1)]
    gear = gear if gears else 0 * gear
    arrow = np.clip((wanted - trip.speed[rows]) / FULL_ARROW, -1.0, 1.0)
    power, fuel = (trip.thrust * trip.speed)[rows], trip.fuel_power[rows]
    efficiency = np.where(fuel > 0.0, 100.0 * np.maximum(power, 0.0) / np.maximum(fuel, 1.0), 0.0)
    columns = {
        "time": trip.time[rows].tolist(),
        "distance": (trip.distance[rows] / 1e3).tolist(),
        "speed": (3.6 * trip.speed[rows]).tolist(),
        "advised_speed": (3.6 * wanted).tolist(),
        "arrow": arrow.tolist(),
        "gear": trip.gear[rows].astype(int).tolist(),
        "advised_gear": gear.tolist(),
        "costate": (costate / 1e3).tolist(),
        "costate_share": (costate / max(float(advice.costate.max()), 1e-9)).tolist(),
        "efficiency": efficiency.tolist(),
    }
    return [Frame(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]


def replay(shown: Iterable[Frame], pace: float = 1.0) -> Iterator[Frame]:
    """Yield the frames when their time has come; `pace` 2 is twice as fast as driven."""
    start = time.monotonic()
    for frame in shown:
        time.sleep(max(start + frame.time / pace - time.monotonic(), 0.0))
        yield frame


def display_server(source: Callable[[], Iterable[Frame]], port: int = 0) -> ThreadingHTTPServer:
    """A server on 127.0.0.1 (never another interface) whose page shows what `source()` yields, anew for each visitor.

    `source` is a replay, or an iterator that a running drive feeds. The caller runs `serve_forever` and closes it.
    """
    page = (resources.files("rollingroad.viz") / "pages" / "display.html").read_bytes()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path == "/":
                self._head("text/html; charset=utf-8")
                self.wfile.write(page)
            elif self.path == "/frames":
                self._head("text/event-stream")
                try:
                    for frame in source():
                        self.wfile.write(f"data: {json.dumps(asdict(frame))}\n\n".encode())
                        self.wfile.flush()
                    self.wfile.write(b"event: end\ndata: {}\n\n")
                except (BrokenPipeError, ConnectionResetError):
                    return  # the visitor left
            else:
                self.send_error(HTTPStatus.NOT_FOUND)

        def _head(self, kind: str) -> None:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", kind)
            self.send_header("Cache-Control", "no-store")
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:
            """Silent: the page is for one driver."""

    server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
    server.daemon_threads = True
    return server


def replay_server(folder: Path, *, pace: float = 1.0, port: int = 0) -> ThreadingHTTPServer:
    """The display of the advised drive in the run `folder`. Raises BadInput where drive or advice is missing."""
    path = folder / "advised" / "truth.parquet"
    if not path.is_file():
        raise BadInput(folder, "advised/truth.parquet", "expected a run folder with an advised drive")
    told = gears_told(read_results(folder))
    shown = frames(Trip.read(path), read_advice(folder / "advice.parquet"), gears=told)
    return display_server(lambda: replay(shown, pace), port)
