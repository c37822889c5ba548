"""A car and a logger that are not ours: quasi-static, its own engine map, its own driver, box noise and packet writer.

Shares no code with the plant, the challenge's generator or `sensors`. Motion first: speeds over time are drawn, the
road lies under them, gears follow the speed, and torque and fuel follow from that. The law of the engine is a Willans
line whose slope and loss bend with speed and load, with a mixture that is richer near full load; fuel is cut off in
overrun. Everything that a real box has and the default one has not: one fix a second, more noise, quantised widths,
idle that hunts, lights and a charging alternator that come and go.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP = 0.05
HEAT = 745.0 * 43e6
CAR = """<?xml version="1.0"?>
<ponthy_config>
  <car>
    <owner owner="nobody" /><make make="Foreign" /><model model="Hatch" /><year year="2011" /><color color="red" />
  </car>
  <engine>
    <type type="1390cc Inline 4" /><displacement displacement="1390cc" /><power power="63kW @5000rpm" />
    <torque torque="132Nm @3800rpm" /><compression comp="10.5:1" /><idle rpm="740" /><inertia lumped="0.12" />
  </engine>
  <wheels><tire summer="195/65 R15" /><inertia lumped="0.75" /></wheels>
  <accelerometer type="other"><calibration>
    <roll phi="0.02" /><pitch theta="-0.03" /><yaw psi="0.01" /><scale scale="1.004" />
  </calibration></accelerometer>
  <transmission type="5-spd manual"><reverse gear="" />
    <first gear="14.07" /><second gear="7.98" /><third gear="5.33" /><fourth gear="4.02" /><fifth gear="3.22" />
  </transmission>
  <drag><aero Cd="0.33" /><rolling Crr="0.0108" /></drag>
  <area frontal="2.14" /><mass wet="1180" />
  <inj><calibration fuelPerSecond="0.0112" /><calibration lag="-0.0006" /><timing pattern="sequential" /></inj>
  <vss><calibration metersPerTick="{tick:.9f}" /></vss>
</ponthy_config>
"""
RATIOS = np.array([14.07, 7.98, 5.33, 4.02, 3.22])


def radius_of(width: float = 0.195, ratio: float = 0.65, rim: float = 15.0) -> float:
    """m, unloaded, from the tyre's name."""
    return rim * 0.0254 / 2.0 + width * ratio


@dataclass(frozen=True)
class World:
    """What is true of the car, its box and the day. Defaults: no gap (inside the tolerances of the nominal model)."""

    mass: float = 1256.0 * 1.008
    crr: float = 0.0108 * 0.985
    cd_a: float = 0.33 * 2.14 * 1.01
    rho: float = 1.2
    radius: float = 0.0
    """m; 0: what the file says."""
    wind_north: float = 0.0
    accessory: float = 0.0
    """W of electricity beyond what the references have."""
    cold: float = 0.0
    """Share of extra friction at the start."""
    late_fix: float = 0.2
    """s, of the receiver's speed."""
    rate: float = 1.0
    """Fixes a second."""
    noise: float = 1.6
    """Times the default box's accelerometer noise."""
    jam: bool = False
    brake_drag: float = 0.0
    """N."""
    accelerometer: bool = True
    receiver: bool = True


def wheel_radius(car_radius: float, w: World) -> float:
    """m."""
    return w.radius or car_radius


