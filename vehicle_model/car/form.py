"""The form of a car file: every element and attribute of seed 004, C.1.2, and of our own element, with defaults."""

from math import pi

GEAR_NAMES = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
RPM = 2.0 * pi / 60.0

# (element path, attribute) of C.1.2 -> None where it is required, else what is assumed when absent
FORM: dict[tuple[str, str], str | None] = {
    ("car/owner", "owner"): "",
    ("car/make", "make"): "",
    ("car/model", "model"): "",
    ("car/year", "year"): "",
    ("car/color", "color"): "",
    ("engine/type", "type"): "",
    ("engine/displacement", "displacement"): None,
    ("engine/power", "power"): None,
    ("engine/torque", "torque"): None,
    ("engine/compression", "comp"): None,
    ("engine/idle", "rpm"): None,
    ("engine/inertia", "lumped"): None,
    ("wheels/tire", "summer"): None,
    ("wheels/inertia", "lumped"): None,
    ("accelerometer", "type"): "",
    ("accelerometer/calibration/roll", "phi"): "0",
    ("accelerometer/calibration/pitch", "theta"): "0",
    ("accelerometer/calibration/yaw", "psi"): "0",
    ("accelerometer/calibration/scale", "scale"): "1",
    ("transmission", "type"): "",
    ("transmission/reverse", "gear"): "",
    **{(f"transmission/{name}", "gear"): "" for name in GEAR_NAMES},
    ("drag/aero", "Cd"): None,
    ("drag/rolling", "Crr"): None,
    ("area", "frontal"): None,
    ("mass", "wet"): None,
    ("inj/calibration", "fuelPerSecond"): None,
    ("inj/calibration", "lag"): "0",
    ("inj/timing", "pattern"): "sequential",
    ("vss/calibration", "metersPerTick"): None,
    # our own element
    ("rollingroad", "name"): "",
    ("rollingroad/engine", "cylinders"): "",
    ("rollingroad/engine", "redline"): "",
    ("rollingroad/engine", "turbocharged"): "",
    ("rollingroad/engine", "friction"): "1",
    ("rollingroad/engine", "throttling"): "1",
    ("rollingroad/fuel", "density"): "745",
    ("rollingroad/fuel", "heatingValue"): "43.0e6",
    ("rollingroad/driver", "mass"): "76",
    ("rollingroad/world", "airDensity"): "1.2",
    ("rollingroad/world", "gravity"): "9.805",
    ("rollingroad/wheels", "radius"): "",
    ("rollingroad/driveline", "loss"): "0.04",
    ("rollingroad/driveline", "dragTorque"): "6",
    ("rollingroad/driveline", "shiftTime"): "0.35",
    ("rollingroad/driveline", "launchRpm"): "0",
    ("rollingroad/driveline", "variable"): "no",
    ("rollingroad/driveline", "boostTime"): "-1",
    ("rollingroad/driveline", "scheduleRpm"): "0",
    ("rollingroad/driveline", "scheduleReserve"): "0.9",
    ("rollingroad/driveline", "electricalPower"): "350",
    ("rollingroad/tolerances", "mass"): "0.02",
    ("rollingroad/tolerances", "rollingResistance"): "0.03",
    ("rollingroad/tolerances", "dragArea"): "0.02",
    ("rollingroad/tolerances", "fuel"): "0.005",
    ("rollingroad/tolerances", "airDensity"): "0.005",
    ("rollingroad/tolerances", "wheelRadius"): "0.001",
    ("rollingroad/tolerances", "wind"): "0.4",
}
LABELS = tuple(
    key for key, default in FORM.items() if default == "" and key[0].split("/")[0] in ("car", "accelerometer")
)
Values = dict[tuple[str, str], str]
