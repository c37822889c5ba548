"""From a log to the events that the compiled observer reads: one row per packet, admitted, ordered, with a 10 Hz grid.

Time stamps are the one thing a filter cannot gate by chi-square, so they are judged first. A packet enters unless its
stamp is not finite, lies further back than packets may overtake each other, or jumps ahead alone. A jump that
several packets in a row confirm is a hole, or, where it is absurdly long or goes back, a clock that was set anew.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from observer.kernel import (
    ACCELEROMETER,
    COLUMNS,
    COMPASS_EVENT,
    FUEL,
    GPS,
    GRID,
    GYROSCOPE,
    INJECTOR,
    MAP,
    REPEATED,
    SKEW,
    SPEED_EVENT,
    STEP,
    WHEEL,
)
from sensors.log import SensorLog

HORIZON = 0.05
"""s: how far a packet may be overtaken (an injector pulse is written at its end and stamped at its start)."""
JUMP = 5.0
"""s: a longer step ahead must be confirmed."""
CONFIRMED = 5
"""Packets in a row that confirm a step."""
RESTART = 3600.0
"""s: a confirmed step that is longer is taken for a clock that was set anew."""
GRID_STEP = 0.1
"""s: the estimate's grid."""

ADMITTED, NOT_FINITE, BACKWARD, JUMPED = range(4)
VERDICTS = ("admitted", "not_finite", "backward", "jumped")
DOOR = 4
"""Size of the door's memory: newest time, candidate, how often confirmed, shift of the clock."""

_SOURCES: dict[str, tuple[int, float, tuple[str, ...]]] = {
    "accelerometer": (ACCELEROMETER, 0.5e-3, ("x", "y", "z")),
    "wheel": (WHEEL, 62.5e-6, ()),
    "injector": (INJECTOR, 0.5e-3, ("width", "saturated")),
    "gps": (GPS, 0.0, ("utc", "latitude", "longitude", "altitude", "hdop", "quality", "speed", "course")),
    "skew": (SKEW, 0.0, ("gained",)),
    "gyroscope": (GYROSCOPE, 0.0, ("x", "y", "z")),
    "compass": (COMPASS_EVENT, 0.0, ("heading",)),
    "speed": (SPEED_EVENT, 0.0, ("speed",)),
    "fuel": (FUEL, 0.0, ("power",)),
}
"""Stream: code, half the quantum of its stamps (s; stamps are cut, not rounded), columns in the order of the kernel."""


def door() -> NDArray[np.float64]:
    """Return the door's memory before the first packet."""
    return np.array([math.nan, math.nan, 0.0, 0.0])


@njit(cache=True)
def admit(t, memory):
    """Judge the stamp `t` (s). Return the verdict and the time to use; `memory` (DOOR,) is changed.

    memory: newest admitted time, candidate for a new time base, how many packets confirmed it, shift of the clock.
    """
    if not math.isfinite(t) or abs(t) > 1e12:
        return NOT_FINITE, t
    t = t + memory[3]
    newest = memory[0]
    if math.isnan(newest) or (t >= newest - HORIZON and t <= newest + JUMP):
        if math.isnan(newest):
            # the first packet may itself be the odd one out: it is a candidate like any other
            if memory[2] > 0.0 and abs(t - memory[1]) <= 1.0:
                memory[2] += 1.0
            else:
                memory[2] = 1.0
            memory[1] = t
            if memory[2] < CONFIRMED:
                return JUMPED, t
            memory[0] = t
            memory[2] = 0.0
            return ADMITTED, t
        if t > newest:
            memory[0] = t
        memory[2] = 0.0
        return ADMITTED, t
    if memory[2] > 0.0 and abs(t - memory[1]) <= 1.0:
        memory[2] += 1.0
    else:
        memory[2] = 1.0
    memory[1] = t
    if memory[2] >= CONFIRMED:
        memory[2] = 0.0
        if t < newest or t > newest + RESTART:
            shift = newest + 1.0 - t
            memory[3] += shift
            t = t + shift
        memory[0] = t
        return ADMITTED, t
    return (BACKWARD if t < newest else JUMPED), t


@njit(cache=True)
def _admit_all(times, memory, verdicts):
    """Run `admit` over the packets in their order; `times` is replaced by the times to use."""
    for i in range(times.shape[0]):
        verdict, t = admit(times[i], memory)
        verdicts[i] = verdict
        times[i] = t


def packet_rows(stream: str, packets: NDArray) -> NDArray[np.float64]:
    """Return `packets` of `stream` (sensors.log.STREAMS) as event rows (n, COLUMNS), in the kernel's order."""
    code, half, columns = _SOURCES[stream]
    rows = np.zeros((len(packets), COLUMNS))
    rows[:, 0] = packets["t"] + half
    rows[:, 1] = code
    for place, name in enumerate(columns):
        rows[:, 2 + place] = packets[name]
    return rows


