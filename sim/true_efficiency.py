"""True efficiency as DESIGN defines it: fuel to wheel, steady, gears weighted by the trips' time in each cell."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from observer.efficiency_map import SPEED_STEP, TORQUE_STEP
from vehicle_model.car.parameters import Car
from vehicle_model.car.trip import Trip
from vehicle_model.plant import steady
from vehicle_model.plant.parameters import plant_parameters

Array = NDArray[np.float64]


def gear_shares(car: Car, trips: Sequence[Trip]) -> Callable[[Array, Array], Array]:
    """Return share(engine speed rad/s, torque N m) -> (..., gears): of the trips' time there, clutch locked.

    Counted in cells of 50 rpm x 2 N m; in cells never visited, the share of the time at that engine speed; where the
    engine never turned, all gears alike.
    """
    gears = len(car.gear_ratios)
    rows = int(car.engine.redline_speed * 1.2 / SPEED_STEP) + 2
    columns = int(1.6 * car.engine.max_torque / TORQUE_STEP) + 2
    seconds = np.zeros((rows, columns, gears))
    for trip in trips:
        c = trip.channels
        driving = (c["clutch"] > 0.99) & (c["gear"] > 0.5) & (c["thrust"] > 0.0) & (c["engine_speed"] > 1.0)
        omega = c["engine_speed"][driving]
        torque = c["thrust"][driving] * c["speed"][driving] / omega
        place = _cells(omega, torque, rows, columns)
        np.add.at(seconds, (*place, c["gear"][driving].astype(int) - 1), trip.step)
    by_speed = seconds.sum(axis=1, keepdims=True)
    anywhere = np.where(by_speed.sum(axis=2, keepdims=True) > 0.0, by_speed, 1.0)
    weights = np.where(seconds.sum(axis=2, keepdims=True) > 0.0, seconds, anywhere)
    weights /= weights.sum(axis=2, keepdims=True)
    return lambda engine_speed, torque: weights[_cells(engine_speed, torque, rows, columns)]


def true_efficiency(
    car: Car, settings: Mapping[str, float] | None, trips: Sequence[Trip]
) -> Callable[[Array, Array], Array]:
    """Return eta(engine speed rad/s, torque N m): broadcasts; NaN where the engine cannot be.

    Torque is T = thrust x speed / engine speed, at the wheels' level; the gears weigh by `gear_shares`.
    """
    p = plant_parameters(car, settings)
    shares = gear_shares(car, trips)

    def efficiency(engine_speed: Array, torque: Array) -> Array:
        omega, load = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        share = shares(omega, load)
        eta, full = np.zeros(omega.shape), np.zeros(omega.shape)
        flat_speed = np.unique(omega)
        for gear in range(1, len(car.gear_ratios) + 1):
            eta += share[..., gear - 1] * steady.true_efficiency(p, gear, omega, load)
            full += share[..., gear - 1] * np.interp(omega, flat_speed, steady.full_load(p, gear, flat_speed))
        possible = (omega >= 0.9 * car.engine.idle_speed) & (omega <= 1.02 * car.engine.redline_speed)
        return np.where(possible & (load <= 1.02 * full), eta, np.nan)

    return efficiency


def _cells(omega: Array, torque: Array, rows: int, columns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    i = np.clip((omega / SPEED_STEP).astype(int), 0, rows - 1)
    return i, np.clip((torque / TORQUE_STEP).astype(int), 0, columns - 1)
