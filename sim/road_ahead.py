"""What a navigation system knows of the road ahead: limits and bends along the route, hills from the road map."""

import numpy as np
from scipy.ndimage import minimum_filter1d

from controller.advice import RoadAhead
from sensors.elevation import altitude_profile
from sensors.projection import to_geodetic
from sensors.roadmap import RoadMap
from vehicle_model.car.route import Route

STEP = 5.0
"""m between the places of the road ahead."""
LATERAL_COMFORT = 2.2
"""m/s2 that an adviser plans for in bends."""
COURTESY = 0.7
"""Share of the possible speed below which others are held up."""
STARTING = 60.0
"""m at both ends where courtesy asks for nothing."""
BRAKING = 1.0
"""m/s2 by which courtesy lets the speed fall and rise around a slow place."""


def road_ahead(route: Route, road_map: RoadMap) -> RoadAhead:
    """Return limits, bend speeds and hills along `route`, every 5 m.

    Limits and bends are map data along the navigation route (the route's own plan view: an electronic horizon); the
    pitch comes from the road map's altitudes, never from the true pitch. `speed_max` is the lower of the limit and of
    2.2 m/s2 sideways; `speed_min` 70 % of what can be driven with 1 m/s2 around slow places, 0 near both ends.
    """
    latitude, longitude = to_geodetic(route.north, route.east, route.origin)[:2]
    s = np.arange(0.0, route.length, STEP)
    _, pitch = altitude_profile(road_map, route.s, latitude, longitude)
    bend = np.sqrt(LATERAL_COMFORT / np.maximum(np.abs(route.straightness), 1e-6))
    possible = np.minimum(route.speed_limit, bend)
    step = float(route.s[1] - route.s[0])
    lowest = minimum_filter1d(possible, max(round(STEP / step), 1))
    speed_max = np.interp(s, route.s, lowest)
    square = speed_max**2
    gain = 2.0 * BRAKING * STEP
    for i in range(len(square) - 2, -1, -1):
        square[i] = min(square[i], square[i + 1] + gain)
    for i in range(1, len(square)):
        square[i] = min(square[i], square[i - 1] + gain)
    speed_min = COURTESY * np.sqrt(square)
    speed_min[(s < STARTING) | (s > s[-1] - STARTING)] = 0.0
    return RoadAhead(s=s, pitch=np.interp(s, route.s, pitch), speed_max=speed_max, speed_min=speed_min)
