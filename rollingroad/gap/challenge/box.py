"""The challenge's own sensor box: what a logger would have written, packet by packet (seed 004, C.1.4 and C.1.5).

Noise as the default box of CLI.md, "At the door". Written with numpy only; shares no code with `sensors`.
"""

import time as clock_of_day

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.challenge.routes import geodetic

NEUTRAL = {
    "acc_pitch": 0.0, "acc_scale": 1.0, "acc_drift": 0.0, "gps_lag": 0.2, "gps_stuck": 0.0, "skew": 0.0,
    "dead_time": 0.0, "flow": 1.0, "flow_droop": 0.0, "radius": 1.0, "growth": 0.0, "slip": 0.0, "uneven": 0.0,
    "wheel_jump": 0.0,
}  # fmt: skip
"""Sensor-side departures: rad, -, m/s2 per h, s, share of time, s/s, s, -, per (g/s), -, per (m/s)2, per N, -, -."""
EPOCH = 1_256_634_000.0


def record(
    truth: dict[str, NDArray], north: NDArray, east: NDArray, box: dict[str, float], effects: dict[str, float],
    heat_per_volume: float, rng: np.random.Generator,
) -> bytes:  # fmt: skip
    """Return the card's bytes of one drive. `north`, `east` (n,) m along it; `heat_per_volume` J/m3 that truly
    burns."""
    e = {**NEUTRAL, **effects}
    t = truth["time"]
    ppm = 1e-6 * rng.normal(0, 10) + e["skew"]
    start = rng.uniform(2.0, 60.0)  # s on the logger's clock when the drive begins

    def logger(at: NDArray) -> NDArray:
        return start + at * (1.0 + ppm)

    packets: list[tuple[NDArray, NDArray]] = []
    packets.append(_accelerometer(truth, box, e, logger, rng))
    packets.append(_wheel(truth, box, e, logger, rng))
    packets.append(_injector(truth, box, e, heat_per_volume, logger, rng))
    skew_t = np.arange(10.0, t[-1], 10.0)
    gained = np.diff(np.round(np.append(0.0, skew_t * ppm * 1e3)))
    stamp = _milliseconds(logger(skew_t))
    packets.append(
        (logger(skew_t), _frames(5, stamp, np.clip(gained, -128, 127).astype(np.int8)[:, None].view(np.uint8)))
    )
    arrival, sentences = _gps(truth, north, east, e, rng)
    at = np.concatenate([p[0] for p in packets] + [logger(arrival)])
    raw: list[bytes] = []
    for _, frames in packets:
        raw += [row.tobytes() for row in frames]
    for text in sentences:
        body = text.encode()
        raw.append(b"\xff\x02" + bytes([len(body) + 1]) + body + bytes([(len(body) + 1 + sum(body)) % 256]))
    return b"".join(raw[i] for i in np.argsort(at, kind="stable"))


def _milliseconds(t: NDArray) -> NDArray:
    return np.round(t * 1e3).astype("<u4")


def _frames(kind: int, stamp: NDArray, rest: NDArray) -> NDArray:
    """Packets of one kind as a byte matrix: preamble, type, length, stamp, rest (n, k) uint8, check."""
    n, k = rest.shape
    out = np.empty((n, 3 + 4 + k + 1), np.uint8)
    out[:, 0], out[:, 1], out[:, 2] = 0xFF, kind, 4 + k + 1
    out[:, 3:7] = stamp.astype("<u4")[:, None].view(np.uint8).reshape(n, 4)
    out[:, 7:-1] = rest
    out[:, -1] = out[:, 2:-1].sum(axis=1, dtype=np.uint64) % 256
    return out


