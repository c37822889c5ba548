"""Residual channels: what each sensor said less what the replayed simulator, or another sensor, says; block by block.

Channels (value: unit)
    fuel_power    W      fuel less replay, in blocks of one regime: idle, drive, overrun, launch, open
    coast_force   N      force that the motion needs less the overrun's, while the fuel is cut: road load without fuel
    gnss_speed    m/s    receiver's speed less wheel speed
    gear_ratio    -      engine speed / (gear x wheel speed) - 1
    idle_speed    rad/s  engine speed at standstill less the declared
    launch_speed  rad/s  engine speed while the clutch slips at launch
    shift_time    s      time without a gear, per shift
    height_gps    m      receiver's altitude less the height that specific force and wheels integrate to
    height_map    m      the road map's altitude less the same
    clock_rate    s/s    what the logger's clock gains on the receiver's
    gnss_second   m/s    as gnss_speed, of a second receiver
The thrust that a filter infers is no channel: it is built from acceleration and believed resistances, so a force
balance of it is true by construction. Fuel against required work, and coasting, are independent.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.blocks import CHANNELS, Prepared
from rollingroad.gap.motion import LAG, motion_of
from rollingroad.gap.reconstruct import Trace
from rollingroad.gap.replay import Motion, Replay, replay_vector
from vehicle_model.car.parameters import Car
from vehicle_model.plant import kernel as k

Array = NDArray[np.float64]
Correction = Callable[[Replay, Motion, NDArray[np.int64]], Array]
"""W to add to a replay's fuel, (n,), from the replay, the motion and the regimes."""


def values(p: Prepared, car: Car, vector: Array, correction: Correction | None = None) -> Array:
    """Residual of each block, (m,): measured less replay under the plant's `vector`, its fuel corrected as the
    reference trips showed (a setting that moves the torque moves along the *corrected* map)."""
    s, trace, layout = p.samples, p.trace, p.layout
    nominal = replay_vector(vector, s.motion)
    out = np.zeros(len(layout.time))
    m = s.motion

    def put(channel: str, sample: Array) -> None:
        part = layout.parts.get(channel)
        if part is not None:
            index, number, count = part
            out[layout.channel == CHANNELS.index(channel)] = np.bincount(number, sample[index]) / count

    burnt = (
        nominal.fuel if correction is None else nominal.fuel + correction(nominal, m, s.regime) * (1.0 - nominal.cut)
    )
    put("fuel_power", np.nan_to_num(s.fuel) - burnt)
    put("coast_force", nominal.overrun_force - nominal.road_force)
    ratio = vector[k.P_RATIO + np.maximum(m.gear, 1)] / car.wheel_radius
    put("gear_ratio", m.engine_speed / np.maximum(m.speed * ratio, 1.0) - 1.0)
    put("idle_speed", m.engine_speed - nominal.idle_speed)
    put("launch_speed", m.engine_speed - nominal.launch_speed)
    part = layout.parts.get("shift_time")
    if part is not None:
        out[layout.channel == CHANNELS.index("shift_time")] = part[2] * trace.step - nominal.shift_time
    if trace.gps:
        at = trace.gps["t"] - trace.time[0]
        put("gnss_speed", trace.gps["speed"] - np.interp(at - LAG, m.time, m.speed))
        level = np.interp(at - LAG, m.time, s.height)
        put("height_gps", trace.gps["altitude"] - level)
        put("height_map", trace.gps["map_altitude"] - level)
    if trace.second:
        at = trace.second["t"] - trace.time[0]
        put("gnss_second", trace.second["speed"] - np.interp(at - LAG, m.time, m.speed))
    if "gps" in trace.clock:
        out[layout.channel == CHANNELS.index("clock_rate")] = trace.clock["gps"]
    return out


def block_means(p: Prepared, channel: str, sample: Array) -> Array:
    """(m,) zero but for the blocks of `channel`, which hold the mean of `sample` ((n,) samples, or fixes) over each."""
    out = np.zeros(len(p.layout.time))
    part = p.layout.parts.get(channel)
    if part is not None:
        index, number, count = part
        out[p.layout.channel == CHANNELS.index(channel)] = np.bincount(number, sample[index]) / count
    return out


def resensed(p: Prepared, trace: Trace, car: Car, vector: Array) -> Prepared:
    """The same trip and blocks with another `trace`: what a sensor's departure makes of the channels."""
    motion, height, bias, _ = motion_of(trace, car, float(vector[k.P_IDLE]))
    return replace(p, trace=trace, samples=replace(p.samples, motion=motion, height=height, fuel=trace.fuel, bias=bias))
