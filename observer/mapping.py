"""The efficiency map from ordinary driving: grid, weights, validity, merging of trips (seed 004, 3.3.4 and 3.4)."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from observer.efficiency_map import SPEED_STEP, TORQUE_STEP, EfficiencyMap, FuelMap, Limits
from observer.envelope import declared_torque, default_overrun, observed_limits
from observer.estimate import Estimate
from observer.fits import Fit
from observer.operating_points import OperatingPoints, operating_points
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

MIN_SECONDS, MIN_VISITS, MAX_DEVIATION = 0.5, 2, 0.05
"""The validity rule of DESIGN.md."""
CORRELATION_TIME = 0.5
"""s over which the errors of the estimate stay alike: a stay of d seconds counts as 1 + d / this samples."""
VISIT_SCATTER = 0.006
"""Efficiency: what a stay is off by however long it lasts (grade, wind, warmth, transients); a prior, replaced by what
the scatter between stays shows once there are enough of them."""
TRIP_SCATTER = 0.006
"""Relative: what all samples of a trip are off by together (mass, wind, fuel scale inside the tolerances)."""


def map_engine(estimates: Sequence[Estimate], car: Car, *, smoothed: bool = True) -> EfficiencyMap:
    """Return the efficiency map that the trips show together, on the grid of 50 rpm by 2 N m.

    Each stay in a cell (contiguous samples) gives one mean, weighted by the observer's covariance of its samples over
    their *effective* number, plus a scatter between stays: a long stay is not many measurements. Trips merge by the
    same weights. `smoothed` takes the smoother's states, else the causal filter's.
    """
    trips = [operating_points(estimate, car, smoothed=smoothed) for estimate in estimates]
    columns = int(np.ceil(1.1 * car.engine.redline_speed / SPEED_STEP))
    rows = int(np.ceil(1.5 * car.engine.max_torque / TORQUE_STEP))
    stays = _stays(trips, columns, rows)
    fuel_total = sum(_fuel_burnt(estimate, smoothed=smoothed) for estimate in estimates)
    limits = observed_limits(trips, estimates, car, columns, smoothed=smoothed)
    return _grid(stays, columns, rows, fuel_total, limits, len(trips))


def _fuel_burnt(estimate: Estimate, *, smoothed: bool) -> float:
    """J over the trip: fuel energy at the end minus at the start."""
    energy = estimate.column("fuel_energy", smoothed=smoothed)
    energy = energy[np.isfinite(energy)]
    return float(energy[-1] - energy[0]) if len(energy) else 0.0


_INTEGERS, _REALS = ("trip", "cell", "count"), ("seconds", "fuel", "eta", "square", "omega", "torque", "variance")
STAY = np.dtype([*((name, "i8") for name in _INTEGERS), *((name, "f8") for name in _REALS)])
"""One stay: sums over its samples divided by `count`; `variance` that of its mean, from the observer's covariance."""


