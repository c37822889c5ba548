"""Advice: what to do at each place and speed of the road ahead, and why (the costate)."""

from dataclasses import dataclass, field

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

    The plan (n,) is the trajectory from the start speed; the policy (p, m), on its own coarser places `policy_s`, is
    the optimal action at any other speed, which is what a driver needs after traffic has interfered. The costate
    lambda_v = -dV/dv >= 0 is the worth of speed, J per m/s: what the fuel to come will be less of for being 1 m/s
    faster now. Between two places the action of the first holds.
    """

    s: NDArray[np.float64]
    speed: NDArray[np.float64]
    torque: NDArray[np.float64]
    """T = thrust / (gear ratio / wheel radius), N m: what the wheels get, seen at the engine; negative in overrun."""
    gear: NDArray[np.int64]
    """1 ...; 0 where the clutch is open (creeping to a halt)."""
    costate: NDArray[np.float64]
    time: NDArray[np.float64]
    """s since the start of the plan."""
    fuel: NDArray[np.float64]
    """J burnt up to s, predicted."""
    policy_speed: NDArray[np.float64]
    """(m,), m/s: the grid of the policy's second axis."""
    policy_acceleration: NDArray[np.float64]
    """(p, m), m/s2 to be had."""
    policy_gear: NDArray[np.int64]
    """(p, m)."""
    policy_costate: NDArray[np.float64]
    """(p, m)."""
    time_value: float
    """W: what a second is worth, J/s (the multiplier of trip time)."""
    policy_s: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """(p,), m: the places of the policy."""
    coasting: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, np.bool_))
    """(n,): off the throttle, fuel cut (rolling in gear, or braking)."""
    brake_force: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """(n,), N: planned braking."""
    certificate: dict[str, float] = field(default_factory=dict)
    """How well Pontryagin's conditions hold along the plan; see `controller.route`."""

    @property
    def trip_time(self) -> float:
        """Predicted duration, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def trip_fuel(self) -> float:
        """Predicted fuel, J."""
        return float(self.fuel[-1] - self.fuel[0])

    def action(self, s: float, speed: float) -> tuple[float, int, float]:
        """Acceleration (m/s2), gear and costate (J per m/s) advised at place `s`, m, and `speed`, m/s."""
        # Plain min and max: clipping one number with numpy takes longer than all the rest, and this is asked ten times
        # a second.
        place = min(max(int(np.searchsorted(self.policy_s, s, side="right")) - 1, 0), len(self.policy_s) - 1)
        grid = self.policy_speed
        upper = min(max(int(np.searchsorted(grid, speed)), 1), len(grid) - 1)
        share = min(max(float((speed - grid[upper - 1]) / (grid[upper] - grid[upper - 1])), 0.0), 1.0)
        nearest = upper if share > 0.5 else upper - 1
        row = self.policy_acceleration[place]
        worth = self.policy_costate[place]
        return (
            float((1.0 - share) * row[upper - 1] + share * row[upper]),
            int(self.policy_gear[place, nearest]),
            float((1.0 - share) * worth[upper - 1] + share * worth[upper]),
        )
