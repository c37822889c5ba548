"""The learnt engine map as a prior for the momentary efficiency (seed 000, chapter 6): outliers suppressed.

The filter's efficiency F v / P_in is noisy because its thrust is; its fuel power hardly is. A map learnt on earlier
trips tells the efficiency at this engine speed and *fuel power*, without the thrust. What the filter sees beyond that,
the residual, is what an estimator of `observer.priors` follows, its prior centred on nothing: the map, until the engine
insists.
"""

import numpy as np
from numpy.typing import NDArray

from observer.efficiency_map import FuelMap
from observer.estimate import Estimate
from observer.priors.estimators import Estimator

Array = NDArray[np.float64]
LEAST_FUEL = 1.0
"""Fuel power, as a share of the idle's, above which the filter's efficiency is listened to."""
LARGEST = 0.5
"""Residuals beyond this, of either sign, are no efficiency at all and left out."""


def efficiency_by_fuel(fuel_map: FuelMap, engine_speed: Array, fuel_power: Array) -> Array:
    """Efficiency (n,) at `engine_speed` (n,) rad/s and `fuel_power` (n,) W; 0 below zero torque's fuel."""
    speeds, torques = fuel_map.engine_speed, fuel_map.torque
    i = np.clip(np.searchsorted(speeds, engine_speed) - 1, 0, len(speeds) - 2)
    x = np.clip((engine_speed - speeds[i]) / (speeds[i + 1] - speeds[i]), 0.0, 1.0)[:, None]
    power = np.maximum.accumulate((1.0 - x) * fuel_map.fuel_power[i] + x * fuel_map.fuel_power[i + 1], axis=1)
    torque = np.array([np.interp(p, row, torques) for p, row in zip(fuel_power, power, strict=True)])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(fuel_power > power[:, 0], torque * engine_speed / fuel_power, 0.0)


def with_map(estimate: Estimate, fuel_map: FuelMap, estimator: Estimator) -> Array:
    """Momentary efficiency (n,) on the estimate's grid, causal: the map's plus the residual by `estimator`.

    `estimator` takes residuals (k, 1, 1), zero being the map's word. Where the fuel is cut or the filter has no
    sensible efficiency the residual is held.
    """
    thrust, speed = estimate.column("thrust"), estimate.column("speed")
    fuel, engine_speed = estimate.column("fuel_power"), estimate.column("engine_speed")
    told = efficiency_by_fuel(fuel_map, np.nan_to_num(engine_speed), np.nan_to_num(fuel))
    with np.errstate(divide="ignore", invalid="ignore"):
        residual = thrust * speed / fuel - told
    use = (
        np.isfinite(residual) & (fuel > LEAST_FUEL * fuel_map.idle_power) & (np.abs(residual) < LARGEST) & (told > 0.0)
    )
    if not use.any():
        return told
    followed = estimator.estimate(residual[use][:, None, None], np.zeros(1))[:, 0, 0]
    places = np.maximum.accumulate(np.where(use, np.arange(len(use)), -1))
    held = np.concatenate([[0.0], followed])[np.cumsum(use)]
    return np.where(places >= 0, told + held, told)
