"""What a driver heeds whatever he is told: bends, lights, the car in front, the end, the warning of the device."""

import math

import numpy as np
from numpy.typing import NDArray

from sim.drivers import Style
from sim.traffic import PERIOD, Traffic
from vehicle_model.car.route import Route

BEND_BRAKING = 1.5
"""m/s2 by which he slows down for a bend or a lower limit."""
SPEEDOMETER = 1.04
"""Displayed over true speed: ECE R39 forbids a dial to show less and allows 10 % + 4 km/h more."""
WALKING = 1.4
"""m/s of closing in below which a time to collision says nothing: rolling up in a queue."""
STOP_SHORT = 1.0
"""m before a signal's line where he stops."""
STOPPING = 3.0
"""m/s2: a light that turns yellow is driven through where stopping would take more. The yellow phases of the network
are as long as that asks for (netconvert's `tls.yellow.min-decel`)."""
LEAST_ROOM = 0.3
"""m to a line below which the braking that is needed is not computed any more."""
WARNED_TIME = 3.5
"""s to collision at which the device of an advised driver warns of the car in front."""
WARNED_BRAKING = 1.2
"""m/s2 by which he then brakes to stay above it, while there is room."""
WARNED_GAIN = 1.5
"""1/s: how soon he is back below the warning."""
WARNED_AT_MOST = 2.5
"""m/s2 that a warning asks for; what is more urgent than that he sees himself."""


def speed_cap(route: Route, lateral_comfort: float, braking: float = BEND_BRAKING) -> NDArray[np.float64]:
    """Speed (m/s) over `route.s` that limits and bends ahead allow, slowing down in time by `braking` (m/s2)."""
    bend = np.sqrt(lateral_comfort / np.maximum(np.abs(route.straightness), 1e-6))
    square = np.minimum(route.speed_limit, bend) ** 2
    gained = 2.0 * braking * (route.s[1] - route.s[0])
    for i in range(len(square) - 2, -1, -1):
        square[i] = min(square[i], square[i + 1] + gained)
    return np.sqrt(square)


def must_stop(state: str, distance: float, speed: float, stopping: bool) -> bool:
    """Whether the signal asks to stop: red, or yellow that can be obeyed or that he is `stopping` for."""
    if state in ("r", "u"):
        return True
    return state in ("y", "Y") and (stopping or speed**2 / (2.0 * STOPPING) < distance - STOP_SHORT)


def safe_wish(
    traffic: Traffic, style: Style, speed: float, leader: str, gap: float, leader_speed: float, stop: float, left: float
) -> float:
    """The acceleration (m/s2) that SUMO's model and the junctions ahead allow at most."""
    allowed = math.inf
    if leader:
        # Also told to launch harder he follows as he always does: whoever closes up harder brakes more.
        follow = traffic.follow_speed(speed, gap, leader, leader_speed, style.acceleration)
        allowed = (follow - speed) / PERIOD
    planned = traffic.planned_acceleration()
    if stop < math.inf:
        # The model brakes ever harder than needed where a place to stop appears late: a person brakes evenly.
        needed = -(speed**2) / (2.0 * max(stop - STOP_SHORT, LEAST_ROOM))
        evenly = min(needed, -style.deceleration)
        modelled = (traffic.stop_speed(speed, stop - STOP_SHORT, style.acceleration) - speed) / PERIOD
        allowed = min(allowed, max(modelled, evenly))
        planned = max(planned, evenly)  # SUMO's own plan, at the same line
    if left < 30.0 + speed * speed / (2.0 * 1.0):
        allowed = min(allowed, _halt(speed, left - 1.5))
    if speed < 1.5:
        may, gap_to_line = traffic.may_enter(8.0)
        if not may:
            allowed = min(allowed, _halt(speed, gap_to_line - STOP_SHORT))
    return min(allowed, planned)


def warned(speed: float, gap: float, leader_speed: float) -> float:
    """Acceleration (m/s2) that heeds the device's warning of the car in front; inf where there is nothing to warn of.

    Closing in is allowed by what constant braking takes back, and near the car by `WARNED_TIME`: the parabola
    c^2 = 2 b (d - d0) and the line c = d / tau touch at d = 2 d0, d0 = b tau^2 / 2. A beep needs no look at the
    display: it is heeded at once, whatever becomes of the other advice.
    """
    if not gap < math.inf:
        return math.inf
    room = max(gap, 0.0) + 2.0
    reserve = 0.5 * WARNED_BRAKING * WARNED_TIME**2
    if room < 2.0 * reserve:
        closing = room / WARNED_TIME
        braking = closing / WARNED_TIME
    else:
        closing = math.sqrt(2.0 * WARNED_BRAKING * (room - reserve))
        braking = WARNED_BRAKING
    asked = WARNED_GAIN * (leader_speed + max(closing, WALKING) - speed) - braking
    return max(asked, -WARNED_AT_MOST)


def _halt(speed: float, room: float) -> float:
    """Acceleration that brings the car to rest within `room` m, gently at the end."""
    if room <= 0.2:
        return -1.5 if speed > 0.0 else -0.5
    # Roll up to the place at a walking pace rather than stopping short of it.
    target = math.sqrt(2.0 * 1.0 * room)
    return min((target - speed) / 0.6, 1.0)


def stop_ahead(stopping: bool, light: float, left: float, gap: float, leader_speed: float, style: Style) -> bool:
    """Whether a stop lies within the distance from which this driver rolls."""
    reach = style.coasts_before_stop
    return (stopping and light < reach) or left < reach or (gap < reach and leader_speed < 0.5)
