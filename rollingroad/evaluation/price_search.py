"""The price of time at which advised trips take, in the mean, as long as the baseline's: sought on a grid of prices.

On the grid first; where two neighbours are found of which one is late and the other in time, the price half a step
between them is driven too, and counts if by the same rule it is in time. A step is a factor of 1.78: late by 1.2 % at
one end and early by 0.8 % at the other, it made up a third of a saving.
"""

import math
from collections.abc import Callable, Mapping

from rollingroad.evaluation.compare import bracket
from rollingroad.evaluation.evaluate_advisors import UNHURRIED

PRICE_STEP = 10.0**0.25
"""Ratio between neighbouring prices: all are powers of it, or lie halfway between two (by ratio), so that more seeds
find the drives of fewer done."""
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


def seek(
    at: Callable[[float], float | None],
    price: float,
    rounds: int,
    scouts: Callable[[float], float | None] | None = None,
) -> None:
    """Drive by `at` (see `drive_around`) around the baseline's time, beginning near `price` (W), then half a step on.

    `scouts` drives a few of the same seeds: it finds where to begin, and what it finds late is not driven finer.
    """
    leap = LEAP
    if scouts is not None:
        price, leap = lowest_in_time(drive_around(scouts, price, rounds)) or price, 1
    between = halfway(drive_around(at, price, rounds, leap))
    if between is None:
        return
    if scouts is None or ((time := scouts(between)) is not None and time <= AIM):
        at(between)


def halfway(times: Mapping[float, float]) -> float | None:
    """The price (W) between the lowest in time and its neighbour, which is late; None where that was not driven."""
    first = min((price for price, time in times.items() if time <= AIM), default=None)
    if first is None or on_grid(first) - 1 not in map(on_grid, times):
        return None
    return PRICE_STEP ** (on_grid(first) - 0.5)


def lowest_in_time(times: Mapping[float, float]) -> float | None:
    """The lowest price whose relative time is not beyond `AIM`, else the highest; None without any."""
    return min((price for price, time in times.items() if time <= AIM), default=max(times, default=None))
