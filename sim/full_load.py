"""What a driver's log seldom shows and every petrol engine does: near full load it is fed more fuel than it can burn.

A map of smooth fits, found on a drive that kept away from full load, continues its line there. Drivers who know their
engine keep a reserve; a planner that believes the line hurries uphill with the pedal to the floor and pays for it.
Rich mixture gives the most torque at lambda about 0.88 (Heywood, Internal Combustion Engine Fundamentals, 1988,
15.2.2; Bosch Automotive Handbook, "Mixture formation"), part load runs at 1.
"""

from dataclasses import replace

import numpy as np

from observer.efficiency_map import FuelMap

RICH = 0.88
"""lambda at full load."""
BEGINS = 0.85
"""Share of full load from which the mixture is made richer, up to all of it at full load."""


def enriched(fuel_map: FuelMap) -> FuelMap:
    """`fuel_map` with the fuel (W) that a rich mixture adds near full load; unchanged below `BEGINS`."""
    load = fuel_map.torque / fuel_map.torque_max[:, None]
    share = np.clip((load - BEGINS) / (1.0 - BEGINS), 0.0, 1.0)
    return replace(fuel_map, fuel_power=fuel_map.fuel_power * (1.0 + (1.0 / RICH - 1.0) * share))
