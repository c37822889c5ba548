"""What of the advice a human can follow: an arrow that does not dance, a gear that stays for a while (seed 004, 5.1.3).

An optimal plan, made anew every second, swings between slightly more and slightly less, and so does its gear. On the
display that is one change every few seconds, and each change is a look away from the road. So the display shows an
arrow (up, hold, down) with hysteresis and a least time between two changes, and a gear that must have been wanted for a
while; what it shows is what the driver acts upon. What is urgent (to lift off; to pull out of a bend) is never delayed.
"""

import math
from dataclasses import dataclass, field, replace

from sim.advisor import Suggestion

OUTER, INNER = 0.30, 0.10
"""m/s2 beyond which "hold" becomes an arrow, and below which an arrow becomes "hold"."""
ARROW_DWELL = 5.0
"""s that an arrow stays at least, unless another is urgent."""
URGENT = 0.50
"""m/s2 of wanted change of speed that does not wait."""
GEAR_DWELL, GEAR_SURE = 5.0, 1.0
"""s that a gear stays at least, and that another must have been wanted for."""
BRAKING = 1.5
"""m/s2 that an arrow down makes him brake by at most; for more there must be something on the road to see."""
FAR_GEAR = 2
"""Gears between shown and wanted that do not wait for `GEAR_DWELL`."""


@dataclass
class Display:
    """Turns what an advisor wants into what is shown. `show` is called once per `period` (s); see the module."""

    period: float
    changes: int = field(default=0, init=False)
    """Changes of arrow or gear so far: what there was to look at."""
    _arrow: int = field(default=0, init=False)
    _arrow_age: float = field(default=math.inf, init=False)
    _gear: int = field(default=0, init=False)
    _gear_age: float = field(default=math.inf, init=False)
    _other_gear: float = field(default=0.0, init=False)
    _dark: bool = field(default=True, init=False)
    _lit: bool = field(default=False, init=False)
    """Whether it ever was."""

    def show(self, wanted: Suggestion | None) -> Suggestion | None:
        """What the display shows of `wanted`; None while there is no advice."""
        self._arrow_age += self.period
        self._gear_age += self.period
        if wanted is None:
            self._dark = True
            return None
        if wanted.automatic:  # nothing to look at: the car does it
            self._arrow, self._gear, self._dark = 1, wanted.gear, False
            self._arrow_age = self._gear_age = math.inf
            return wanted
        arrow = 0 if wanted.free else self._next_arrow(wanted)
        # A new arrow is looked at anyway: the gear may come with it.
        gear = wanted.gear if arrow != self._arrow else self._next_gear(wanted)
        changed = (arrow, gear) != (self._arrow, self._gear)
        # What lights up again is looked at, also where it says what it said before.
        if self._lit and (changed or self._dark):
            self.changes += 1
        self._lit = True
        if arrow != self._arrow:
            self._arrow, self._arrow_age = arrow, 0.0
        if gear != self._gear:
            self._gear, self._gear_age = gear, 0.0
        self._dark = False
        return replace(wanted, acceleration=_within(arrow, wanted.acceleration), gear=gear, coast=self._rolls(wanted))

    def _rolls(self, wanted: Suggestion) -> bool:
        return wanted.coast and self._arrow < 0

    def _next_arrow(self, wanted: Suggestion) -> int:
        a, now = wanted.acceleration, self._arrow
        if wanted.coast:
            a = min(a, -URGENT)
        away = 1 if a > OUTER else -1 if a < -OUTER else 0
        if self._dark:
            return away
        back = now if now * a > INNER else 0
        target = away or back
        if target == now or abs(a) >= URGENT:
            return target
        return target if self._arrow_age >= ARROW_DWELL else now

    def _next_gear(self, wanted: Suggestion) -> int:
        if self._dark or not self._gear:
            self._other_gear = 0.0
            return wanted.gear
        if self._arrow < 0:  # slowing down, he shifts up for less drag at once, down as the engine asks
            self._other_gear = 0.0
            return max(self._gear, wanted.gear)
        if wanted.gear == self._gear:
            self._other_gear = 0.0
            return self._gear
        self._other_gear += self.period
        far = abs(wanted.gear - self._gear) >= FAR_GEAR
        sure = self._other_gear >= GEAR_SURE and (far or self._gear_age >= GEAR_DWELL)
        if not sure:
            return self._gear
        self._other_gear = 0.0
        return wanted.gear


def _within(arrow: int, acceleration: float) -> float:
    """The acceleration (m/s2) that an arrow can say."""
    if arrow > 0:
        return max(acceleration, 0.0)
    if arrow < 0:
        return max(min(acceleration, 0.0), -BRAKING)
    return min(max(acceleration, -OUTER), OUTER)
