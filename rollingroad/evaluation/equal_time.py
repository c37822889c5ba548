"""Fuel at the baseline's mean trip time: DESIGN.md, "Fair comparisons"."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rollingroad.evaluation.compare import Consumption, bracket, corrected_fuel
from rollingroad.evaluation.price_search import CLOSE

Account = Mapping[str, Any]
"""What a drive cost and how safe it was: see `evaluate_drives.account`."""
LATE = 100e3
"""W: at most this is charged for a second late. It is what the last seconds cost where others measured it (5 % of the
time of a 5 km route are worth 7 to 15 % of its fuel: 40 to 85 kW); prices far above only happen at signals."""


@dataclass(frozen=True)
class Found:
    """Advised drives at the baseline's mean time, by seed; at the nearest mean time where no price gives that."""

    equal: bool
    """Whether the mean times are equal."""

    fuel: Mapping[int, float]
    """J at the baseline's mean time, with the baseline's energy at the end."""
    exact: Mapping[int, float] | None
    """J interpolated at exactly the baseline's mean time; None where no two prices bracket it."""
    naive: Mapping[int, float]
    """J at the thriftiest price, as metered."""
    nearer: Mapping[int, Account]
    """The drives at the price whose mean time is nearer."""
    time_difference_percent: float
    price: float
    """W."""
    not_bracketed: tuple[int, ...]
    """Seeds whose own baseline time lies beyond all that was driven; they count in the means all the same."""


def relative_time(baseline: Mapping[int, Account], drives: Mapping[int, Account]) -> float:
    """Mean trip time of `drives` over that of `baseline` over the same seeds."""
    return sum(a["time"] for a in drives.values()) / sum(baseline[seed]["time"] for seed in drives)


def at_equal_time(baseline: Mapping[int, Account], driven: Mapping[float, Mapping[int, Account]]) -> Found | None:
    """The drives `driven` (by price of time, W, and seed) at the mean time of `baseline` (by seed); None without any.

    Of the prices whose mean time is within `CLOSE` the lowest counts, what is late charged; where none is, fuel is
    interpolated between the two that bracket it, or taken at the nearest (`Found.equal` False).
    """
    prices = sorted(driven)
    ratios = [relative_time(baseline, driven[price]) for price in prices]
    if not prices:
        return None
    pair, equal = bracket(ratios, 1.0), True
    near = [i for i, ratio in enumerate(ratios) if abs(ratio - 1.0) <= CLOSE]
    exact = None if pair is None else _between(baseline, driven[prices[pair[0]]], driven[prices[pair[1]]])[0]
    if near:
        pair = near[0], near[0]
    elif pair is None:
        nearest = min(range(len(prices)), key=lambda i: abs(ratios[i] - 1.0))
        pair, equal = (nearest, nearest), False
    low, high = (driven[prices[i]] for i in pair)
    fuel, share, left = _between(baseline, low, high)
    seeds = sorted(fuel)
    if not seeds:
        return None
    if near:  # what he is late has its price
        share_late = max(left, 0.0) / sum(baseline[s]["time"] for s in seeds)
        owed = min(prices[pair[0]], LATE) * share_late
        fuel = {s: burnt + owed * baseline[s]["time"] for s, burnt in fuel.items()}
    thrifty = min((d for d in driven.values() if set(seeds) <= set(d)), key=lambda d: sum(d[s]["fuel"] for s in seeds))
    spans = {s: [d[s]["time"] for d in driven.values() if s in d] for s in seeds}
    return Found(
        equal=equal,
        fuel=fuel,
        exact=exact,
        naive={s: thrifty[s]["fuel"] for s in seeds},
        nearer=low if share <= 0.5 else high,
        time_difference_percent=100.0 * left / sum(baseline[s]["time"] for s in seeds),
        price=prices[pair[0]] ** (1.0 - share) * prices[pair[1]] ** share,
        not_bracketed=tuple(s for s in seeds if not min(spans[s]) <= baseline[s]["time"] <= max(spans[s])),
    )


def _between(
    baseline: Mapping[int, Account], low: Mapping[int, Account], high: Mapping[int, Account]
) -> tuple[dict[int, float], float, float]:
    """Fuel (J) by seed between two prices, at the share that makes the mean times equal if one does; the share; and
    the time (s, summed over the seeds) that is left late."""
    seeds = sorted(set(low) & set(high))
    a, b = (sum(d[s]["time"] for s in seeds) for d in (low, high))
    target = sum(baseline[s]["time"] for s in seeds)
    share = 0.0 if b == a else float(np.clip((target - a) / (b - a), 0.0, 1.0))
    fuel = {
        s: (1.0 - share) * _corrected(baseline, low[s], s) + share * _corrected(baseline, high[s], s) for s in seeds
    }
    return fuel, share, (1.0 - share) * a + share * b - target


def _corrected(baseline: Mapping[int, Account], drive: Account, seed: int) -> float:
    base = baseline[seed]
    return corrected_fuel(_consumption(drive), _consumption(base), base["efficiency"])


def _consumption(account: Account) -> Consumption:
    return Consumption(**{key: account[key] for key in ("fuel", "time", "distance", "end_energy")}, price=0.0)
