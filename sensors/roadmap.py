"""The digital road map on board: ways through nodes, and altitudes along them (seed 004, 2.5.2 and C.1.1.1).

As in table C.2, a way has nodes where its shape needs them and, apart from those, elevations at even distances along
it, both ends included (C.1, note 30). A way may be driven in either direction.
"""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensors import matching_kernel as kernel
from sensors import quadtile
from sensors.projection import to_geodetic, to_local
from sensors.settings import BoxSettings
from vehicle_model.car.errors import BadInput
from vehicle_model.car.randomness import generator
from vehicle_model.car.route import Route

__all__ = ["RoadMap", "Roads", "from_osm", "from_route", "from_sumo_network", "join", "read_road"]

CELL = 100.0
"""m, of the grid in which roads are found by place."""
CHORD = 12.0
"""m on either side, over which a heading is taken."""
WAY_LENGTH = 2000.0
"""m, of the ways into which a route is cut."""
SHAPE_TOLERANCE = 0.15
"""m by which a straight piece may cut a bend of a route's map."""


@dataclass(frozen=True)
class RoadMap:
    """Nodes (n,), ways as runs of node indices, elevations as runs of altitudes."""

    latitude: NDArray[np.float64]
    """(n,) deg."""
    longitude: NDArray[np.float64]
    way_start: NDArray[np.int64]
    """(ways + 1,): way i goes through nodes `way_nodes[way_start[i] : way_start[i + 1]]`."""
    way_nodes: NDArray[np.int64]
    elevation_start: NDArray[np.int64]
    """(ways + 1,): where way i's altitudes begin in `elevation`; a way without any has none."""
    elevation: NDArray[np.float64]
    """m above sea level, evenly spaced along the way, both ends included."""
    altitude_sigma: float = 1.0
    """m, deviation of one altitude from the truth."""

    @property
    def ways(self) -> int:
        """Number of ways."""
        return self.way_start.size - 1

    @property
    def origin(self) -> tuple[float, float, float]:
        """Middle of the map (deg, deg, m): about which its own plane lies."""
        return float(self.latitude.mean()), float(self.longitude.mean()), 0.0

    @cached_property
    def roads(self) -> "Roads":
        """The map as the matcher needs it, made once."""
        return _roads(self)

    def nearest(
        self, latitude: float, longitude: float, heading: float | None = None, radius: float = 100.0
    ) -> tuple[int, float, float] | None:
        """Return (link, distance along it in m, distance across in m) of the road nearest to a place (deg), or None.

        With `heading` (rad) only roads within 45 degrees of it, in either direction, count. `roads` holds the links.
        """
        north, east = to_local(latitude, longitude, self.origin)
        found = self.roads.near(float(north), float(east), radius)
        if heading is not None and found.size:
            off = np.abs((found[:, 3] - heading + np.pi / 2) % np.pi - np.pi / 2)
            found = found[off < np.pi / 4]
        if not found.size:
            return None
        link, s, across, _ = found[np.argmin(found[:, 2])]
        return int(link), float(s), float(across)

    def write(self, directory: Path) -> None:
        """Write the quad-tile files of C.1.1 into `directory`; see `sensors.quadtile`."""
        quadtile.write(
            directory,
            quadtile.Database(
                self.latitude, self.longitude, self.way_start, self.way_nodes, self.elevation_start, self.elevation
            ),
        )

    @staticmethod
    def read(directory: Path) -> "RoadMap":
        """Read what `write` wrote. Raises BadInput for missing or damaged files."""
        data = quadtile.read(directory)
        return RoadMap(
            data.latitude, data.longitude, data.way_start, data.way_nodes, data.elevation_start, data.elevation
        )


@dataclass(frozen=True)
class Roads:
    """Links between junctions in the map's own plane (m about `RoadMap.origin`), flat, with an index by place."""

    origin: tuple[float, float, float]
    start: NDArray[np.int64]
    """(links + 1,): points of link i."""
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    s: NDArray[np.float64]
    """m along the link."""
    segment_link: NDArray[np.int64]
    """(points,): the link of the segment that begins at a point; -1 at a link's last point."""
    ends: NDArray[np.int64]
    """(links, 2): junctions at its start and its end."""
    junction_start: NDArray[np.int64]
    junction_link: NDArray[np.int64]
    junction_end: NDArray[np.int64]
    """0: the link starts at this junction, 1: it ends there."""
    point_start: NDArray[np.int64]
    """(links + 1,): observation points of link i, at which the map tells heading and altitude."""
    point_s: NDArray[np.float64]
    point_heading: NDArray[np.float64]
    """rad, in the link's direction."""
    point_altitude: NDArray[np.float64]
    point_straightness: NDArray[np.float64]
    point_grade: NDArray[np.float64]
    point_sigma: NDArray[np.float64]
    """rad, of the heading."""
    grid: NDArray[np.float64]
    grid_start: NDArray[np.int64]
    grid_segment: NDArray[np.int64]

    def near(self, north: float, east: float, radius: float, most: int = 64) -> NDArray[np.float64]:
        """Rows (link, s, distance, heading) of the links within `radius` m of a place in the map's plane."""
        found = np.empty((most, 4))
        count = kernel.nearby(
            north, east, float(radius), self.grid, self.grid_start, self.grid_segment, self.segment_link, self.start,
            self.north, self.east, self.s, found, most,
        )  # fmt: skip
        return found[:count]


