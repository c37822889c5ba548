"""The efficiency map from ordinary driving: grid, weights, validity, merging of trips (seed 004, 3.3.4 and 3.4)."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from observer.allocation import allocate
from observer.efficiency_map import SPEED_STEP, TORQUE_STEP, EfficiencyMap, FuelMap, Limits
from observer.envelope import (
    LEAST_CELLS,
    WHEEL_SHARE,
    declared_torque,
    default_overrun,
    drag_of_lines,
    observed_limits,
)
from observer.estimate import Estimate
from observer.fit_form import PLACE_SCATTER, Fit, valid_cells
from observer.fit_willans import fit_willans
from observer.operating_points import TORQUE_FLOOR, OperatingPoints, gear_ratios, operating_points
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

MIN_SECONDS, MIN_VISITS, MAX_DEVIATION = 0.5, 2, 0.05
"""The validity rule of DESIGN.md."""
CORRELATION_TIME = 1.0
"""s over which the errors of the estimate stay alike: a stay of d seconds counts as 1 + d / this samples."""
VISIT_SCATTER = 0.006
"""Efficiency: what a stay is off by however long it lasts (grade, wind, warmth, transients); a prior, replaced by what
the scatter between stays shows once there are enough of them."""
LEAST_TORQUE = -3.0
"""N m: where a sample's own torque is cut off before it enters a fit."""
TRIP_SCATTER, COMMON_SCATTER = 0.006, 0.006
"""Relative, of the torque: what all samples of a trip are off by together (payload, warmth), and what no further trip
takes away (mass, squat, fuel scale inside the tolerances)."""
CRUISE = 25.0
"""m/s at which the tolerances of the road load are turned into an error of the torque in top gear."""


def map_engine(estimates: Sequence[Estimate], car: Car, *, smoothed: bool = True) -> EfficiencyMap:
    """Return the efficiency map that the trips show together, on the grid of 50 rpm by 2 N m.

    A sample belongs to the cell that its fuel says (`observer.allocation`), and is moved from where it lies to the
    cell's centre along a first Willans fit of the same trips, eta = eta_fit(centre) P_fit(omega, T) / P_in: inside a
    cell, and within the error of the torque, the fit's slope is all that is used of it. Each stay in a cell (contiguous
    samples) gives one mean, weighted by the observer's covariance of its samples over their *effective* number, plus a
    scatter between stays: a long stay is not many measurements. Trips merge by the same weights. `smoothed` takes the
    smoother's states, else the causal filter's.
    """
    trips = [operating_points(estimate, car, smoothed=smoothed) for estimate in estimates]
    columns = int(np.ceil(1.1 * car.engine.redline_speed / SPEED_STEP))
    rows = int(np.ceil(1.5 * car.engine.max_torque / TORQUE_STEP))
    allocated = allocate(trips, car)
    fuel_total = sum(_fuel_burnt(estimate, smoothed=smoothed) for estimate in estimates)
    limits = observed_limits(trips, estimates, car, columns, smoothed=smoothed)
    first = _grid(_stays(trips, allocated, columns, rows, None), columns, rows, fuel_total, limits, len(trips))
    tangent = fit_willans(valid_cells(first), car, limits)
    if first.valid.sum() >= LEAST_CELLS:
        limits = replace(limits, overrun_torque=drag_of_lines(trips, tangent, car, columns))
    found = _grid(_stays(trips, allocated, columns, rows, tangent), columns, rows, fuel_total, limits, len(trips))
    # a relative error of the torque moves eta at a given torque by the slope of the Willans line only
    omega, torque = np.meshgrid(found.engine_speed, found.torque, indexing="ij")
    common = shared_torque_error(car, len(trips))
    relative = np.hypot(PLACE_SCATTER, tangent.shared_error(omega, torque, common))
    error = np.hypot(found.standard_error, found.mean * relative)
    return replace(found, standard_error=error, common_error=common)


def shared_torque_error(car: Car, trips: int) -> tuple[float, float]:
    """Standard deviation of the torque's error that all cells share: N m, and relative.

    The first is the road load inside the car's declared tolerances (limits, hence / sqrt(3)): rolling resistance, drag,
    air density and wind at `CRUISE`, turned into torque by the top gear.
    """
    limits = car.tolerances
    drag = 0.5 * car.air_density * car.drag_area * CRUISE**2
    parts = (
        limits.rolling_resistance * car.rolling_resistance * car.mass * car.gravity,
        drag * limits.drag_area,
        drag * limits.air_density,
        drag * 2.0 * limits.wind / CRUISE,
    )
    force = float(np.linalg.norm(parts)) / np.sqrt(3.0)
    relative = float(np.hypot(COMMON_SCATTER, TRIP_SCATTER / np.sqrt(max(trips, 1))))
    return float(force / gear_ratios(car).min()), relative


