"""The engine's efficiency over engine speed and torque, as found; and the table of fuel power that a planner needs."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

SPEED_STEP = 50.0 * 2.0 * np.pi / 60.0
"""Width of a cell, rad/s: 50 rpm (seed 004, 3.4)."""
TORQUE_STEP = 2.0
"""Height of a cell, N m."""


@dataclass(frozen=True)
class FuelMap:
    """Fuel power over a grid of engine speed and torque T = thrust x speed / engine speed: all a planner may know.

    Found from a log (`observer.mapping.fuel_map`), or true (`sim` hands one to the oracle).
    """

    engine_speed: NDArray[np.float64]
    """(n,), rad/s, ascending."""
    torque: NDArray[np.float64]
    """(m,), N m, ascending from 0."""
    fuel_power: NDArray[np.float64]
    """(n, m), W; positive at zero torque, finite everywhere."""
    torque_max: NDArray[np.float64]
    """(n,), N m: full load at each engine speed."""
    overrun_torque: NDArray[np.float64]
    """(n,), N m, negative: with fuel cut off."""
    idle_power: float
    """W, clutch open at idle."""
    idle_speed: float
    """rad/s: below it the engine cannot drive."""


@dataclass(frozen=True)
class Limits:
    """What the trips showed of the engine's limits, per column of the map; NaN where nothing was seen."""

    torque_max: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """(n,), N m: from stretches at full throttle."""
    overrun_torque: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """(n,), N m, negative: with the fuel cut off and the brakes (as far as can be told) released."""
    idle_power: float = float("nan")
    """W: at standstill."""
    idle_speed: float = float("nan")
    """rad/s: at standstill."""


@dataclass(frozen=True)
class EfficiencyMap:
    """Grid of mean efficiency with deviation and counts. Shapes (n, m): engine-speed cells by torque cells."""

    engine_speed: NDArray[np.float64]
    """(n,), cell centres, rad/s."""
    torque: NDArray[np.float64]
    """(m,), cell centres, N m."""
    mean: NDArray[np.float64]
    """Efficiency at the cell's centre, NaN where never visited."""
    deviation: NDArray[np.float64]
    """Spread of the samples, not of their mean."""
    count: NDArray[np.int64]
    """Samples."""
    visits: NDArray[np.int64]
    """Separate stays in the cell."""
    seconds: NDArray[np.float64]
    fuel: NDArray[np.float64]
    """J burnt in the cell while it was being mapped."""
    valid: NDArray[np.bool_]
    """The rule of DESIGN.md: at least 0.5 s from at least two visits, deviation at most 0.05."""
    fuel_total: float
    """J burnt over the trips, mapped or not: the base of `fuel_share`."""
    standard_error: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 0)))
    """One standard deviation of `mean` as an estimate of the truth (observer's covariance, scatter between visits and
    what all samples of a trip share); empty if unknown."""
    common_error: tuple[float, float] = (0.0, 0.0)
    """N m, and relative, of the torque: the part of `standard_error` that all cells share, however often visited."""
    limits: Limits = field(default_factory=Limits)
    trips: int = 1

    @property
    def fuel_share(self) -> float:
        """Share of all fuel burnt that the valid cells cover."""
        return float(self.fuel[self.valid].sum() / self.fuel_total) if self.fuel_total > 0 else 0.0
