"""Advice: what to do at each place and speed of the road ahead, and why (the costate)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class RoadAhead:
    """What an advisor may know of the road: map data, not the truth. Arrays (n,) over distance `s`, m."""

    s: NDArray[np.float64]
    pitch: NDArray[np.float64]
    """theta from the road map's altitudes, rad."""
    speed_max: NDArray[np.float64]
    """m/s: the limit, and what the curves allow."""
    speed_min: NDArray[np.float64]
    """m/s: what courtesy asks for (0 at stops)."""


@dataclass(frozen=True)
class Advice:
    """The optimal plan over distance, and the policy around it, from one value function.

    The plan (n,) is the trajectory from the start speed; the policy (n, m) is the optimal action at any other
    speed, which is what a driver needs after traffic has interfered. The costate lambda_v = -dV/dv >= 0 is the worth of
    speed, J per m/s: what the fuel to come will be less of for being 1 m/s faster now.
    """

    s: NDArray[np.float64]
    speed: NDArray[np.float64]
    torque: NDArray[np.float64]
    gear: NDArray[np.int64]
    costate: NDArray[np.float64]
    time: NDArray[np.float64]
    fuel: NDArray[np.float64]
    """J burnt up to s, predicted."""
    policy_speed: NDArray[np.float64]
    """(m,), m/s: the grid of the policy's second axis."""
    policy_acceleration: NDArray[np.float64]
    """(n, m), m/s2 to be had."""
    policy_gear: NDArray[np.int64]
    """(n, m)."""
    policy_costate: NDArray[np.float64]
    """(n, m)."""
    time_value: float
    """W: what a second is worth (the multiplier of trip time)."""
