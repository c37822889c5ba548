"""A trip brought onto one even grid: speed from wheel ticks, engine speed and fuel from injector pulses, specific
force.

Every channel comes from its own sensor, so that later a disagreement between two of them says something. (A filter's
smoothed states have fused it away.) Units SI, conventions of `vehicle_model.car`.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d
from scipy.signal import savgol_filter

from observer.observe import pulse_angle, rotation
from rollingroad.gap.road import Road, match
from sensors.log import SensorLog
from vehicle_model.car.parameters import Car

STEP = 0.2
"""s, of the grid."""
CUT_GAP = 0.3
"""s without an injector pulse that count as fuel cut off (a cycle at 500 rpm lasts 0.24 s)."""
STOP_GAP = 1.2
"""s without a wheel tick that count as standstill."""


@dataclass(frozen=True)
class Trace:
    """One trip. Arrays (n,) on a grid of `step` s unless said otherwise; NaN where a channel is not known."""

    name: str
    time: NDArray[np.float64]
    step: float
    speed: NDArray[np.float64]
    """m/s from the wheels (or the speed column)."""
    acceleration: NDArray[np.float64]
    fuel: NDArray[np.float64]
    """W."""
    engine_speed: NDArray[np.float64]
    """rad/s from the pulses; NaN while they are silent."""
    gear: NDArray[np.int64]
    """1 ... while locked in it, else 0."""
    cut: NDArray[np.bool_]
    force: NDArray[np.float64]
    """m/s2, specific force along the body's x."""
    lateral: NDArray[np.float64]
    vertical: NDArray[np.float64]
    heading: NDArray[np.float64]
    curvature: NDArray[np.float64]
    map_altitude: NDArray[np.float64]
    """m, of the road map under the receiver's track; NaN off the map."""
    saturated: NDArray[np.bool_]
    gps: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """At the receiver's epochs: t (logger clock, lag not removed), speed, altitude, map_altitude, north, east."""
    clock: dict[str, float] = field(default_factory=dict)
    """skew (s/s) by the receiver's time and by the skew packets, with deviations."""
    pulses: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """t, width, energy of each injector pulse."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    second: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """As `gps`, of a second receiver: t, speed."""

    @property
    def distance(self) -> NDArray[np.float64]:
        """m since the start."""
        return np.concatenate([[0.0], np.cumsum(0.5 * (self.speed[1:] + self.speed[:-1]) * self.step)])


def reconstruct(log: SensorLog, car: Car, road: Road | None) -> Trace:
    """Return the trip of `log` on a grid of STEP (box logs) or of the log's own rate (speed and fuel columns)."""
    if len(log["wheel"]) < 50 and len(log["speed"]) >= 20:
        return _from_columns(log, car)
    span = [log[s]["t"][[0, -1]] for s in ("wheel", "injector", "accelerometer") if len(log[s]) > 1]
    start, end = min(s[0] for s in span), max(s[1] for s in span)
    t = np.arange(start + 0.5, end - 0.5, STEP)
    speed, acceleration = _speed(log["wheel"]["t"], car.metres_per_tick, t)
    pulses = _pulses(log, car)
    fuel, omega, cut, saturated = _fuel(pulses, t)
    ratios = np.asarray(car.gear_ratios) / car.wheel_radius
    gear = _gear(omega, speed, ratios, cut)
    body = _body(log, car, t)
    gps, clock, origin = _gps(log)
    n = len(t)
    heading, curvature, altitude = np.full(n, np.nan), np.zeros(n), np.full(n, np.nan)
    if gps:
        heading, curvature = _course(gps, t, speed, acceleration)
        if road is not None:
            place = match(road, gps["north"], gps["east"], gps["course"], origin)
            gps["map_altitude"] = place.altitude
            seen = gps["t"] - 0.2  # the default receiver's lag
            good = np.isfinite(place.altitude)
            if good.sum() > 20:
                altitude = np.interp(t, seen[good], place.altitude[good])
                near = np.interp(t, seen, good.astype(float)) > 0.5
                altitude[~near] = np.nan
    return Trace(
        log.name, t, STEP, speed, acceleration, fuel, omega, gear, cut, *body, heading, curvature, altitude,
        saturated, gps,
        clock, pulses, origin,
    )  # fmt: skip


