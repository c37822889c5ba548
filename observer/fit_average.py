"""The mean of several forms of one map: where they err apart, the mean errs less."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.fit_form import Cells, Fit, r_squared


@dataclass(frozen=True)
class AverageFit(Fit):
    """The mean fuel power of `members` (at least one)."""

    name: str
    members: tuple[Fit, ...]
    r2: float
    r2_efficiency: float

    def fuel_power(self, engine_speed: ArrayLike, torque: ArrayLike) -> NDArray[np.float64]:
        return np.mean([member.fuel_power(engine_speed, torque) for member in self.members], axis=0)


def fit_average(name: str, members: tuple[Fit, ...], cells: Cells) -> AverageFit:
    """The average of `members`, scored on `cells`."""
    mean = AverageFit(name, members, 0.0, 0.0)
    power = mean.fuel_power(cells.engine_speed, cells.torque)
    r2 = r_squared(cells.fuel_power, power)
    return AverageFit(name, members, r2, r_squared(cells.efficiency, cells.engine_speed * cells.torque / power))
