"""The road along one route, as it truly is: geometry, limits, and where the sky is hidden."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

OPEN_SKY, CANYON, TUNNEL = 0, 1, 2
"""Values of `Route.sky`: what a satellite receiver sees there."""


@dataclass(frozen=True)
class Route:
    """Arrays over distance `s` (n,), evenly spaced; angles in rad, lengths in m, conventions of `vehicle_model.car`.

    Geometry is smooth (continuous heading and pitch), so that a 10 ms simulation sees finite curvature.
    """

    s: NDArray[np.float64]
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    altitude: NDArray[np.float64]
    heading: NDArray[np.float64]
    """psi, unwrapped."""
    pitch: NDArray[np.float64]
    """theta."""
    straightness: NDArray[np.float64]
    """S_j = d(psi)/ds, rad/m."""
    vertical_straightness: NDArray[np.float64]
    """S_k = d(theta)/ds, rad/m."""
    speed_limit: NDArray[np.float64]
    """m/s."""
    sky: NDArray[np.int8]
    """OPEN_SKY, CANYON or TUNNEL."""
    origin: tuple[float, float, float]
    """Latitude and longitude (deg, WGS 84) and altitude above sea level (m) of north = east = 0."""

    @property
    def length(self) -> float:
        """Length of the route, m."""
        return float(self.s[-1] - self.s[0])
