"""The advisor's side of the dashboard: what it may see, what it may say; and the follower of a plan."""

import math
from dataclasses import dataclass
from typing import Protocol

from controller.advice import Advice, RoadAhead
from observer.efficiency_map import FuelMap
from vehicle_model.car.parameters import Car

GLIDE_HORIZON = 200.0
"""m ahead within which a red signal or a slower leader is worth gliding to."""
COAST = 0.45
"""m/s2 that a car loses rolling in gear with the fuel cut: the advisor's rule of thumb."""
DELAY = 0.8
"""s that a person is presumed to take to act upon advice."""
HIS_OWN = 0.8
"""m/s2 of braking from which nothing is said to who acts late."""
FOLLOWING = 4.0
"""s to the car in front within which one follows it."""
LIFTING = -0.2
"""m/s2 above which nothing is said to who follows."""


@dataclass(frozen=True)
class View:
    """What a dashboard shows, and a driver sees. Never the truth beyond that."""

    time: float
    """s since the start."""
    distance: float
    """m along the navigation route."""
    speed: float
    """m/s: the box's own, of wheel pulses and GPS, hence true to a few parts in a thousand. The *driver* goes by his
    dial, which shows more (`sim.caution.SPEEDOMETER`): see `scenarios/drivers.md`."""
    gear: int
    leader_gap: float
    """m of free road to the car in front, inf where none is seen."""
    leader_speed: float
    """m/s, nan where none is seen."""
    signal_distance: float
    """m to the next signal, inf where none is in sight."""
    signal_state: str
    """"red", "yellow", "green" or ""."""
    destination_distance: float
    """m to the end of the journey."""
    told_distance: float = math.inf
    """m to the next signal where it tells when it turns, inf where none does."""
    told_green: tuple[tuple[float, float], ...] = ()
    """(start, end) of that signal's green times on the way taken, s from now, in order; yellow is not green."""


@dataclass(frozen=True)
class Context:
    """What an advisor may go by before it sets out. Never the truth: the oracle alone is handed the true map."""

    road: RoadAhead
    fuel_map: FuelMap
    """As found (the oracle's: true)."""
    car: Car
    """The nominal car."""
    time_value: float = 8_000.0
    """W: what a second is worth; set so that the mean trip takes as long as the baseline's."""
    start_speed: float = 0.0
    """m/s."""
    end_speed: float = 0.0
    """m/s."""
    pedal_to_the_floor: bool = False
    """Whether the car carries out accelerations itself once he presses the pedal to the floor."""
    begin: float = 50.0
    """m: silent before, so that two drives can be shown to be the same until advice is given."""
    delay: float = DELAY
    """s that the advisor presumes a person takes to act upon advice; 0 for one who follows at once."""
    tells_gears: bool = True
    """Whether gears are told; not to a driver who shifts well by himself (`sim.shift_habit`)."""


@dataclass(frozen=True)
class Suggestion:
    """What the driver is told."""

    acceleration: float
    """m/s2 wanted."""
    gear: int
    """0: as you like."""
    costate: float = 0.0
    """J per m/s: worth of speed, for the display."""
    coast: bool = False
    """Foot off: let it roll in gear."""
    free: bool = False
    """His pace is his own: only the gear is told."""
    automatic: bool = False
    """The pedal-to-the-floor mode of 5.1.3: he has only to press, and the car does it, at once and exactly."""


class Advisor(Protocol):
    """Anything that gives advice. `reset` is called at the start of each drive, `advise` at each step of 0.1 s."""

    def reset(self) -> None: ...

    def advise(self, view: View) -> Suggestion | None:
        """Return advice, or None for "drive as you like"."""
        ...


def keeps_his_distance(view: View, acceleration: float) -> bool:
    """Whether who acts late had better be told nothing: he follows a car, and is not asked to lift off."""
    return view.leader_gap < FOLLOWING * view.speed and acceleration > LIFTING


@dataclass(frozen=True)
class AdviceFollower:
    """Follows the policy of a plan: (s, v) -> acceleration, gear, costate; glides to what stands in the way."""

    advice: Advice
    glide: bool = True
    """Whether to lift off early for red signals and slower leaders in sight."""
    begin: float = 0.0
    """m: silent before (for a comparison that starts later)."""
    delay: float = 0.0
    """s that a person takes to act upon advice: it is said for where he will be by then, and braking and following a
    car close in front are left to him, who sees what for; 0 for one who acts at once."""
    tells_gears: bool = True
    """See `Context`."""

    def reset(self) -> None:
        """Nothing to forget: the policy is fixed."""

    def advise(self, view: View) -> Suggestion | None:
        """The policy's action here; a glide where something stands in the way."""
        if view.distance < self.begin:
            return None
        acceleration, gear, costate = self.advice.action(view.distance + self.delay * view.speed, view.speed)
        gear = gear if self.tells_gears else 0
        glides = self.glide and worth_gliding(view)
        if self.delay > 0.0 and (acceleration < -HIS_OWN or (keeps_his_distance(view, acceleration) and not glides)):
            return None
        if glides and acceleration > -COAST:
            return Suggestion(-COAST, view.gear, costate, coast=True)
        return Suggestion(acceleration, gear, costate)


def worth_gliding(view: View) -> bool:
    """Whether rolling in gear, here and now, still reaches the red signal or the slower leader in sight."""
    v = view.speed
    if view.signal_state in ("red", "yellow") and view.signal_distance < GLIDE_HORIZON:
        # Roll if rolling alone would not stop short of the line.
        return v * v / (2.0 * COAST) > view.signal_distance and v > 4.0
    if view.leader_gap < GLIDE_HORIZON and view.leader_speed < v - 0.5 and v > 3.0:
        needed = (v - view.leader_speed) ** 2 / (2.0 * COAST)
        return needed > view.leader_gap - 1.2 * view.leader_speed
    return False
