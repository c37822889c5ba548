"""Between geodetic coordinates and the project's local north and east: one map for the box, the road map and the car.

The plane that touches the ellipsoid (WGS 84) at the trip's origin; heights are kept out of it, so that a place has the
same north and east at any altitude. Forth and back agree within a centimetre up to 50 km from the origin.
(Seed 004, 1.1.1 projects to a local Mercator plane; the two differ by centimetres over a trip.)
"""

import numpy as np
import pymap3d
from numpy.typing import ArrayLike, NDArray

EARTH_RADIUS = 6_371_000.0


def to_geodetic(
    north: ArrayLike, east: ArrayLike, origin: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return latitude and longitude (deg) of local `north`, `east` (m) about `origin` (latitude, longitude, ...)."""
    north, east = np.asarray(north, dtype=np.float64), np.asarray(east, dtype=np.float64)
    # The earth's surface falls away below the plane; its horizontal share is what matters, so a sphere will do.
    down = (north**2 + east**2) / (2.0 * EARTH_RADIUS)
    latitude, longitude, _ = pymap3d.enu2geodetic(east, north, -down, origin[0], origin[1], 0.0)
    return np.asarray(latitude), np.asarray(longitude)


def to_local(
    latitude: ArrayLike, longitude: ArrayLike, origin: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return local north and east (m) about `origin` (deg). The inverse of `to_geodetic`."""
    latitude, longitude = np.asarray(latitude, dtype=np.float64), np.asarray(longitude, dtype=np.float64)
    east, north, _ = pymap3d.geodetic2enu(latitude, longitude, np.zeros_like(latitude), origin[0], origin[1], 0.0)
    return np.asarray(north), np.asarray(east)
