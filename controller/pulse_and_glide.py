"""A given number of pulses and glides over a distance on the level, CVT: what the corner of 4.5.1 is compared with.

Where the least fuel power P(p) over shaft power p = w T lies above its lower convex hull, the maximum of H alternates
between the two ends p_low and p_high of the chord, and ever faster alternation costs ever less: the infimum is that of
`distance.bellman` on the hull. A driver makes a finite number of pulses. This is the best drive with so many: a pulse
from the start speed, then glides and pulses between two speeds, and a last glide to the end.
"""

import time as clock

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from controller.controller_model import ControllerModel
from controller.distance import cheapest_power, lower_hull
from controller.solution import Solution
from vehicle_model.car.errors import BadInput

SLICES = 120
"""Midpoint slices of one pulse or glide; doubling them changes J by less than 1e-5 (tested)."""


def pulse_and_glide(
    model: ControllerModel, distance: float, start_speed: float, pulses: int, *, case: str = "cvt-distance"
) -> Solution:
    """Least fuel over `distance` m from `start_speed` m/s in `pulses` pulses, time and final speed free.

    The two speeds and the pulse's power are found by Nelder and Mead's simplex. Notes: the number of pulses, speeds.
    Raises BadInput where the map is convex: there it has no pulses.
    """
    if pulses < 1:
        raise BadInput("pulse and glide", f"{pulses} pulses", "at least one")
    began = clock.perf_counter()
    shaft, least = cheapest_power(model, 2000)
    apart = np.flatnonzero(least - lower_hull(shaft, least) > 1e-6 * least)
    if not len(apart):
        raise BadInput("pulse and glide", "fuel power", "a map that is not convex over shaft power")
    low, high = shaft[max(apart[0] - 1, 0)], shaft[min(apart[-1] + 1, len(shaft) - 1)]
    low_power = float(np.interp(low, shaft, least))

    def drive(z: NDArray[np.float64]) -> tuple[float, float]:
        """(J, s) of the drive between exp(z[1]) and exp(z[0]) at pulses of exp(z[2]) W; J huge where there is none."""
        top, bottom, pulse = np.exp(z)
        if not start_speed <= top or not bottom < 0.999 * top or not low < pulse <= shaft[-1]:
            return 1e12, 0.0
        if pulse < 1.01 * model.road_load(top) * top or low > 0.999 * model.road_load(bottom) * bottom:
            return 1e12, 0.0
        power = float(np.interp(pulse, shaft, least))
        first, place = _leg(model, pulse, start_speed, top)
        up, up_metres = _leg(model, pulse, bottom, top)
        down, down_metres = _leg(model, low, top, bottom)
        place += (pulses - 1) * (up_metres + down_metres)
        if place > distance:
            return 1e9 * place / distance, 0.0
        rolled = _glide(model, low, top, distance - place)
        burning, rolling = first + (pulses - 1) * up, (pulses - 1) * down + rolled
        return power * burning + low_power * rolling, burning + rolling

    guesses = [np.log([q * start_speed, r * start_speed, 0.99 * high]) for q, r in ((2.0, 1.1), (2.9, 1.6))]
    options = {"maxiter": 600, "xatol": 1e-5, "fatol": 1.0}
    found = [minimize(lambda z: drive(z)[0], z, method="Nelder-Mead", options=options) for z in guesses]
    best = min(found, key=lambda answer: answer.fun)
    cost, duration = drive(best.x)
    top, bottom, pulse = (float(part) for part in np.exp(best.x))
    nothing = np.empty((0, 2))
    solution = Solution(
        case,
        "pulse-and-glide",
        cost,
        duration,
        distance,
        np.empty(0),
        nothing,
        nothing,
        nothing,
        wall=clock.perf_counter() - began,
        notes={"pulses": float(pulses), "lowest_speed": bottom, "highest_speed": top, "pulse_power": pulse},
    )
    return solution if cost < 1e8 else solution.refuse("no drive with so many pulses was found")


def _leg(model: ControllerModel, power: float, start: float, end: float) -> tuple[float, float]:
    """(s, m) from speed `start` to `end` at shaft power `power`: dt = M_a v dv / (p - R v), midpoint rule."""
    width = (end - start) / SLICES
    v = start + width * (np.arange(SLICES) + 0.5)
    dt = model.accelerated_mass * v * width / (power - model.road_load(v) * v)
    return float(dt.sum()), float((v * dt).sum())


def _glide(model: ControllerModel, power: float, speed: float, metres: float) -> float:
    """Seconds over `metres` from `speed` at shaft power `power`: midpoint rule over distance in E = v^2/2."""
    ds, energy, seconds = metres / (2 * SLICES), 0.5 * speed**2, 0.0
    for _ in range(2 * SLICES):
        middle = energy
        for gain in (0.5, 1.0):
            v = np.sqrt(2.0 * middle)
            middle = max(energy + gain * ds * (power / v - model.road_load(v)) / model.accelerated_mass, 0.01)
            half = v if gain == 1.0 else np.sqrt(2.0 * middle)
        energy, seconds = middle, seconds + ds / half
    return float(seconds)
