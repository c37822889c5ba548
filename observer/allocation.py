"""Which cell does a sample belong to? By its fuel, not by its thrust alone.

The error of the thrust enters a sample's torque and its efficiency alike. Sorting samples into cells by that torque
collects, in the outermost cells, those whose thrust is estimated too high, and their efficiency with it (0.01 to 0.03
near full load). The fuel power is known ten times better: the torque that the whole of the trips shows for that fuel
power at that engine speed, T = g(omega, P_in / omega), says where a sample lies; its own thrust then says the
efficiency there.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.special import comb

from observer.operating_points import OperatingPoints
from vehicle_model.car.parameters import Car

ORDERS = (3, 3, 3)
"""Degree in engine speed of the coefficients of 1, p and p^2, p = P_in / omega."""
DRAGGING = -4.0
"""N m: a fired engine locked to the road pushes at least this hard; below, the brakes are on."""
SPEED_BIN, FUEL_BIN = 5.0, 5.0
"""rad/s and N m of fuel torque: bins of the local part of g."""
WIDTH = (2.0, 1.5)
"""Standard deviations of its Gaussian kernel, bins."""
LOCAL_PRIOR = 1.5
"""N m: how far the local part may lie from zero."""
CORRELATION_TIME = 0.7
"""s over which errors of the thrust stay alike."""
MODEL_ERROR = (0.25, 0.006)
"""N m, and relative: standard deviation of g beyond its statistical error."""
OUTLIER = 4.0
"""Standard deviations from g beyond which a sample is none of the engine's alone (brakes, a wrong gear)."""
LEAST_SAMPLES = 300


def allocate(trips: Sequence[OperatingPoints], car: Car) -> list[tuple[NDArray[np.float64], NDArray[np.bool_]]]:
    """Return for each trip the torque (n,) that says each sample's cell, and which samples agree with it (n,).

    The torque is the mean of the sample's own and of g, weighted by their variances. g is a polynomial, robustly fitted
    over all trips, plus a local mean of what it leaves, shrunk towards zero where there is little.
    """
    used = [trip.firing & (trip.torque > DRAGGING) for trip in trips]
    joined = [np.concatenate([np.empty(0)] + [_columns(trip)[i][use] for trip, use in zip(trips, used, strict=True)])
              for i in range(4)]  # fmt: skip
    omega, fuel, torque, variance = joined
    if len(omega) < LEAST_SAMPLES:
        return [(trip.torque, np.ones(len(trip.torque), bool)) for trip in trips]
    coefficients, keep = _robust_fit(_rows(omega, fuel, car), torque, np.sqrt(variance + (0.3 + 0.02 * torque) ** 2))
    left = torque - _rows(omega, fuel, car) @ coefficients
    effective = trips[0].step / CORRELATION_TIME / (variance + MODEL_ERROR[0] ** 2)
    shape = (int(1.2 * car.engine.redline_speed / SPEED_BIN), int(8.0 * car.engine.max_torque / FUEL_BIN))
    total, weight = np.zeros(shape), np.zeros(shape)
    place = _bins(omega[keep], fuel[keep], shape)
    np.add.at(weight, place, effective[keep])
    np.add.at(total, place, (effective * left)[keep])
    # a Gaussian kernel of unit height: sums of information, not densities
    height = 2.0 * np.pi * WIDTH[0] * WIDTH[1]
    weight, total = (height * gaussian_filter(grid, WIDTH, mode="constant") for grid in (weight, total))
    local, doubt = total / (weight + LOCAL_PRIOR**-2), 1.0 / (weight + LOCAL_PRIOR**-2)

    allocated = []
    for trip in trips:
        omega, fuel, own_torque, own = _columns(trip)
        place = _bins(omega, fuel, shape)
        model = _rows(omega, fuel, car) @ coefficients + local[place]
        unsure = doubt[place] + MODEL_ERROR[0] ** 2 + (MODEL_ERROR[1] * model) ** 2
        share = own / (own + unsure)
        agrees = np.abs(own_torque - model) < OUTLIER * np.sqrt(own + unsure)
        allocated.append((share * model + (1.0 - share) * own_torque, agrees))
    return allocated


def _columns(trip: OperatingPoints) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Engine speed, fuel torque P_in / omega, torque and its variance, each (n,)."""
    fuel = trip.fuel_power / np.maximum(trip.engine_speed, 1.0)
    return trip.engine_speed, fuel, trip.torque, trip.variance * fuel**2


def _bins(omega: NDArray, fuel: NDArray, shape: tuple[int, int]) -> tuple[NDArray, NDArray]:
    column = np.clip(np.nan_to_num(omega) / SPEED_BIN, 0, shape[0] - 1).astype(int)
    return column, np.clip(np.nan_to_num(fuel) / FUEL_BIN, 0, shape[1] - 1).astype(int)


def _robust_fit(rows: NDArray, torque: NDArray, sigma: NDArray) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Weighted least squares with a weak ridge, then twice more without what lies too far off; and what was kept."""
    ridge = 1e-2 * np.eye(rows.shape[1])
    keep = np.ones(len(torque), bool)
    coefficients = np.zeros(rows.shape[1])
    for _ in range(3):
        weighted = rows[keep] / sigma[keep, None]
        coefficients = np.linalg.solve(weighted.T @ weighted + ridge, weighted.T @ (torque[keep] / sigma[keep]))
        off = np.abs(torque - rows @ coefficients) / sigma
        keep = off < OUTLIER * max(1.0, 1.48 * float(np.median(off[keep])))
    return np.asarray(coefficients, float), np.asarray(keep, bool)


def _rows(omega: NDArray, fuel: NDArray, car: Car) -> NDArray[np.float64]:
    """Bernstein polynomials of engine speed times powers of the fuel's torque."""
    low, high = 0.8 * car.engine.idle_speed, car.engine.redline_speed
    x = np.clip((omega - low) / (high - low), 0.0, 1.05)
    p = fuel / (3.0 * car.engine.max_torque)
    columns = [
        comb(order, k) * x**k * (1.0 - x) ** (order - k) * p**degree
        for degree, order in enumerate(ORDERS)
        for k in range(order + 1)
    ]
    return np.stack(columns, axis=-1)
