"""The polynomials of seed 004, 3.4: eta, phi = 1/eta and P_in, classed by the highest degree of a single variable."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.fit_form import Cells, Fit, r_squared
from vehicle_model.car.parameters import Car

DEGREES = (2, 3, 4)
PRINTED: dict[str, tuple[tuple[int, int], ...]] = {
    "eta printed 3": ((1, 1), (2, 1), (1, 2), (3, 0), (1, 3)),
    "phi printed 4": ((1, 1), (2, 1), (1, 2), (2, 2), (3, 0), (1, 3), (1, 4), (0, 4)),
    "P_in printed 4": ((1, 1), (2, 1), (1, 2), (2, 2), (0, 3), (3, 0), (1, 3), (0, 4)),
}
"""The forms whose equations survive in the captions of figures 3.19, 3.15 and 3.18: exponents of (omega, T)."""
FLOOR = 0.02
"""Efficiency below which a fitted eta or phi is not inverted any more."""


def exponents(kind: str, degree: int) -> tuple[tuple[int, int], ...]:
    """Exponents of (omega, T), the constant left out: `full` has every product up to `degree` in each variable,
    `total` those whose exponents sum to at most `degree`."""
    pairs = ((i, j) for i in range(degree + 1) for j in range(degree + 1) if i + j > 0)
    return tuple(pair for pair in pairs if kind == "full" or sum(pair) <= degree)


@dataclass(frozen=True)
class PolynomialFit(Fit):
    """Normalised and centred least squares (3.4.1): F_n c_n = y_n."""

    name: str
    target: str
    powers: tuple[tuple[int, int], ...]
    column_mean: NDArray[np.float64]
    """m_F."""
    column_deviation: NDArray[np.float64]
    """sigma_F."""
    mean: float
    """m_y."""
    deviation: float
    """sigma_y."""
    normalised: NDArray[np.float64]
    """c_n."""
    r2: float
    r2_efficiency: float
    spread: NDArray[np.float64]
    """(F_n' F_n / n)^-1, n cells."""

    def leverage(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        """Variance of the fitted value per variance of a cell's, in units of its mean over the cells: 1 among them, and
        the square of what an error of theirs grows to elsewhere."""
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        columns = (_columns(omega, torque, self.powers) - self.column_mean) / self.column_deviation
        own = 1.0 + np.einsum("...i,ij,...j->...", columns, self.spread, columns)
        return own / (1.0 + len(self.powers))

    def value(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        """The fitted quantity itself (eta, phi or P_in)."""
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        columns = (_columns(omega, torque, self.powers) - self.column_mean) / self.column_deviation
        return columns @ self.normalised * self.deviation + self.mean

    def efficiency(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        value = self.value(engine_speed, torque)
        if self.target == "eta":
            return value
        if self.target == "phi":
            return np.where(value > 1.0, 1.0 / np.maximum(value, 1.0), 1.0)
        return super().efficiency(engine_speed, torque)

    def fuel_power(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        value = self.value(engine_speed, torque)
        if self.target == "P_in":
            return value
        output = np.asarray(engine_speed, float) * np.asarray(torque, float)
        return output * value if self.target == "phi" else output / np.maximum(value, FLOOR)

    @property
    def coefficients(self) -> dict[tuple[int, int], float]:
        """Coefficients alpha of the plain polynomial in rad/s and N m by exponents, (0, 0) the constant.

        From c_n by expanding the normalisation, the closed form of the thesis' (F'F)^-1 F'(F_n c_n sigma + m).
        """
        plain = self.normalised * self.deviation / self.column_deviation
        constant = self.mean - float(plain @ self.column_mean)
        return {(0, 0): constant} | {power: float(alpha) for power, alpha in zip(self.powers, plain, strict=True)}


@dataclass(frozen=True)
class CutFit(Fit):
    """Remedy 2 for empty areas (3.4): beyond the first minimum outside the data the efficiency is zero."""

    name: str
    inner: Fit
    engine_speed: NDArray[np.float64]
    torque: NDArray[np.float64]
    kept: NDArray[np.bool_]
    r2: float
    r2_efficiency: float

    def efficiency(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        column = np.clip(np.rint(np.interp(omega, self.engine_speed, np.arange(len(self.engine_speed)))), 0, None)
        row = np.clip(np.rint(np.interp(torque, self.torque, np.arange(len(self.torque)))), 0, None)
        kept = self.kept[column.astype(int), row.astype(int)]
        return np.where(kept, self.inner.efficiency(omega, torque), 0.0)

    def fuel_power(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        output = np.asarray(engine_speed, float) * np.asarray(torque, float)
        return output / np.maximum(self.efficiency(engine_speed, torque), FLOOR)


def fit_polynomials(cells: Cells, car: Car) -> dict[str, Fit]:
    """Every polynomial that the cells can carry, by name; eta also with remedies 1 ("border") and 2 ("cut").

    Remedy 1 lines the right-hand border (5 % above the red line) with points of zero efficiency.
    """
    fits: dict[str, Fit] = {}
    forms = {f"{target} {kind} {degree}": (target, exponents(kind, degree)) for target in ("eta", "phi", "P_in")
             for kind in ("total", "full") for degree in DEGREES}  # fmt: skip
    forms |= {name: (name.split()[0], powers) for name, powers in PRINTED.items()}
    edge = np.linspace(0.05, 1.0, 20) * car.engine.max_torque
    bordered = Cells(
        np.append(cells.engine_speed, np.full(20, 1.05 * car.engine.redline_speed)),
        np.append(cells.torque, edge),
        np.append(cells.efficiency, np.zeros(20)),
        np.append(cells.standard_error, np.full(20, 0.01)),
    )
    for name, (target, powers) in forms.items():
        if len(cells.torque) <= 2 * len(powers) or not identifiable(cells, powers):
            continue
        fits[name] = fit_polynomial(cells, name, target, powers)
        if target == "eta":
            fit = fit_polynomial(bordered, f"{name} border", target, powers)
            eta = fit.efficiency(cells.engine_speed, cells.torque)
            r2 = r_squared(cells.efficiency, eta)
            fits[f"{name} border"] = replace(fit, r2=r2, r2_efficiency=r2)
            fits[f"{name} cut"] = cut_at_minimum(fits[name], cells, car)
    return fits


def identifiable(cells: Cells, powers: tuple[tuple[int, int], ...]) -> bool:
    """Whether the cells lie at enough engine speeds and torques to tell the columns `powers` apart: a trip in a queue
    has many cells at two engine speeds, which fit any curvature."""
    speeds, torques = len(np.unique(cells.engine_speed)), len(np.unique(cells.torque))
    return speeds > max(i for i, _ in powers) and torques > max(j for _, j in powers)


def fit_polynomial(cells: Cells, name: str, target: str, powers: tuple[tuple[int, int], ...]) -> PolynomialFit:
    """Least squares of `target` ("eta", "phi", "P_in") with the columns `powers` and a constant."""
    data = {"eta": lambda: cells.efficiency, "phi": lambda: 1.0 / cells.efficiency, "P_in": lambda: cells.fuel_power}
    wanted = data[target]()
    columns = _columns(cells.engine_speed, cells.torque, powers)
    column_mean, column_deviation = columns.mean(axis=0), columns.std(axis=0)
    column_deviation = np.where(column_deviation > 0, column_deviation, 1.0)
    mean, deviation = float(wanted.mean()), float(wanted.std()) or 1.0
    unit = (columns - column_mean) / column_deviation
    normalised = np.linalg.lstsq(unit, (wanted - mean) / deviation)[0]
    spread = np.linalg.pinv(unit.T @ unit / len(unit), hermitian=True)
    fit = PolynomialFit(
        name, target, powers, column_mean, column_deviation, mean, deviation, normalised, 0.0, 0.0, spread
    )
    fitted, eta = fit.value(cells.engine_speed, cells.torque), fit.efficiency(cells.engine_speed, cells.torque)
    return replace(fit, r2=r_squared(wanted, fitted), r2_efficiency=r_squared(cells.efficiency, eta))


def cut_at_minimum(fit: Fit, cells: Cells, car: Car) -> CutFit:
    """Remedy 2: going outwards from the cells along both axes, keep the fit up to its first minimum (or zero).

    A climb above the best efficiency among the cells is cut as well: it is the extrapolation's.
    """
    omega = np.linspace(0.5 * car.engine.idle_speed, 1.1 * car.engine.redline_speed, 161)
    torque = np.linspace(0.0, 1.5 * car.engine.max_torque, 161)
    eta = fit.efficiency(*np.meshgrid(omega, torque, indexing="ij"))
    column = np.abs(omega[:, None] - cells.engine_speed).argmin(axis=0)
    row = np.abs(torque[:, None] - cells.torque).argmin(axis=0)
    ceiling = 1.02 * float(fit.efficiency(cells.engine_speed, cells.torque).max())
    kept = _falling_outwards(eta, column, row, ceiling) & _falling_outwards(eta.T, row, column, ceiling).T
    cut = CutFit(f"{fit.name} cut", fit, omega, torque, kept, 0.0, 0.0)
    r2 = r_squared(cells.efficiency, cut.efficiency(cells.engine_speed, cells.torque))
    return replace(cut, r2=r2, r2_efficiency=r2)


def _falling_outwards(eta: NDArray, along: NDArray, line: NDArray, ceiling: float) -> NDArray[np.bool_]:
    """Along the first axis of `eta` (n, m): True between the cells (`along`, `line`) and, outwards, while it is
    positive, at most `ceiling`, and has not begun to rise again after falling.

    A line without cells takes the extent of the nearest one that has.
    """
    kept = np.zeros(eta.shape, bool)
    seen = np.unique(line)
    for number in range(eta.shape[1]):
        here = along[line == seen[np.abs(seen - number).argmin()]]
        low, high = int(here.min()), int(here.max())
        kept[low : high + 1, number] = True
        kept[high:, number] = _until_minimum(eta[high:, number], ceiling)
        kept[: low + 1, number] = _until_minimum(eta[low::-1, number], ceiling)[::-1]
    return kept


def _until_minimum(values: NDArray, ceiling: float) -> NDArray[np.bool_]:
    """True from the start over any climb and the fall after it, up to the first minimum, zero or `ceiling`."""
    change = np.diff(values)
    falling = np.maximum.accumulate(np.append(False, change < 0.0))
    risen_again = np.append(False, (change > 0.0) & falling[:-1])
    return ~np.maximum.accumulate(risen_again | (values <= 0.0) | (values > ceiling))


def _columns(omega: NDArray, torque: NDArray, powers: tuple[tuple[int, int], ...]) -> NDArray[np.float64]:
    """F: one column per pair of exponents, last axis."""
    return np.stack([omega**i * torque**j for i, j in powers], axis=-1)
