"""Synthetic truths for the sensors' tests: a car on a known road, without any plant."""

import numpy as np

from vehicle_model.car.parameters import Car, Engine, Injector, Mounting
from vehicle_model.car.trip import Trip


def smart(mounting: Mounting | None = None, pattern: str = "sequential") -> Car:
    """The car of seed 004, C.1.2, in SI units."""
    rpm = 2.0 * np.pi / 60.0
    engine = Engine(698e-6, 3, 9.0, 60e3, 5250 * rpm, 110.0, 4500 * rpm, 850 * rpm, 6000 * rpm, 0.061, True)
    return Car(
        "smart", 844.0, 0.39, 1.93, 0.0125, 0.2955, 0.62, (13.25, 9.604, 7.37, 5.796, 4.208, 3.23), 0.270183975491887,
        engine, Injector(0.008e-3, -0.0004, pattern), mounting=mounting or Mounting(),
    )  # fmt: skip


def drive(duration: float = 300.0, speed: float = 15.0, step: float = 0.01, sky=None, bend: float = 0.0) -> Trip:
    """A wavy drive about `speed` m/s over gentle hills; engine in a fixed gear, stops at the start and the end."""
    t = np.arange(int(duration / step) + 1) * step
    ramp = np.clip(t / 20.0, 0.0, 1.0) * np.clip((duration - t - 5.0) / 20.0, 0.0, 1.0)
    v = np.maximum(speed * ramp * (1.0 + 0.25 * np.sin(2.0 * np.pi * t / 60.0)), 0.0)
    a = np.gradient(v, t)
    s = np.concatenate(([0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * step)))
    pitch = 0.03 * np.sin(2.0 * np.pi * s / 900.0)
    heading = 0.5 + bend * s
    gradient = 0.03 * 2.0 * np.pi / 900.0 * np.cos(2.0 * np.pi * s / 900.0)
    ds = np.diff(s, prepend=0.0)
    turning = np.maximum(v / 0.2955 * 5.796, 90.0)
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (turning[1:] + turning[:-1]) * step)))
    power = np.where(a < -0.15, 0.0, 8e3 + 9e3 * np.maximum(a, 0.0) + 15.0 * v**2)
    channels = dict(
        time=t, distance=s, speed=v, acceleration=a, north=np.cumsum(ds * np.cos(heading)),
        east=np.cumsum(ds * np.sin(heading)), altitude=300.0 + np.cumsum(ds * np.sin(pitch)), heading=heading,
        pitch=pitch, straightness=np.full_like(t, bend), vertical_straightness=gradient, engine_speed=turning,
        engine_angle=angle, fuel_power=power, fuel_energy=np.cumsum(power) * step, wheel_angle=s / 0.2955,
        battery_voltage=np.full_like(t, 14.0), coolant_temperature=np.full_like(t, 360.0),
        sky=np.zeros_like(t) if sky is None else sky(s),
    )  # fmt: skip
    return Trip(channels, step, (49.61, 6.13, 300.0))


def winding_route(length: float = 6000.0, step: float = 1.0, tunnel: tuple[float, float] | None = None):
    """A road with bends (some tight), hills to 6 % and perhaps a tunnel, as a Route."""
    from vehicle_model.car.route import TUNNEL, Route

    s = np.arange(0.0, length + step, step)
    bends = 0.004 * np.sin(2 * np.pi * s / 700.0) + 0.05 * np.exp(-((((s % 1500.0) - 900.0) / 12.0) ** 2))
    heading = 0.7 + np.cumsum(bends) * step
    pitch = 0.06 * np.sin(2 * np.pi * s / 1300.0) * np.cos(2 * np.pi * s / 5000.0)
    sky = np.zeros(s.size, dtype=np.int8)
    if tunnel:
        sky[(s >= tunnel[0]) & (s < tunnel[1])] = TUNNEL
    north, east = np.cumsum(np.cos(heading) * np.cos(pitch)) * step, np.cumsum(np.sin(heading) * np.cos(pitch)) * step
    return Route(
        s, north, east, 300.0 + np.cumsum(np.sin(pitch)) * step, heading, pitch, bends, np.gradient(pitch, s),
        np.full(s.size, 25.0), sky, (49.61, 6.13, 0.0),
    )  # fmt: skip


def drive_along(route, speed: float = 15.0, step: float = 0.01) -> Trip:
    """A drive from one end of `route` to the other, about `speed` m/s, slowing down now and then."""
    duration = 1.15 * route.length / speed + 60.0
    base = drive(duration, speed, step)
    s = np.minimum(base.distance, route.length - 1.0)
    at = {
        name: np.interp(s, route.s, getattr(route, name))
        for name in ("north", "east", "altitude", "heading", "pitch", "straightness", "vertical_straightness")
    }
    sky = route.sky[np.clip(np.round(s / (route.s[1] - route.s[0])).astype(int), 0, route.sky.size - 1)].astype(float)
    moving = base.distance < route.length - 1.0
    keep = slice(0, int(moving.sum()))
    channels = {**base.channels, **at, "sky": sky}
    return Trip({name: values[keep] for name, values in channels.items()}, step, route.origin)
