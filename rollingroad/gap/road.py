"""The road under a track: altitude of the nearest way of the road map, matched by place and direction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sensors.projection import to_local
from sensors.roadmap import RoadMap

SPACING = 10.0
"""m between the points that a way is resampled to."""
FAR = 25.0
"""m beyond which a fix is off the map."""


@dataclass(frozen=True)
class Road:
    """Ways as polylines: `ways[i]` (k, 3) latitude, longitude (deg), altitude (m)."""

    ways: tuple[NDArray[np.float64], ...]


def road_of(maps: list[RoadMap]) -> Road:
    """The ways of `maps` that have altitudes, a point at each of their nodes and every 10 m between."""
    ways = []
    for one in maps:
        origin = one.origin
        for i in range(one.ways):
            nodes = one.way_nodes[one.way_start[i] : one.way_start[i + 1]]
            ele = one.elevation[one.elevation_start[i] : one.elevation_start[i + 1]]
            if len(nodes) < 2 or len(ele) < 1:
                continue
            lat, lon = one.latitude[nodes], one.longitude[nodes]
            y, x = to_local(lat, lon, origin)
            length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(y), np.diff(x)))])
            if length[-1] <= 0.0:
                continue
            at = np.union1d(length, np.arange(0.0, length[-1], SPACING))
            heights = np.interp(at, np.linspace(0.0, length[-1], len(ele)), ele)
            ways.append(np.stack([np.interp(at, length, lat), np.interp(at, length, lon), heights], axis=1))
    return Road(tuple(ways))


@dataclass(frozen=True)
class Place:
    """Where each fix lies on the map, (n,); NaN off it."""

    altitude: NDArray[np.float64]
    way: NDArray[np.int64]
    along: NDArray[np.float64]


def match(road: Road, north: NDArray, east: NDArray, course: NDArray, origin: tuple[float, float, float]) -> Place:
    """Return the place on `road` of fixes at local `north`, `east` (m about `origin`) with `course` (rad, NaN
    unsaid)."""
    n = len(north)
    points, altitudes, headings, ways, along = [], [], [], [], []
    for number, way in enumerate(road.ways):
        y, x = to_local(way[:, 0], way[:, 1], origin)
        length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(y), np.diff(x)))])
        if length[-1] < SPACING:
            continue
        s = np.arange(0.0, length[-1], SPACING)
        yy, xx = np.interp(s, length, y), np.interp(s, length, x)
        points.append(np.stack([yy, xx], axis=1))
        altitudes.append(np.interp(s, length, way[:, 2]))
        headings.append(np.arctan2(np.gradient(xx), np.gradient(yy)))
        ways.append(np.full(len(s), number))
        along.append(s)
    if not points:
        return Place(np.full(n, np.nan), np.full(n, -1), np.full(n, np.nan))
    place, ele, heading = np.concatenate(points), np.concatenate(altitudes), np.concatenate(headings)
    way, s = np.concatenate(ways), np.concatenate(along)
    tree = cKDTree(place)
    count = min(8, len(place))
    distance, index = tree.query(np.stack([north, east], axis=1), k=count, distance_upper_bound=FAR)
    distance, index = distance.reshape(n, count), np.minimum(index.reshape(n, count), len(place) - 1)
    turn = np.nan_to_num(np.abs(np.sin(course[:, None] - heading[index])))  # a two-way road has both directions
    cost = distance + 30.0 * turn
    best = np.argmin(np.where(np.isfinite(cost), cost, 1e9), axis=1)
    chosen = index[np.arange(n), best]
    near = np.isfinite(distance[np.arange(n), best])
    # between the two resampled points on either side
    dx = np.stack([north, east], axis=1) - place[chosen]
    forward = dx[:, 0] * np.cos(heading[chosen]) + dx[:, 1] * np.sin(heading[chosen])
    neighbour = np.clip(chosen + np.where(forward > 0, 1, -1), 0, len(place) - 1)
    share = np.where(way[neighbour] == way[chosen], np.clip(np.abs(forward) / SPACING, 0, 1), 0.0)
    altitude = ele[chosen] * (1 - share) + ele[neighbour] * share
    return Place(
        np.where(near, altitude, np.nan), np.where(near, way[chosen], -1), np.where(near, s[chosen] + forward, np.nan)
    )