def _runs(starts: NDArray[np.int64], stops: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices of all [start, stop) joined, and where each run begins in them (with the end)."""
    lengths = stops - starts
    offsets = np.concatenate(([0], np.cumsum(lengths)))
    return np.arange(offsets[-1]) - np.repeat(offsets[:-1] - starts, lengths), offsets


def _roads(road: RoadMap) -> Roads:
    north_of, east_of = to_local(road.latitude, road.longitude, road.origin)
    node = road.way_nodes
    way = np.repeat(np.arange(road.ways), np.diff(road.way_start))
    north, east = north_of[node], east_of[node]
    first, last = road.way_start[:-1], road.way_start[1:] - 1
    # Distance along each way; in `place` the ways stand one behind the other, apart, so that one interp serves all.
    step = np.hypot(np.diff(north, prepend=north[:1]), np.diff(east, prepend=east[:1]))
    step[first] = 1000.0
    place = np.cumsum(step)
    s = place - place[first][way]
    length = s[last]
    # Links: ways cut where a node belongs to more than one place of the network.
    uses = np.bincount(node, minlength=road.latitude.size)
    junction = uses[node] > 1
    junction[first] = True
    junction[last] = True
    cut = np.flatnonzero(junction)
    inside = way[cut[:-1]] == way[cut[1:]]
    begin, end = cut[:-1][inside], cut[1:][inside]
    whole = s[end] - s[begin] > 0.05
    begin, end = begin[whole], end[whole]
    points, start = _runs(begin, end + 1)
    segment_link = np.repeat(np.arange(begin.size), end + 1 - begin)
    segment_link[start[1:] - 1] = -1
    ends = np.column_stack((node[begin], node[end]))
    order = np.argsort(ends.reshape(-1), kind="stable")
    junction_start = np.concatenate(([0], np.cumsum(np.bincount(ends.reshape(-1), minlength=road.latitude.size))))
    # Observation points: the ways' elevations; where there are none, even distances without an altitude.
    count = np.diff(road.elevation_start)
    blank = np.maximum(2, np.round(length / 50.0).astype(np.int64) + 1)
    points_of = np.where(count > 1, count, blank)
    number, offsets = _runs(np.zeros(road.ways, np.int64), points_of)
    owner = np.repeat(np.arange(road.ways), points_of)
    along = number * (length / (points_of - 1))[owner]
    known = (count > 1)[owner]
    altitude = np.full(along.size, np.nan)
    altitude[known] = road.elevation[
        _runs(road.elevation_start[:-1][count > 1], road.elevation_start[1:][count > 1])[0]
    ]
    grade = np.gradient(altitude) / np.maximum((length / (points_of - 1))[owner], 1.0) if along.size > 1 else altitude
    grade[offsets[:-1]] = 0.0
    grade[offsets[1:] - 1] = 0.0
    grade = np.clip(np.nan_to_num(grade), -0.1, 0.1)
    at = place[first][owner] + along
    link = np.searchsorted(place[begin], at + 1e-6, side="right") - 1
    inside = (link >= 0) & (at <= place[end][np.maximum(link, 0)] + 1e-6)
    at, link, altitude, grade = at[inside], link[inside], altitude[inside], grade[inside]
    low, high = place[begin][link], place[end][link]

    def heading(middle: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
        a, b = np.maximum(middle - reach, low), np.minimum(middle + reach, high)
        return np.arctan2(np.interp(b, place, east) - np.interp(a, place, east),
                          np.interp(b, place, north) - np.interp(a, place, north))  # fmt: skip

    clear = np.minimum(at - low, high - at) >= CHORD
    direction = heading(at, CHORD)
    before = heading(np.maximum(at - CHORD, low + 1.0), CHORD)
    behind = heading(np.minimum(at + CHORD, high - 1.0), CHORD)
    span = np.maximum(np.minimum(at + CHORD, high - 1.0) - np.maximum(at - CHORD, low + 1.0), 1.0)
    straightness = ((behind - before + np.pi) % (2.0 * np.pi) - np.pi) / span
    sigma = np.where(clear, 0.02, 0.08) + 2.0 * np.abs(straightness)
    grid, grid_start, grid_segment = _grid(north[points], east[points], segment_link)
    return Roads(
        road.origin, start, north[points], east[points], s[points] - np.repeat(s[begin], np.diff(start)), segment_link,
        ends, junction_start, order // 2, order % 2,
        np.searchsorted(link, np.arange(begin.size + 1)), at - low, direction, altitude, straightness, grade, sigma,
        grid, grid_start, grid_segment,
    )  # fmt: skip


def _grid(
    north: NDArray[np.float64], east: NDArray[np.float64], segment_link: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    corner = north.min() - 1.0, east.min() - 1.0
    extent = np.ptp(north) + 2.0, np.ptp(east) + 2.0
    size = max(CELL, float(np.sqrt(extent[0] * extent[1] / 4e6)))
    rows, columns = (int(part / size) + 1 for part in extent)
    grid = np.array([*corner, size, rows, columns])
    segments = np.flatnonzero(segment_link >= 0)
    counts = np.zeros(rows * columns, dtype=np.int64)
    nothing = np.empty(0, dtype=np.int64)
    kernel.fill_grid(segments, north, east, grid, counts, nothing, nothing)
    start = np.concatenate(([0], np.cumsum(counts)))
    filled = np.empty(start[-1], dtype=np.int64)
    counts[:] = 0
    kernel.fill_grid(segments, north, east, grid, counts, start, filled)
    return grid, start, filled


def join(ways: Iterable[tuple[NDArray[np.int64], NDArray[np.float64]]], latitude, longitude, sigma=1.0) -> RoadMap:
    """Make a RoadMap of ways given as (node indices, altitudes) and the nodes' coordinates (deg)."""
    ways = list(ways)
    nodes = [np.asarray(way, dtype=np.int64) for way, _ in ways]
    heights = [np.asarray(height, dtype=np.float64) for _, height in ways]
    empty = [np.empty(0)]
    return RoadMap(
        np.asarray(latitude, dtype=np.float64),
        np.asarray(longitude, dtype=np.float64),
        np.concatenate(([0], np.cumsum([way.size for way in nodes]))).astype(np.int64),
        np.concatenate(nodes).astype(np.int64) if nodes else np.empty(0, np.int64),
        np.concatenate(([0], np.cumsum([height.size for height in heights]))).astype(np.int64),
        np.concatenate(heights or empty),
        sigma,
    )


def from_route(route: Route, seed: int = 0, settings: BoxSettings | None = None) -> RoadMap:
    """Return the map of one route as a mapping agency would have it: shape where the road bends, altitudes with errors.

    Elevations every `road_map_spacing` m with `road_map_altitude_error` from `seed`, and the effect grade_map_error.
    """
    settings = settings or BoxSettings()
    s = route.s - route.s[0]
    # A chord of length d cuts a bend by S d^2 / 8.
    density = np.maximum(1.0 / 50.0, np.sqrt(np.abs(route.straightness) / (8.0 * SHAPE_TOLERANCE)))
    level = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(s))))
    count = max(2, int(np.ceil(level[-1])) + 1)
    node_s = np.interp(np.linspace(0.0, level[-1], count), level, s)
    north, east = np.interp(node_s, s, route.north), np.interp(node_s, s, route.east)
    latitude, longitude = to_geodetic(north, east, route.origin)
    pieces = max(1, round(s[-1] / WAY_LENGTH))
    cuts = np.unique(np.searchsorted(node_s, np.linspace(0.0, s[-1], pieces + 1)[1:-1]))
    cuts = np.unique(np.concatenate(([0], cuts, [count - 1])))
    rng = generator(seed, "sensors.road_map")
    ways = []
    before = rng.standard_normal()
    for a, b in itertools.pairwise(cuts):
        points = max(2, round((node_s[b] - node_s[a]) / settings.road_map_spacing) + 1)
        at = np.linspace(node_s[a], node_s[b], points)
        noise = np.concatenate(([before], rng.standard_normal(points - 1)))
        before = noise[-1]
        truth = np.interp(at - settings.road_map_shift, s, route.altitude)
        error = settings.road_map_altitude_error * noise + settings.road_map_grade_bias * at
        ways.append((np.arange(a, b + 1), truth + error))
    return join(ways, latitude, longitude, max(settings.road_map_altitude_error, 0.1))


def from_osm(path: Path) -> RoadMap:
    """Read a map from OpenStreetMap XML, altitudes from `ele`. Raises BadInput; see `sensors.road_files`."""
    from sensors.road_files import read_osm

    return read_osm(path)


def from_sumo_network(path: Path, origin: tuple[float, ...] | None = None) -> RoadMap:
    """Read a map from a SUMO network (.net.xml). Raises BadInput; see `sensors.road_files`."""
    from sensors.road_files import read_sumo_network

    return read_sumo_network(path, origin)


def read_road(path: Path) -> RoadMap:
    """Read a map from what `path` is: a directory of quad-tile files, a SUMO network or an OpenStreetMap extract.

    Raises BadInput where it is none of these.
    """
    if path.is_dir():
        return RoadMap.read(path)
    if not path.is_file():
        raise BadInput(path, "", "a road: OpenStreetMap XML, a SUMO network or a directory of quad-tile files")
    with path.open("rb") as file:
        head = file.read(4096)
    return from_sumo_network(path) if b"<net" in head else from_osm(path)
