"""Pontryagin's conditions along a planned drive: how far the dynamic programme's plan is from an extremal.

Per metre of road, with lambda = -dV/dE (J per m2/s2; lambda_v = v lambda):
    H(u) = lambda (F - R)/M_eff - fuel per metre - W/v        the plan's action should maximise it
    d lambda/ds = -dH/dE                                      where no speed limit is touched (there lambda may jump)
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.drive_table import DriveTable
from controller.route_kernel import hold_line


@dataclass(frozen=True)
class Stages:
    """The road cut into K even stages; arrays (K,) but for `s` and `top` (K+1,)."""

    s: NDArray[np.float64]
    ds: NDArray[np.float64]
    grade_force: NDArray[np.float64]
    """M g (sin theta + C_rr cos theta), N."""
    top: NDArray[np.float64]
    """Highest kinetic energy v^2/2 at each place, m2/s2."""
    slow_speed: NDArray[np.float64]
    """m/s."""


@dataclass(frozen=True)
class Path:
    """A plan on the stages."""

    energy: NDArray[np.float64]
    """E (K+1,)."""
    gear: NDArray[np.int64]
    """(K,); 0 off the throttle."""
    seconds: NDArray[np.float64]
    """(K,)."""
    fuel: NDArray[np.float64]
    """(K,), J."""
    costate: NDArray[np.float64]
    """lambda_v (K+1,)."""
    cost: float
    """Cost to go at the start, J."""


def swings(stages: Stages, path: Path, energy_step: float) -> int:
    """Driven stages after which the acceleration changes sign from more than 0.25 m/s2 to less than -0.25, or back.

    A change between neighbouring energies of the grid (`energy_step`, m2/s2) does not count: those lie on both sides of
    a steady speed.
    """
    acceleration = np.diff(path.energy) / stages.ds
    least = np.maximum(0.25, 1.5 * energy_step / stages.ds[1:])
    strong = np.minimum(np.abs(acceleration[1:]), np.abs(acceleration[:-1])) > least
    driven = (path.gear[1:] > 0) & (path.gear[:-1] > 0)
    return int(np.count_nonzero(driven & strong & (acceleration[1:] * acceleration[:-1] < 0.0)))


def certify_plan(
    table: DriveTable,
    stages: Stages,
    path: Path,
    drag: float,
    time_value: float,
    comfort: float,
    hold: tuple[NDArray[np.float64], ...],
) -> dict[str, float]:
    """Return `maximum_gap`, `costate_error`, `pulses`, `swings` and `hull_gain` of a plan.

    `hold` are the lines that take the reward out of pulse and glide, as the plan was charged by them (`hold_lines`).
    maximum_gap: mean of max H - H(own) over every gear and force within `comfort` m/s2, as a share of the running
    cost; costate_error: median mismatch of the costate equation over one stage, as a share of the costate; both where
    neither a speed limit nor the lowest engine speed of the gear is touched (there the costate may jump);
    pulses: returns from rolling to driving; swings: those of `swings`, the throttle open; hull_gain: share of fuel per
    metre by which the lower convex hull over force, all gears and rolling together, lies under the plan's driving:
    what pulse and glide would be rewarded with.
    """
    k = np.arange(len(stages.ds))
    middle = 0.5 * (path.energy[1:] + path.energy[:-1])
    row = np.clip(np.rint(2.0 * middle / table.energy_step).astype(int), 1, len(table.coast_force) - 2)
    start = np.clip(np.rint(2.0 * path.energy[:-1] / table.energy_step).astype(int), 0, len(table.coast_force) - 1)
    speed = np.sqrt(2.0 * np.maximum(middle, 1e-3))
    worth = path.costate[:-1] / np.sqrt(2.0 * np.maximum(path.energy[:-1], 1e-3))
    load = stages.grade_force + drag * middle
    acceleration = np.diff(path.energy) / stages.ds
    running = path.fuel / stages.ds + time_value / speed
    lines = [hold_line(*hold, int(r), float(f)) for r, f in zip(row, load, strict=True)]
    base, lean, bend = (np.array(part) for part in zip(*lines, strict=True))
    lean = lean * table.mass[-1]

    def held(a: NDArray[np.float64]) -> NDArray[np.float64]:
        return base + a * (lean + a * bend)

    own = worth * acceleration - np.maximum(path.fuel / stages.ds, held(acceleration))

    low, high, burnt = table.force_low[:, row], table.force_high[:, row], table.fuel[:, row, :]
    usable = (high > 0.0) & (table.force_high[:, start] > 0.0)
    share = np.linspace(0.0, 1.0, burnt.shape[2])
    with np.errstate(invalid="ignore"):
        force = np.where(usable, low, 0.0)[..., None] + np.where(usable, high - low, 0.0)[..., None] * share
    possible = (force - load[None, :, None]) / table.mass[:, None, None]
    allowed = usable[..., None] & (possible <= comfort)
    charged = np.maximum(burnt, np.moveaxis(held(np.moveaxis(possible, 1, 2)), 2, 1))
    best = np.max(np.where(allowed, worth[None, :, None] * possible - charged, -np.inf), axis=(0, 2))
    slowing = (table.coast_force[row] - load) / table.coast_mass[row]
    best = np.maximum(best, worth * slowing - np.maximum(table.coast_fuel[row], held(slowing)))
    inside = (path.energy[1:] < stages.top[1:] * (1.0 - 1e-9)) & (path.energy[:-1] > 25.0) & (path.gear > 0)
    inside &= table.force_high[np.maximum(path.gear, 1) - 1, np.maximum(start - 4, 0)] > 0.0
    gap = np.maximum(best - own, 0.0)

    chosen = np.maximum(path.gear, 1) - 1
    pull = table.mass[chosen] * acceleration + load
    slope = (_at(table, chosen, row + 1, pull) - _at(table, chosen, row - 1, pull)) / table.energy_step
    predicted = worth[:-1] + (stages.ds * (worth * drag / table.mass[chosen] + slope - time_value / speed**3))[:-1]
    free = inside[:-1] & inside[1:] & (path.gear[:-1] == path.gear[1:]) & np.isfinite(predicted)
    mismatch = np.abs(predicted - worth[1:])[free]
    error = float(np.median(mismatch) / np.mean(worth[1:][free])) if free.any() else 0.0

    driving = np.flatnonzero(inside | ((path.gear > 0) & (path.energy[:-1] > 25.0)))
    sample = driving[:: max(len(driving) // 12, 1)]
    gains = [_hull_gain(table, int(row[i]), float(pull[i]), float(path.fuel[i] / stages.ds[i])) for i in sample]
    return {
        "maximum_gap": float(np.mean(gap[inside]) / np.mean(running)) if inside.any() else 0.0,
        "costate_error": error,
        "pulses": float(np.count_nonzero((path.gear[:-1] == 0) & (path.gear[1:] > 0) & (path.energy[1:-1] > 25.0))),
        "swings": float(swings(stages, path, table.energy_step)),
        "hull_gain": float(np.mean(gains)) if gains else 0.0,
        "stages": float(len(k)),
    }


def _at(table: DriveTable, gear: NDArray[np.int64], row: NDArray[np.int64], force: NDArray) -> NDArray[np.float64]:
    """Fuel per metre at `force`, J/m; NaN where the gear cannot be used there."""
    low, high = table.force_low[gear, row], table.force_high[gear, row]
    usable = high > 0.0
    with np.errstate(invalid="ignore"):
        x = np.where(usable, (force - low) / np.where(usable, high - low, 1.0), 0.0) * (table.fuel.shape[2] - 1)
    x = np.clip(x, 0.0, table.fuel.shape[2] - 1.0)
    q = np.minimum(x.astype(int), table.fuel.shape[2] - 2)
    fuel = table.fuel[gear, row]
    below = np.take_along_axis(fuel, q[:, None], axis=1)[:, 0]
    above = np.take_along_axis(fuel, q[:, None] + 1, axis=1)[:, 0]
    return np.where(usable, below + (x - q) * (above - below), np.nan)


def _hull_gain(table: DriveTable, row: int, force: float, burnt: float) -> float:
    """1 - hull(force)/burnt at one speed: the best mixture of two forces (any gears, or rolling) with this mean."""
    usable = table.force_high[:, row] > 0.0
    share = np.linspace(0.0, 1.0, table.fuel.shape[2])
    low, high = table.force_low[usable, row], table.force_high[usable, row]
    points = np.append((low[:, None] + (high - low)[:, None] * share).ravel(), table.coast_force[row])
    costs = np.append(table.fuel[usable, row].ravel(), table.coast_fuel[row])
    left, right = points <= force, points >= force
    if not left.any() or not right.any() or burnt <= 0.0:
        return 0.0
    x0, x1 = points[left][:, None], points[right][None, :]
    y0, y1 = costs[left][:, None], costs[right][None, :]
    weight = np.where(x1 > x0, (force - x0) / np.where(x1 > x0, x1 - x0, 1.0), 0.0)
    return max(1.0 - float(np.min(y0 + weight * (y1 - y0))) / burnt, 0.0)
