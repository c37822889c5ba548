"""The three-axis accelerometer (LIS3LV02D; seed 004, 2.3.2): specific force in its own axes, at 40 Hz, 12 bit."""

import numpy as np
from numpy.typing import NDArray

from sensors.clock import Clock
from sensors.settings import BoxSettings
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator
from vehicle_model.car.trip import Trip

READING = np.dtype([("t", "f8"), ("delay", "f8"), ("x", "f8"), ("y", "f8"), ("z", "f8")])
"""t: trip time; delay: s by which a fault holds it back; specific force, m/s2, sensor axes."""

STANDARD_GRAVITY = 9.80665
COUNTS = 2047
"""12 bit, signed, one count a milli-g."""


def rotation(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    """Rz(yaw) Ry(pitch) Rx(roll), right-handed, rad (CLI.md, "At the door")."""
    (sr, cr), (sp, cp), (sy, cy) = ((np.sin(a), np.cos(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def specific_force(trip: Trip, gravity: float, squat: float, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Specific force in body axes (n, 3), m/s2, at trip time `t` (n,).

    The road's axes as in `vehicle_model.car` (1.9 with the erratum: dv/dt + g sin(theta), whatever the mass),
    turned nose-up by `squat` rad per g.
    """
    channel = {
        name: np.interp(t, trip.time, getattr(trip, name))
        for name in ("speed", "acceleration", "pitch", "straightness", "vertical_straightness")
    }
    forward = channel["acceleration"] + gravity * np.sin(channel["pitch"])
    upward = gravity * np.cos(channel["pitch"]) + channel["vertical_straightness"] * channel["speed"] ** 2
    leftward = -channel["straightness"] * channel["speed"] ** 2
    angle = squat * channel["acceleration"] / gravity
    return np.column_stack(
        (
            forward * np.cos(angle) + upward * np.sin(angle),
            leftward,
            upward * np.cos(angle) - forward * np.sin(angle),
        )
    )


def bias(settings: BoxSettings, seed: int) -> NDArray[np.float64]:
    """Bias of this trip (3,), m/s2: the box's own plus a little from trip to trip, inside the limit."""
    limit = settings.accelerometer_bias
    own = limit * generator(settings.device_seed, "box.accelerometer.bias").uniform(-1.0, 1.0, 3)
    trip = settings.accelerometer_bias_trip * generator(seed, "sensors.accelerometer.bias").standard_normal(3)
    return np.clip(own + trip, -limit, limit)


def mounting(car: Car, settings: BoxSettings) -> NDArray[np.float64]:
    """Matrix (3, 3) from specific force in body axes to the sensor's: the calibration's inverse, and its error."""
    m = car.mounting
    calibrated = m.scale * rotation(m.roll, m.pitch, m.yaw)
    missed = settings.accelerometer_mount_error * generator(settings.device_seed, "box.mounting").standard_normal(3)
    moved = (settings.accelerometer_mount_roll, settings.accelerometer_mount_pitch, settings.accelerometer_mount_yaw)
    error = rotation(*(missed + np.array(moved)))
    return np.linalg.inv(calibrated) @ error.T * (1.0 + settings.accelerometer_scale_error)


def measure(trip: Trip, car: Car, settings: BoxSettings, clock: Clock, seed: int) -> NDArray:
    """Readings (n,) of READING: whole milli-g in sensor axes, given in m/s2, saturated at 12 bit."""
    count = int(np.floor(trip.duration * (1.0 + clock.rate) * settings.accelerometer_rate)) + 1
    t = trip.time[0] + np.arange(count) / settings.accelerometer_rate / (1.0 + clock.rate)
    force = specific_force(trip, car.gravity, settings.body_squat, t)
    rng = generator(seed, "sensors.accelerometer")
    speed = np.interp(t, trip.time, trip.speed)
    level = settings.accelerometer_noise + settings.accelerometer_noise_per_speed * speed
    vertical = settings.accelerometer_noise_vertical + settings.accelerometer_noise_vertical_per_speed * speed
    noise = rng.standard_normal((count, 3)) * np.column_stack((level, level, vertical))
    firing = np.interp(t, trip.time, trip.engine_angle) * (0.5 * car.engine.cylinders)
    turning = np.interp(t, trip.time, trip.engine_speed) > 1.0
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    shake = settings.accelerometer_vibration * np.sin(firing[:, None] + phase) * turning[:, None]
    offset = np.tile(bias(settings, seed), (count, 1))
    offset[:, 0] += settings.accelerometer_drift * 20.0 * (1.0 - np.exp(-(t - t[0]) / settings.box_warm_up))
    body = force + noise + shake + offset
    raw = body @ mounting(car, settings).T
    count_g = np.clip(np.round(raw / STANDARD_GRAVITY * 1000.0), -COUNTS - 1, COUNTS)
    out = np.zeros(count, dtype=READING)
    out["t"] = t
    for axis, name in enumerate("xyz"):
        out[name] = count_g[:, axis] * (STANDARD_GRAVITY / 1000.0)
    return out
