"""What every fit offers, and the cells that fits are made from."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.efficiency_map import EfficiencyMap

PLACE_SCATTER = 0.008
"""Relative, of the efficiency: what no further stay at a place takes away (gear, warmth and transients go with the
place), alike in neighbouring cells. By the coverage of development hours of both cars."""


class Fit(ABC):
    """A smooth map. `r2` is that of the fitted quantity (eta, phi or P_in), as in seed 004, 3.4.

    `r2_efficiency` is that of eta over the same cells, so that forms can be compared.
    """

    name: str
    r2: float
    r2_efficiency: float

    @abstractmethod
    def fuel_power(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        """P_in, W, at rad/s and N m (broadcast)."""

    def leverage(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        """How much more the cells' errors weigh in the fitted value than among the cells, squared; 1 for a form that
        its shape holds where there are none."""
        return np.ones(np.broadcast_shapes(np.shape(engine_speed), np.shape(torque)))

    def efficiency(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        """eta = omega T / P_in at rad/s and N m (broadcast)."""
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.nan_to_num(omega * torque / self.fuel_power(omega, torque), nan=0.0, posinf=0.0, neginf=0.0)

    def steepness(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        """d(log P_in) / d(log T): what a relative error of the torque does to eta (0 at idle, 1 without losses)."""
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        slope = (self.fuel_power(omega, torque + 1.0) - self.fuel_power(omega, torque - 1.0)) / 2.0
        return torque * slope / self.fuel_power(omega, torque)

    def shared_error(
        self, engine_speed: ArrayLike, torque: ArrayLike, common_error: tuple[float, float]
    ) -> NDArray[np.float64]:
        """Relative error of eta that an error of the torque (N m, and relative) makes everywhere at once."""
        torque = np.asarray(torque, float)
        relative = np.hypot(common_error[0] / np.maximum(torque, 1.0), common_error[1])
        return relative * self.steepness(engine_speed, torque)


@dataclass(frozen=True)
class Cells:
    """The valid cells of a map as columns (k,)."""

    engine_speed: NDArray[np.float64]
    torque: NDArray[np.float64]
    efficiency: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    common_error: tuple[float, float] = (0.0, 0.0)
    """N m, and relative, of the torque: the part of `standard_error` that the cells share."""

    @property
    def fuel_power(self) -> NDArray[np.float64]:
        """W."""
        return self.engine_speed * self.torque / self.efficiency


def valid_cells(efficiency_map: EfficiencyMap) -> Cells:
    """The valid cells at their centres; standard error 0.005 where the map does not say."""
    valid = efficiency_map.valid & (np.nan_to_num(efficiency_map.mean, nan=0.0) > 0.01)
    omega, torque = np.meshgrid(efficiency_map.engine_speed, efficiency_map.torque, indexing="ij")
    known = efficiency_map.standard_error.shape == valid.shape
    error = efficiency_map.standard_error[valid] if known else np.full(int(valid.sum()), 0.005)
    return Cells(omega[valid], torque[valid], efficiency_map.mean[valid], error, efficiency_map.common_error)


def r_squared(data: NDArray, fitted: NDArray) -> float:
    """Coefficient of determination, NaN with fewer than two data."""
    spread = float(np.sum((data - data.mean()) ** 2)) if len(data) > 1 else 0.0
    return 1.0 - float(np.sum((data - fitted) ** 2)) / spread if spread > 0 else float("nan")
