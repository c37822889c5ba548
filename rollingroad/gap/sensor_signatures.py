"""Signatures of the sensors: the trip as a wrong sensor would have told it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.observe import pulse_angle
from rollingroad.gap.channels import block_means, resensed, values
from rollingroad.gap.design import CLOCK, RATIO
from rollingroad.gap.replay import replay_vector
from rollingroad.gap.signature_form import Column, Context, Variant

Array = NDArray[np.float64]


def sensor(effect: str, columns: tuple[Column, ...], make: Callable[[Context], list[Array]]) -> Variant:
    return Variant(effect, columns, {}, lambda c: np.stack(make(c), axis=1))


def _moved(c: Context, **channels: Any) -> Array:
    """Change of the residuals if the trace's `channels` were these."""
    return (
        values(resensed(c.p, replace(c.p.trace, **channels), c.car, c.vector), c.car, c.vector, c.correction)
        - c.neutral
    )


def _speed_scaled(c: Context, share: Array) -> Array:
    """Change per unit if the wheels told (1 + share) times the speed."""
    step = 0.01
    t = c.p.trace
    v = t.speed * (1.0 + step * share)
    return _moved(c, speed=v, acceleration=t.acceleration * (1.0 + step * share)) / step


def wheel_slip(c: Context) -> list[Array]:
    force = replay_vector(c.vector, c.p.samples.motion).road_force
    compliance = 1.0 / (30.0 * 0.55 * c.car.mass * c.car.gravity)
    return [_speed_scaled(c, np.clip(force, -4000, 6000) * compliance)]


def wheel_radius(c: Context) -> list[Array]:
    v = c.p.trace.speed
    return [-_speed_scaled(c, np.ones_like(v)), -_speed_scaled(c, (v / 27.78) ** 2)]


def tyre_radius(c: Context) -> list[Array]:
    """As `wheel_radius`, of the tyre itself and not of the sensor's scale: the engine turns with the wheel."""
    return [np.where(c.p.layout.channel == RATIO, 0.0, column) for column in wheel_radius(c)]


def mount(c: Context) -> list[Array]:
    t = c.p.trace
    time = t.time - t.time[0]
    g = c.car.gravity
    known = np.where(np.isfinite(t.force), t.force, 0.0)
    return [
        _moved(c, force=t.force - 0.01 * g) / 0.01,  # the box's nose up by more than the file says: it reads less
        _moved(c, force=t.force + 0.02 * known) / 0.02,
        _moved(c, force=t.force + 0.1 * time / 3600.0) / 0.1,
    ]


def dead_time(c: Context) -> list[Array]:
    m = c.p.samples.motion
    firing = ~c.p.trace.cut
    power = c.car.injector_power * m.engine_speed / pulse_angle(c.car) * firing
    return [block_means(c.p, "fuel_power", power)]


def _fixes(c: Context, sample: Array) -> Array:
    at = c.p.trace.gps["t"] - c.p.trace.time[0]
    return np.interp(at - 0.2, c.p.samples.motion.time, sample)


def gps_lag(c: Context) -> list[Array]:
    if not c.p.trace.gps:
        return [np.zeros(len(c.base))] * 2
    first = block_means(c.p, "gnss_speed", -_fixes(c, c.p.samples.motion.acceleration))
    second = np.zeros(len(c.base))
    if c.p.trace.second:
        at = c.p.trace.second["t"] - c.p.trace.time[0]
        m = c.p.samples.motion
        second = block_means(c.p, "gnss_second", -np.interp(at - 0.2, m.time, m.acceleration))
    return [first, second]


def clock(c: Context) -> list[Array]:
    return [(c.p.layout.channel == CLOCK).astype(float)]


def grade_map(c: Context) -> list[Array]:
    if not c.p.trace.gps:
        return [np.zeros(len(c.base))] * 2
    m = c.p.samples.motion
    height = c.p.trace.gps["map_altitude"]
    good = np.isfinite(height)
    slope = np.zeros(len(height))
    if good.sum() > 50:
        s = _fixes(c, m.distance)
        at = np.arange(s[good][0], s[good][-1] + 1.0, 20.0)
        level = np.interp(at, np.maximum.accumulate(s[good]), height[good])
        level = np.convolve(np.pad(level, 3, mode="edge"), np.ones(7) / 7, mode="valid")
        slope = np.interp(s, at, np.gradient(level, 20.0)) if len(at) > 5 else slope
    return [block_means(c.p, "height_map", _fixes(c, m.distance)), block_means(c.p, "height_map", slope)]
