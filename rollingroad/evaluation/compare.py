"""Fair comparison of two drives: same route, same traffic, equal trip time, stored energy at the end accounted for.

Fuel is compared *at the baseline's trip time*: the advised fuel is interpolated between two drives, at different prices
of time, whose trip times bracket the baseline's (DESIGN.md, "Fair comparisons").
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Consumption:
    """What one drive cost. `fuel` in J, `time` in s, `end_energy` in J: kinetic energy still in the car at the end."""

    fuel: float
    time: float
    distance: float
    end_energy: float
    price: float
    """W: the price of time at which it was driven (0 for a baseline)."""


@dataclass(frozen=True)
class Comparison:
    """An advised driver against a baseline. Savings in percent of the baseline's fuel; None without a bracket."""

    baseline: Consumption
    fuel: float | None
    """J at the baseline's trip time and end energy."""
    saving_percent: float | None
    time_difference_percent: float
    """What is left of the difference in time after interpolation: 0 inside a bracket."""
    naive_saving_percent: float
    """Fuel of the thriftiest advised drive against the baseline's, time ignored."""
    nearest: int
    """Index of the advised drive whose time is nearest to the baseline's."""


def corrected_fuel(drive: Consumption, baseline: Consumption, efficiency: float) -> float:
    """Fuel of `drive`, J, as if it had ended with the baseline's stored energy.

    Energy still in the car is worth the fuel that it would take to put it there, at the `efficiency` (0 to 1) of the
    trip. Positions at the end are equal, and so is the potential energy.
    """
    return drive.fuel - (drive.end_energy - baseline.end_energy) / efficiency


def bracket(times: Sequence[float], target: float) -> tuple[int, int] | None:
    """Indices of the two drives with the nearest times at or below and above `target`; None where one side is empty."""
    below = [i for i, t in enumerate(times) if t <= target]
    above = [i for i, t in enumerate(times) if t >= target]
    if not below or not above:
        return None
    return max(below, key=lambda i: times[i]), min(above, key=lambda i: times[i])


def compare(baseline: Consumption, advised: Sequence[Consumption], efficiency: float) -> Comparison:
    """Compare `advised` drives (at least one) with `baseline`; `efficiency` is that of `corrected_fuel`.

    Where even the drive at no price of time arrives before the baseline, it makes up the difference parked at its
    destination: waiting parked does not count, and burns nothing.
    """
    times = [drive.time for drive in advised]
    fuels = [corrected_fuel(drive, baseline, efficiency) for drive in advised]
    nearest = min(range(len(advised)), key=lambda i: abs(times[i] - baseline.time))
    naive = 100.0 * (1.0 - min(drive.fuel for drive in advised) / baseline.fuel)
    pair = bracket(times, baseline.time)
    unhurried = [i for i, drive in enumerate(advised) if drive.price <= 0.0 and drive.time <= baseline.time]
    if pair is None and unhurried:  # nothing is gained by being slower still: he waits, parked, engine off
        pair = unhurried[0], unhurried[0]
    if pair is None:
        left = 100.0 * (times[nearest] / baseline.time - 1.0)
        return Comparison(baseline, None, None, left, naive, nearest)
    low, high = pair
    share = 0.0 if times[high] == times[low] else (baseline.time - times[low]) / (times[high] - times[low])
    fuel = fuels[low] + share * (fuels[high] - fuels[low])
    return Comparison(baseline, fuel, 100.0 * (1.0 - fuel / baseline.fuel), 0.0, naive, nearest)


def search_bracket(
    drive: Callable[[Sequence[float]], Sequence[Consumption]],
    target: float,
    prices: tuple[float, float],
    *,
    width: float = 0.03,
    rounds: int = 3,
) -> list[Consumption]:
    """Drive at prices of time until two drives bracket the trip time `target` within `width` (relative).

    `drive` takes several prices (W) at once, so that they can run side by side, and returns one drive each. Trip time
    falls with the price, but not evenly: a signal missed costs half a minute. So each round adds two prices, outside
    the range while there is no bracket, inside the bracket after that; whatever was driven is returned, in order of
    driving, for the caller to compare.
    """
    done = list(drive(prices))
    for _ in range(rounds - 1):
        times = [d.time for d in done]
        pair = bracket(times, target)
        if pair is None:
            if min(times) > target:  # too slow at every price so far
                high = max(d.price for d in done)
                done += drive((high * 2.0, high * 5.0))
            else:
                low = min(d.price for d in done)
                if low <= 0.0:  # at no price at all he is still early: he waits, parked (see `compare`)
                    break
                done += drive((low / 4.0, 0.0))
            continue
        a, b = (done[i] for i in pair)
        if b.time - a.time <= width * target:
            break
        low, high = sorted((a.price, b.price))
        if high - low <= 1e-3 * abs(high):  # the same price twice: the gap is a signal's, not the price's
            break
        done += drive(tuple(_between(low, high, share) for share in (1.0 / 3.0, 2.0 / 3.0)))
    return done


def _between(low: float, high: float, share: float) -> float:
    """A price between two: by ratio where both are positive (time answers to the ratio), else by difference."""
    return low ** (1.0 - share) * high**share if low > 0.0 else low + share * (high - low)
