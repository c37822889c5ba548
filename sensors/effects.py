"""The sensors' rows of the catalogue of effects, and how a value of one reaches the box."""

from collections.abc import Mapping

from sensors.settings import BoxSettings
from vehicle_model.car.effects import Effect, Parameter

EFFECTS = (
    Effect(
        "injector_dead_time",
        "injector",
        "Injector's dead time differs from the calibrated lag, and with the voltage",
        (
            Parameter(
                "extra", "s", 0.0, -0.3e-3, 0.3e-3, "0.5 - 1.5 ms in all, (M); the car file's lag is the neutral"
            ),
            Parameter("per_volt", "s/V", 0.0, -0.2e-3, 0.0, "-0.1 .. -0.2 ms/V, (M); from 14 V"),
        ),
        ("injector_width",),
        ("accessory_load",),
    ),
    Effect(
        "injector_fouling",
        "injector",
        "Fouled injectors: the trims open them longer for the same fuel",
        (Parameter("flow_lost", "", 0.0, -0.02, 0.12, "-2 .. -10 %, (M)"),),
        ("injector_width",),
        ("fuel_energy",),
    ),
    Effect(
        "grade_map_error",
        "road_map",
        "The road map's grades are biased, or lie at the wrong place",
        (
            Parameter("bias", "", 0.0, -0.006, 0.006, "+-0.3 % bias, EFFECTS 28"),
            Parameter("shift", "m", 0.0, -40.0, 40.0, "offsets of 10 - 30 m, EFFECTS 28"),
        ),
        ("map_altitude",),
        ("rolling_resistance", "brake_drag"),
    ),
    Effect(
        "accelerometer_mount",
        "accelerometer",
        "The accelerometer has moved, is off in scale, or drifts as it warms",
        (
            Parameter("pitch", "rad", 0.0, -0.1, 0.1, "-0.6 m/s2 forward, comma2k19"),
            Parameter("roll", "rad", 0.0, -0.1, 0.1, "as pitch"),
            Parameter("yaw", "rad", 0.0, -0.1, 0.1, "as pitch"),
            Parameter("scale", "", 0.0, -0.05, 0.05, "data sheet of the LIS3LV02D: a few per cent"),
            Parameter("drift", "m/s2/K", 0.0, -0.03, 0.03, "0.5 - 3 mg/C, (M)"),
        ),
        ("accelerometer",),
        ("grade_map_error",),
    ),
    Effect(
        "gps_lag",
        "gps",
        "The receiver's filter lags, reflections mislead it, it sticks",
        (
            Parameter("seconds", "s", 0.2, 0.0, 2.0, "0.16 and 1.48 s, comma2k19"),
            Parameter("multipath", "m", 0.0, 0.0, 30.0, "correlated over 15 s, everywhere; EFFECTS 30"),
            Parameter("stuck", "", 0.0, 0.0, 0.5, "share of the time with repeated fixes; EFFECTS 30"),
        ),
        ("gps_speed", "gps_position"),
        ("clock_skew",),
    ),
    Effect(
        "clock_skew",
        "clock",
        "The logger's clock runs fast or slow, and its stamps scatter",
        (
            Parameter("rate", "", 0.0, -500e-6, 500e-6, "10 - 100 ppm, (M)"),
            Parameter("jitter", "s", 1e-3, 0.0, 0.02, "CAN 3 - 23 ms, 1 - 99 %, comma2k19"),
            Parameter("capture_jitter", "s", 0.0, 0.0, 5e-3, "as jitter, of edges captured in hardware"),
        ),
        ("time",),
        ("gps_lag",),
    ),
)
"""Rows 16, 18 and 28 to 31 of EFFECTS."""

FIELD = {
    "injector_dead_time.extra": "injector_dead_time",
    "injector_dead_time.per_volt": "injector_dead_time_per_volt",
    "injector_fouling.flow_lost": "injector_fouling",
    "grade_map_error.bias": "road_map_grade_bias",
    "grade_map_error.shift": "road_map_shift",
    "accelerometer_mount.pitch": "accelerometer_mount_pitch",
    "accelerometer_mount.roll": "accelerometer_mount_roll",
    "accelerometer_mount.yaw": "accelerometer_mount_yaw",
    "accelerometer_mount.scale": "accelerometer_scale_error",
    "accelerometer_mount.drift": "accelerometer_drift",
    "gps_lag.seconds": "gps_lag",
    "gps_lag.multipath": "gps_multipath",
    "gps_lag.stuck": "gps_stuck",
    "clock_skew.rate": "clock_skew",
    "clock_skew.jitter": "clock_jitter",
    "clock_skew.capture_jitter": "clock_capture_jitter",
}
"""Effect parameter -> field of BoxSettings. A parameter's neutral is the field's default."""


def with_effects(settings: BoxSettings, values: Mapping[str, float]) -> BoxSettings:
    """Return `settings` with the effects in `values` ({"effect.parameter": value}) set; keys of other rooms are left.

    A value at its neutral leaves the field as it is.
    """
    neutral = {f"{effect.id}.{part.name}": part.neutral for effect in EFFECTS for part in effect.parameters}
    chosen = {FIELD[key]: float(value) for key, value in values.items() if key in FIELD and value != neutral[key]}
    return settings.changed(**chosen) if chosen else settings