def profile(rng: np.random.Generator, minutes: float, jam: bool) -> tuple[Array, Array]:
    """Time and speed of a drive with stops: ramps of drawn slopes between drawn speeds, rounded over two seconds."""
    t, v = [0.0, rng.uniform(6, 15)], [0.0, 0.0]

    def then(seconds: float, speed: float) -> None:
        t.append(t[-1] + seconds)
        v.append(speed)

    while t[-1] < 60.0 * minutes:
        kind = rng.choice(3, p=[0.5, 0.35, 0.15] if not jam else [0.95, 0.05, 0.0])
        goal = (
            (rng.uniform(5, 9), rng.uniform(6, 15))[0 if jam else 1]
            if kind == 0
            else (rng.uniform(16, 25) if kind == 1 else rng.uniform(26, 34))
        )
        if rng.random() < (0.45 if jam else 0.25):
            goal = 0.0
        slope = (
            rng.uniform(0.7, 1.7) * (1 - 0.5 * max(v[-1], goal) / 36)
            if goal > v[-1]
            else (rng.choice([rng.uniform(0.15, 0.5), rng.uniform(0.8, 1.7)], p=[0.6, 0.4] if jam else [0.4, 0.6]))
        )
        if not jam and goal < v[-1] and rng.random() < 0.6:  # foot off first
            drop = min(v[-1] - goal, rng.uniform(1.5, 5))
            then(drop / (0.25 + 0.35 * v[-1] / 30), v[-1] - drop)
        then(max(abs(goal - v[-1]) / slope, 1.5), goal)
        then(rng.uniform(4, 25) if goal == 0 else rng.uniform(4, 12 if jam else 40), goal)
    if v[-1] > 0:
        then(v[-1] / 1.1, 0.0)
    then(8.0, 0.0)
    grid = np.arange(0.0, t[-1], STEP)
    x = np.interp(grid, t, v)
    moving = x > 0.3
    sway = _slow(rng, len(grid), 1.0, 9.0) * (0.9 if jam else 0.35)
    x = np.where(moving, np.maximum(x + sway * np.minimum(x / 8.0, 1.0), 0.0), x)
    width = int(2.0 / STEP)
    return grid, np.maximum(
        np.convolve(np.pad(x, width, mode="edge"), np.hanning(width) / np.hanning(width).sum(), mode="same")[
            width:-width
        ],
        0.0,
    )


def _slow(rng: np.random.Generator, n: int, sd: float, tau: float) -> Array:
    k = int(3 * tau / STEP)
    shape = np.exp(-0.5 * (np.arange(-k, k + 1) * STEP / tau) ** 2)
    x = np.convolve(rng.normal(size=n + 2 * k), shape, mode="valid")
    return sd * x / max(float(np.std(x)), 1e-9)