def _fuel_burnt(estimate: Estimate, *, smoothed: bool) -> float:
    """J over the trip: fuel energy at the end minus at the start."""
    energy = estimate.column("fuel_energy", smoothed=smoothed)
    energy = energy[np.isfinite(energy)]
    return float(energy[-1] - energy[0]) if len(energy) else 0.0


_INTEGERS, _REALS = ("trip", "cell", "count"), ("seconds", "fuel", "eta", "square", "variance")
STAY = np.dtype([*((name, "i8") for name in _INTEGERS), *((name, "f8") for name in _REALS)])
"""One stay: sums over its samples divided by `count`; `variance` that of its mean, from the observer's covariance."""


def _stays(
    trips: Sequence[OperatingPoints],
    allocated: Sequence[tuple[NDArray, NDArray]],
    columns: int,
    rows: int,
    tangent: Fit | None,
) -> NDArray:
    """Every stay of every trip in a cell, shape (k,), dtype STAY; moved to the cells' centres along `tangent`."""
    found = [np.empty(0, STAY)]
    for number, (trip, (torque, agrees)) in enumerate(zip(trips, allocated, strict=True)):
        column, row = np.floor(trip.engine_speed / SPEED_STEP), np.floor(torque / TORQUE_STEP)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        index = np.flatnonzero(trip.firing & agrees & (torque > TORQUE_FLOOR) & inside)
        if not len(index):
            continue
        cell = (column[index] * rows + row[index]).astype(np.int64)
        new = np.ones(len(index), bool)
        new[1:] = (np.diff(index) > 1) | (np.diff(cell) != 0)
        starts = np.flatnonzero(new)
        count = np.diff(np.append(starts, len(index)))
        fuel = np.maximum(trip.fuel_power[index], 1.0)
        worth, variance = trip.power[index], trip.variance[index]
        if tangent is not None:
            centre = tangent.efficiency((column[index] + 0.5) * SPEED_STEP, (row[index] + 0.5) * TORQUE_STEP)
            omega, own = trip.engine_speed[index], np.maximum(trip.torque[index], LEAST_TORQUE)
            worth = centre * tangent.fuel_power(omega, own)
            # an error of the torque moves P_fit by its slope, and eta by less than in P_out / P_in
            variance = variance * tangent.steepness(omega, torque[index]) ** 2

        def mean(values: NDArray, starts: NDArray = starts, count: NDArray = count) -> NDArray:
            return np.add.reduceat(values, starts) / count

        eta = worth / fuel
        stays = np.empty(len(starts), STAY)
        stays["trip"], stays["cell"], stays["count"] = number, cell[starts], count
        stays["seconds"] = count * trip.step
        stays["fuel"] = mean(fuel) * stays["seconds"]
        stays["eta"] = mean(worth) / mean(fuel)
        stays["square"] = mean(eta**2) - mean(eta) ** 2
        stays["variance"] = mean(variance) / (1.0 + stays["seconds"] / CORRELATION_TIME)
        found.append(stays)
    return np.concatenate(found)


def _grid(stays: NDArray, columns: int, rows: int, fuel_total: float, limits: Limits, trips: int) -> EfficiencyMap:
    """Stays into cells."""
    size, cell = columns * rows, stays["cell"]

    def total(values: NDArray) -> NDArray:
        return np.bincount(cell, values, minlength=size)

    between = _scatter_between_stays(stays, size)
    weight = 1.0 / (stays["variance"] + between**2)
    weights = total(weight)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total(weight * stays["eta"]) / weights
        count = total(stays["count"].astype(float))
        spread = total(stays["count"] * (stays["square"] + (stays["eta"] - mean[cell]) ** 2)) / count
        error = np.sqrt(1.0 / weights)
    deviation = np.sqrt(np.maximum(spread, 0.0))
    seconds, visits = total(stays["seconds"]), np.bincount(cell, minlength=size)
    valid = (seconds >= MIN_SECONDS - 1e-9) & (visits >= MIN_VISITS) & (deviation <= MAX_DEVIATION)
    shape = (columns, rows)
    return EfficiencyMap(
        engine_speed=np.asarray((np.arange(columns) + 0.5) * SPEED_STEP, float),
        torque=np.asarray((np.arange(rows) + 0.5) * TORQUE_STEP, float),
        mean=mean.reshape(shape),
        deviation=deviation.reshape(shape),
        count=count.astype(np.int64).reshape(shape),
        visits=visits.astype(np.int64).reshape(shape),
        seconds=seconds.reshape(shape),
        fuel=total(stays["fuel"]).reshape(shape),
        valid=valid.reshape(shape),
        fuel_total=float(fuel_total),
        standard_error=np.where(weights > 0, error, np.nan).reshape(shape),
        limits=limits,
        trips=trips,
    )


