"""A log as readings of ten instants a second: what the readable filters of the family are fed.

The compiled observer takes every packet at its own time. The filters of appendix A are far slower; here the packets of
0.1 s are joined into one reading of few values, at the middle of that time. Pulses become a speed and a fuel power,
increments both, so that a lost one offsets nothing (LESSONS of a first observer).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer import model
from observer.events import prepare
from observer.kernel import ACCELEROMETER, GPS, INJECTOR, MAP, WHEEL
from observer.observe import pulse_angle, rotation
from observer.settings import DEFAULT
from sensors.log import SensorLog
from sensors.matching import observations
from sensors.roadmap import RoadMap
from vehicle_model.car.parameters import Car

WIDTH = 0.1
"""s."""
SILENCE, CUT = DEFAULT.tick_silence, DEFAULT.cut_gap
POSITION, ALTITUDE = 25.0, 60.0
"""m2, variance of a fix that errs slowly, given five times a second to a filter without a state for that error."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Instant:
    """What was measured about `time` (s): kinds (m,) of `observer.model`, values, variances, and their `aux`."""

    time: float
    kinds: tuple[int, ...]
    value: Array
    variance: Array
    aux: Array


def instants(log: SensorLog, car: Car, road_map: RoadMap | None = None) -> tuple[list[Instant], float]:
    """Return the instants of `log` from its first to its last packet, and the altitude (m) that stands for down = 0.

    North and east count from the first fix, as in `observe`. Kinds: accelerations, speed, fuel power, position,
    altitude, Doppler speed, course, and what the road map says.
    """
    passages = None if road_map is None else observations(log, road_map, car.metres_per_tick, DEFAULT.gps_lag)
    rows, _ = prepare(log, passages)
    if not len(rows):
        return [], 0.0
    t, code = rows[:, 0], rows[:, 1].astype(int)
    first, last = round(t[0] / WIDTH) + 1, round(t[-1] / WIDTH) - 1
    middle = np.arange(first, last + 1) * WIDTH
    edges = np.append(middle - 0.5 * WIDTH, middle[-1] + 0.5 * WIDTH)
    told: list[list[tuple[int, float, float, float]]] = [[] for _ in middle]
    _accelerations(rows[code == ACCELEROMETER], car, edges, told)
    _speeds(t[code == WHEEL], car, edges, told)
    _powers(rows[code == INJECTOR], car, edges, told)
    datum = _fixes(rows[code == GPS], edges, middle, told)
    nodes = rows[code == MAP]
    known = nodes[np.isfinite(nodes[:, 4]), 4]
    if datum is None:
        datum = float(known[0]) if len(known) else 0.0
    for row in nodes:
        place = _place(row[0], edges)
        if place is None:
            continue
        lag = middle[place] - row[0] + row[8]
        for kind, value, deviation in (
            (model.MAP_HEADING, row[2], row[3]),
            (model.MAP_ALTITUDE, row[4] - datum, row[5]),
        ):
            if np.isfinite(value):
                told[place].append((kind, value, deviation**2, lag))
    found = []
    for time, rows_ in zip(middle, told, strict=True):
        columns = np.array(rows_, dtype=np.float64).reshape(-1, 4)
        found.append(
            Instant(float(time), tuple(int(k) for k in columns[:, 0]), columns[:, 1], columns[:, 2], columns[:, 3])
        )
    return found, datum


def _place(time: float, edges: Array) -> int | None:
    place = int(np.searchsorted(edges, time, side="right")) - 1
    return place if 0 <= place < len(edges) - 1 else None


def _accelerations(rows: Array, car: Car, edges: Array, told: list) -> None:
    body = rows[:, 2:5] @ rotation(car.mounting).T
    good = np.isfinite(body).all(axis=1)
    rows, body = rows[good], body[good]
    begin, end = np.searchsorted(rows[:, 0], edges[:-1]), np.searchsorted(rows[:, 0], edges[1:])
    for i, (a, b) in enumerate(zip(begin, end, strict=True)):
        if b > a:
            mean, n = body[a:b].mean(axis=0), b - a
            for axis, deviation in enumerate((0.18, 0.18, 0.6)):
                told[i].append((model.ACCELERATION_X + axis, mean[axis], deviation**2 / n, 0.0))


