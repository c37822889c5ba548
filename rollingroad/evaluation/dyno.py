"""The map found on the road beside the map found on the dynamometer (seed 004, 3.5)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.efficiency_map import EfficiencyMap
from observer.fit_form import Fit


@dataclass(frozen=True)
class DynoComparison:
    """Efficiencies are fractions of 1."""

    cells: int
    """Valid cells of the road's map that the dynamometer's range holds."""
    rmse: float
    """Road minus dynamometer, cell by cell."""
    fit_rmse: float
    scale: float
    """What the road's map must be multiplied by to fit the dynamometer's best: the scale error of 3.3.5."""
    scaled_rmse: float
    """What is left after that: the form."""
    peak_value_error: float
    """Value at the peak found on the road (fit, valid cells) minus the dynamometer's best."""


def compare_with_dyno(
    efficiency_map: EfficiencyMap,
    fit: Fit,
    engine_speed: NDArray,
    torque: NDArray,
    efficiency: NDArray,
    gear_shares: Callable[[NDArray, NDArray], NDArray] | None = None,
) -> DynoComparison:
    """Compare over the cells that both know.

    `engine_speed` (n,), rad/s, and `torque` (m,), N m, are the dynamometer's steps, `efficiency` what it found, NaN
    beyond full load: (n, m) in one gear; or (gears, n, m), a run in each, weighted at every cell by `gear_shares`
    (engine speed, torque -> (k, gears)), the road's own use of them. Cells outside the steps, or next to a NaN of a
    gear that was used there, are left out.
    """
    omega, load = np.meshgrid(efficiency_map.engine_speed, efficiency_map.torque, indexing="ij")
    omega, load = omega[efficiency_map.valid], load[efficiency_map.valid]
    if gear_shares is None:
        bench = _bilinear(engine_speed, torque, efficiency, omega, load)
    else:
        runs = np.stack([_bilinear(engine_speed, torque, run, omega, load) for run in efficiency], axis=1)
        shares = gear_shares(omega, load)
        bench = np.sum(np.where(shares > 0.0, shares * runs, 0.0), axis=1)
    both = np.isfinite(bench)
    nothing = float("nan")
    if not both.any():
        return DynoComparison(0, nothing, nothing, nothing, nothing, nothing)
    road, bench = efficiency_map.mean[efficiency_map.valid][both], bench[both]
    fitted = fit.efficiency(omega[both], load[both])
    scale = float(road @ bench / (road @ road))
    return DynoComparison(
        cells=int(both.sum()),
        rmse=_rms(road - bench),
        fit_rmse=_rms(fitted - bench),
        scale=scale,
        scaled_rmse=_rms(scale * road - bench),
        peak_value_error=float(fitted.max() - np.nanmax(efficiency)),
    )


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _bilinear(x: NDArray, y: NDArray, values: NDArray, at_x: NDArray, at_y: NDArray) -> NDArray[np.float64]:
    """Bilinear interpolation of `values` (n, m) over ascending `x`, `y`; NaN outside and beside a NaN."""
    i = np.clip(np.searchsorted(x, at_x) - 1, 0, len(x) - 2)
    j = np.clip(np.searchsorted(y, at_y) - 1, 0, len(y) - 2)
    a, b = (at_x - x[i]) / (x[i + 1] - x[i]), (at_y - y[j]) / (y[j + 1] - y[j])
    low = (1.0 - b) * values[i, j] + b * values[i, j + 1]
    high = (1.0 - b) * values[i + 1, j] + b * values[i + 1, j + 1]
    inside = (a >= 0.0) & (a <= 1.0) & (b >= 0.0) & (b <= 1.0)
    return np.where(inside, (1.0 - a) * low + a * high, np.nan)
