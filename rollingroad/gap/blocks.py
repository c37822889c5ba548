"""A trip cut into blocks: which samples are compared, in which regime, and how much each block may scatter."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from rollingroad.gap.motion import LAG, grade_known, motion_of
from rollingroad.gap.reconstruct import Trace
from rollingroad.gap.replay import Motion, Replay, replay_vector
from vehicle_model.car.parameters import Car
from vehicle_model.plant import kernel as k

Array = NDArray[np.float64]

CHANNELS = (
    "fuel_power", "coast_force", "gnss_speed", "gear_ratio", "idle_speed", "launch_speed", "shift_time", "height_gps",
    "height_map", "clock_rate", "gnss_second",
)  # fmt: skip
REGIMES = ("idle", "drive", "overrun", "launch", "open", "all")
BLOCK = 5.0
"""s, of the fuel and force blocks."""
COARSE = 30.0
"""s, of the fuel blocks where speed and fuel are all there is."""
CREEP = 5.5
"""m/s in first gear, below which clutch and brake are the driver's own: neither shows in wheels and pulses."""
UNSURE = 4.0
"""Times the fuel's deviation while the clutch slips or may slip."""
TIMING = 0.08
"""s by which force and fuel may be apart: what a jerk makes of it is noise."""
LOCAL_GRADE = 0.02
"""Deviation of a block's grade where nothing tells it."""
BRAKE_LIMIT = 0.28
"""m/s2: while the fuel is cut, a deceleration that much beyond the overrun's is the brake's."""


@dataclass(frozen=True)
class Samples:
    """A trip's samples: what the replay needs and what is compared. Arrays (n,)."""

    motion: Motion
    fuel: Array
    regime: NDArray[np.int64]
    """Index into REGIMES, -1 where the fuel tells nothing."""
    coasting: NDArray[np.bool_]
    bias: float
    bias_sd: float
    """m/s2: forward accelerometer bias that the receiver's altitude shows."""
    height: Array
    """m, integrated from specific force with no bias."""


@dataclass(frozen=True)
class Layout:
    """Which samples make which block, (m,) blocks in all; fixed once from the unperturbed trip."""

    channel: NDArray[np.int64]
    regime: NDArray[np.int64]
    time: Array
    """s since the trip began, middle of the block."""
    distance: Array
    sigma: Array
    """A first idea of each block's deviation."""
    parts: dict[str, tuple[NDArray, NDArray, NDArray]]
    """channel -> (sample or fix index, block number within the channel, count per block)."""


@dataclass(frozen=True)
class Prepared:
    """A trip, ready to be compared with any setting of the simulator."""

    name: str
    trace: Trace
    samples: Samples
    layout: Layout
    start: float


def prepare(trace: Trace, car: Car, vector: Array) -> Prepared:
    """Return the trip of `trace` with its regimes and blocks; `vector` is the nominal plant's (`plant_parameters`)."""
    motion, height, bias, bias_sd = motion_of(trace, car, float(vector[k.P_IDLE]))
    nominal = replay_vector(vector, motion)
    coarse = not np.isfinite(trace.engine_speed).any()
    regime = _regimes(trace, motion, nominal, car, vector, coarse)
    excess = (nominal.road_force - nominal.overrun_force) / car.mass
    held = trace.cut & (motion.gear > 0) & (motion.speed > 4.0)
    calm = uniform_filter1d(held.astype(float), 5) > 0.99
    coasting = _unbraked(calm, uniform_filter1d(excess, 5))
    samples = Samples(motion, trace.fuel, regime, coasting, bias, bias_sd, height)
    return Prepared(trace.name, trace, samples, _layout(trace, samples, nominal, car, coarse), float(trace.time[0]))


def _unbraked(calm: NDArray[np.bool_], excess: Array) -> NDArray[np.bool_]:
    """Of each run with the fuel cut, the samples near its least braked level, if that level is no brake's itself."""
    change = np.diff(np.concatenate([[0], calm.astype(int), [0]]))
    out = np.zeros(len(calm), bool)
    for a, b in zip(np.flatnonzero(change == 1), np.flatnonzero(change == -1), strict=True):
        if b - a < 5:
            continue
        level = np.partition(excess[a:b], -3)[-3]
        if abs(level) < BRAKE_LIMIT:
            out[a:b] = np.abs(excess[a:b] - level) < 0.05
    return out


