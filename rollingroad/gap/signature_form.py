"""What a signature is: columns of an effect's settings, how they are made, and for which trip."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.blocks import Prepared
from rollingroad.gap.channels import Correction, values
from rollingroad.gap.replay import vector_of
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """One column: the parameter it moves, its unit and neutral value, the prior deviation of its coefficient."""

    parameter: str
    unit: str
    neutral: float
    sd: float
    sign: int = 0
    """+1 or -1 where the coefficients of this parameter's columns, added up, can only have that sign, physically."""


@dataclass(frozen=True)
class Variant:
    """One shape of an effect."""

    effect: str
    columns: tuple[Column, ...]
    shape: Mapping[str, float]
    """Parameters of shape, as settings."""
    make: Callable[["Context"], Array]
    """(m, number of columns)."""
    settings: Callable[[Array], list[dict[str, float]]] | None = None
    """Settings of the simulator, at given coefficients, whose signals add up to the effect's; None for a sensor's."""
    swings: bool = False
    """The first column is the mean of what comes and goes by the two others: without a swing it is another effect."""

    def at(self, c: "Context", value: Array) -> Array:
        """(m,): the signal re-simulated at coefficients `value`. Raises BadInput where the simulator refuses them."""
        assert self.settings is not None
        return sum((c.neutral - c.residual(one) for one in self.settings(value)), np.zeros(len(c.base)))


@dataclass(frozen=True)
class Context:
    """A trip and the nominal car that it is compared with."""

    p: Prepared
    car: Car
    vector: Array
    base: Array
    fuel: Array
    """(m,) W, what the calibrated simulator says that each fuel block burns. (The measured fuel as a regressor of
    itself
    would explain its own noise.)"""
    correction: Correction | None = None

    def residual(self, settings: Mapping[str, float]) -> Array:
        """(m,): measured less calibrated replay under `settings` ("effect.parameter": value)."""
        return values(self.p, self.car, vector_of(self.car, settings), self.correction)

    @cached_property
    def neutral(self) -> Array:
        """(m,): the same with nothing set."""
        return values(self.p, self.car, self.vector, self.correction)

    @cached_property
    def compressor(self) -> Array:
        """(m,) per W at the crankshaft."""
        return (self.neutral - self.residual({"accessory_load.power": 400.0})) / 400.0 * 0.536


PERIODS, COHERENT = (17.0, 65.0), 1500.0
"""s: of a compressor; twice the longest time over which two neighbouring frequencies stay in step."""
