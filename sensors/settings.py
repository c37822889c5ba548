"""Every number of the sensor box, in one place. The defaults are the *default box* of the figures."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

KILOMETRE_PER_HOUR = 1.0 / 3.6


@dataclass(frozen=True)
class Fault:
    """A fault of one sensor on the timeline; `sensors.faults` says what each kind does."""

    sensor: str
    """accelerometer, gps, wheel, injector, skew, gyroscope or compass."""
    kind: str
    """ok, off, stuck, garbage, wrong, slow, delayed, intermittent or noisy."""
    start: float = 0.0
    """s of trip time."""
    end: float = float("inf")
    strength: float | None = None
    """What it means, and its default, depends on the kind."""


@dataclass(frozen=True)
class BoxSettings:
    """The box as built and fitted. SI units; `*_noise` are standard deviations.

    Errors that are a property of this box (bias, mounting, tooth pattern, clock rate) are drawn from `device_seed`;
    what changes from trip to trip from the trip's seed.
    """

    device_seed: int = 0
    faults: tuple[Fault, ...] = ()

    accelerometer_rate: float = 40.0
    """Hz, of the logger's clock."""
    accelerometer_noise: float = 0.10
    """m/s2, x and y, at rest."""
    accelerometer_noise_per_speed: float = 0.004
    """m/s2 per m/s."""
    accelerometer_noise_vertical: float = 0.30
    accelerometer_noise_vertical_per_speed: float = 0.02
    accelerometer_vibration: float = 0.10
    """m/s2, amplitude at the engine's firing frequency, all axes, while the engine turns."""
    accelerometer_bias: float = 0.3
    """m/s2: the largest; the box's own is drawn uniformly, axis by axis."""
    accelerometer_bias_trip: float = 0.02
    """m/s2, from trip to trip, inside the limit above."""
    accelerometer_mount_error: float = float(np.radians(0.2))
    """rad, about each axis: what the calibration in the car file misses."""
    accelerometer_mount_roll: float = 0.0
    """rad, on top of the above: the box has been moved since its calibration."""
    accelerometer_mount_pitch: float = 0.0
    accelerometer_mount_yaw: float = 0.0
    accelerometer_scale_error: float = 0.0
    """Relative."""
    accelerometer_drift: float = 0.0
    """m/s2 per K on x; the box warms by 20 K over `box_warm_up`."""
    box_warm_up: float = 900.0
    """s, time constant."""
    body_squat: float = float(np.radians(1.0))
    """rad of nose-up per g of forward acceleration."""

    gps_rate: float = 5.0
    gps_horizontal_error: float = 1.8
    """m, north and east each, correlated over `gps_horizontal_time`."""
    gps_horizontal_time: float = 120.0
    gps_white_noise: float = 0.4
    """m, north and east each."""
    gps_altitude_error: float = 3.5
    gps_altitude_time: float = 200.0
    gps_lag: float = 0.2
    """s, time constant of the receiver's own filter; 0: raw."""
    gps_speed_noise: float = 0.08
    """m/s, Doppler."""
    gps_delay_shortest: float = 0.040
    """s from the epoch to the arrival of the sentences' last byte."""
    gps_delay_longest: float = 0.250
    gps_canyon_error: float = 8.0
    """m, multipath between houses, correlated over `gps_canyon_time`."""
    gps_canyon_time: float = 15.0
    gps_canyon_outage: float = 0.10
    """Share of the time without a fix between houses."""
    gps_reacquisition: float = 3.0
    """s without a fix behind a tunnel, at most."""
    gps_multipath: float = 0.0
    """m, reflections everywhere, correlated over `gps_canyon_time`."""
    gps_stuck: float = 0.0
    """Share of the time in which the receiver repeats its last fix, ten seconds at a time ("dynamically stuck")."""

    wheel_tooth_error: float = 0.003
    """Share of a tooth's pitch, fixed pattern over a turn."""
    wheel_radius_error: float = 0.001
    """Relative, at most: the rolling radius against the car file's."""
    wheel_radius_change: float = 0.0
    """Relative, wear or pressure: a larger radius makes fewer pulses per metre."""
    wheel_radius_growth: float = 0.0
    """Relative growth at 100 km/h, with the square of speed."""
    wheel_silent_below: float = 3.0 * KILOMETRE_PER_HOUR
    """m/s: slowing down below it the Hall sensor falls silent,"""
    wheel_speaks_above: float = 4.0 * KILOMETRE_PER_HOUR
    """and it speaks again above this."""

    injector_noise: float = 0.006
    """Relative, of the opening, per pulse."""
    injector_dead_time: float = 0.0
    """s of electrical width on top of the car file's lag at 14 V."""
    injector_dead_time_per_volt: float = 0.0
    """s/V, from 14 V (negative: more dead time at low voltage)."""
    injector_fouling: float = 0.0
    """Share of the flow lost: the trims open longer for the same fuel."""

    injector_simultaneous_above: float = 0.0
    """rad/s of engine speed above which all injectors fire together (2.3.4.1, note 8); 0: never."""

    clock_rate_error: float = 10e-6
    """Relative, one deviation of the box's own rate."""
    clock_skew: float = 0.0
    """Relative, on top of the above."""
    clock_jitter: float = 1e-3
    """s: of stamps set by the main loop (accelerometer, gyroscope, compass, skew)."""
    clock_capture_jitter: float = 0.0
    """s: of stamps captured in hardware (wheel and injector edges), which the 125 us and 250 ns fields are made of."""
    skew_interval: float = 10.0
    """s between skew packets."""

    road_map_spacing: float = 50.0
    """m between nodes with an altitude."""
    road_map_altitude_error: float = 1.0
    """m, node by node."""
    road_map_grade_bias: float = 0.0
    """Added to every grade, along the route."""
    road_map_shift: float = 0.0
    """m by which altitudes lie too far along the road."""

    gyroscope: bool = False
    """Fitted? Not in the thesis' box (2.3 note 5)."""
    gyroscope_rate: float = 40.0
    gyroscope_noise: float = float(np.radians(0.1))
    """rad/s per sample."""
    gyroscope_bias: float = float(np.radians(0.5))
    compass: bool = False
    compass_rate: float = 10.0
    compass_noise: float = float(np.radians(1.5))
    compass_deviation: float = float(np.radians(3.0))
    """rad, of the car's own iron, once per turn."""

    def changed(self, **values: Any) -> "BoxSettings":
        """A copy with some fields changed."""
        return replace(self, **values)
