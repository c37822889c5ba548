"""Plausible ranges of a car's declared parameters: outside them the file is wrong, not the car unusual."""

from math import isfinite, pi
from typing import Any

from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

RPM = 2.0 * pi / 60.0

# parameter as the message names it, where it is found, unit in the message, factor from SI to that unit, low, high
LIMITS: tuple[tuple[str, str, str, float, float, float], ...] = (
    ("mass wet", "wet_mass", "kg", 1.0, 200.0, 4500.0),
    ("drag/aero Cd", "drag_coefficient", "", 1.0, 0.1, 1.2),
    ("area frontal", "frontal_area", "m2", 1.0, 0.5, 6.0),
    ("drag/rolling Crr", "rolling_resistance", "", 1.0, 0.003, 0.04),
    ("wheel radius", "wheel_radius", "m", 1.0, 0.2, 0.5),
    ("wheels/inertia lumped", "wheel_inertia", "kg m2", 1.0, 0.05, 5.0),
    ("vss/calibration metersPerTick", "metres_per_tick", "m", 1.0, 0.005, 3.0),
    ("rollingroad/driver mass", "driver_mass", "kg", 1.0, 0.0, 200.0),
    ("rollingroad/world airDensity", "air_density", "kg/m3", 1.0, 0.7, 1.6),
    ("rollingroad/world gravity", "gravity", "m/s2", 1.0, 9.7, 9.9),
    ("engine/displacement", "engine.displacement", "cc", 1e6, 100.0, 9000.0),
    ("engine cylinders", "engine.cylinders", "", 1.0, 1.0, 16.0),
    ("engine/compression comp", "engine.compression", ":1", 1.0, 6.0, 16.0),
    ("engine/power", "engine.max_power", "kW", 1e-3, 3.0, 800.0),
    ("engine/power speed", "engine.max_power_speed", "rpm", 1.0 / RPM, 1500.0, 14000.0),
    ("engine/torque", "engine.max_torque", "Nm", 1.0, 8.0, 1500.0),
    ("engine/torque speed", "engine.max_torque_speed", "rpm", 1.0 / RPM, 800.0, 12000.0),
    ("engine/idle rpm", "engine.idle_speed", "rpm", 1.0 / RPM, 300.0, 2000.0),
    ("rollingroad/engine redline", "engine.redline_speed", "rpm", 1.0 / RPM, 2000.0, 16000.0),
    ("engine/inertia lumped", "engine.inertia", "kg m2", 1.0, 0.005, 2.0),
    ("rollingroad/engine friction", "engine.friction", "", 1.0, 0.4, 2.0),
    ("rollingroad/engine throttling", "engine.throttling", "", 1.0, 0.1, 1.0),
    ("inj/calibration fuelPerSecond", "injector.flow", "l/s", 1e3, 0.0005, 0.2),
    ("inj/calibration lag", "injector.lag", "s", 1.0, -0.003, 0.003),
    ("accelerometer roll", "mounting.roll", "rad", 1.0, -2 * pi, 2 * pi),
    ("accelerometer pitch", "mounting.pitch", "rad", 1.0, -2 * pi, 2 * pi),
    ("accelerometer yaw", "mounting.yaw", "rad", 1.0, -2 * pi, 2 * pi),
    ("accelerometer scale", "mounting.scale", "", 1.0, 0.5, 2.0),
    ("rollingroad/fuel density", "fuel.density", "kg/m3", 1.0, 600.0, 900.0),
    ("rollingroad/fuel heatingValue", "fuel.heating_value", "J/kg", 1.0, 2.0e7, 5.0e7),
    ("rollingroad/driveline loss", "driveline.loss", "", 1.0, 0.0, 0.3),
    ("rollingroad/driveline dragTorque", "driveline.drag_torque", "Nm", 1.0, 0.0, 100.0),
    ("rollingroad/driveline shiftTime", "driveline.shift_time", "s", 1.0, 0.05, 2.0),
    ("rollingroad/driveline launchRpm", "driveline.launch_speed", "rpm", 1.0 / RPM, 0.0, 8000.0),
    ("rollingroad/driveline boostTime", "driveline.boost_time", "s", 1.0, -1.0, 5.0),
    ("rollingroad/driveline scheduleRpm", "driveline.schedule_speed", "rpm", 1.0 / RPM, 0.0, 8000.0),
    ("rollingroad/driveline scheduleReserve", "driveline.schedule_reserve", "m/s2", 1.0, 0.0, 5.0),
    ("rollingroad/driveline electricalPower", "driveline.electrical_power", "W", 1.0, 0.0, 3000.0),
    ("rollingroad/tolerances mass", "tolerances.mass", "", 1.0, 0.0, 0.5),
    ("rollingroad/tolerances rollingResistance", "tolerances.rolling_resistance", "", 1.0, 0.0, 0.5),
    ("rollingroad/tolerances dragArea", "tolerances.drag_area", "", 1.0, 0.0, 0.5),
    ("rollingroad/tolerances fuel", "tolerances.fuel", "", 1.0, 0.0, 0.5),
    ("rollingroad/tolerances airDensity", "tolerances.air_density", "", 1.0, 0.0, 0.5),
    ("rollingroad/tolerances wheelRadius", "tolerances.wheel_radius", "", 1.0, 0.0, 0.5),
    ("rollingroad/tolerances wind", "tolerances.wind", "m/s", 1.0, 0.0, 20.0),
)


def check_car(car: Car, source: object) -> None:
    """Raise `BadInput` with the parameter's name, value and range where `car` is not plausible."""
    for name, place, unit, factor, low, high in LIMITS:
        value: Any = car
        for part in place.split("."):
            value = getattr(value, part)
        value = value * factor
        if not isfinite(value) or not low <= value <= high:
            raise BadInput(
                source, name, f"{value:g} {unit}".strip() + f" is outside {low:g} to {high:g} {unit}".rstrip()
            )
    e = car.engine
    for gear, ratio in enumerate(car.gear_ratios, start=1):
        if not isfinite(ratio) or not 0.5 <= ratio <= 40.0:
            raise BadInput(source, f"transmission gear {gear}", f"{ratio:g} is outside 0.5 to 40")
    for gear, (upper, lower) in enumerate(zip(car.gear_ratios, car.gear_ratios[1:], strict=False), start=1):
        if lower >= upper:
            raise BadInput(
                source,
                f"transmission gear {gear + 1}",
                f"{lower:g} is not below gear {gear}'s {upper:g}: gears descend",
            )
    order = (e.idle_speed, e.max_torque_speed, e.max_power_speed)
    if not order[0] < order[1] <= order[2] <= e.redline_speed * 1.0001:
        speeds = ", ".join(f"{value / RPM:.0f}" for value in (*order, e.redline_speed))
        raise BadInput(source, "engine", f"idle < torque's speed <= power's speed <= redline, found {speeds} rpm")
    torque = e.max_power / e.max_power_speed
    if torque > 1.02 * e.max_torque:
        raise BadInput(
            source, "engine/power", f"{e.max_power / 1e3:g} kW needs {torque:.1f} Nm, more than the {e.max_torque:g} Nm"
        )
    pressure = e.max_torque * 4.0 * pi / e.displacement / 1e5
    high = 30.0 if e.turbocharged else 15.0
    if not 4.0 <= pressure <= high:
        kind = "turbocharged" if e.turbocharged else "naturally aspirated"
        raise BadInput(
            source, "engine/torque", f"mean pressure {pressure:.1f} bar is outside 4 to {high:g} bar ({kind} engine)"
        )