def drive(seed: int, w: World, minutes: float = 12.0) -> dict[str, Array]:
    """One drive of the car: what truly happens, every STEP s."""
    rng = np.random.default_rng(seed)
    t, v = profile(rng, minutes, w.jam)
    a = np.gradient(v, STEP)
    s = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * STEP)])
    waves = [(rng.uniform(0.5, 1.0) * 0.012, rng.uniform(500, 2500), rng.uniform(0, 7)) for _ in range(3)]
    pitch = sum(h * np.sin(2 * np.pi * s / long + p) for h, long, p in waves)
    altitude = 240.0 + np.concatenate([[0.0], np.cumsum(np.diff(s) * pitch[1:])])
    turns = np.sort(rng.uniform(0, s[-1], max(3, int(s[-1] / 700))))
    heading = rng.uniform(0, 6.28) + np.zeros(len(s))
    for at in turns:
        heading += rng.uniform(-1.6, 1.6) / (1 + np.exp(np.clip((at - s) / 12.0, -60, 60)))
    wind = 0.15 * rng.normal(size=2)
    along = v + (w.wind_north + wind[0]) * np.cos(heading) + wind[1] * np.sin(heading)
    resist = (
        0.5 * w.rho * w.cd_a * along * np.abs(along)
        + w.mass * 9.81 * (np.sin(pitch) + w.crr * (1 + 0.0006 * v * v / 10)) * (v > 0.05)
        + w.brake_drag * (v > 0.05)
    )
    r = wheel_radius(radius_of(), w)
    force = (w.mass + 4 * 0.75 / r**2) * a + resist
    lever = RATIOS / r
    n = len(t)
    gear, omega, locked, torque, burnt, brake = (np.zeros(n) for _ in range(6))
    idle = 740 / 9.549 + _slow(rng, n, 0.8, 3.0)
    g, gap, up = 1, 0.0, rng.uniform(215, 265)
    electric = 190.0 + 60.0 * (_slow(rng, n, 1.0, 200.0) > 0.5) + w.accessory / 0.536
    heat, cut, wi = 0.0, False, idle[0]
    peak = 132.0
    for i in range(n):
        want = 1
        if v[i] > 2.0:
            if v[i] * lever[g - 1] > up * (1 + 0.25 * max(a[i], 0)) and g < 5:
                want = g + 1
            elif v[i] * lever[g - 1] < 125 + 20 * max(a[i], 0) and g > 1:
                want = g - 1
            else:
                want = g
        if want != g and gap <= 0:
            g, gap = want, 0.75
        gap -= STEP
        road = v[i] * lever[g - 1]
        clutch = gap <= 0 and not (road < 95 and a[i] <= 0.02) and v[i] > 0.1
        slip = clutch and g == 1 and road < 165
        if slip:
            wi += (max(165.0, road) - wi) * STEP / 0.3
        elif clutch:
            wi = road if abs(wi - road) < 6 else wi + (road - wi) * STEP / 0.15
        else:
            wi += (max(idle[i], 0.0) - wi) * STEP / 0.5
        friction = (13.0 + 0.012 * wi + 6e-5 * wi * wi) * (1.0 + w.cold * np.exp(-heat / 9e6))
        load = electric[i] / max(wi, 60.0)
        need = 0.0
        if clutch:
            total = force[i] + (0.0 if slip else 0.12 * lever[g - 1] ** 2 * a[i])
            need = total / lever[g - 1] / 0.957 if total > 0 else total / lever[g - 1] * 0.957
            need += 0.006 * wi + 1.0
        least = -(friction + 4.5 + load)
        cut = clutch and not slip and need < 0.9 * least and wi > (120 if cut else 150)
        at = min(max(need, least if cut else -0.3 * friction), peak * (1.06 - 0.35 * (wi / 400 - 1) ** 2))
        # of what the drive needs less than the overrun gives, the brake does the rest
        brake[i] = max(0.0, (at - need) * lever[g - 1]) if clutch else max(0.0, -force[i])
        share = max(at, 0.0) / peak
        slope = 2.42 + 0.16 * (wi / 260 - 1) ** 2 + 0.25 * max(share - 0.7, 0.0) / 0.3
        fuel = wi * slope * max(at + load + friction * (1.0 - 0.25 * share) + 3.0 * (1 - share) ** 2, 3.0)
        burnt[i] = 0.0 if cut else fuel
        heat += burnt[i] * STEP
        gear[i], omega[i], locked[i], torque[i] = g, wi, float(clutch and not slip), at
    return {
        "time": t, "s": s, "speed": v, "acceleration": a, "pitch": pitch, "altitude": altitude, "heading": heading,
        "engine_speed": omega, "burnt": burnt, "brake": brake, "thrust": force, "gear": gear, "locked": locked,
        "north": np.concatenate([[0.0], np.cumsum(np.diff(s) * np.cos(heading[1:]))]),
        "east": np.concatenate([[0.0], np.cumsum(np.diff(s) * np.sin(heading[1:]))]),
    }  # fmt: skip


def _packet(kind: int, body: bytes) -> bytes:
    head = bytes([len(body) + 1]) + body
    return bytes([0xFF, kind]) + head + bytes([sum(head) & 0xFF])