def _speeds(ticks: Array, car: Car, edges: Array, told: list) -> None:
    """Speed over each instant, where pulses come; else that the car is all but standing."""
    if len(ticks) < 2:
        return
    way = np.interp(edges, ticks, car.metres_per_tick * np.arange(len(ticks)))
    after = np.clip(np.searchsorted(ticks, edges), 1, len(ticks) - 1)
    gap = ticks[after] - ticks[after - 1]
    for i in range(len(edges) - 1):
        if not ticks[0] <= edges[i] <= ticks[-1] - WIDTH or max(gap[i], gap[i + 1]) > SILENCE:
            told[i].append((model.SILENT_WHEELS, 0.3, 0.25, 0.0))
        else:
            told[i].append(
                (model.SPEED, (way[i + 1] - way[i]) / WIDTH, 2.0 * (DEFAULT.tooth_deviation / WIDTH) ** 2, 0)
            )


def _powers(rows: Array, car: Car, edges: Array, told: list) -> None:
    """Mean fuel power over each instant: a pulse's energy is burnt up to the next."""
    if len(rows) < 2:
        return
    energy = car.injector_power * np.clip(rows[:, 2] + car.injector.lag, 0.0, 0.1)
    gap = np.diff(rows[:, 0], append=rows[-1, 0] + 0.1)
    span = np.where(gap > CUT, pulse_angle(car) / 150.0, np.maximum(gap, 2e-3))
    # burnt so far: climbs over each span, flat in the holes
    knots = np.stack([rows[:, 0], np.minimum(rows[:, 0] + span, rows[:, 0] + gap)], axis=1).ravel()
    total = np.stack([np.cumsum(energy) - energy, np.cumsum(energy)], axis=1).ravel()
    burnt = np.interp(edges, knots, total)
    for i in range(len(edges) - 1):
        power = (burnt[i + 1] - burnt[i]) / WIDTH
        told[i].append((model.FUEL_POWER, power, (0.02 * power) ** 2 + 1e4, 0.0))


def _fixes(rows: Array, edges: Array, middle: Array, told: list) -> float | None:
    """Position, altitude, Doppler speed and course; returns the altitude of the first fix, if there is one."""
    good = np.isfinite(rows[:, 2:6]).all(axis=1) & (rows[:, 7] > 0)
    rows = rows[good]
    if not len(rows):
        return None
    clock = rows[:, 0] - rows[:, 2]
    late = clock - clock.min() + DEFAULT.gps_arrival + DEFAULT.gps_lag
    north = (rows[:, 3] - rows[0, 3]) * 111_200.0
    east = (rows[:, 4] - rows[0, 4]) * 111_320.0 * np.cos(np.radians(rows[0, 3]))
    for k, row in enumerate(rows):
        place = _place(row[0], edges)
        if place is None:
            continue
        lag, hdop = late[k] + middle[place] - row[0], max(row[6], 1.0) if np.isfinite(row[6]) else 2.0
        told[place] += [
            (model.GPS_NORTH, north[k], POSITION * hdop**2, lag),
            (model.GPS_EAST, east[k], POSITION * hdop**2, lag),
            (model.GPS_ALTITUDE, row[5] - rows[0, 5], ALTITUDE * hdop**2, lag),
        ]
        if np.isfinite(row[8]):
            told[place].append((model.GPS_SPEED, row[8], DEFAULT.gps_speed**2, lag))
            if row[8] > 3.0 and np.isfinite(row[9]):
                told[place].append((model.GPS_COURSE, row[9], (DEFAULT.gps_course / row[8]) ** 2, lag))
    return float(rows[0, 5])
