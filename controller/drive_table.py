"""What driving costs per metre, gear by gear: the fuel map seen from the wheels, over kinetic energy and thrust.

Kinetic energy per mass E = v^2/2 is the state: over a distance ds a net force F - R changes it by (F - R) ds / M_eff,
exactly and without regard to speed. M_eff = M_a + J_e N^2 holds the wheels *and* the engine (ERRATA on 1.13 and 1.14);
F = T N is what engine torque T brings to the wheels in a gear of N = engine speed / speed, 1/m.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.hold_lines import hold_lines
from observer.efficiency_map import FuelMap
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

LEVELS = 40
"""Force levels of the table between overrun and full load."""


@dataclass(frozen=True)
class DriveTable:
    """Fuel per metre by gear (G), half-grid kinetic energy (2 n - 1 rows) and force level (LEVELS)."""

    energy_step: float
    """Spacing of the energy nodes, m2/s2; row r of the table is at E = r x energy_step / 2."""
    nodes: int
    """n, energy nodes from standstill to the top speed."""
    fuel: NDArray[np.float64]
    """(G, 2n-1, LEVELS), J/m."""
    force_low: NDArray[np.float64]
    """(G, 2n-1), N: with fuel cut off. Above `force_high` where the gear cannot be used."""
    force_high: NDArray[np.float64]
    """(G, 2n-1), N: full load; -inf where the gear cannot be used."""
    coast_force: NDArray[np.float64]
    """(2n-1,), N: off the throttle, in the highest gear that keeps the engine turning."""
    coast_fuel: NDArray[np.float64]
    """(2n-1,), J/m: 0 with fuel cut, idling with the clutch open."""
    coast_gear: NDArray[np.int64]
    """(2n-1,): 0 with the clutch open."""
    coast_mass: NDArray[np.float64]
    """(2n-1,), M_eff of the coasting car, kg."""
    mass: NDArray[np.float64]
    """(G,), M_eff, kg."""
    ratio: NDArray[np.float64]
    """(G,), N, 1/m."""
    marginal_cost: float
    """J of fuel for one more J at the wheels, in the middle of the map: what stored energy is worth."""
    hold: tuple[NDArray[np.float64], ...]
    """What holding the speed costs and the lines that support it: see `hold_lines.hold_lines`."""


def drive_table(
    fuel_map: FuelMap,
    car: Car,
    *,
    speed_top: float,
    nodes: int = 200,
    engine_speed_min: float | None = None,
    coast_speed_min: float | None = None,
) -> DriveTable:
    """Tabulate `fuel_map` as seen from the wheels of `car`, up to `speed_top` m/s.

    `engine_speed_min`, rad/s, is the lowest engine speed advised under load (1.25 times idle by default; first gear
    slips its clutch below it), `coast_speed_min` the lowest at which fuel stays cut (1.35 times idle).
    Raises BadInput for a map that is not positive or not finite.
    """
    if not np.all(np.isfinite(fuel_map.fuel_power)) or np.any(fuel_map.fuel_power < 0.0):
        raise BadInput("fuel map", "fuel_power", "finite and not negative everywhere")
    if np.any(fuel_map.torque_max <= 0.0) or np.any(fuel_map.overrun_torque > 0.0):
        raise BadInput("fuel map", "torque_max, overrun_torque", "full load above zero and overrun not above zero")
    if len(fuel_map.engine_speed) < 2 or fuel_map.engine_speed[-1] <= fuel_map.engine_speed[0]:
        raise BadInput("fuel map", "engine_speed", "at least two ascending engine speeds")
    lowest = engine_speed_min or 1.25 * max(fuel_map.idle_speed, 1.0)
    lowest_cut = coast_speed_min or 1.35 * max(fuel_map.idle_speed, 1.0)
    highest = min(car.engine.redline_speed, float(fuel_map.engine_speed[-1]))
    ratio = np.asarray(car.gear_ratios) / car.wheel_radius
    mass = car.accelerated_mass + car.engine.inertia * ratio**2
    step = 0.5 * speed_top**2 / (nodes - 1)
    speed = np.sqrt(np.arange(2 * nodes - 1) * step)
    speed[0] = 0.5 * speed[1]  # row 0 stands for the first half cell: nothing is burnt per metre at a true standstill

    gears = len(ratio)
    fuel = np.zeros((gears, len(speed), LEVELS))
    low = np.full((gears, len(speed)), np.inf)
    high = np.full((gears, len(speed)), -np.inf)
    for g in range(gears):
        turning = ratio[g] * speed
        usable = (turning <= highest) & ((turning >= lowest) | (g == 0))
        engine_speed = np.clip(turning, lowest if g == 0 else fuel_map.engine_speed[0], highest)
        torque_max = np.interp(engine_speed, fuel_map.engine_speed, fuel_map.torque_max)
        overrun = np.interp(engine_speed, fuel_map.engine_speed, fuel_map.overrun_torque)
        overrun = np.where(turning >= lowest_cut, np.minimum(overrun, -0.1), 0.0)
        torque = overrun[:, None] + (torque_max - overrun)[:, None] * np.linspace(0.0, 1.0, LEVELS)
        power = fuel_power(fuel_map, engine_speed[:, None], torque, overrun[:, None])
        fuel[g] = power / speed[:, None]
        low[g, usable] = (overrun * ratio[g])[usable]
        high[g, usable] = (torque_max * ratio[g])[usable]

    coast_gear = np.zeros(len(speed), np.int64)
    for g in range(gears):
        coast_gear[(ratio[g] * speed >= lowest_cut) & (ratio[g] * speed <= highest)] = g + 1
    engaged = coast_gear > 0
    coast_ratio = np.where(engaged, ratio[np.maximum(coast_gear, 1) - 1], 0.0)
    drag = np.interp(coast_ratio * speed, fuel_map.engine_speed, fuel_map.overrun_torque)
    coast_force = np.where(engaged, np.minimum(drag, 0.0) * coast_ratio, 0.0)
    coast_fuel = np.where(engaged, 0.0, fuel_map.idle_power / speed)
    return DriveTable(
        energy_step=step,
        nodes=nodes,
        fuel=fuel,
        force_low=low,
        force_high=high,
        coast_force=coast_force,
        coast_fuel=coast_fuel,
        coast_gear=coast_gear,
        coast_mass=np.where(engaged, mass[np.maximum(coast_gear, 1) - 1], car.accelerated_mass),
        mass=mass,
        ratio=ratio,
        marginal_cost=_marginal_cost(fuel_map),
        hold=hold_lines(step, fuel, low, high, coast_force, coast_fuel),
    )


def fuel_power(
    fuel_map: FuelMap,
    engine_speed: NDArray[np.float64],
    torque: NDArray[np.float64],
    overrun: NDArray[np.float64],
) -> NDArray[np.float64]:
    """P_in, W, at engine speed and torque (broadcast): bilinear, falling linearly from P_in(w, 0) to 0 at `overrun`."""
    speeds, torques, power = fuel_map.engine_speed, fuel_map.torque, fuel_map.fuel_power
    engine_speed, torque, overrun = np.broadcast_arrays(engine_speed, torque, overrun)
    i = np.clip(np.searchsorted(speeds, engine_speed, side="right") - 1, 0, len(speeds) - 2)
    j = np.clip(np.searchsorted(torques, torque, side="right") - 1, 0, len(torques) - 2)
    x = np.clip((engine_speed - speeds[i]) / (speeds[i + 1] - speeds[i]), 0.0, 1.0)
    y = np.maximum((torque - torques[j]) / (torques[j + 1] - torques[j]), 0.0)
    low = power[i, j] + x * (power[i + 1, j] - power[i, j])
    high = power[i, j + 1] + x * (power[i + 1, j + 1] - power[i, j + 1])
    driving = low + y * (high - low)
    share = np.where(overrun < 0.0, np.clip(1.0 - torque / np.where(overrun < 0.0, overrun, -1.0), 0.0, 1.0), 1.0)
    return np.where(torque < 0.0, driving * share, driving)


def _marginal_cost(fuel_map: FuelMap) -> float:
    """Median slope of fuel power over shaft power between 30 % and 80 % of full load, middle engine speeds."""
    span = fuel_map.engine_speed[-1] - fuel_map.engine_speed[0]
    speed = fuel_map.engine_speed[0] + span * np.linspace(0.2, 0.6, 9)
    full = np.interp(speed, fuel_map.engine_speed, fuel_map.torque_max)
    zero = np.zeros_like(speed)
    burnt = fuel_power(fuel_map, speed, 0.8 * full, zero) - fuel_power(fuel_map, speed, 0.3 * full, zero)
    return float(np.median(burnt / (0.5 * full * speed)))