def card(d: dict[str, Array], w: World, seed: int, tick: float) -> bytes:
    """The card's bytes of a drive, one packet after the other in order of time."""
    rng = np.random.default_rng([seed, 7])
    skew, begin = 1e-6 * rng.normal(0, 8), rng.uniform(3, 40)
    t = d["time"]

    def clock(x: float) -> float:
        return begin + x * (1 + skew)

    def ms(x: float) -> bytes:
        return int(x * 1e3).to_bytes(4, "little")

    rows: list[tuple[float, bytes]] = []
    if w.accelerometer:
        at = np.arange(0.0, t[-1], 0.025)
        v, a, p = (np.interp(at, t, d[k]) for k in ("speed", "acceleration", "pitch"))
        nose = p + np.radians(0.8) * a / 9.81
        noise = w.noise * (0.10 + 0.004 * v)
        turning = np.interp(at, t, np.gradient(d["heading"], STEP))
        body = np.stack([a + 9.81 * np.sin(nose) + noise * rng.normal(size=len(at)) + 0.06,
                         -v * turning + noise * rng.normal(size=len(at)) - 0.1,
                         9.81 * np.cos(nose) + 3 * noise * rng.normal(size=len(at)) + 0.12])  # fmt: skip
        roll, pitch, yaw = 0.02, -0.03, 0.01
        rx = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
        ry = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
        rz = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        raw = (rz @ ry @ rx).T @ body / 1.004 / 9.80665 * 1000.0
        for x, values in zip(at, np.round(raw).astype(int).T, strict=True):
            when = clock(float(x))
            rows.append(
                (
                    when,
                    _packet(
                        1,
                        ms(when)
                        + b"".join(int(np.clip(q, -32768, 32767)).to_bytes(2, "little", signed=True) for q in values),
                    ),
                )
            )
    r = wheel_radius(radius_of(), w)
    turned = d["s"] * radius_of() / r
    k = np.arange(1, int(turned[-1] / tick))
    at = np.interp(tick * (k + 0.004 * rng.normal(size=len(k))), turned + 1e-9 * np.arange(len(t)), t)
    for x in np.sort(at[np.interp(at, t, d["speed"]) > 1.0]):
        when = clock(float(x))
        rows.append((when, _packet(3, ms(when) + bytes([int((when * 1e3 % 1.0) * 8)]))))
    angle = np.concatenate([[0.0], np.cumsum(d["engine_speed"][1:] * STEP)])
    k = np.arange(1, int(angle[-1] / (4 * np.pi)))
    at = np.interp(k * 4 * np.pi, angle, t)
    energy = np.concatenate([[0.0], np.cumsum(d["burnt"][1:] * STEP)])
    amount = np.diff(np.interp(np.append(at, t[-1]), t, energy))
    for x, joule in zip(at, amount, strict=True):
        if joule > 60.0:
            width = joule / (0.0112e-3 * HEAT) * (1 + 0.009 * rng.normal()) + 0.0006
            when = clock(float(x)) + 2e-4 * rng.normal()
            rows.append((when, _packet(4, ms(when) + min(int(width / 250e-9), 65535).to_bytes(2, "little"))))
    before = 0
    for x in np.arange(10.0, t[-1], 10.0):
        now = round(x * skew * 1e3)
        rows.append((clock(x), _packet(5, ms(clock(x)) + int(now - before).to_bytes(1, "little", signed=True))))
        before = now
    if w.receiver:
        rows += _fixes(d, w, rng, clock)
    return b"".join(body for _, body in sorted(rows, key=lambda row: row[0]))


def _fixes(d, w: World, rng, clock) -> list[tuple[float, bytes]]:
    t = d["time"]
    epoch = np.arange(1.0, t[-1], 1.0 / w.rate)
    n = len(epoch)

    def drift(sd: float, tau: float) -> Array:
        x = np.zeros(n)
        keep = np.exp(-1.0 / w.rate / tau)
        for i in range(1, n):
            x[i] = keep * x[i - 1] + sd * np.sqrt(1 - keep**2) * rng.normal()
        return x

    north, east, alt, v, course = (
        np.interp(epoch - w.late_fix, t, d[k]) for k in ("north", "east", "altitude", "speed", "heading")
    )
    north = north + drift(1.6, 90.0) + 0.4 * rng.normal(size=n)
    east = east + drift(1.6, 90.0) + 0.4 * rng.normal(size=n)
    alt = alt + drift(4.0, 150.0) + rng.normal(size=n)
    v = np.maximum(v + 0.11 * rng.normal(size=n), 0.0)
    lat, lon = 49.6 + north / 111_200.0, 6.1 + east / (111_320.0 * np.cos(np.radians(49.6)))
    rows = []
    for i in range(n):
        sec = 36_000.0 + epoch[i]
        hms = f"{int(sec // 3600):02d}{int(sec // 60 % 60):02d}{sec % 60:05.2f}"
        place = f"{int(lat[i]):02d}{lat[i] % 1 * 60:08.5f},N,{int(lon[i]):03d}{lon[i] % 1 * 60:08.5f},E"
        text = ""
        for body in (
            f"GPGGA,{hms},{place},1,08,1.0,{alt[i]:.1f},M,47.0,M,,",
            f"GPRMC,{hms},A,{place},{v[i] / 0.514444:.3f},{np.degrees(course[i]) % 360:.2f},140511,,,A",
        ):
            check = 0
            for ch in body.encode():
                check ^= ch
            text += f"${body}*{check:02X}\r\n"
        when = clock(float(epoch[i])) + rng.uniform(0.05, 0.22)
        rows.append((when - 0.004, _packet(2, text[:70].encode())))
        rows.append((when, _packet(2, text[70:].encode())))
    return rows
