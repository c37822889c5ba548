"""One pass through the chain, as data: what the views show and what a run folder holds."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.advice import Advice, RoadAhead
from observer.efficiency_map import EfficiencyMap
from observer.estimate import Estimate
from observer.fit_form import Fit
from sensors.log import SensorLog
from vehicle_model.car.parameters import Car
from vehicle_model.car.route import Route
from vehicle_model.car.trip import Trip


@dataclass(frozen=True)
class Run:
    """Everything that one `rollingroad run` made. `results` is the object of `run --json` (CLI.md)."""

    results: Mapping[str, Any]
    car: Car
    route: Route
    baseline: Trip
    """The first drive, from which `log`, `estimate` and `efficiency_map` come."""
    advised: Trip
    """The drive with advice that arrived nearest to the baseline's time."""
    log: SensorLog
    estimate: Estimate
    efficiency_map: EfficiencyMap
    fits: Mapping[str, Fit]
    advice: Advice
    true_efficiency: NDArray[np.float64] | None
    """"True efficiency" of DESIGN.md at the cell centres of `efficiency_map`, (n, m); NaN where the engine cannot be.
    None where there is no truth (real logs)."""
    road_ahead: RoadAhead | None
    """What the advisor knew of the road; None in a run read back from a folder."""
    folder: Path

    @property
    def gears_told(self) -> bool:
        """Whether the advised driver was told gears; else those of `advice` are the plan's alone."""
        return gears_told(self.results)


def gears_told(results: Mapping[str, Any]) -> bool:
    """Whether the advised driver of `run --json` was told gears; runs that do not say so told them."""
    return bool(results["advised"].get("gears_told", True))
