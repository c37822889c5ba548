"""Map matching: from GPS fixes and the odometer to what the road map says at the nodes that the car passes.

Causal and incremental; a whole log at once runs through the same compiled kernel, so both give the same bits.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sensors import matching_kernel as kernel
from sensors.log import SensorLog
from sensors.projection import to_local
from sensors.roadmap import RoadMap

OBSERVATION = np.dtype(
    [
        ("t", "f8"),
        ("heading", "f8"),
        ("heading_sigma", "f8"),
        ("altitude", "f8"),
        ("altitude_sigma", "f8"),
        ("straightness", "f8"),
        ("straightness_sigma", "f8"),
        ("north", "f8"),
        ("east", "f8"),
        ("link", "f8"),
        ("order", "f8"),
    ]
)
"""At the passage of a node: logger time s; DEM_psi rad; DEM_alt m (NaN where the map has none); S_j rad/m; each with
its deviation; the node's place in the map's plane, m about `RoadMap.origin`; the link of `RoadMap.roads`; and the
place in the log of the packet at whose arrival it was known (in `Matcher.update_*` the number of the call)."""

RECEIVER_LAG = 0.2
"""s, assumed of the receiver's own filter."""


def _fresh() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    state, hypotheses, ring = (
        np.zeros(kernel.STATE),
        np.zeros((kernel.MOST, kernel.HYPOTHESIS)),
        np.full((kernel.RING, 2), np.nan),
    )
    state[kernel.LAST_LINK] = -1.0
    return state, hypotheses, ring


@dataclass
class Matcher:
    """Follows one drive on `road_map`. Not thread-safe; one object per drive."""

    road_map: RoadMap
    receiver_lag: float = RECEIVER_LAG
    _calls: int = 0
    _memory: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] = field(default_factory=_fresh)

    def update(self, rows: NDArray[np.float64]) -> NDArray:
        """Take events (n, 8) in the order of arrival (see `matching_kernel.match`); return OBSERVATIONs (m,)."""
        roads = self.road_map.roads
        out = np.empty((max(16, 2 * len(rows)), kernel.OUTPUT))
        count = kernel.match(
            rows, *self._memory, roads.start, roads.north, roads.east, roads.s, roads.segment_link, roads.ends,
            roads.junction_start, roads.junction_link, roads.junction_end, roads.point_start, roads.point_s,
            roads.point_heading, roads.point_altitude, roads.point_straightness, roads.point_grade, roads.point_sigma,
            roads.grid, roads.grid_start, roads.grid_segment, self.receiver_lag, self.road_map.altitude_sigma, out,
        )  # fmt: skip
        found = out[:count].view(OBSERVATION).reshape(-1)
        found["order"] += self._calls
        self._calls += len(rows)
        return found

    def update_odometer(self, t: float, distance: float) -> NDArray:
        """The odometer stands at `distance` (m, cumulative) at logger time `t` (s). Returns what was passed."""
        return self.update(np.array([[t, kernel.ODOMETER, distance, 0.0, 0.0, 0.0, 0.0, 0.0]]))

    def update_fix(
        self, t: float, utc: float, latitude: float, longitude: float, speed: float, course: float, hdop: float
    ) -> NDArray:
        """A fix arrived at logger time `t` (s); units of `sensors.log`. Returns what was passed."""
        north, east = to_local(latitude, longitude, self.road_map.origin)
        return self.update(np.array([[t, kernel.FIX, float(north), float(east), utc, speed, course, hdop]]))


def events(log: SensorLog, road_map: RoadMap, metres_per_tick: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the matcher's events (n, 8) of `log` in the order of its packets, and each one's place in the log.

    The odometer is the wheel's pulses; a log without any gives its `speed`, integrated.
    """
    wheel, fixes, speed = log["wheel"], log["gps"], log["speed"]
    if wheel.size:
        rows, order = np.zeros((wheel.size, 8)), wheel["order"]
        rows[:, 0], rows[:, 2] = wheel["t"], metres_per_tick * np.arange(1, wheel.size + 1)
    else:
        rows, order = np.zeros((speed.size, 8)), speed["order"]
        rows[:, 0] = speed["t"]
        step = np.clip(np.diff(speed["t"], prepend=speed["t"][:1]), 0.0, 1.0)
        rows[:, 2] = np.cumsum(np.nan_to_num(speed["speed"]) * step)
    rows[:, 1] = kernel.ODOMETER
    fixes = fixes[(fixes["quality"] > 0) & np.isfinite(fixes["latitude"]) & np.isfinite(fixes["longitude"])]
    fix = np.zeros((fixes.size, 8))
    if fixes.size:
        fix[:, 0], fix[:, 1] = fixes["t"], kernel.FIX
        fix[:, 2], fix[:, 3] = to_local(fixes["latitude"], fixes["longitude"], road_map.origin)
        fix[:, 4], fix[:, 5], fix[:, 6] = fixes["utc"], fixes["speed"], fixes["course"]
        fix[:, 7] = fixes["hdop"]
    both, place = np.concatenate((rows, fix)), np.concatenate((order, fixes["order"]))
    sequence = np.argsort(place, kind="stable")
    return both[sequence], place[sequence]


def observations(
    log: SensorLog, road_map: RoadMap, metres_per_tick: float, receiver_lag: float = RECEIVER_LAG
) -> NDArray:
    """Return the OBSERVATIONs (m,) of a whole log, in the order in which they became known; `order` is that of the log.

    The same bits as feeding a `Matcher` event by event.
    """
    rows, place = events(log, road_map, metres_per_tick)
    found = Matcher(road_map, receiver_lag).update(rows)
    found["order"] = place[found["order"].astype(np.int64)]
    return found