def _regimes(trace: Trace, m: Motion, nominal: Replay, car: Car, vector: Array, coarse: bool) -> NDArray[np.int64]:
    known = np.isfinite(trace.fuel) & ~trace.saturated
    if coarse:
        return np.where(known, REGIMES.index("all"), -1)
    locked = m.gear > 0
    settled = uniform_filter1d(locked.astype(float), 5) > 0.99
    peak = car.engine.max_torque
    drive = settled & ~trace.cut & (nominal.engine_torque > 0.04 * peak)
    overrun = (
        settled & (nominal.engine_torque < 0.8 * nominal.overrun) & (m.engine_speed > vector[k.P_CUT_RESUME] + 20.0)
    )
    overrun &= uniform_filter1d(overrun.astype(float), 9) > 0.99
    steady = np.abs(np.gradient(uniform_filter1d(m.engine_speed, 5), trace.step)) < 3.0
    idle = (uniform_filter1d(m.speed, 11) < 0.02) & ~trace.cut & steady
    launch = ~locked & (m.acceleration > 0.2) & (m.speed > 0.3) & (m.speed < 6.0) & ~trace.cut
    opened = ~locked & ~launch & ~idle & (m.speed > 0.5) & ~trace.cut
    out = np.full(len(m.time), -1)
    for name, mask in (("open", opened), ("launch", launch), ("drive", drive), ("overrun", overrun), ("idle", idle)):
        out[mask & known] = REGIMES.index(name)
    return out