def _from_columns(log: SensorLog, car: Car) -> Trace:
    """Speed (and fuel) columns: everything else is unknown."""
    rows, burnt = log["speed"], log["fuel"]
    t = np.asarray(rows["t"], float)
    keep = np.append(True, np.diff(t) > 1e-6)
    t, v = t[keep], np.asarray(rows["speed"], float)[keep]
    step = max(float(np.median(np.diff(t))), 0.2)
    grid = np.arange(t[0], t[-1] + 1e-9, step)
    v = np.interp(grid, t, v)
    fuel = np.interp(grid, burnt["t"], burnt["power"]) if len(burnt) > 20 else np.full(len(grid), np.nan)
    n = len(grid)
    unknown = np.full(n, np.nan)
    a = np.gradient(v, step)
    turning = log["engine_speed"]
    omega, gear, cut = unknown.copy(), np.zeros(n, int), np.zeros(n, bool)
    if len(turning) > 20:
        omega = np.interp(grid, turning["t"], turning["speed"])
        cut = (fuel < 0.02 * np.nanmedian(fuel)) & (v > 3.0)
        gear = _gear(omega, v, np.asarray(car.gear_ratios) / car.wheel_radius, np.zeros(n, bool))
    gps, clock, origin = _gps(log)
    force, lateral, vertical = _body(log, car, grid)
    return Trace(
        log.name, grid, step, v, a, fuel, omega, gear, cut, force, lateral, vertical,
        unknown.copy(), np.zeros(n), unknown.copy(), np.zeros(n, bool), gps, clock, {}, origin,
        {name: np.asarray(log["gps_second"][name], float) for name in ("t",
            "speed")} if len(log["gps_second"]) >= 10 else {},
    )  # fmt: skip


def _speed(ticks: NDArray, metres: float, t: NDArray) -> tuple[NDArray, NDArray]:
    """Speed and acceleration: the ticks' distance, smoothed by local cubics over 1.1 s and 0.9 s."""
    if len(ticks) < 10:
        return np.zeros(len(t)), np.zeros(len(t))
    ticks = np.maximum.accumulate(np.asarray(ticks, float))
    gap = np.diff(ticks)
    holes = np.flatnonzero(gap > STOP_GAP)
    place = np.arange(len(ticks)) * metres
    extra_t, extra_d = [], []
    for k in holes:  # it rolls out and starts below the sensor's threshold
        quarter = min(0.45, gap[k] / 4.0)
        for at, share in ((ticks[k] + quarter, 0.35), (ticks[k] + 2 * quarter, 0.5),
                          (ticks[k + 1] - 2 * quarter, 0.5), (ticks[k + 1] - quarter, 0.65)):  # fmt: skip
            extra_t.append(at)
            extra_d.append(place[k] + share * metres)
    at, where = np.concatenate([ticks, extra_t]), np.concatenate([place, extra_d])
    order = np.argsort(at, kind="stable")
    fine = np.arange(t[0] - 1.0, t[-1] + 1.0, 0.1)
    d = np.interp(fine, at[order], where[order])
    v = np.maximum(savgol_filter(d, 11, 2, deriv=1, delta=0.1), 0.0)
    a = savgol_filter(v, 9, 2, deriv=1, delta=0.1)
    v[v < 0.25] = 0.0
    return np.interp(t, fine, v), np.interp(t, fine, a)


def _pulses(log: SensorLog, car: Car) -> dict[str, NDArray]:
    rows = log["injector"]
    t = np.maximum.accumulate(np.asarray(rows["t"], float)) if len(rows) else np.empty(0)
    opening = np.maximum(np.asarray(rows["width"], float) + car.injector.lag, 0.0)
    share = pulse_angle(car) / (4.0 * np.pi)
    return {
        "t": t,
        "width": np.asarray(rows["width"], float),
        "energy": opening * car.injector_power * 1.0,
        "saturated": np.asarray(rows["saturated"], bool),
        "angle": np.full(len(t), 4.0 * np.pi * share),
    }


