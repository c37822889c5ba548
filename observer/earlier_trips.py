"""What several earlier trips learnt, as one: the box's usual bias, and how well it is known.

A box's biases are its own, and each trip adds a change of its own (`ObserverSettings.bias_trip_deviation`). What one
trip learnt is therefore off by that change however long it was; the mean over trips is off by less.
"""

from collections.abc import Mapping, Sequence

from observer.observe import LEARNT, trip_change
from observer.settings import DEFAULT, ObserverSettings


def carried_over(trips: Sequence[Mapping[str, float]], settings: ObserverSettings = DEFAULT) -> dict[str, float]:
    """Return what `trips` (each an `Estimate.learnt`) say together, for the next trip's observer (m/s2, m2/s4).

    Weighted mean, each trip by its own variance and that of the change from trip to trip; `observer.observe.start` adds
    the next trip's. No trips: nothing.
    """
    change = trip_change(settings)
    found: dict[str, float] = {}
    for name in LEARNT:
        told = [(trip[name], trip[f"{name}_variance"] + change[name]) for trip in trips if name in trip]
        if told:
            weight = sum(1.0 / variance for _, variance in told)
            found[name] = sum(value / variance for value, variance in told) / weight
            found[f"{name}_variance"] = 1.0 / weight
    return found
