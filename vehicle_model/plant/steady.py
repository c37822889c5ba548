"""The steady plant: what a dynamometer would find. The true efficiency map that every estimate is judged by.

*Torque* is at wheel level here: T = thrust x speed / engine speed, behind gearbox losses and tyre slip, before wheel
inertia: what an observer of the car can see (seed 004, eq. 1.14 in steady driving). Warm engine. A variator is taken at
the ratio that its car file lists as that gear.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vehicle_model.plant import kernel as k

Array = NDArray[np.float64]
FUEL, FULL_LOAD, OVERRUN, ENGINE_FUEL = range(4)


def fuel_power(parameters: Array, gear: ArrayLike, engine_speed: ArrayLike, torque: ArrayLike) -> Array:
    """Fuel power (W) that gives wheel-level `torque` (N m) at `engine_speed` (rad/s) in `gear` (1 ...); broadcasts.

    The engine fires: overrun cut-off is `overrun`'s. Torques beyond full load are extrapolated; see `full_load`.
    """
    return _over(FUEL, parameters, gear, engine_speed, torque)


def true_efficiency(parameters: Array, gear: ArrayLike, engine_speed: ArrayLike, torque: ArrayLike) -> Array:
    """Fuel-to-wheel efficiency eta = T omega / P_in at the same arguments as `fuel_power`."""
    w, t = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
    power = fuel_power(parameters, gear, engine_speed, torque)
    return np.divide(w * t, power, out=np.zeros_like(power), where=power > 0.0)


def full_load(parameters: Array, gear: ArrayLike, engine_speed: ArrayLike) -> Array:
    """Wheel-level torque (N m) at full load; broadcasts."""
    return _over(FULL_LOAD, parameters, gear, engine_speed, 0.0)


def overrun(parameters: Array, gear: ArrayLike, engine_speed: ArrayLike) -> Array:
    """Wheel-level torque (N m, negative) with the fuel cut (as far as the car cuts it); broadcasts."""
    return _over(OVERRUN, parameters, gear, engine_speed, 0.0)


def idle(parameters: Array) -> tuple[float, float]:
    """Idle speed (rad/s) and fuel power (W) of the idling engine, clutch open."""
    speed = float(parameters[k.P_IDLE])
    return speed, float(engine_fuel_power(parameters, speed, 0.0) * parameters[k.P_IDLE_FUEL])


def engine_fuel_power(parameters: Array, engine_speed: ArrayLike, brake_torque: ArrayLike) -> Array:
    """Fuel power (W) at the crankshaft's own torque (N m): the engine alone, as on an engine bench; broadcasts."""
    return _over(ENGINE_FUEL, parameters, 1, engine_speed, brake_torque)


def engine_full_load(parameters: Array, engine_speed: ArrayLike) -> Array:
    """Full-load torque (N m) at the crankshaft, behind the accessories that the car always drives."""
    nodes = np.arange(k.TABLE)
    table = parameters[k.P_FULL_LOAD : k.P_FULL_LOAD + k.TABLE]
    return np.interp(np.asarray(engine_speed, float) * parameters[k.P_TABLE_RATE], nodes, table)


def _over(quantity: int, parameters: Array, gear: ArrayLike, speed: ArrayLike, torque: ArrayLike) -> Array:
    g, w, t = np.broadcast_arrays(np.asarray(gear, np.int64), np.asarray(speed, float), np.asarray(torque, float))
    out = np.empty(g.size)
    # Copies: an array that may be written is another type for the kernel than one that may not, and compiled anew.
    gears, speeds, torques = (np.array(part).reshape(-1) for part in (g, w, t))
    k.steady_table(np.array(parameters), quantity, gears, speeds, torques, out)
    return out.reshape(g.shape)
