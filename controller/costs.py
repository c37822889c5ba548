"""Vector-valued cost: fuel, time, gear changes, comfort, and the emissions of 4.1 where there is a map of them.

A planner minimises one number; what weighs in it is `time_value`, `Comfort` and `blended_map`. What came out is told
component by component, so that a trade can be seen.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from controller.advice import Advice
from observer.efficiency_map import FuelMap
from vehicle_model.car.errors import BadInput


@dataclass(frozen=True)
class TripCosts:
    """What a planned drive costs."""

    fuel: float
    """J."""
    time: float
    """s."""
    shifts: int
    restarts: int
    """Returns from rolling to driving."""
    discomfort: float
    """Mean square acceleration over time, m2/s4."""
    emissions: dict[str, float]
    """kg of each species with a map."""


def blended_map(
    fuel_map: FuelMap, emissions: Mapping[str, NDArray[np.float64]], prices: Mapping[str, float]
) -> FuelMap:
    """`fuel_map` with emissions priced in: fuel_power + sum of price (J/kg) x emission rate (kg/s) on the map's grid.

    Plan on it to trade fuel against emissions (4.1: the zones of least NOx and least fuel lie apart).
    Raises BadInput for a map of another shape, a negative rate or an unknown species.
    """
    power = fuel_map.fuel_power.copy()
    for species, price in prices.items():
        if species not in emissions:
            raise BadInput("emission prices", species, f"one of {', '.join(emissions) or 'no maps given'}")
        rate = emissions[species]
        if rate.shape != power.shape or not np.all(rate >= 0.0):
            raise BadInput("emission map", species, f"rates of shape {power.shape}, not negative")
        power = power + price * rate
    return replace(fuel_map, fuel_power=power)


def trip_costs(
    advice: Advice,
    fuel_map: FuelMap,
    ratios: tuple[float, ...],
    emissions: Mapping[str, NDArray[np.float64]] | None = None,
) -> TripCosts:
    """Components of the cost of a plan; `ratios` N = engine speed / speed, 1/m; `emissions` kg/s on the map's grid."""
    dt = np.diff(advice.time)
    speed = 0.5 * (advice.speed[1:] + advice.speed[:-1])
    gear, off = advice.gear[:-1], advice.coasting[:-1]
    acceleration = np.diff(advice.speed) / dt
    driving = ~off & (gear > 0)
    engine_speed = np.where(gear > 0, np.append(0.0, ratios)[gear] * speed, fuel_map.idle_speed)
    torque = np.clip(advice.torque[:-1], fuel_map.torque[0], fuel_map.torque[-1])
    burnt = {}
    for species, rate in (emissions or {}).items():
        i = np.clip(np.searchsorted(fuel_map.engine_speed, engine_speed) - 1, 0, len(fuel_map.engine_speed) - 2)
        x = np.clip((engine_speed - fuel_map.engine_speed[i]) / np.diff(fuel_map.engine_speed)[i], 0.0, 1.0)
        low = np.array([np.interp(t, fuel_map.torque, rate[k]) for t, k in zip(torque, i, strict=True)])
        high = np.array([np.interp(t, fuel_map.torque, rate[k + 1]) for t, k in zip(torque, i, strict=True)])
        burnt[species] = float(np.sum((low + x * (high - low)) * dt * driving))
    return TripCosts(
        fuel=advice.trip_fuel,
        time=advice.trip_time,
        shifts=int(np.count_nonzero((np.diff(gear) != 0) & driving[1:] & driving[:-1])),
        restarts=int(np.count_nonzero(off[:-1] & ~off[1:])),
        discomfort=float(np.sum(acceleration**2 * dt) / np.sum(dt)),
        emissions=burnt,
    )