def _accelerometer(truth, box, e, logger, rng):
    t = np.arange(0.0, truth["time"][-1], 0.025)
    v = np.interp(t, truth["time"], truth["speed"])
    a = np.interp(t, truth["time"], truth["acceleration"])
    pitch = np.interp(t, truth["time"], truth["pitch"])
    kappa = np.interp(t, truth["time"], truth["curvature"])
    w = np.interp(t, truth["time"], truth["engine_speed"])
    body_pitch = pitch + np.radians(1.0) * a / 9.81  # squat, nose up under acceleration
    vertical = np.gradient(pitch, t) * v
    g = 9.805
    x = a * np.cos(body_pitch - pitch) + g * np.sin(body_pitch)
    y = -kappa * v * v
    z = g * np.cos(body_pitch) + vertical
    noise = 0.10 + 0.004 * v
    phase = np.cumsum(w * box["cylinders"] / 2.0) * 0.025
    f = np.stack(
        [
            x + rng.normal(size=len(t)) * noise + 0.10 * np.sin(phase),
            y + rng.normal(size=len(t)) * noise,
            z + rng.normal(size=len(t)) * (0.3 + 0.02 * v) + 0.10 * np.cos(phase),
        ]
    )
    f += (np.array([box["bias_x"], box["bias_y"], box["bias_z"]]) + rng.normal(0, 0.01, 3))[:, None]
    f[0] += e["acc_drift"] * t / 3600.0
    f *= e["acc_scale"]
    mount = _rotation(box["roll"], box["pitch"], box["yaw"])
    extra = _rotation(box["mount_roll"], box["mount_pitch"] - e["acc_pitch"], 0.0)
    raw = (mount.T @ extra @ f) / box["scale"]
    counts = np.clip(np.round(raw / 9.80665 * 1000.0), -32768, 32767).astype("<i2")
    at = logger(t) + rng.uniform(0, 1e-3, len(t))
    rest = np.ascontiguousarray(counts.T).view(np.uint8).reshape(len(t), 6)
    return at, _frames(1, _milliseconds(at), rest)


def _rotation(roll: float, pitch: float, yaw: float) -> NDArray:
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return rz @ ry @ rx


