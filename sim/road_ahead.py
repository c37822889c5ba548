"""The road ahead as a navigation device knows it: the way, its limits and bends, and slopes from the map's altitudes."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from controller.advice import RoadAhead
from sensors.projection import to_geodetic
from sensors.roadmap import RoadMap
from vehicle_model.car.route import Route

STEP = 10.0
"""m between the places of the road ahead."""
SMOOTHING = 60.0
"""m: sigma of the Gaussian over the map's altitudes, whose own errors are about 1 m every 50 m."""
STEEPEST = 0.12
"""rad: no slope of a map is believed beyond it."""
LATERAL_COMFORT = 2.2
"""m/s2 sideways that is planned with in bends."""


def road_ahead(route: Route, road_map: RoadMap, lateral_comfort: float = LATERAL_COMFORT) -> RoadAhead:
    """Return limits, bends and slopes along `route`; slopes come from `road_map`, never from the route's true pitch.

    Where the map has no altitude the slope is interpolated between places that have one, 0 where none has.
    """
    s = np.arange(float(route.s[0]), float(route.s[-1]), STEP)
    altitude = _altitudes(route, road_map, s)
    known = np.isfinite(altitude)
    smooth = gaussian_filter1d(
        np.interp(s, s[known], altitude[known]) if known.any() else np.zeros(len(s)), SMOOTHING / STEP, mode="nearest"
    )
    pitch = np.clip(np.arctan(np.gradient(smooth, STEP)), -STEEPEST, STEEPEST)
    # The sharpest bend and the lowest limit of each stretch count, not those that happen to lie on the grid.
    bend = np.sqrt(lateral_comfort / np.maximum(np.abs(route.straightness), 1e-6))
    fastest = np.minimum(route.speed_limit, bend)
    edges = np.searchsorted(route.s, np.append(s, route.s[-1]))
    speed_max = np.array([fastest[a : max(b, a) + 1].min() for a, b in zip(edges[:-1], edges[1:], strict=True)])
    return RoadAhead(s, pitch, speed_max, np.zeros(len(s)))


def _altitudes(route: Route, road_map: RoadMap, s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Altitude (m) of the map at each place `s`, NaN where it has none."""
    latitude, longitude = to_geodetic(
        np.interp(s, route.s, route.north), np.interp(s, route.s, route.east), route.origin
    )
    heading = np.interp(s, route.s, route.heading)
    roads = road_map.roads
    found = np.full(len(s), np.nan)
    for i, place in enumerate(zip(latitude, longitude, heading, strict=True)):
        near = road_map.nearest(*place, radius=30.0)
        if near is None:
            continue
        points = slice(*roads.point_start[near[0] : near[0] + 2])
        known = np.isfinite(roads.point_altitude[points])
        if known.any():
            found[i] = np.interp(near[1], roads.point_s[points][known], roads.point_altitude[points][known])
    return found
