"""What the observer is told of noise: of the sensors (the default box) and of the model. All SI, data only."""

from dataclasses import astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ObserverSettings:
    """Standard deviations of the measurements, densities of the process noise, thresholds.

    Order matters: `observer.kernel` reads them as an array. Densities are variances per second unless said otherwise.
    """

    # accelerometer (CLI.md, "At the door"): sd = a + b v
    accelerometer_floor: float = 0.12
    """m/s2, x and y, with the vibration."""
    accelerometer_slope: float = 0.004
    """m/s2 per m/s."""
    accelerometer_vertical_floor: float = 0.32
    accelerometer_vertical_slope: float = 0.02
    # wheel pulses
    tooth_deviation: float = 0.0009
    """m: irregularity of the teeth (0.3 % of 0.27 m, with room)."""
    tick_clock: float = 125e-6
    """s: quantum of the wheel pulse's time; its deviation is this / sqrt(12)."""
    tick_silence: float = 0.35
    """s without a pulse: slower than the pick-up can see."""
    silent_speed: float = 1.1
    """m/s below which no pulses come (3 to 4 km/h)."""
    # injector pulses
    pulse_clock: float = 1e-3
    """s: quantum of the injector pulse's time."""
    pulse_deviation: float = 0.006
    """Relative deviation of one pulse's fuel."""
    pulse_power_deviation: float = 0.0065
    """Relative deviation of the power that one pulse foretells for the interval it opens."""
    cut_gap: float = 0.25
    """s without a pulse: fuel is cut off."""
    # satellite receiver
    gps_white: float = 0.45
    """m, per axis, at HDOP 1."""
    gps_vertical_white: float = 0.7
    """m."""
    gps_drift: float = 1.8
    """m, slowly varying horizontal error, per axis."""
    gps_drift_time: float = 120.0
    """s."""
    gps_vertical_drift: float = 3.5
    """m."""
    gps_vertical_drift_time: float = 200.0
    """s."""
    gps_lag: float = 0.2
    """s: the receiver's own filter."""
    gps_arrival: float = 0.03
    """s: smallest time from an epoch to the last stamped packet before its sentence was complete."""
    gps_speed: float = 0.1
    """m/s."""
    gps_course: float = 0.085
    """m/s across the track: the course's deviation is this / speed."""
    # other sensors
    speed_deviation: float = 0.15
    """m/s, of logs that carry a speed."""
    fuel_deviation: float = 0.03
    """Relative, of logs that carry a fuel flow."""
    gyroscope: float = 0.01
    """rad/s."""
    compass: float = 0.1
    """rad."""
    # process noise
    distance_noise: float = 1e-9
    """m2/s."""
    speed_noise: float = 1e-5
    """(m/s)2/s."""
    thrust_noise: float = 3e3
    """N2/s, always there."""
    thrust_noise_cut: float = 4e6
    """N2/s while fuel is cut off or wheels are silent: brakes show nowhere else."""
    thrust_gain: float = 0.25
    """Thrust that a change of fuel power foretells: gain x change / speed (an efficiency, on average)."""
    thrust_settling: float = 0.05
    """s over which a foretold change of thrust arrives."""
    heading_noise: float = 1e-7
    """rad2/s."""
    pitch_noise: float = 1e-7
    """rad2/s."""
    position_noise: float = 1e-4
    """m2/s, north and east."""
    down_noise: float = 1e-5
    """m2/s."""
    straightness_noise: float = 3e-6
    """(rad/m)2 per metre."""
    vertical_straightness_noise: float = 5e-10
    """(rad/m)2 per metre."""
    energy_noise: float = 1.0
    """J2/s."""
    power_noise: float = 5e5
    """W2/s."""
    angle_noise: float = 1e-6
    """rad2/s."""
    engine_speed_noise: float = 50.0
    """(rad/s)2/s."""
    engine_speed_noise_cut: float = 5000.0
    """(rad/s)2/s while no pulse tells it."""
    bias_noise: float = 1e-9
    """(m/s2)2/s."""
    # start
    bias_deviation: float = 0.18
    """m/s2 of the accelerometer's biases before the first trip: anywhere up to 0.3, and 0.2 degrees of mounting."""
    pitch_deviation: float = 0.04
    """rad, of a road's grade."""
    # gate
    gate: float = 25.0
    """Chi-square with one degree of freedom beyond which a measurement is rejected (5 deviations)."""
    reopen: float = 3.0
    """s of rejections in a row after which the gate opens again."""
    skew_limit: float = 300e-6
    """Largest relative rate of the logger's clock that is believed."""
    # the smoother knows when the fuel changed
    thrust_gain_hindsight: float = 0.12
    thrust_noise_hindsight: float = 1e3
    """N2/s."""
    power_noise_hindsight: float = 1e6
    """W2/s."""
    # odometer: dx/dt = v (1 + scale + slip F)
    slip: float = 7e-6
    """1/N, of the driven tyres: slip stiffness of some 30 times the load."""
    slip_deviation: float = 3e-6
    """1/N."""
    scale_deviation: float = 0.0015
    """Relative, of the wheel's radius."""
    slip_noise: float = 1e-17
    """(1/N)2/s."""
    scale_noise: float = 1e-10
    """1/s."""
    map_heading_scale: float = 0.4
    """Share of the deviation that the matcher states of a heading,"""
    map_straightness_scale: float = 0.15
    """and of a straightness, that is seen in fact."""
    standstill_deviation: float = 0.08
    """m/s about 0 of a car whose wheels have been silent for 2 s."""
    open_clutch: float = 0.03
    """m/s2, of what the accelerometer reads between two gears, beside its noise: the body swings."""
    body_squat: float = 0.0174533
    """rad of nose-up per g of acceleration (1 degree): what a body on springs does to a sensor fixed to it."""
    scale_trip_deviation: float = 5e-4
    """Relative: a tyre's radius from trip to trip, by its pressure and warmth."""
    bias_trip_deviation: float = 0.02
    """m/s2 by which a bias changes from trip to trip."""

    def vector(self) -> NDArray[np.float64]:
        """The settings in the order of their fields, as the kernel reads them."""
        return np.array(astuple(self), dtype=np.float64)


FIELDS = tuple(field.name for field in fields(ObserverSettings))
DEFAULT = ObserverSettings()
"""Derived from the default box's noise (CLI.md, "At the door")."""
