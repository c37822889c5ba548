"""The mean of several forms of one map: where they err apart, the mean errs less."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from observer.efficiency_map import SPEED_STEP, TORQUE_STEP
from observer.fit_form import Cells, Fit, r_squared

REACH = 12.0
"""Cells (of 50 rpm and 2 N m) from the nearest valid one over which the other members fade out. A polynomial of a short
trip says nothing beyond what was driven: half the fuel power, or twice."""
LEVERED = 4.0
"""Leverage up to which a member counts in full; beyond it as much less as its variance is larger. A queue's few engine
speeds bend a polynomial of degree two beyond measure, twelve cells on."""


@dataclass(frozen=True)
class AverageFit(Fit):
    """The mean fuel power of `members` (at least one) near the cells; the first one's alone far from them, and where
    the others hang on the cells by a long lever."""

    name: str
    members: tuple[Fit, ...]
    near: KDTree
    """The valid cells, in units of cells."""
    r2: float
    r2_efficiency: float

    def fuel_power(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        omega, torque = np.broadcast_arrays(np.asarray(engine_speed, float), np.asarray(torque, float))
        distance = self.near.query(_in_cells(omega, torque))[0]
        first = self.members[0].fuel_power(omega, torque)
        near = np.exp(-((distance / REACH) ** 2)) / len(self.members)
        power = first.copy()
        for member in self.members[1:]:
            trusted = near * np.minimum(LEVERED / member.leverage(omega, torque), 1.0)
            power += trusted * (member.fuel_power(omega, torque) - first)
        return power


def fit_average(name: str, members: tuple[Fit, ...], cells: Cells) -> AverageFit:
    """The average of `members`, scored on `cells` (at least one)."""
    near = KDTree(_in_cells(cells.engine_speed, cells.torque))
    power = AverageFit(name, members, near, 0.0, 0.0).fuel_power(cells.engine_speed, cells.torque)
    r2 = r_squared(cells.fuel_power, power)
    efficiency = cells.engine_speed * cells.torque / power
    return AverageFit(name, members, near, r2, r_squared(cells.efficiency, efficiency))


def _in_cells(omega: NDArray, torque: NDArray) -> NDArray[np.float64]:
    return np.stack([omega / SPEED_STEP, torque / TORQUE_STEP], axis=-1)
