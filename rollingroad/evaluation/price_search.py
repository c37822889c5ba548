"""The price of time at which advised trips take, in the mean, as long as the baseline's: sought on a grid of prices."""

import math
from collections.abc import Callable, Mapping

from rollingroad.evaluation.compare import bracket
from rollingroad.evaluation.evaluate_advisors import UNHURRIED

PRICE_STEP = 10.0**0.25
"""Ratio between neighbouring prices: all prices are powers of it, so that more seeds find the drives of fewer done."""
LEAP = 2
"""Steps to the next price while all are on one side of the baseline's time; twice that if they are far from it."""
FAR = 0.05
"""Relative time that is far."""
CLOSE = 0.01
"""Mean trip times this near to the baseline's are equal (DESIGN.md)."""
AIM = 1.0 + CLOSE
"""Relative time around which the search ends: the lowest price that is not later counts."""
ROUNDS = 7
"""Prices at most."""


def on_grid(price: float) -> int:
    """Number of the nearest price that is driven at: `PRICE_STEP` to that power."""
    return round(math.log(price) / math.log(PRICE_STEP))


def drive_around(
    at: Callable[[float], float | None], price: float, rounds: int, leap: int = LEAP
) -> dict[float, float]:
    """Drive at prices of time until two with relative times around `AIM` are one step apart, or `rounds` are over.
    `at` drives at a price and returns the relative time, None where no drive succeeded.

    One price after the other, each where the times so far point to, `leap` steps on while all are on one side; content
    with a time within `CLOSE` where the next price would be below `UNHURRIED`: to hold back a drive that is a little
    quicker only costs fuel. Returns the relative times by price.
    """
    times: dict[int, float] = {}
    step = on_grid(price)
    for _ in range(rounds):
        time = at(PRICE_STEP**step)
        if time is None:
            break
        times[step] = time
        steps = sorted(times)
        pair = bracket([times[k] for k in steps], AIM)
        if pair is None and min(times.values()) > AIM:
            step = steps[-1] + (2 * leap if min(times.values()) > 1.0 + FAR else leap)
        elif pair is None:
            quick = 1.0 - max(times.values())
            if quick <= CLOSE and steps[0] <= on_grid(UNHURRIED):
                break
            step = steps[0] - (2 * leap if quick > FAR else leap)
        else:
            slow, fast = (steps[i] for i in reversed(pair))
            if abs(fast - slow) <= 1:
                break
            share = (times[slow] - AIM) / (times[slow] - times[fast])
            low, high = sorted((slow, fast))
            step = min(max(round(slow + share * (fast - slow)), low + 1), high - 1)
    return {PRICE_STEP**k: time for k, time in times.items()}


def lowest_in_time(times: Mapping[float, float]) -> float | None:
    """The lowest price whose relative time is not beyond `AIM`, else the highest; None without any."""
    return min((price for price, time in times.items() if time <= AIM), default=max(times, default=None))
