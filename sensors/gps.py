"""The satellite receiver (FV-M8; seed 004, 2.3.1): 5 Hz, filtered, wrong in a correlated way, and sometimes deaf."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfinv

from sensors import nmea
from sensors.projection import to_geodetic
from sensors.settings import BoxSettings
from vehicle_model.car.randomness import generator
from vehicle_model.car.route import CANYON, TUNNEL
from vehicle_model.car.trip import Trip

READING = np.dtype([("t", "f8"), ("delay", "f8"), *nmea.FIX.descr])
BYTES_PER_SECOND = 3840.0
"""38,400 baud."""
PIECE = 64
"""Bytes of text that the logger takes over at a time."""
WARM_UP = 20.0


def gauss_markov(rng: np.random.Generator, count: int, step: float, time: float) -> NDArray[np.float64]:
    """A stationary first-order Gauss-Markov process (count,), deviation 1, correlation time `time` (s)."""
    from scipy.signal import lfilter  # a third of what a process that drives, and senses nothing, would import

    keep = np.exp(-step / time)
    drive = rng.standard_normal(count) * np.sqrt(1.0 - keep * keep)
    drive[0] = rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -keep], drive))


def _lagged(values: NDArray[np.float64], step: float, lag: float) -> NDArray[np.float64]:
    """First-order low pass of time constant `lag`, at rest at first."""
    if lag <= 0.0:
        return values
    from scipy.signal import lfilter  # see `gauss_markov`

    keep = np.exp(-step / lag)
    # The exact response to a straight line between samples, so that a steady drive lags by exactly `lag`.
    new = 1.0 - lag / step * (1.0 - keep)
    old = lag / step * (1.0 - keep) - keep
    return lfilter([new, old], [1.0, -keep], values - values[0]) + values[0]


def measure(trip: Trip, settings: BoxSettings, seed: int) -> NDArray:
    """Fixes (n,) of READING, one an epoch; quality 0 where there is none."""
    step = 1.0 / settings.gps_rate
    t = trip.time[0] + np.arange(int(trip.duration / step) + 1) * step
    rng = generator(seed, "sensors.gps")

    def at_epochs(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(t, trip.time, _lagged(values, trip.step, settings.gps_lag))

    errors = {
        name: settings.gps_horizontal_error * gauss_markov(rng, t.size, step, settings.gps_horizontal_time)
        + settings.gps_white_noise * rng.standard_normal(t.size)
        for name in ("north", "east")
    }
    height = settings.gps_altitude_error * gauss_markov(rng, t.size, step, settings.gps_altitude_time)
    sky = trip.sky[np.clip(np.round((t - trip.time[0]) / trip.step).astype(np.int64), 0, trip.time.size - 1)]
    canyon = sky == CANYON
    reflected = _lagged(canyon.astype(np.float64), step, 2.0)
    reflection = np.hypot(settings.gps_canyon_error * reflected, settings.gps_multipath)
    for name in errors:
        errors[name] = errors[name] + reflection * gauss_markov(rng, t.size, step, settings.gps_canyon_time)
    height = height + 1.5 * reflection * gauss_markov(rng, t.size, step, settings.gps_canyon_time)
    lost = _lost(sky, canyon, step, settings, rng)
    # HDOP tells of the satellites' places, not of the multipath: between houses it lies.
    wobble = gauss_markov(rng, t.size, step, 60.0)
    luck = rng.uniform(0.3, 1.2, t.size)
    noise = rng.standard_normal((3, t.size))
    speed = np.abs(at_epochs(trip.speed) + settings.gps_speed_noise * noise[0])
    heading = at_epochs(trip.heading) + noise[1] * settings.gps_speed_noise / np.maximum(speed, 0.3)

    out = np.zeros(t.size, dtype=READING)
    out["t"] = t
    out["utc"] = np.round((trip.gps_epoch + t) * 100.0) / 100.0
    north, east = at_epochs(trip.north) + errors["north"], at_epochs(trip.east) + errors["east"]
    out["latitude"], out["longitude"] = to_geodetic(north, east, trip.origin)
    out["altitude"] = at_epochs(trip.altitude) + height
    out["hdop"] = np.round(np.maximum(0.7, 1.0 + 0.12 * wobble + reflected * luck), 1)
    out["satellites"] = np.clip(np.round(9.0 + wobble - 4.0 * reflected), 4, 12)
    out["quality"] = np.where(lost, 0, 1)
    out["speed"], out["course"] = speed, heading % (2.0 * np.pi)
    return _stuck(out, step, settings.gps_stuck, generator(seed, "sensors.gps.stuck"))


def _stuck(fixes: NDArray, step: float, share: float, rng: np.random.Generator) -> NDArray:
    """Repeat fixes for 10 s at a time, `share` of the time: same place and speed, same good HDOP, the time runs on."""
    if share <= 0.0:
        return fixes
    length = round(10.0 / step)
    begins = np.arange(0, fixes.size, length)
    source = np.arange(fixes.size)
    for begin in begins[rng.uniform(0.0, 1.0, begins.size) < share]:
        source[begin : begin + length] = begin
    out = fixes[source]
    for name in ("t", "utc", "delay"):
        out[name] = fixes[name]
    return out


def _lost(sky, canyon, step: float, settings: BoxSettings, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Where there is no fix: in a tunnel, a while behind it, and now and then between houses."""
    blocked = sky == TUNNEL
    behind = np.flatnonzero(blocked[:-1] & ~blocked[1:]) + 1
    for place in behind:
        wait = int(rng.uniform(0.2, 1.0) * settings.gps_reacquisition / step)
        blocked[place : place + wait] = True
    shade = gauss_markov(rng, sky.size, step, 4.0)
    threshold = np.sqrt(2.0) * erfinv(np.clip(1.0 - 2.0 * settings.gps_canyon_outage, -1.0, 1.0))
    return blocked | (canyon & (shade > threshold))