def map_rows(passages: NDArray, known: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the nodes passed (`sensors.matching.OBSERVATION`) as event rows, at the times `known` (n,), s."""
    rows = np.zeros((len(passages), COLUMNS))
    rows[:, 0] = np.maximum(known, passages["t"])
    rows[:, 1] = MAP
    for column, name in enumerate(("heading", "altitude", "straightness")):
        rows[:, 2 + 2 * column] = passages[name]
        rows[:, 3 + 2 * column] = passages[f"{name}_sigma"]
    rows[:, 8] = rows[:, 0] - passages["t"]
    return rows


def passage_rows(passages: NDArray, log: SensorLog) -> NDArray[np.float64]:
    """Return the event rows of the nodes that a whole log passes, at the stamps of the packets that told of them."""
    told = [log[stream] for stream in ("wheel", "gps", "speed")]
    known = np.concatenate([packets["order"] for packets in told])
    stamps = np.concatenate([packets["t"] for packets in told])
    sequence = np.argsort(known, kind="stable")
    place = np.searchsorted(known[sequence], passages["order"])
    return map_rows(passages, stamps[sequence][place])


def prepare(log: SensorLog, passages: NDArray | None = None) -> tuple[NDArray[np.float64], dict[str, int]]:
    """Return the events of `log` (n, COLUMNS), by time, without grid lines, and what was turned away, counted.

    `passages` are the nodes of the road map that the log passes. Packets are judged in the order in which they stand in
    the log and then sorted by time (stable).
    """
    blocks, orders = [], []
    for stream in _SOURCES:
        packets = log[stream]
        if len(packets):
            blocks.append(packet_rows(stream, packets))
            orders.append(packets["order"])
    if not blocks:
        return np.empty((0, COLUMNS)), {}
    if passages is not None and len(passages):
        # right behind the packet that told them
        blocks.append(passage_rows(passages, log))
        orders.append(passages["order"])
    rows = np.concatenate(blocks)
    rows = rows[np.argsort(np.concatenate(orders), kind="stable")]
    times = rows[:, 0].copy()
    verdicts = np.empty(len(rows), dtype=np.int64)
    _admit_all(times, door(), verdicts)
    rows[:, 0] = times
    refused = {name: int(np.count_nonzero(verdicts == i)) for i, name in enumerate(VERDICTS) if i != ADMITTED}
    rows = rows[verdicts == ADMITTED]
    return rows[np.argsort(rows[:, 0], kind="stable")], {name: count for name, count in refused.items() if count}


def fuel_steps(rows: NDArray[np.float64], opening_lag: float, power: float, cut_gap: float) -> NDArray[np.float64]:
    """Return STEP event rows: when, in hindsight, the fuel power changed, and by how much.

    `rows` are admitted events by time; `opening_lag` (s) and `power` (W, all injectors) turn a width into energy. A
    pulse holds the energy of the interval that it opens, so its mean power is known. Where it lies between its
    neighbours' the power stepped inside the interval, and the share of each neighbour says where; else at its edges.
    """
    pulses = rows[rows[:, 1] == INJECTOR]
    pulses = pulses[np.diff(pulses[:, 0], prepend=-np.inf) >= REPEATED]
    if len(pulses) < 3:
        return np.empty((0, COLUMNS))
    t, energy = pulses[:, 0], power * np.maximum(pulses[:, 2] + opening_lag, 0.0)
    gap = np.diff(t, append=np.inf)
    last = gap > cut_gap
    first = np.concatenate([[True], last[:-1]])
    interval = np.where(last, np.concatenate([[0.05], np.minimum(gap[:-1], cut_gap)]), gap)
    interval = np.maximum(interval, 2e-3)
    mean = energy / interval
    before = np.where(first, 0.0, np.concatenate([[0.0], mean[:-1]]))
    after = np.where(last, 0.0, np.concatenate([mean[1:], [0.0]]))
    change = after - before
    inside = (mean - before) * (after - mean) > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(inside, (after - mean) / change, 0.0)
    blocks = []
    for chosen, at, size, falls in (
        (inside, t + share * interval, change, last),
        (~inside, t, mean - before, np.zeros(len(t), bool)),
        (~inside & last, t + interval, after - mean, last),
    ):
        block = np.zeros((int(np.count_nonzero(chosen)), COLUMNS))
        block[:, 0], block[:, 1] = at[chosen], STEP
        block[:, 2], block[:, 3] = size[chosen], falls[chosen]
        blocks.append(block)
    return np.concatenate(blocks)


def with_grid(rows: NDArray[np.float64], steps: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Return `rows` with a grid line every GRID_STEP from the first event on; events at a line's time go first.

    `steps`, where given, are further event rows, in any order.
    """
    if not len(rows):
        return rows
    first = math.ceil(rows[0, 0] / GRID_STEP)
    last = math.floor(rows[-1, 0] / GRID_STEP)
    grid = np.zeros((max(last - first + 1, 0), COLUMNS))
    grid[:, 0] = np.arange(first, last + 1) * GRID_STEP
    grid[:, 1] = GRID
    if steps is not None:
        rows = np.concatenate([rows, steps])
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
    places = np.searchsorted(rows[:, 0], grid[:, 0], side="right")
    return np.insert(rows, places, grid, axis=0)