def _fuel(pulses: dict[str, NDArray], t: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Fuel power, engine speed, cut-off and saturation on the grid. A pulse's fuel belongs to the cycle it opens."""
    n = len(t)
    at = pulses["t"]
    if len(at) < 20:
        return np.full(n, np.nan), np.full(n, np.nan), np.zeros(n, bool), np.zeros(n, bool)
    gap = np.diff(at)
    typical = np.append(gap, gap[-1])
    silent = typical > CUT_GAP
    last = np.where(~silent, np.arange(len(at)), 0)
    last = np.maximum.accumulate(last)
    length = np.where(silent, typical[last], typical)
    length = np.clip(length, 1e-3, CUT_GAP)
    start, end = at, at + length
    energy = np.cumsum(pulses["energy"])
    knots = np.stack([start, end], axis=1).ravel()
    level = np.stack([energy - pulses["energy"], energy], axis=1).ravel()
    edges = np.append(t - STEP / 2, t[-1] + STEP / 2)
    burnt = np.diff(np.interp(edges, knots, level, left=0.0, right=energy[-1])) / STEP
    speed = pulses["angle"] / length
    middle = at + 0.5 * length
    omega = np.interp(t, middle, speed)
    before = np.searchsorted(at, t) - 1
    quiet = (before < 0) | (t > np.where(before >= 0, end[np.maximum(before, 0)], -np.inf) + 0.05)
    omega[quiet] = np.nan
    bad = np.interp(t, at, pulses["saturated"].astype(float)) > 0.05
    return burnt, omega, quiet, bad


def _gear(omega: NDArray, speed: NDArray, ratios: NDArray, cut: NDArray) -> NDArray[np.int64]:
    """Gear locked in; while pulses are silent, the gear before the silence (it cannot be seen)."""
    shown = omega / np.maximum(speed, 0.3)
    with np.errstate(invalid="ignore", divide="ignore"):
        nearest = np.nanargmin(np.abs(np.log(np.nan_to_num(shown, nan=1.0)[:, None] / ratios)), axis=1)
        near = (np.abs(shown / ratios[nearest] - 1.0) < 0.035) & (speed > 1.5) & np.isfinite(omega)
    gear = np.where(near, nearest + 1, 0)
    steady = (minimum_filter1d(gear, 3) == maximum_filter1d(gear, 3)) & (gear > 0)
    gear = np.where(steady, gear, 0)
    index = np.where(~cut, np.arange(len(gear)), 0)
    index = np.maximum.accumulate(index)
    back = np.maximum(index - 3, 0)
    held = np.maximum(gear[index], gear[back])
    return np.where(cut & (speed > 3.0), held, gear)


def _body(log: SensorLog, car: Car, t: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Specific force in body axes, means over the grid's step."""
    rows = log["accelerometer"]
    if len(rows) < 100:
        nothing = np.full(len(t), np.nan)
        return nothing, nothing.copy(), nothing.copy()
    f = rotation(car.mounting) @ np.stack([rows["x"], rows["y"], rows["z"]])
    at = np.maximum.accumulate(np.asarray(rows["t"], float))
    step = t[1] - t[0]
    edges = np.append(t - step / 2, t[-1] + step / 2)
    out = []
    for axis in f:
        total = np.concatenate([[0.0], np.cumsum(axis)])
        place = np.interp(edges, at, np.arange(len(at), dtype=float))
        sums = np.interp(place, np.arange(len(total), dtype=float), total)
        count = np.maximum(np.diff(place), 1e-9)
        mean = np.diff(sums) / count
        mean[np.diff(place) < 1.0] = np.nan
        out.append(mean)
    return out[0], out[1], out[2]


def _gps(log: SensorLog) -> tuple[dict[str, NDArray], dict[str, float], tuple[float, float, float]]:
    """Fixes on the logger's clock: arrival is late by 40 to 250 ms, so the earliest arrivals tie the two clocks."""
    rows = log["gps"]
    clock: dict[str, float] = {}
    skew = log["skew"]
    if len(skew) > 5:
        length = skew["t"][-1] - skew["t"][0] + np.median(np.diff(skew["t"]))
        clock["packets"] = float(skew["gained"].sum() / length)
        clock["packets_sd"] = float(1.0e-3 / length)
    good = (
        np.isfinite(rows["latitude"]) & np.isfinite(rows["utc"]) & (rows["quality"] > 0)
        if len(rows)
        else np.zeros(0, bool)
    )
    rows = rows[good]
    if len(rows) < 20:
        return {}, clock, (0.0, 0.0, 0.0)
    utc, arrived = rows["utc"] - rows["utc"][0], rows["t"]
    packets = len(log["wheel"]) + len(log["injector"]) > 0
    # a box stamps nothing that comes from the receiver: only when its bytes had arrived is known
    slope, offset = _lower_line(utc, arrived) if packets else (1.0, 0.0)
    if packets and utc[-1] > 100:
        clock["gps"] = slope - 1.0
        clock["gps_sd"] = 0.06 / np.sqrt(len(utc)) / max(utc.std(), 1.0) * 1.5 + 1e-7
    t = offset + slope * utc - 0.045 if packets else np.asarray(arrived, float)
    origin = (
        float(np.median(rows["latitude"])),
        float(np.median(rows["longitude"])),
        float(np.median(rows["altitude"])),
    )
    from sensors.projection import to_local

    north, east = to_local(rows["latitude"], rows["longitude"], origin)
    gps = {
        "t": t, "speed": np.asarray(rows["speed"], float), "altitude": np.asarray(rows["altitude"], float),
        "north": north, "east": east, "course": np.asarray(rows["course"], float), "late": arrived - t,
        "map_altitude": np.full(len(t), np.nan),
    }  # fmt: skip
    return gps, clock, origin


def _lower_line(x: NDArray, y: NDArray) -> tuple[float, float]:
    """Slope by least squares, offset by the second percentile of what is left: the earliest arrivals."""
    slope = float(np.polyfit(x - x.mean(), y - x, 1)[0]) + 1.0
    return slope, float(np.percentile(y - slope * x, 2))


def _course(gps: dict[str, NDArray], t: NDArray, speed: NDArray, acceleration: NDArray) -> tuple[NDArray, NDArray]:
    """Heading and curvature on the grid from the receiver's track (course, where it gives one)."""
    course = gps["course"].copy()
    track = np.arctan2(np.gradient(gps["east"]), np.gradient(gps["north"]))
    course = np.where(np.isfinite(course), course, track)
    moving = gps["speed"] > 1.5
    if moving.sum() < 20:
        return np.full(len(t), np.nan), np.zeros(len(t))
    turned = np.unwrap(course[moving])
    heading = uniform_filter1d(np.interp(t + 0.2, gps["t"][moving], turned), 5)
    rate = np.gradient(uniform_filter1d(heading, 5), t[1] - t[0])
    return heading, np.where(speed > 3.0, rate / np.maximum(speed, 3.0), 0.0)