def _scatter_between_stays(stays: NDArray, size: int) -> float:
    """Standard deviation of a stay's mean beyond what the observer's covariance explains (method of moments).

    From the cells with several stays; the prior counts as fifty degrees of freedom.
    """
    cell = stays["cell"]
    visits = np.bincount(cell, minlength=size)
    several = visits[cell] > 1
    if not several.any():
        return VISIT_SCATTER
    means = np.bincount(cell, stays["eta"], minlength=size) / np.maximum(visits, 1)
    square = (stays["eta"] - means[cell])[several] ** 2
    freedom = several.sum() - np.count_nonzero(visits > 1)
    explained = float(stays["variance"][several].mean())
    # the median resists the few stays that something else has spoilt: 0.455 is that of chi-squared with one freedom
    seen = float(np.median(square) / 0.455) * several.sum() / max(freedom, 1)
    beyond = max(seen - explained, 0.0)
    return float(np.sqrt((freedom * beyond + 50.0 * VISIT_SCATTER**2) / (freedom + 50.0)))


def map_error(efficiency_map: EfficiencyMap, true_efficiency: Callable[[NDArray, NDArray], NDArray]) -> float:
    """Return the rms of mean - truth at the centres of the valid cells, NaN if there are none.

    `true_efficiency(engine_speed, torque)` takes rad/s and N m, arrays (k,). Never state the figure without
    `efficiency_map.fuel_share`.
    """
    omega, torque = centres(efficiency_map)
    found = efficiency_map.mean[efficiency_map.valid]
    return float(np.sqrt(np.mean((found - true_efficiency(omega, torque)) ** 2))) if len(found) else float("nan")


def fit_error(efficiency_map: EfficiencyMap, fit: Fit, true_efficiency: Callable[[NDArray, NDArray], NDArray]) -> float:
    """Return the rms of fit - truth at the centres of the valid cells, NaN if there are none."""
    omega, torque = centres(efficiency_map)
    error = fit.efficiency(omega, torque) - true_efficiency(omega, torque)
    return float(np.sqrt(np.mean(error**2))) if len(error) else float("nan")


