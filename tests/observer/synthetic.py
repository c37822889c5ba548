"""A small truth of the tests' own: a car on a made-up road, and what a box with the default noise would log of it.

It shares nothing with the plant, the sensors or the observer, so that it can contradict all three.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.log import STREAMS, SensorLog
from vehicle_model.car.parameters import Car, Engine, Injector

SMART = Car(
    name="smart",
    wet_mass=844.0,
    drag_coefficient=0.39,
    frontal_area=1.93,
    rolling_resistance=0.0125,
    wheel_radius=0.2954,
    wheel_inertia=0.61,
    gear_ratios=(14.6, 9.9, 6.9, 5.1, 3.9, 2.9),
    metres_per_tick=0.27,
    engine=Engine(6.98e-4, 3, 9.0, 60e3, 550.0, 110.0, 300.0, 89.0, 640.0, 0.12, True),
    injector=Injector(flow=9.0e-6, lag=-0.4e-3, pattern="sequential"),
)
SHIFT_UP = np.array([4.5, 8.0, 12.5, 17.0, 22.0])
"""m/s."""


@dataclass(frozen=True)
class Truth:
    """Arrays over time (n,), every 10 ms; SI."""

    time: NDArray[np.float64]
    distance: NDArray[np.float64]
    speed: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    thrust: NDArray[np.float64]
    heading: NDArray[np.float64]
    pitch: NDArray[np.float64]
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    altitude: NDArray[np.float64]
    straightness: NDArray[np.float64]
    vertical_straightness: NDArray[np.float64]
    fuel_power: NDArray[np.float64]
    fuel_energy: NDArray[np.float64]
    engine_speed: NDArray[np.float64]
    engine_angle: NDArray[np.float64]
    driving: NDArray[np.bool_]


def drive(seed: int = 0, duration: float = 300.0, car: Car = SMART, step: float = 0.01) -> Truth:
    """Drive a winding, hilly road with shifts, overrun and a stop or two. Speed first; forces follow from it."""
    rng = np.random.default_rng([seed, 1])
    n = round(duration / step)
    time = np.arange(n) * step
    # speed: smoothed steps between targets, down to standstill now and then
    targets = []
    while len(targets) * 15.0 < duration + 15.0:
        targets.append(0.0 if rng.random() < 0.15 and targets else rng.uniform(6.0, 30.0))
    speed = np.empty(n)
    v, a = 0.0, 0.0
    for i in range(n):
        wanted = targets[int(time[i] / 15.0)]
        push = np.clip(0.5 * (wanted - v), -2.5, 1.8 if v < 12 else 1.0)
        a += (push - a) * step / 0.25
        if v <= 0.0 and a < 0.0:
            a = 0.0
        v = max(v + a * step, 0.0)
        speed[i] = v
    acceleration = np.gradient(speed, step)
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * step)])
    s = np.arange(0.0, distance[-1] + 10.0, 1.0)
    phase = rng.uniform(0, 2 * np.pi, 6)
    slope = 0.03 * np.sin(s / 90.0 + phase[0]) + 0.03 * np.sin(s / 210.0 + phase[1])
    bend = 0.6 * np.sin(s / 130.0 + phase[2]) + 1.2 * np.sin(s / 410.0 + phase[3])
    pitch, heading = np.interp(distance, s, slope), np.interp(distance, s, bend)
    straightness = np.interp(distance, s, np.gradient(bend))
    vertical = np.interp(distance, s, np.gradient(slope))

    def integral(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * step)])

    north = integral(speed * np.cos(heading) * np.cos(pitch))
    east = integral(speed * np.sin(heading) * np.cos(pitch))
    altitude = 250.0 + integral(speed * np.sin(pitch))
    gear = np.searchsorted(SHIFT_UP, speed)
    changed = np.flatnonzero(np.diff(gear) != 0)
    closed = speed > 2.0
    for i in changed:
        closed[i : i + 40] = False
    load = 0.5 * car.air_density * car.drag_area * speed**2 + car.mass * car.gravity * np.sin(pitch)
    load += car.mass * car.rolling_resistance * (car.gravity * np.cos(pitch) + vertical * speed**2) * (speed > 0)
    thrust = car.accelerated_mass * acceleration + load
    omega = np.where(closed, speed * np.asarray(car.gear_ratios)[gear] / car.wheel_radius, 90.0)
    omega = np.convolve(np.pad(np.maximum(omega, 90.0), 10, mode="edge"), np.ones(21) / 21, mode="valid")
    brake = thrust < -0.02 * omega * car.gear_ratios[2]
    willans = 0.41
    power = np.where(
        closed & ~brake, np.maximum(thrust * speed, 0.0) / willans + 14.0 * omega + 0.045 * omega**2, 2.5e3
    )
    power = np.where(closed & brake & (omega > 150.0), 0.0, power)
    near = np.zeros(n, bool)
    for i in changed:
        near[max(i - 30, 0) : i + 70] = True
    return Truth(
        time=time,
        distance=distance,
        speed=speed,
        acceleration=acceleration,
        thrust=thrust,
        heading=heading,
        pitch=pitch,
        north=north,
        east=east,
        altitude=altitude,
        straightness=straightness,
        vertical_straightness=vertical,
        fuel_power=power,
        fuel_energy=integral(power),
        engine_speed=omega,
        engine_angle=integral(omega),
        driving=closed & ~near & (thrust > 0.0) & (power > 0.0),
    )


def sense(
    truth: Truth, seed: int = 0, car: Car = SMART, *, gps: bool = True, noise: float = 1.0, start: float = 3.0
) -> SensorLog:
    """What the default box logs of `truth`, from logger time `start` on. `noise` scales every error."""
    rng = np.random.default_rng([seed, 2])
    t, step = truth.time, truth.time[1] - truth.time[0]
    packets: dict[str, NDArray] = {}

    sample = np.arange(0.0, t[-1], 0.025)
    v = np.interp(sample, t, truth.speed)
    bias = noise * rng.uniform(-0.2, 0.2, 3)
    body = np.stack(
        [
            np.interp(sample, t, truth.acceleration + car.gravity * np.sin(truth.pitch)),
            np.interp(sample, t, -truth.straightness * truth.speed**2),
            np.interp(sample, t, car.gravity * np.cos(truth.pitch) + truth.vertical_straightness * truth.speed**2),
        ]
    )
    plane, vertical = 0.10 + 0.004 * v, 0.3 + 0.02 * v
    body += bias[:, None] + noise * rng.normal(size=body.shape) * np.stack([plane, plane, vertical])
    unit = 9.80665e-3
    acc = np.zeros(len(sample), STREAMS["accelerometer"])
    acc["t"] = np.floor((sample + start) * 1e3) * 1e-3
    acc["x"], acc["y"], acc["z"] = np.round(body / unit) * unit
    packets["accelerometer"] = acc

    ticks = np.arange(1, int(truth.distance[-1] / car.metres_per_tick))
    rising = np.concatenate([[True], np.diff(truth.distance) > 0])
    places = ticks * car.metres_per_tick * (1 + noise * 1e-3 * rng.normal()) + noise * 8e-4 * rng.normal(
        size=len(ticks)
    )
    moment = np.interp(np.clip(places, 0, truth.distance[-1] - 1e-6), truth.distance[rising], t[rising])
    seen = np.interp(moment, t, truth.speed) > 1.0
    wheel = np.zeros(int(seen.sum()), STREAMS["wheel"])
    wheel["t"] = np.floor((moment[seen] + start) / 125e-6) * 125e-6
    packets["wheel"] = wheel

    count = int(truth.engine_angle[-1] / (4 * np.pi))
    moment = np.interp(4 * np.pi * np.arange(1, count), truth.engine_angle, t)
    energy = np.diff(np.interp(moment, t, truth.fuel_energy), append=0.0)[:-1]
    moment = moment[:-1]
    fired = np.interp(moment, t, truth.fuel_power) > 0.0
    opening = energy / car.injector_power * (1 + noise * 0.006 * rng.normal(size=len(energy)))
    width = np.round((opening - car.injector.lag) / 250e-9) * 250e-9
    inj = np.zeros(int(fired.sum()), STREAMS["injector"])
    inj["t"] = np.floor((moment[fired] + start) * 1e3) * 1e-3
    inj["width"] = np.minimum(width[fired], 65535 * 250e-9)
    inj["saturated"] = width[fired] >= 65535 * 250e-9
    packets["injector"] = inj

    if gps:
        epoch = np.arange(0.4, t[-1] - 0.4, 0.2)

        def slow(deviation: float, tau: float) -> NDArray[np.float64]:
            phi = np.exp(-0.2 / tau)
            out, e = np.empty(len(epoch)), deviation * rng.normal()
            for i in range(len(epoch)):
                e = phi * e + deviation * np.sqrt(1 - phi**2) * rng.normal()
                out[i] = e
            return noise * out

        fix = np.zeros(len(epoch), STREAMS["gps"])
        north = np.interp(epoch - 0.2, t, truth.north) + slow(1.8, 120) + noise * 0.4 * rng.normal(size=len(epoch))
        east = np.interp(epoch - 0.2, t, truth.east) + slow(1.8, 120) + noise * 0.4 * rng.normal(size=len(epoch))
        fix["altitude"] = (
            np.interp(epoch - 0.2, t, truth.altitude) + slow(3.5, 200) + noise * 0.5 * rng.normal(size=len(epoch))
        )
        fix["latitude"] = 49.6 + np.degrees(north / 6_378_600.0)
        fix["longitude"] = 6.1 + np.degrees(east / (6_390_000.0 * np.cos(np.radians(49.6))))
        fix["hdop"], fix["quality"], fix["satellites"] = 1.0, 1, 8
        fix["utc"] = 1_256_634_000.0 + epoch
        fix["t"] = epoch + start + rng.uniform(0.04, 0.2, len(epoch)) - 0.01
        vg = np.interp(epoch - 0.2, t, truth.speed)
        fix["speed"] = vg + noise * 0.1 * rng.normal(size=len(epoch))
        fix["course"] = np.interp(epoch - 0.2, t, truth.heading) + noise * 0.15 / np.maximum(vg, 0.5) * rng.normal(
            size=len(epoch)
        )
        packets["gps"] = fix
    del step
    every = np.concatenate([p["t"] for p in packets.values()])
    rank = np.argsort(np.argsort(every, kind="stable"), kind="stable")
    at = 0
    for p in packets.values():
        p["order"] = rank[at : at + len(p)]
        at += len(p)
    return SensorLog(packets, name="synthetic")
