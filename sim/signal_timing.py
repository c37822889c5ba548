"""Signals that tell when they turn: whether to keep on, to hurry, or to be slower and arrive when it is green.

The green times are those that the signal itself broadcasts (`View.told_green`). To arrive later than the plan would,
the car rolls first and holds the lower speed then: of all ways to be at the line at that time, that wastes little,
since the speed that air and brakes would have taken is given up at once.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.advice import Advice, RoadAhead
from sim.advisor import COAST, View

AFTER = 3.0
"""s after the turn to green at which to be at the line: nobody brakes for it then, and a cross street is clear."""
BEFORE = 1.0
"""s of green that must be left."""
QUEUE = 2.0
"""s that each car waiting at the line takes to leave."""
CAR = 7.0
"""m of a queue for each car."""
LEAVING, BRAKING = 1.2, 1.5
"""m/s2 of speeding up and slowing down in the forecasts."""
STEP = 5.0
"""m between the places of a forecast."""
SLOWEST = 4.0
"""m/s: slower than this nobody is asked to creep up to a line; he rolls there and stops."""
FIRM = 1.0
"""m/s2 of slowing down at most, to spare a stop."""
SETTLE = 2.0
"""s within which the lower speed is held."""
ABOVE = 0.8
"""m/s above the speed to hold from which he rolls, until he is there."""


@dataclass(frozen=True)
class Timing:
    """What a signal's green times ask for."""

    arrival: float | None = None
    """s from now at which to be at the line where the plan would be there too early; None: as planned."""
    hurry: bool = False
    """Whether it is green in time only for someone who hurries."""


def timing(view: View, plan: Advice, whole: Advice, road: RoadAhead) -> Timing | None:
    """What to do about the signal that tells; None where none does or none of its green times helps.

    `plan` is the plan in hand, `whole` the whole road's beyond it.
    """
    if not view.told_green or not 0.0 < view.told_distance < math.inf:
        return None
    places = view.distance + np.arange(0.0, view.told_distance + STEP, STEP)
    wanted = np.where(
        places <= plan.s[-1], np.interp(places, plan.s, plan.speed), np.interp(places, whole.s, whole.speed)
    )
    fastest = np.interp(places, road.s, road.speed_max)
    planned = max(_seconds(view.speed, wanted, view.told_distance), _led(view))
    quickest = max(_seconds(view.speed, fastest, view.told_distance), _led(view))
    for start, end in view.told_green:
        start = start + _queue(view) + AFTER if start > 0.0 else 0.0
        if planned <= end - BEFORE:
            return Timing(start if planned < start - 0.5 else None)
        if start <= quickest <= end - BEFORE:
            return Timing(hurry=True)
    return None


def slower(speed: float, distance: float, seconds: float) -> tuple[float, float] | None:
    """Speed (m/s) to hold, and braking (m/s2) down to it, to be `distance` m ahead in `seconds` s.

    Slowing down from v0 by b to v and holding it covers v t + (v0 - v)^2 / 2 b; b is that of rolling, or what is
    needed. (inf, 0) where there is no reason to be slower, None where that would be to creep.
    """
    surplus = speed * seconds - distance
    if surplus <= 0.0:
        return math.inf, 0.0
    b = max(COAST, 2.0 * surplus / seconds**2)
    target = speed - b * (seconds - math.sqrt(max(seconds**2 - 2.0 * surplus / b, 0.0)))
    return None if b > FIRM or target < SLOWEST else (target, b)


def _seconds(speed: float, wanted: NDArray[np.float64], distance: float) -> float:
    """s for `distance` m at the speeds `wanted` (m/s, every `STEP` m), from `speed`."""
    square = np.maximum(wanted, 1.0) ** 2
    for i in range(len(square) - 2, -1, -1):
        square[i] = min(square[i], square[i + 1] + 2.0 * BRAKING * STEP)
    passed, energy = 0.0, max(speed, 1.0) ** 2
    for k in range(len(square) - 1):
        later = min(energy + 2.0 * LEAVING * STEP, max(square[k + 1], energy - 2.0 * BRAKING * STEP))
        length = min(STEP, distance - k * STEP)
        passed += max(length, 0.0) * 2.0 / (math.sqrt(energy) + math.sqrt(later))
        energy = later
    return passed


def _led(view: View) -> float:
    """s until the car in front, a few seconds ahead and on the move, lets one reach the line."""
    if view.leader_gap < 3.0 * view.speed and view.leader_speed > 1.0:
        return max(view.told_distance - view.leader_gap, 0.0) / max(view.leader_speed, 1.0)
    return 0.0


def _queue(view: View) -> float:
    """s that cars standing at the line need before one can pass it."""
    standing = view.leader_gap < view.told_distance and view.leader_speed < 1.0
    return QUEUE * max((view.told_distance - view.leader_gap) / CAR, 1.0) if standing else 0.0
