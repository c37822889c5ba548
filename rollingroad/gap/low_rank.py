"""How many independent departures the residuals show: Hockerdal's A_q by singular values (seed 001, 4.1).

There x are an engine's states and A_q q moves their stationary point; here the rows are the residual channels, averaged
over 30 s and in units of their noise, so a singular value of sqrt(windows) is what noise alone gives.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.blocks import CHANNELS
from rollingroad.gap.calibration import Calibration, unexplained
from rollingroad.gap.trips import Layout, Trip, Whitened

WINDOW = 30.0
USED = ("fuel_power", "coast_force", "gnss_speed", "gear_ratio", "height_gps", "height_map")


@dataclass(frozen=True)
class LowRank:
    """`directions` (k, channels): columns of A_q, as rows; `values` (k,) per sqrt(window); noise alone gives about
    1."""

    channels: tuple[str, ...]
    directions: NDArray[np.float64]
    values: NDArray[np.float64]


def low_rank(trips: Sequence[Trip], whitened: Sequence[Whitened], layout: Layout, calibration: Calibration) -> LowRank:
    """Singular values and directions of the residuals of all trips."""
    rows = []
    for trip, w in zip(trips, whitened, strict=True):
        r = unexplained(w, layout, calibration)
        window = (trip.p.layout.time / WINDOW).astype(int)
        table = np.zeros((int(window.max()) + 1, len(USED)))
        for i, name in enumerate(USED):
            mask = trip.p.layout.channel == CHANNELS.index(name)
            total = np.bincount(window[mask], r[mask], minlength=len(table))
            count = np.bincount(window[mask], minlength=len(table))
            table[:, i] = total / np.sqrt(np.maximum(count, 1))
        rows.append(table)
    table = np.concatenate(rows)
    _, values, directions = np.linalg.svd(table, full_matrices=False)
    return LowRank(USED, directions, values / np.sqrt(len(table)))
