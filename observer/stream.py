"""The observer as a stream: packet by packet as they are read from the card, with the same bits as `observe` in batch.

Packets are held back for `events.HORIZON`, since they may overtake each other by that much; memory does not grow.
"""

import heapq
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer import kernel
from observer.events import ADMITTED, GRID_STEP, HORIZON, admit, door, map_rows, packet_rows
from observer.observe import records_from, start, tell_repairs
from observer.settings import DEFAULT, ObserverSettings
from sensors.matching import Matcher
from sensors.roadmap import RoadMap
from vehicle_model.car.parameters import Car

_CHUNK = 128
"""Events that go through the kernel at a time."""


class Update(NamedTuple):
    """What became known by a packet: lines of the 10 Hz estimate and records. Shapes (k,), (k, 17), (k, 17), (m,)."""

    time: NDArray[np.float64]
    state: NDArray[np.float64]
    variance: NDArray[np.float64]
    records: NDArray


class Observer:
    """The causal filter of `observe`, fed packet by packet.

    The road map needs wheel pulses here (a log that carries a speed instead is matched in batch only).
    """

    def __init__(
        self,
        car: Car,
        road_map: RoadMap | None = None,
        learnt: Mapping[str, float] | None = None,
        settings: ObserverSettings = DEFAULT,
    ) -> None:
        self._car, self._learnt, self._settings = car, learnt, settings
        self._matcher = None if road_map is None else Matcher(road_map, settings.gps_lag)
        self._ticks = 0
        self._door = door()
        self._held: list[tuple[float, int, NDArray[np.float64]]] = []
        self._arrived = 0
        self._grid = 0
        self._filter: kernel.Filter | None = None
        self.refused = 0
        """Packets whose time stamp was refused."""
        self.repairs = 0
        """Resets of a covariance that was not positive any more."""

    def update(self, stream: str, packets: NDArray) -> Update:
        """Take `packets` of one stream (`sensors.log.STREAMS`), next in the log's order; return what became known."""
        rows = packet_rows(stream, packets)
        for i in range(len(rows)):
            self._take(rows[i])
            if self._matcher is not None and stream in ("wheel", "gps"):
                self._match(stream, packets[i])
        newest = self._door[0]
        return self._release(newest - HORIZON if math.isfinite(newest) else -math.inf)

    def finish(self) -> Update:
        """Release what is still held back, at the end of a log."""
        return self._release(math.inf)

    def _take(self, row: NDArray[np.float64]) -> None:
        verdict, time = admit(row[0], self._door)
        if verdict != ADMITTED:
            self.refused += 1
            return
        row[0] = time
        heapq.heappush(self._held, (time, self._arrived, row))
        self._arrived += 1

    def _match(self, stream: str, packet: np.void) -> None:
        assert self._matcher is not None
        if stream == "wheel":
            self._ticks += 1
            passed = self._matcher.update_odometer(packet["t"], self._car.metres_per_tick * self._ticks)
        elif packet["quality"] > 0 and math.isfinite(packet["latitude"]) and math.isfinite(packet["longitude"]):
            names = ("t", "utc", "latitude", "longitude", "speed", "course", "hdop")
            passed = self._matcher.update_fix(*(packet[name] for name in names))
        else:
            return
        for row in map_rows(passed, np.full(len(passed), packet["t"])):
            self._take(row)

    def _release(self, until: float) -> Update:
        rows: list[NDArray[np.float64]] = []
        while self._held and self._held[0][0] < until:
            time, _, row = heapq.heappop(self._held)
            if self._filter is None:
                self._grid = math.ceil(time / GRID_STEP)
                self._filter = start(self._car, self._settings, self._learnt, time)._replace(
                    records=np.empty((6 * _CHUNK, 7)),
                    grid_x=np.empty((_CHUNK, kernel.NX)),
                    grid_P=np.empty((_CHUNK, kernel.NX)),
                )
                self._filter.counts[kernel.RECORDING] = 1
            while self._grid * GRID_STEP < time:
                rows.append(self._grid_line())
            rows.append(row)
        if until == math.inf and self._filter is not None and rows:
            while self._grid * GRID_STEP <= rows[-1][0]:
                rows.append(self._grid_line())
        return self._advance(rows)

    def _grid_line(self) -> NDArray[np.float64]:
        line = np.zeros(kernel.COLUMNS)
        line[0], line[1] = self._grid * GRID_STEP, kernel.GRID
        self._grid += 1
        return line

    def _advance(self, rows: list[NDArray[np.float64]]) -> Update:
        time, states, variances, records = [], [], [], []
        f = self._filter
        for first in range(0, len(rows), _CHUNK):
            assert f is not None
            part = np.array(rows[first : first + _CHUNK])
            f.counts[[kernel.RECORDS, kernel.GRID_LINES]] = 0
            kernel.advance(part, 0, len(part), f)
            self.repairs = tell_repairs(f, self.repairs)
            lines = f.counts[kernel.GRID_LINES]
            time.append(part[part[:, 1] == kernel.GRID, 0])
            states.append(f.grid_x[:lines, :17].copy())
            variances.append(f.grid_P[:lines, :17].copy())
            records.append(f.records[: f.counts[kernel.RECORDS]].copy())
        if not time:
            return Update(np.empty(0), np.empty((0, 17)), np.empty((0, 17)), records_from(np.empty((0, 7))))
        return Update(
            np.concatenate(time),
            np.concatenate(states),
            np.concatenate(variances),
            records_from(np.concatenate(records)),
        )
