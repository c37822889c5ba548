"""Whether a driver needs to be told gears: what the gears of his own drive burnt more than the map's best.

A driver who shifts well by himself is best left alone. He feels the engine; what is told comes late, stays on the
display for some seconds, and is chosen on a map that is known to a few percent. So gears are told to those only whose
own drive, as the observer saw it, says that they have something to gain.
"""

import numpy as np

from controller.drive_table import LEVELS, DriveTable, drive_table
from observer.efficiency_map import FuelMap
from observer.estimate import Estimate
from vehicle_model.car.parameters import Car

MATCH = 0.06
"""Relative: engine speed over road speed this near to a gear's ratio is that gear, engaged."""
FULL = 0.8
"""Share of full load that a gear to compare with may be used to: the rest is held in reserve."""
WORTH = 0.03
"""Share of the fuel below which his gears are left to him: who shifts by such a map himself stays below 0.02."""


def wasted_by_gears(estimate: Estimate, table: DriveTable) -> float:
    """Share (0 to 1) of the fuel under load that the cheapest gears would have saved, by `table`; 0 where unseen."""
    speed, turning = estimate.column("speed", smoothed=True), estimate.column("engine_speed", smoothed=True)
    force = estimate.column("thrust", smoothed=True)
    moving = (speed > 3.0) & (force > 0.0)
    speed, force = speed[moving], force[moving]
    if not len(speed):
        return 0.0
    off = np.abs(turning[moving] / speed / table.ratio[:, None] - 1.0)
    gear, engaged = off.argmin(axis=0), off.min(axis=0) < MATCH
    row = np.clip(np.rint(speed**2 / table.energy_step).astype(int), 0, table.fuel.shape[1] - 1)
    low, high = table.force_low[:, row], table.force_high[:, row]
    with np.errstate(invalid="ignore"):
        level = np.where(high > low, (force - low) / (high - low), np.inf)
    near = np.clip(np.rint(np.nan_to_num(level, posinf=0.0) * (LEVELS - 1)).astype(int), 0, LEVELS - 1)
    burnt = np.where(level >= 0.0, table.fuel[np.arange(len(table.ratio))[:, None], row, near], np.inf)
    best = np.where(level <= FULL, burnt, np.inf).min(axis=0)
    own = np.where(level <= 1.0, burnt, np.inf)[gear, np.arange(len(gear))]
    seen = engaged & np.isfinite(own) & np.isfinite(best)
    own, best, speed = own[seen], best[seen], speed[seen]
    spent = float(np.sum(own * speed))
    return float(np.sum(np.maximum(own - best, 0.0) * speed)) / spent if spent > 0.0 else 0.0


def gears_are_worth_telling(estimate: Estimate, found: FuelMap, car: Car) -> bool:
    """Whether the drive that `estimate` shows wasted more than `WORTH` by its gears, on the map `found`."""
    table = drive_table(found, car, speed_top=float(estimate.column("speed").max()) + 1.0)
    return wasted_by_gears(estimate, table) > WORTH
