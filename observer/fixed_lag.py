"""A smoother that waits: the estimate of each 10 Hz instant, given everything that came in up to a lag later."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from observer import kernel
from observer.events import GRID_STEP, prepare
from observer.observe import SEGMENT, hindsight, start
from observer.settings import DEFAULT, ObserverSettings
from sensors.log import SensorLog
from sensors.matching import observations
from sensors.roadmap import RoadMap
from vehicle_model.car.parameters import Car

SHORTEST = 0.5
"""s: below it the next pulses, which tell when the fuel changed, are not yet known."""


def observe_lagged(
    log: SensorLog,
    car: Car,
    lag: float,
    road_map: RoadMap | None = None,
    learnt: Mapping[str, float] | None = None,
    settings: ObserverSettings = DEFAULT,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return times (n,) s on the logger's clock, states (n, 17) and variances (n, 17) at a fixed `lag` (s).

    At the log's end the lag shrinks to what is left. Raises ValueError for a shorter lag.
    """
    if not lag >= SHORTEST:
        raise ValueError(f"a lag of at least {SHORTEST} s, not {lag!r}")
    passages = None if road_map is None else observations(log, road_map, car.metres_per_tick, settings.gps_lag)
    packets, _ = prepare(log, passages)
    back = hindsight(packets, start(car, settings, learnt, float(packets[0, 0]) if len(packets) else 0.0))
    wait = round(lag / GRID_STEP)
    on_grid = back.events[:, 1] == kernel.GRID
    smooth_x, smooth_P = back.filter.grid_x.copy(), back.filter.grid_P.copy()
    done = 0
    for number in range(len(back.checkpoints)):
        f = back.tape(number, beyond=lag + GRID_STEP)
        lines = f.counts[kernel.TAPE_LINES]
        at = np.flatnonzero(f.tape_index[:lines, 0] == kernel.OP_GRID)
        own = int(np.count_nonzero(on_grid[number * SEGMENT : (number + 1) * SEGMENT]))
        for k in range(own):
            end = at[k + wait] + 1 if k + wait < len(at) else lines
            adjoint, information = np.zeros(kernel.NX), np.zeros((kernel.NX, kernel.NX))
            kernel.retreat(f, at[k], end, done + k, adjoint, information, smooth_x, smooth_P)
        done += own
    return back.events[on_grid, 0], smooth_x[:, :17], smooth_P[:, :17]
