"""Between geodetic coordinates and the project's local north and east: one map for the box, the road map and the car.

Equirectangular about the trip's origin, with the ellipsoid's two radii of curvature there (WGS 84). It is exactly
invertible and independent of altitude; against a tangent plane it is off by a few metres at 10 km, which does not
matter as long as every room uses this one map (seed 004, 1.1.1 projects to a local Mercator plane likewise).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pymap3d import Ellipsoid
from pymap3d.rcurve import meridian, transverse

WGS84 = Ellipsoid.from_name("wgs84")


def metres_per_radian(origin: tuple[float, ...]) -> tuple[float, float]:
    """Return metres north per rad of latitude and metres east per rad of longitude at `origin` (deg, deg, ...)."""
    latitude = origin[0]
    north = float(meridian(latitude, WGS84, deg=True))
    east = float(transverse(latitude, WGS84, deg=True)) * float(np.cos(np.radians(latitude)))
    return north, east


def to_geodetic(
    north: ArrayLike, east: ArrayLike, origin: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return latitude and longitude (deg) of local `north`, `east` (m) about `origin` (latitude, longitude in deg, ...)."""
    per_latitude, per_longitude = metres_per_radian(origin)
    latitude = origin[0] + np.degrees(np.asarray(north, dtype=np.float64) / per_latitude)
    longitude = origin[1] + np.degrees(np.asarray(east, dtype=np.float64) / per_longitude)
    return latitude, longitude


def to_local(
    latitude: ArrayLike, longitude: ArrayLike, origin: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return local north and east (m) about `origin` (deg) of `latitude`, `longitude` (deg). Inverse of `to_geodetic`."""
    per_latitude, per_longitude = metres_per_radian(origin)
    north = np.radians(np.asarray(latitude, dtype=np.float64) - origin[0]) * per_latitude
    east = np.radians(np.asarray(longitude, dtype=np.float64) - origin[1]) * per_longitude
    return north, east