def _wheel(truth, box, e, logger, rng):
    t, v = truth["time"], truth["speed"]
    ratio = (1.0 + e["slip"] * truth["thrust"]) / (e["radius"] * (1.0 + e["growth"] * v * v))
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] * ratio[1:] + v[:-1] * ratio[:-1]) * np.diff(t))])
    tick = box["tick"]
    teeth = np.cumsum(1.0 + 0.003 * rng.normal(size=7))
    teeth *= 7.0 / teeth[-1]
    n = int(turned[-1] / tick) - 1
    k = np.arange(1, max(n, 2))
    place = tick * (7.0 * (k // 7) + np.append(0.0, teeth)[k % 7])
    rising = np.maximum.accumulate(turned + 1e-9 * np.arange(len(turned)))
    at = np.interp(place, rising, t)
    keep = np.interp(at, t, v) > rng.uniform(3.2, 3.8) / 3.6
    at = at[keep]
    if e["wheel_jump"]:
        at = at[rng.random(len(at)) > e["wheel_jump"]]
    at = logger(at) + rng.normal(0, 2e-4, len(at))
    at = np.sort(at)
    ms = np.floor(at * 1e3)
    sub = np.clip(np.floor((at * 1e3 - ms) * 8), 0, 7).astype(np.uint8)
    return at, _frames(3, ms.astype("<u4"), sub[:, None])


def _injector(truth, box, e, heat_per_volume, logger, rng):
    t, angle = truth["time"], truth["engine_angle"]
    k = np.arange(1, int(angle[-1] / (4 * np.pi)))
    at = np.interp(k * 4 * np.pi, angle + 1e-9 * np.arange(len(angle)), t)
    heat = np.concatenate([[0.0], np.cumsum(truth["burnt"][1:] * np.diff(t))])
    amount = np.diff(np.interp(np.append(at, min(2 * at[-1] - at[-2], t[-1])), t, heat))
    period = np.diff(np.append(at, 2 * at[-1] - at[-2]))
    flow = box["flow"] * box["fuel"] * e["flow"] * 1e-3  # m3/s, what truly flows
    flow = flow * (1.0 - e["flow_droop"] * amount / np.maximum(period, 1e-3) / 43e3)
    opening = amount / heat_per_volume / flow * (1.0 + 0.006 * rng.normal(size=len(at)))
    if e["uneven"]:
        opening = opening * (1.0 + e["uneven"] * np.where(k % 2 == 0, 1.0, -1.0))
    # a mean opening over the coming cycle; below 20 J nothing was injected: overrun
    live = amount > 20.0
    width = opening[live] - box["lag"] + e["dead_time"]
    at = logger(at[live]) + rng.normal(0, 2e-4, int(live.sum()))
    counts = np.clip(np.round(width / 250e-9), 0, 65535).astype("<u2")
    rest = counts[:, None].view(np.uint8).reshape(len(at), 2)
    return at, _frames(4, np.floor(np.maximum(at, 0) * 1e3).astype("<u4"), rest)


def _correlated(n: int, step: float, sd: float, tau: float, rng) -> NDArray:
    """First-order Gauss-Markov process."""
    from scipy.signal import lfilter

    phi = np.exp(-step / tau)
    drive = rng.normal(size=n) * sd * np.sqrt(1 - phi**2)
    drive[0] = rng.normal() * sd
    return lfilter([1.0], [1.0, -phi], drive)


def _gps(truth, north, east, e, rng):
    t = truth["time"]
    epoch = np.arange(0.4, t[-1], 0.2)
    seen = epoch - e["gps_lag"]
    n = len(epoch)
    ne = [np.interp(seen, t, x) + _correlated(n, 0.2, 1.8 / np.sqrt(2), 120.0, rng) + rng.normal(0, 0.4 / np.sqrt(2), n)
          for x in (north, east)]  # fmt: skip
    alt = np.interp(seen, t, truth["altitude"]) + _correlated(n, 0.2, 3.5, 200.0, rng) + rng.normal(0, 0.8, n)
    speed = np.maximum(np.interp(seen, t, truth["speed"]) + rng.normal(0, 0.08, n), 0.0)
    course = np.degrees(np.interp(seen, t, truth["heading"])) + rng.normal(0, 0.4, n)
    if e["gps_stuck"]:
        hold = np.zeros(n, bool)
        for begin in np.flatnonzero(rng.random(n) < e["gps_stuck"] / 25.0):
            hold[begin : begin + 25] = True
        source = np.maximum.accumulate(np.where(hold, 0, np.arange(n)))
        ne, alt, speed = [x[source] for x in ne], alt[source], speed[source]
    lat, lon = geodetic(ne[0], ne[1])
    utc = EPOCH + epoch
    sentences, arrivals = [], []
    delay = rng.uniform(0.04, 0.25, n)
    lat_d, lon_d = np.floor(lat), np.floor(lon)
    lat_m, lon_m = (lat - lat_d) * 60, (lon - lon_d) * 60
    knots = speed / 0.514444
    course = course % 360
    hundredths = np.round(utc * 100).astype(np.int64)
    seconds = hundredths // 100
    day = clock_of_day.strftime("%d%m%y", clock_of_day.gmtime(int(utc[0])))
    for i in range(n):
        s = int(seconds[i] % 86400)
        hms = f"{s // 3600:02d}{s // 60 % 60:02d}{s % 60:02d}.{hundredths[i] % 100:02d}"
        place = f"{int(lat_d[i]):02d}{lat_m[i]:08.5f},N,{int(lon_d[i]):03d}{lon_m[i]:08.5f},E"
        gga = f"GPGGA,{hms},{place},1,09,0.9,{alt[i]:.1f},M,47.0,M,,"
        rmc = f"GPRMC,{hms},A,{place},{knots[i]:.3f},{course[i]:.2f},{day},,,A"
        both = ""
        for body in (gga, rmc):
            check = 0
            for ch in body.encode():
                check ^= ch
            both += f"${body}*{check:02X}\r\n"
        sentences.append(both[:90])
        sentences.append(both[90:])
        arrivals += [epoch[i] + delay[i] - 0.01, epoch[i] + delay[i]]
    return np.maximum.accumulate(np.array(arrivals)), sentences
