"""The tracks of seed 000, chapter 4: setpoints (n, d) that estimators are asked to follow.

Setpoints that print shows only in figures are ours and said at each track.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vehicle_model.car.randomness import generator

Array = NDArray[np.float64]


def steps(levels: Sequence[float | Sequence[float]], hold: int = 100) -> Array:
    """Levels held for `hold` samples each: (len(levels) * hold, d)."""
    return np.repeat(np.array([np.atleast_1d(level) for level in levels], float), hold, axis=0)


def _ramp(start: float, end: float, count: int) -> Array:
    return np.linspace(start, end, count)[:, None]


ON, NEAR, FAR = 15.0, 16.0, 20.0
"""Setpoints of table 4.1: on the prior's peak, one deviation from it (as in 4.3's bimodal case), five from it."""

STATIONARY = {name: steps([level], 200) for name, level in (("on", ON), ("near", NEAR), ("far", FAR))}
SMALL_STEPS = np.concatenate([steps([15.0, 15.5, 15.0, 16.0, 15.0]), _ramp(15.0, 16.5, 100), steps([16.5])])
"""Figure 4.4: within the probable part of the prior."""
LARGE_STEPS = np.concatenate([steps([15.0, 20.0, 20.0, 20.0, 15.0]), _ramp(15.0, 20.0, 100), steps([20.0])])
"""Figure 4.5: away from the prior at 100, back to it at 400 (both in the text), then a ramp."""
BIMODAL = steps([15.0, 16.0, 20.0, 15.0, 18.0, 15.0])
"""Figure 4.6: on both peaks (15, 18), between them (16), off them; from one to the other at 400."""
PLANE_STEPS = steps([(0.0, 0.0), (0.7, -0.8), (0.0, 0.0), (0.7, -0.1), (0.0, 0.0)])
"""Figure 4.11: away at 100, back at 200, and a lesser departure at 300 (setpoints from its text)."""
PLANE_STATIONARY = steps([(0.0, 0.0)], 200)
"""Figure 4.15 and table 4.2."""


def measured(track: Array, deviation: float | Sequence[float], runs: int, seed: int = 0) -> Array:
    """Measurements (n, runs, d) of `track` (n, d) under white Gaussian noise of `deviation` (a number or (d,))."""
    rng = generator(seed, "prior tracks")
    return track[:, None, :] + np.asarray(deviation) * rng.standard_normal((len(track), runs, track.shape[1]))
