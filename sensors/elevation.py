"""Altitude and pitch along a route, from the road map alone: what a planner may know of the hills ahead."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import make_smoothing_spline

from sensors.projection import to_local
from sensors.roadmap import RoadMap

STEP = 10.0
"""m, at which the route is looked up in the map."""


def altitude_profile(
    road_map: RoadMap, s: ArrayLike, latitude: ArrayLike, longitude: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return altitude (n,) m and pitch (n,) rad along a route, smoothed: map data only.

    Parameters: `s` (n,) distance along the route, m, increasing; `latitude`, `longitude` (n,) deg. The map's altitudes
    scatter by about a metre from node to node, which over 50 m is a grade of 3 %: a smoothing spline with its strength
    from generalised cross-validation takes that out. Off the map the altitude is interpolated; a map without
    altitudes gives zeros.
    """
    s = np.asarray(s, dtype=np.float64)
    look = np.arange(s[0], s[-1] + STEP, STEP) if s[-1] > s[0] else s[:1]
    north, east = to_local(np.asarray(latitude), np.asarray(longitude), road_map.origin)
    north, east = np.interp(look, s, north), np.interp(look, s, east)
    heading = np.arctan2(np.gradient(east), np.gradient(north)) if look.size > 1 else np.zeros(1)
    at, heights = _passed(road_map, look, north, east, heading)
    if at.size == 0:
        return np.zeros(s.size), np.zeros(s.size)
    if at.size < 6:
        altitude = np.interp(s, at, heights)
        return altitude, np.arctan(np.gradient(altitude, s)) if s.size > 1 else np.zeros(s.size)
    spline = make_smoothing_spline((at - at[0]) / 100.0, heights)
    inside = np.clip(s, at[0], at[-1])
    slope = spline.derivative()((inside - at[0]) / 100.0) / 100.0
    altitude = spline((inside - at[0]) / 100.0) + (s - inside) * slope
    return np.asarray(altitude), np.arctan(slope)


def _passed(road_map: RoadMap, s, north, east, heading) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The map's elevation points that the route passes: (distance along the route, altitude), increasing."""
    roads = road_map.roads
    found: dict[int, tuple[float, float]] = {}
    for k in range(s.size):
        near = roads.near(float(north[k]), float(east[k]), 30.0)
        if near.shape[0] == 0:
            continue
        off = np.abs((near[:, 3] - heading[k] + np.pi / 2) % np.pi - np.pi / 2)
        best = int(np.argmin(near[:, 2] + 20.0 * off))
        if off[best] > 0.7:
            continue
        link, along = int(near[best, 0]), near[best, 1]
        forward = np.cos(near[best, 3] - heading[k]) > 0
        first, last = roads.point_start[link], roads.point_start[link + 1]
        gap = roads.point_s[first:last] - along
        for j in np.flatnonzero(np.abs(gap) <= STEP):
            distance, height = abs(gap[j]), roads.point_altitude[first + j]
            # A place may be passed twice on a route that comes back: once per hundred metres is enough to tell.
            key = (first + j) * 100_000 + int(s[k] // 200.0)
            if np.isfinite(height) and (key not in found or distance < found[key][0]):
                found[key] = (distance, s[k] + (gap[j] if forward else -gap[j]), height)  # type: ignore[assignment]
    rows = np.array(sorted((row[1], row[2]) for row in found.values())).reshape(-1, 2)  # type: ignore[misc]
    if rows.shape[0] == 0:
        return np.empty(0), np.empty(0)
    # Points that fall together (shared ends, the seam of a key) count once.
    apart = np.concatenate(([True], np.diff(rows[:, 0]) > 1.0))
    return rows[apart, 0], rows[apart, 1]
