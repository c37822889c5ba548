"""Advice without optimal control: what a driving instructor says, and gliding to a stop. Neither knows the map."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.advice import RoadAhead
from sim.advisor import COAST, GLIDE_HORIZON, Context, Suggestion, View, worth_gliding
from vehicle_model.car.parameters import Car

RPM = 2.0 * math.pi / 60.0
BRISK = 1.8
"""m/s2: "accelerate briskly rather than gently"."""
SHIFT_UP, LOWEST = 2_400.0 * RPM, 1_350.0 * RPM
"""rad/s: up while accelerating; and the least at a steady speed."""
PUSH = 0.4
"""m/s2 from which it is an acceleration, and the gear is chosen for one."""
TOLERANCE = 0.5
"""m/s above the speed that rolling allows before the foot goes off: else it would go on and off at each limit."""
CRAWL = 5.0
"""m/s at which one rolls up to a red light."""


def rolling_cap(road: RoadAhead, braking: float = COAST) -> NDArray[np.float64]:
    """Speed (m/s) at each place of `road` from which losing `braking` m/s2 keeps within the limits ahead."""
    square = road.speed_max**2
    gained = 2.0 * braking * np.diff(road.s)
    for i in range(len(square) - 2, -1, -1):
        square[i] = min(square[i], square[i + 1] + gained[i])
    return np.sqrt(square)


def early_gear(car: Car, speed: float, *, accelerating: bool) -> int:
    """The instructor's gear: the highest above 1,350 rpm at a steady speed, the lowest below 2,400 rpm accelerating."""
    turning = np.asarray(car.gear_ratios) / car.wheel_radius * speed
    highest = max(int(np.count_nonzero(turning >= LOWEST)), 1)
    if not accelerating:
        return highest
    return min(int(np.count_nonzero(turning > SHIFT_UP)) + 1, highest)


@dataclass(frozen=True)
class GlideToStop:
    """Lifts off where rolling reaches a red signal, a slower leader or the destination; else silent."""

    context: Context

    def reset(self) -> None:
        """Nothing to forget."""

    def advise(self, view: View) -> Suggestion | None:
        """Roll, or None."""
        if view.distance < self.context.begin:
            return None
        return Suggestion(-COAST, view.gear, coast=True) if worth_gliding(view) or _ends_here(view) else None


def _ends_here(view: View) -> bool:
    rolled_out = view.speed**2 / (2.0 * COAST)
    return view.destination_distance < min(rolled_out, GLIDE_HORIZON) and view.speed > 4.0


@dataclass
class Coach:
    """The rule of thumb: brisk acceleration, early upshift, foot off early for limits, bends, signals and leaders."""

    context: Context

    def reset(self) -> None:
        """Look up from where rolling does for each slow place."""
        road = self.context.road
        self._rolling = rolling_cap(road)
        self._limit = rolling_cap(road, 1.5)

    def advise(self, view: View) -> Suggestion | None:
        """Brisk, steady or rolling."""
        c = self.context
        if view.distance < c.begin:
            return None
        v = view.speed
        limit = float(np.interp(view.distance, c.road.s, self._limit))
        rolling = float(np.interp(view.distance, c.road.s, self._rolling))
        if v > limit:
            return Suggestion((limit - v) / 1.0, view.gear)
        if worth_gliding(view) or _ends_here(view) or v > rolling + TOLERANCE:
            return Suggestion(-COAST, view.gear, coast=True)
        # Nobody accelerates towards a red light.
        ahead = max(v, CRAWL) if view.signal_state in ("red", "yellow") else rolling
        wanted = min(BRISK, ahead - v, rolling - v)
        return Suggestion(wanted, early_gear(c.car, v, accelerating=wanted > PUSH))