def _layout(trace: Trace, samples: Samples, nominal: Replay, car: Car, coarse: bool) -> Layout:
    m = samples.motion
    columns: dict[str, list] = {"channel": [], "regime": [], "time": [], "distance": [], "sigma": []}
    parts = {}

    def add(
        channel: str, index: NDArray, label: NDArray, time: Array, regime: NDArray, sigma: Array, least: int
    ) -> None:
        """Blocks of samples `index` that share `label`; `time`, `regime`, `sigma` per sample."""
        if not len(index):
            return
        _, number, count = np.unique(label, return_inverse=True, return_counts=True)
        keep = count[number] >= least
        index, number = index[keep], number[keep]
        if not len(index):
            return
        _, number, count = np.unique(number, return_inverse=True, return_counts=True)
        parts[channel] = (index, number, count)

        def mean(x: Array) -> Array:
            return np.bincount(number, x[keep]) / count

        columns["channel"].append(np.full(len(count), CHANNELS.index(channel)))
        columns["regime"].append(np.round(mean(regime.astype(float))).astype(int))
        columns["time"].append(mean(time))
        columns["distance"].append(np.interp(mean(time), m.time, m.distance))
        columns["sigma"].append(np.sqrt(np.bincount(number, sigma[keep] ** 2)) / np.sqrt(count))

    step = trace.step
    span = COARSE if coarse else BLOCK
    block = (m.time / span).astype(int)
    index = np.flatnonzero(samples.regime >= 0)
    label = block[index] * 16 + samples.regime[index]
    force = 0.012 * car.mass + 10.0
    if not (coarse or grade_known(trace)):  # the road is taken for level: its hills are noise
        force = float(np.hypot(force, LOCAL_GRADE * car.mass * car.gravity))
    slope = 2.7
    sigma = np.sqrt((force * slope * m.speed) ** 2 + (0.012 * np.nan_to_num(samples.fuel)) ** 2 + 150.0**2)
    jerk = np.gradient(m.acceleration, step) if not coarse else np.zeros(len(m.time))
    # a running sum may end a little below zero
    jerk = np.sqrt(np.maximum(uniform_filter1d(jerk**2, max(1, round(2.0 / step))), 0.0))
    sigma = np.hypot(sigma, TIMING * car.mass * jerk * slope * m.speed)
    slipping = np.isin(samples.regime, [REGIMES.index("launch"), REGIMES.index("open")])
    sigma = sigma * np.where(slipping | ((m.gear == 1) & (m.speed < CREEP)), UNSURE, 1.0)
    if coarse:
        sigma = np.full(len(m.time), 0.05 * float(np.nanmean(trace.fuel)) if np.isfinite(trace.fuel).any() else 1.0)
    full = np.maximum(span / step, 1.0)
    count = np.bincount(np.unique(label, return_inverse=True)[1]) if len(label) else np.zeros(0)
    share = count[np.unique(label, return_inverse=True)[1]] / full if len(label) else np.zeros(0)
    blocksigma = sigma[index] / np.sqrt(np.maximum(share, 0.02))
    add("fuel_power", index, label, m.time[index], samples.regime[index], blocksigma, max(2, round(0.8 / step)))
    if not coarse:
        index = np.flatnonzero(samples.coasting)
        run = np.cumsum(np.append(True, np.diff(index) > 1)) if len(index) else index
        label = run * 10_000 + block[index]
        add("coast_force", index, label, m.time[index], np.full(len(index), 2), np.full(len(index), 1.6 * force), 5)
        index = np.flatnonzero(samples.regime == REGIMES.index("drive"))
        add("gear_ratio", index, block[index], m.time[index], np.full(len(index), 1), np.full(len(index), 0.002), 8)
        index = np.flatnonzero(samples.regime == REGIMES.index("idle"))
        add("idle_speed", index, block[index], m.time[index], np.full(len(index), 0), np.full(len(index), 2.0), 10)
        launches = _events(samples.regime == REGIMES.index("launch"), 4, 60)
        shifts = _events((m.gear == 0) & ~trace.cut & (m.speed > 3.5), 2, 12)
        for name, (index, label), spread in (("launch_speed", launches, 12.0), ("shift_time", shifts, 0.25)):
            regime = np.full(len(index), 3 if name == "launch_speed" else 4)
            add(name, index, label, m.time[index], regime, np.full(len(index), spread), 1)
    if trace.gps and len(trace.gps["t"]) > 100:
        at = trace.gps["t"] - trace.time[0]
        wheel = np.interp(at - LAG, m.time, m.speed)
        rate = np.interp(at - LAG, m.time, np.abs(m.acceleration))
        index = np.flatnonzero(
            (wheel > 3.0) & np.isfinite(trace.gps["speed"]) & (at > 2) & (at < m.time[-1] - 2) & (rate < 2.5)
        )
        label = (at[index] / max(1.0, 2.0 * float(np.median(np.diff(at))))).astype(int)  # at least two fixes a block
        add("gnss_speed", index, label, at[index], np.full(len(index), 1), np.full(len(index), 0.06), 2)
        if np.isfinite(trace.force).mean() > 0.9:
            for name, column in (("height_gps", "altitude"), ("height_map", "map_altitude")):
                index = np.flatnonzero(np.isfinite(trace.gps[column]) & (at > 2) & (at < m.time[-1] - 2))
                add(
                    name, index, (at[index] / 10).astype(int), at[index], np.full(len(index), 1), np.ones(len(index)), 5
                )
    if parts.get("coast_force") is not None:
        columns["sigma"] = _doubt_brakes(columns, parts["coast_force"], nominal)
    if len(trace.second.get("t", ())) >= 10:
        at = trace.second["t"] - trace.time[0]
        wheel = np.interp(at - LAG, m.time, m.speed)
        index = np.flatnonzero((wheel > 3.0) & np.isfinite(trace.second["speed"]) & (at > 2) & (at < m.time[-1] - 0.5))
        add("gnss_second", index, index, at[index], np.full(len(index), 1), np.full(len(index), 0.3), 1)
    stacked = {name: np.concatenate(rows) if rows else np.zeros(0) for name, rows in columns.items()}
    if "gps" in trace.clock:
        deviation = np.hypot(trace.clock["gps_sd"], 12e-6)
        rows = {"channel": CHANNELS.index("clock_rate"), "regime": 1, "time": m.time[-1], "distance": m.distance[-1]}
        stacked = {n: np.append(x, deviation if n == "sigma" else rows[n]) for n, x in stacked.items()}
    return Layout(
        stacked["channel"].astype(int),
        stacked["regime"].astype(int),
        stacked["time"],
        stacked["distance"],
        stacked["sigma"],
        parts,
    )


def _doubt_brakes(columns: dict[str, list], part: tuple[NDArray, NDArray, NDArray], nominal: Replay) -> list:
    """Deviations, larger for coasting blocks that stand above the trip's lower levels: there a light brake is
    likely."""
    index, number, count = part
    value = np.bincount(number, (nominal.overrun_force - nominal.road_force)[index]) / count
    usual = np.percentile(value, 35)
    at = next(i for i, rows in enumerate(columns["channel"]) if rows[0] == CHANNELS.index("coast_force"))
    sigma = columns["sigma"]
    return [np.maximum(rows, np.abs(value - usual) / 1.2) if i == at else rows for i, rows in enumerate(sigma)]


def _events(mask: NDArray[np.bool_], shortest: int, longest: int) -> tuple[NDArray, NDArray]:
    """Samples of each run of `mask` between `shortest` and `longest` samples long, and the run's number."""
    change = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    keep = (ends - starts >= shortest) & (ends - starts <= longest)
    index = [np.arange(a, b) for a, b in zip(starts[keep], ends[keep], strict=True)]
    label = [np.full(len(rows), n) for n, rows in enumerate(index)]
    return (np.concatenate(index), np.concatenate(label)) if index else (np.zeros(0, int), np.zeros(0, int))