def text_pieces(readings: NDArray, settings: BoxSettings, seed: int):
    """Write the fixes as NMEA and cut the text as it came: (text uint8, lengths (n,), arrival (n,) trip time).

    A GSA once a second. The last byte of an epoch arrives `gps_delay_shortest` to `gps_delay_longest` after it.
    """
    rng = generator(seed, "sensors.gps.arrival")
    epoch = np.round((readings["utc"] - np.floor(readings["utc"])) * settings.gps_rate).astype(np.int64)
    text, ends = nmea.write(readings, epoch % max(1, round(settings.gps_rate)) == 0)
    begins = np.concatenate(([0], ends[:-1]))
    duration = (ends - begins) / BYTES_PER_SECOND
    done = rng.uniform(settings.gps_delay_shortest, settings.gps_delay_longest, readings.size)
    arrival = np.maximum.accumulate(readings["t"] + readings["delay"] + done)
    first = begins + rng.integers(1, PIECE + 1, readings.size)
    cuts = first[:, None] + PIECE * np.arange(6)
    inside = cuts < ends[:, None]
    cut = np.concatenate((cuts[inside], ends))
    epoch_of = np.concatenate(
        (np.broadcast_to(np.arange(readings.size)[:, None], cuts.shape)[inside], np.arange(ends.size))
    )
    order = np.argsort(cut, kind="stable")
    cut, epoch_of = cut[order], epoch_of[order]
    lengths = np.diff(cut, prepend=0)
    early = (ends[epoch_of] - cut) / BYTES_PER_SECOND
    start = np.maximum(arrival - duration, readings["t"] + readings["delay"] + settings.gps_delay_shortest)
    came = np.maximum(arrival[epoch_of] - early, np.minimum(start, arrival)[epoch_of])
    return text, lengths.astype(np.int64), np.maximum.accumulate(came)