def centres(efficiency_map: EfficiencyMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Engine speed (rad/s) and torque (N m) at the centres of the valid cells, each (k,)."""
    omega, torque = np.meshgrid(efficiency_map.engine_speed, efficiency_map.torque, indexing="ij")
    return omega[efficiency_map.valid], torque[efficiency_map.valid]


def fuel_map(efficiency_map: EfficiencyMap, car: Car, fit: Fit) -> FuelMap:
    """Return the planner's table: `fit` over the engine's whole range, with the limits that were seen or declared.

    Finite everywhere and positive at zero torque whatever the fit does there: fuel power is kept at or above that of a
    loss-free engine (efficiency 0.6) and above a tenth of the idle's per engine speed, and rises convexly with torque.
    """
    engine = car.engine
    first = np.floor(engine.idle_speed / SPEED_STEP)
    omega = np.arange(first, np.ceil(engine.redline_speed / SPEED_STEP) + 1) * SPEED_STEP
    limits = efficiency_map.limits
    declared = WHEEL_SHARE * declared_torque(omega, car)
    torque_max = _seen_or(declared, efficiency_map.engine_speed, limits.torque_max, omega)
    overrun = np.minimum(
        _seen_or(default_overrun(omega, car), efficiency_map.engine_speed, limits.overrun_torque, omega), -0.5
    )
    torque = np.arange(0.0, torque_max.max() + 2.0 * TORQUE_STEP, TORQUE_STEP)
    grid_omega, grid_torque = np.meshgrid(omega, torque, indexing="ij")
    power = np.asarray(fit.fuel_power(grid_omega, grid_torque), dtype=float)
    idle_speed = limits.idle_speed if np.isfinite(limits.idle_speed) else engine.idle_speed
    idle_power = limits.idle_power
    if not np.isfinite(idle_power):
        idle_power = float(np.nan_to_num(fit.fuel_power(np.array([idle_speed]), np.array([0.0]))[0], nan=0.0))
        idle_power = max(idle_power, 0.5e5 * engine.displacement * idle_speed)
    floor = np.maximum(grid_omega * grid_torque / 0.6, 0.1 * idle_power * grid_omega / engine.idle_speed)
    power = np.maximum(np.where(np.isfinite(power), power, floor), floor)
    power = np.stack([_convex(column) for column in np.maximum.accumulate(power, axis=1)])
    return FuelMap(omega, torque, power, torque_max, overrun, float(idle_power), float(engine.idle_speed))


def _convex(values: NDArray) -> NDArray[np.float64]:
    """The values (m,) with their steps made to rise (isotonic regression) and the mean kept.

    Fuel power is convex in torque: pumping falls and enrichment sets in at the top. A dent that noise has made would
    be worth driving in to a planner, and cost fuel on the road.
    """
    steps = np.maximum(isotonic_regression(np.diff(values)).x, 0.0)
    shape = np.concatenate([[0.0], np.cumsum(steps)])
    return np.maximum(shape + float(np.mean(values - shape)), 0.5 * values.min())


def _seen_or(declared: NDArray, columns: NDArray, seen: NDArray, omega: NDArray) -> NDArray[np.float64]:
    """`declared` (n,) at `omega`, scaled by seen / declared, interpolated over the columns where it was seen."""
    known = np.flatnonzero(np.isfinite(seen))
    if not len(known):
        return declared
    ratio = seen[known] / np.interp(columns[known], omega, declared)
    return declared * np.interp(omega, columns[known], ratio)


_TABLES = ("mean", "deviation", "count", "visits", "seconds", "fuel", "valid", "standard_error")


def write(efficiency_map: EfficiencyMap, folder: Path, fits: dict[str, Fit] | None = None) -> None:
    """Write `map.json` (axes, totals, limits, fits' names and R2) and `map.parquet` (one row per cell, row-major)."""
    folder.mkdir(parents=True, exist_ok=True)
    shape, limits = efficiency_map.mean.shape, efficiency_map.limits
    head = {
        "engine_speed_rad_s": efficiency_map.engine_speed.tolist(),
        "torque_N_m": efficiency_map.torque.tolist(),
        "fuel_total_J": efficiency_map.fuel_total,
        "fuel_share": efficiency_map.fuel_share,
        "valid_cells": int(efficiency_map.valid.sum()),
        "trips": efficiency_map.trips,
        "common_error": efficiency_map.common_error,
        "torque_max_N_m": _listed(limits.torque_max),
        "overrun_torque_N_m": _listed(limits.overrun_torque),
        "idle_power_W": _listed(np.array([limits.idle_power]))[0],
        "idle_speed_rad_s": _listed(np.array([limits.idle_speed]))[0],
        "fits": [
            {"name": name, "r2": fit.r2, "r2_efficiency": fit.r2_efficiency} for name, fit in (fits or {}).items()
        ],
    }
    tables = {name: getattr(efficiency_map, name) for name in _TABLES}
    whole = {name: (table if table.shape == shape else np.full(shape, np.nan)) for name, table in tables.items()}
    rows = pa.table({name: table.ravel() for name, table in whole.items()})
    aside = folder / "map.parquet.part"
    pq.write_table(rows, aside, compression="zstd")
    aside_json = folder / "map.json.part"
    aside_json.write_text(json.dumps(head, indent=1) + "\n")
    aside.replace(folder / "map.parquet")
    aside_json.replace(folder / "map.json")


def read(folder: Path) -> EfficiencyMap:
    """Read what `write` wrote. Raises BadInput if a file is missing or does not fit the other."""
    try:
        head = json.loads((folder / "map.json").read_text())
        rows = pq.read_table(folder / "map.parquet")
        omega, torque = np.array(head["engine_speed_rad_s"]), np.array(head["torque_N_m"])
        shape = (len(omega), len(torque))
        tables = {name: rows[name].to_numpy().reshape(shape) for name in _TABLES}
        limits = Limits(
            _array(head["torque_max_N_m"]),
            _array(head["overrun_torque_N_m"]),
            float(_array([head["idle_power_W"]])[0]),
            float(_array([head["idle_speed_rad_s"]])[0]),
        )
    except FileNotFoundError as error:
        raise BadInput(
            folder, "", f"map.json and map.parquet expected, {Path(error.filename).name} is missing"
        ) from None
    except (KeyError, ValueError, TypeError, pa.ArrowException) as error:
        raise BadInput(folder, "map.json, map.parquet", f"a map as `write` writes it expected ({error})") from None
    totals = {"fuel_total": head["fuel_total_J"], "trips": head["trips"], "common_error": tuple(head["common_error"])}
    return EfficiencyMap(omega, torque, limits=limits, **totals, **tables)


def _listed(values: NDArray) -> list[float | None]:
    """JSON has no NaN."""
    return [float(value) if np.isfinite(value) else None for value in values]


def _array(values: list[float | None]) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values], dtype=float)
