"""The true efficiency map of a trip: what an ideal observer of that trip could find at best (DESIGN.md)."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from observer.efficiency_map import SPEED_STEP, TORQUE_STEP
from vehicle_model.car.parameters import Car
from vehicle_model.car.trip import Trip
from vehicle_model.plant import steady
from vehicle_model.plant.parameters import plant_parameters

Array = NDArray[np.float64]


def gear_times(trips: Sequence[Trip]) -> dict[int, dict[tuple[int, int], float]]:
    """Seconds driven in each gear and cell of 50 rpm by 2 Nm, over `trips`: {gear: {(column, row): s}}."""
    times: dict[int, dict[tuple[int, int], float]] = {}
    for trip in trips:
        c = trip.channels
        use = (c["clutch"] >= 1.0) & (c["gear"] >= 1.0) & (c["thrust"] > 0.0) & (c["fuel_power"] > 0.0)
        omega = c["engine_speed"][use]
        torque = c["thrust"][use] * c["speed"][use] / omega
        cells = np.stack([c["gear"][use], omega // SPEED_STEP, torque // TORQUE_STEP], axis=1).astype(int)
        for (gear, column, row), count in zip(*np.unique(cells, axis=0, return_counts=True), strict=True):
            cell = times.setdefault(int(gear), {})
            cell[int(column), int(row)] = cell.get((int(column), int(row)), 0.0) + count * trip.step
    return times


def true_efficiency(car: Car, settings: Mapping[str, float], trips: Sequence[Trip]) -> Callable[[Array, Array], Array]:
    """Return eta(engine_speed, torque): fuel to wheel, steady, gears weighted by the trips' time in the cell.

    The callable takes arrays of equal shape, rad/s and N m (wheel level); where the trips never were, the gears count
    by their time over the whole of the trips.
    """
    parameters = plant_parameters(car, settings)
    times = gear_times(trips)
    overall = {gear: sum(cells.values()) for gear, cells in times.items()} or {1: 1.0}

    def efficiency(engine_speed: Array, torque: Array) -> Array:
        omega, wanted = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        columns, rows = (omega // SPEED_STEP).astype(int).ravel(), (wanted // TORQUE_STEP).astype(int).ravel()
        power, weight = np.zeros(omega.size), np.zeros(omega.size)
        seen = [any((c, r) in cells for cells in times.values()) for c, r in zip(columns, rows, strict=True)]
        for gear, total in overall.items():
            cells = times.get(gear, {})
            share = np.array(
                [cells.get((c, r), 0.0) if known else total for c, r, known in zip(columns, rows, seen, strict=True)]
            )
            power += share * steady.fuel_power(parameters, gear, omega.ravel(), wanted.ravel())
            weight += share
        return (omega * wanted) / (power / weight).reshape(omega.shape)

    return efficiency