def _stays(trips: Sequence[OperatingPoints], columns: int, rows: int) -> NDArray:
    """Every stay of every trip in a cell, shape (k,), dtype STAY."""
    found = [np.empty(0, STAY)]
    for number, trip in enumerate(trips):
        column = np.floor(trip.engine_speed / SPEED_STEP)
        row = np.floor(trip.torque / TORQUE_STEP)
        inside = trip.mapped & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        index = np.flatnonzero(inside)
        if not len(index):
            continue
        cell = (column[index] * rows + row[index]).astype(np.int64)
        new = np.ones(len(index), bool)
        new[1:] = (np.diff(index) > 1) | (np.diff(cell) != 0)
        starts = np.flatnonzero(new)
        count = np.diff(np.append(starts, len(index)))
        power, fuel = trip.power[index], np.maximum(trip.fuel_power[index], 1.0)

        def mean(values: NDArray, starts: NDArray = starts, count: NDArray = count) -> NDArray:
            return np.add.reduceat(values, starts) / count

        eta = power / fuel
        stays = np.empty(len(starts), STAY)
        stays["trip"], stays["cell"], stays["count"] = number, cell[starts], count
        stays["seconds"] = count * trip.step
        stays["fuel"] = mean(fuel) * stays["seconds"]
        stays["eta"] = mean(power) / mean(fuel)
        stays["square"] = mean(eta**2) - mean(eta) ** 2
        stays["omega"], stays["torque"] = mean(trip.engine_speed[index]), mean(trip.torque[index])
        stays["variance"] = mean(trip.variance[index]) / (1.0 + stays["seconds"] / CORRELATION_TIME)
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
        mean, omega, torque = (total(weight * stays[name]) / weights for name in ("eta", "omega", "torque"))
        count = total(stays["count"].astype(float))
        spread = total(stays["count"] * (stays["square"] + (stays["eta"] - mean[cell]) ** 2)) / count
        trips_seen = np.maximum(np.bincount(np.unique(np.stack([stays["trip"], cell]), axis=1)[1], minlength=size), 1)
        error = np.sqrt(1.0 / weights + (TRIP_SCATTER * mean) ** 2 / trips_seen)
    deviation = np.sqrt(np.maximum(spread, 0.0))
    seconds, visits = total(stays["seconds"]), np.bincount(cell, minlength=size)
    valid = (seconds >= MIN_SECONDS - 1e-9) & (visits >= MIN_VISITS) & (deviation <= MAX_DEVIATION)
    shape = (columns, rows)
    return EfficiencyMap(
        engine_speed=(np.arange(columns) + 0.5) * SPEED_STEP,
        torque=(np.arange(rows) + 0.5) * TORQUE_STEP,
        mean=mean.reshape(shape),
        deviation=deviation.reshape(shape),
        count=count.astype(np.int64).reshape(shape),
        visits=visits.astype(np.int64).reshape(shape),
        seconds=seconds.reshape(shape),
        fuel=total(stays["fuel"]).reshape(shape),
        valid=valid.reshape(shape),
        fuel_total=float(fuel_total),
        standard_error=np.where(weights > 0, error, np.nan).reshape(shape),
        engine_speed_mean=omega.reshape(shape),
        torque_mean=torque.reshape(shape),
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
    """Return the rms of mean - truth over the valid cells, NaN if there are none.

    `true_efficiency(engine_speed, torque)` takes rad/s and N m, arrays (k,); it is asked at the samples' mean place in
    each cell. Never state the figure without `efficiency_map.fuel_share`.
    """
    valid = efficiency_map.valid
    if not valid.any():
        return float("nan")
    omega, torque = places(efficiency_map)
    return float(np.sqrt(np.mean((efficiency_map.mean[valid] - true_efficiency(omega[valid], torque[valid])) ** 2)))


def fit_error(efficiency_map: EfficiencyMap, fit: Fit, true_efficiency: Callable[[NDArray, NDArray], NDArray]) -> float:
    """Return the rms of fit - truth at the centres of the valid cells, NaN if there are none."""
    omega, torque = np.meshgrid(efficiency_map.engine_speed, efficiency_map.torque, indexing="ij")
    omega, torque = omega[efficiency_map.valid], torque[efficiency_map.valid]
    if not len(omega):
        return float("nan")
    return float(np.sqrt(np.mean((fit.efficiency(omega, torque) - true_efficiency(omega, torque)) ** 2)))


def places(efficiency_map: EfficiencyMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Engine speed and torque that each cell's mean stands for, (n, m): the samples' mean, else the centre."""
    omega, torque = np.meshgrid(efficiency_map.engine_speed, efficiency_map.torque, indexing="ij")
    if efficiency_map.torque_mean.shape != omega.shape:
        return omega, torque
    seen = np.isfinite(efficiency_map.torque_mean)
    return (
        np.where(seen, efficiency_map.engine_speed_mean, omega),
        np.where(seen, efficiency_map.torque_mean, torque),
    )


def fuel_map(efficiency_map: EfficiencyMap, car: Car, fit: Fit) -> FuelMap:
    """Return the planner's table: `fit` over the engine's whole range, with the limits that were seen or declared.

    Finite everywhere and positive at zero torque whatever the fit does there: fuel power is kept at or above that of a
    loss-free engine (efficiency 0.6) and above a tenth of the idle's per engine speed, and never falls with torque.
    """
    engine = car.engine
    first = np.floor(engine.idle_speed / SPEED_STEP)
    omega = np.arange(first, np.ceil(engine.redline_speed / SPEED_STEP) + 1) * SPEED_STEP
    limits = efficiency_map.limits
    declared = declared_torque(omega, car)
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
    power = np.maximum.accumulate(power, axis=1)
    return FuelMap(omega, torque, power, torque_max, overrun, float(idle_power), float(engine.idle_speed))


def _seen_or(declared: NDArray, columns: NDArray, seen: NDArray, omega: NDArray) -> NDArray[np.float64]:
    """`declared` (n,) at `omega`, scaled by seen / declared, interpolated over the columns where it was seen."""
    known = np.flatnonzero(np.isfinite(seen))
    if not len(known):
        return declared
    ratio = seen[known] / np.interp(columns[known], omega, declared)
    return declared * np.interp(omega, columns[known], ratio)


_TABLES = ("mean", "deviation", "count", "visits", "seconds", "fuel", "valid")
_TABLES += ("standard_error", "engine_speed_mean", "torque_mean")


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
    return EfficiencyMap(omega, torque, fuel_total=head["fuel_total_J"], limits=limits, trips=head["trips"], **tables)


def _listed(values: NDArray) -> list[float | None]:
    """JSON has no NaN."""
    return [float(value) if np.isfinite(value) else None for value in values]


def _array(values: list[float | None]) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values], dtype=float)
