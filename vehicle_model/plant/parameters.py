"""From a car's declared data and the effects' settings to the kernel's flat parameter vector.

The declared data fix what a maker publishes (displacement, compression, power and torque at their speeds, masses,
gears); what he does not publish is filled with textbook values that the comments name. The efficiency map is nowhere
among them: it follows from friction, pumping, compression and the losses of burning.
"""

from collections.abc import Mapping
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from vehicle_model.car.effects import complete_settings
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car
from vehicle_model.plant import kernel as k
from vehicle_model.plant.effects import EFFECTS

AMBIENT_PRESSURE = 101_325.0
BAR = 1.0e5
_OWN = {effect.id for effect in EFFECTS}


def own_settings(settings: Mapping[str, float]) -> dict[str, float]:
    """Return those of `settings` ("effect.parameter": value) whose effect is a row of the plant's."""
    return {key: value for key, value in settings.items() if key.split(".")[0] in _OWN}


def plant_parameters(car: Car, settings: Mapping[str, float] | None = None) -> NDArray[np.float64]:
    """Return the kernel's vector (`kernel.PARAMETERS`,) of `car` under `settings` ("effect.parameter": value).

    Keys of other rooms' effects are left to them. Raises `BadInput` for an unknown parameter of a row of ours, a value
    out of range, and a car whose engine cannot hold its own idle.
    """
    s = complete_settings(own_settings(settings or {}), EFFECTS)
    p = np.zeros(k.PARAMETERS)
    _body(p, car, s)
    _driveline(p, car, s)
    _engine(p, car, s)
    _full_load(p, car)
    _accessories(p, car, s)
    check_idle(p, car.name)
    _closed_throttle(p, car)
    return p


def _body(p: NDArray[np.float64], car: Car, s: dict[str, float]) -> None:
    mass = car.mass * s["mass.factor"]
    p[k.P_MASS] = mass
    p[k.P_GRAVITY] = car.gravity
    p[k.P_RADIUS] = car.wheel_radius * (1.0 + s["wheel_radius.change"])
    p[k.P_RADIUS_GROWTH] = s["wheel_radius.growth"] / (100.0 / 3.6) ** 2
    p[k.P_DRIVEN_INERTIA] = p[k.P_FREE_INERTIA] = 2.0 * car.wheel_inertia
    p[k.P_FREE_RADIUS] = car.wheel_radius
    p[k.P_DRAG] = 0.5 * car.air_density * s["air_density.factor"] * car.drag_area * s["drag_area.factor"]
    p[k.P_YAW_DRAG] = s["cross_wind.growth"]
    p[k.P_WIND], p[k.P_WIND_FROM] = s["head_wind.speed"], s["head_wind.from"]
    p[k.P_GUST], p[k.P_GUST_RATE] = s["head_wind.gust"], 2.0 * pi / s["head_wind.gust_period"]
    p[k.P_CROSS], p[k.P_CROSS_FROM] = s["cross_wind.speed"], s["cross_wind.from"]
    p[k.P_ROLLING] = car.rolling_resistance * s["rolling_resistance.factor"]
    # Crr rises by some 5 % from standstill to 30 m/s (a radial tyre); the declared value holds at 15 m/s
    p[k.P_ROLLING_SPEED] = 0.6e-4
    p[k.P_ROLLING_BASE] = 1.0 - p[k.P_ROLLING_SPEED] * 15.0**2
    p[k.P_TYRE_COLD] = s["tyre_warm_up.amount"]
    p[k.P_TYRE_FAST_SHARE] = s["tyre_warm_up.fast_share"]
    p[k.P_TYRE_RATE], p[k.P_TYRE_FAST_RATE] = 1.0 / s["tyre_warm_up.time"], 1.0 / s["tyre_warm_up.fast_time"]
    # lateral force m v^2 S_j at a slip angle of force / stiffness: the force's part along the road
    p[k.P_CORNERING] = s["cornering_drag.factor"] * mass / (10.0 * car.gravity)
    p[k.P_BRAKE_DRAG], p[k.P_BRAKE_DRAG_HOT] = s["brake_drag.force"], s["brake_drag.after_braking"]
    p[k.P_BRAKE_COOLING] = 1.0 / s["brake_drag.decay"]
    p[k.P_BRAKE_LIMIT] = 0.9 * mass * car.gravity  # dry road
    p[k.P_TRACTION] = 0.9 * 0.6 * mass * car.gravity  # on the driven axle, load shift counted
    p[k.P_SLIP_COMPLIANCE] = s["wheel_slip.factor"] / (30.0 * 0.55 * car.mass * car.gravity)
    p[k.P_SLIP_RELAXATION] = 20.0  # relaxation length over speed, some tens of ms


def _driveline(p: NDArray[np.float64], car: Car, s: dict[str, float]) -> None:
    gears = len(car.gear_ratios)
    if gears > k.MAX_GEARS:
        raise BadInput(car.name, "transmission", f"at most {k.MAX_GEARS} gears, found {gears}")
    d = car.driveline
    p[k.P_GEARS] = gears
    p[k.P_CVT] = 1.0 if d.continuously_variable else 0.0
    p[k.P_CVT_RATE] = 0.8
    # two meshes; the gear nearest to direct loses least, the ends of the range a little more
    middle = 0.5 * (gears - 1)
    for gear, ratio in enumerate(car.gear_ratios, start=1):
        p[k.P_RATIO + gear] = ratio
        distance = abs(gear - 1 - middle) / max(middle, 1.0)
        p[k.P_LOSS + gear] = max(d.loss * (0.9 + 0.2 * distance) + s["driveline_loss.share"], 0.0)
    p[k.P_GEAR_DRAG] = 0.5 * d.drag_torque * s["driveline_loss.drag"]
    p[k.P_GEAR_DRAG_SPEED] = 0.5 * d.drag_torque / 60.0 * s["driveline_loss.drag"]  # churning; half at 60 rad/s
    p[k.P_GEAR_OIL_COLD] = s["gearbox_oil_cold.amount"]
    p[k.P_GEAR_OIL_RATE] = 1.0 / s["gearbox_oil_cold.distance"]
    p[k.P_SHIFT_TIME] = max(d.shift_time + s["shift_loss.time"], 0.1)
    p[k.P_CLUTCH_CAPACITY] = s["clutch_slip.capacity"] * car.engine.max_torque
    launch = d.launch_speed or min(0.5 * car.engine.max_torque_speed + 0.5 * car.engine.idle_speed + 40.0, 330.0)
    p[k.P_LAUNCH_SPEED] = max(launch * s["clutch_slip.launch"], 1.2 * car.engine.idle_speed)
    p[k.P_SCHEDULE_SPEED] = d.schedule_speed or 2.2 * car.engine.idle_speed
    p[k.P_SCHEDULE_RESERVE] = d.schedule_reserve
    p[k.P_LAUNCH_FORCE] = 0.35 * car.mass * car.gravity


def _engine(p: NDArray[np.float64], car: Car, s: dict[str, float]) -> None:
    e = car.engine
    p[k.P_INERTIA] = e.inertia
    p[k.P_IDLE], p[k.P_REDLINE] = e.idle_speed, e.redline_speed
    p[k.P_TORQUE_PER_PRESSURE] = e.displacement / (4.0 * pi)
    # small cylinders have more wall per volume: heat loss and rubbing grow with the inverse of their length scale
    size = (e.displacement / e.cylinders / 450e-6) ** (-1.0 / 3.0)
    # air-standard Otto cycle with gamma 1.28 (burnt mixture), of which heat loss and burning leave 0.905 (450 cc)
    p[k.P_CYCLE_EFFICIENCY] = (1.0 - 0.095 * size) * (1.0 - e.compression ** (1.0 - 1.28))
    # a cylinder full at manifold pressure p holds fuel for 30.6 p of heat (stoichiometric, 43 MJ/kg, filling 0.9)
    p[k.P_PRESSURE_GAIN] = 30.6 * p[k.P_CYCLE_EFFICIENCY]
    p[k.P_AMBIENT_PRESSURE] = AMBIENT_PRESSURE
    p[k.P_PUMPING_FLOOR] = (0.20 if e.turbocharged else 0.06) * BAR
    p[k.P_THROTTLING] = e.throttling
    p[k.P_DILUTION] = 0.35
    p[k.P_KNOCK] = 1.2
    p[k.P_KNOCK_LIMIT] = max(1.10 - 0.12 * (e.compression - 9.0), 0.6)
    p[k.P_KNOCK_SLOPE] = 0.6 / e.max_power_speed
    p[k.P_ENRICHMENT], p[k.P_ENRICHMENT_LOAD] = s["enrichment.amount"], min(s["enrichment.load"], 0.999)
    p[k.P_DRIFT] = s["map_drift.size"]
    p[k.P_DRIFT_SPEED] = s["map_drift.speed"] * e.redline_speed
    p[k.P_DRIFT_TORQUE] = s["map_drift.torque"] * e.max_torque
    p[k.P_DRIFT_SPEED_WIDTH] = s["map_drift.speed_width"] * e.redline_speed
    p[k.P_DRIFT_TORQUE_WIDTH] = s["map_drift.torque_width"] * e.max_torque
    p[k.P_FUEL_ENERGY] = s["fuel_energy.factor"]
    p[k.P_BOOST_ONSET] = 0.55
    own_lag = car.driveline.boost_time if car.driveline.boost_time >= 0.0 else (0.5 if e.turbocharged else 0.05)
    p[k.P_BOOST_TIME] = max(own_lag + s["turbo_lag.time"], 0.02)
    p[k.P_CUT_SHARE] = s["fuel_cutoff.share"]
    p[k.P_CUT_RESUME] = e.idle_speed + s["fuel_cutoff.resume"]
    p[k.P_CUT_BAND] = 10.0
    p[k.P_TARGET_TEMPERATURE] = 363.15
    p[k.P_START_TEMPERATURE] = s["cold_start.temperature"]
    p[k.P_FRICTION_EXPONENT] = s["cold_start.exponent"]
    p[k.P_OIL_SHARE] = s["cold_start.oil_share"]
    p[k.P_WARM_UP_ENERGY] = s["cold_start.energy"] * e.displacement
    p[k.P_WARM_UP_OIL_ENERGY] = s["cold_start.oil_energy"] * e.displacement
    p[k.P_COLD_ENRICHMENT] = s["cold_start.enrichment"]
    p[k.P_CRANK_ENERGY], p[k.P_CRANK_IDLE] = s["cranking_fuel.energy"], s["cranking_fuel.idle_raise"]
    p[k.P_CRANK_RETARD], p[k.P_CRANK_TIME] = s["cranking_fuel.retard"], s["cranking_fuel.time"]
    # at standstill the spark stands late, to have torque in reserve
    p[k.P_IDLE_FUEL], p[k.P_STOP_AFTER] = 1.15 * s["idle_fuel.factor"], s["idle_fuel.stop_after"]

    top = 1.15 * e.redline_speed
    p[k.P_TABLE_RATE] = (k.TABLE - 1) / top
    speed = np.linspace(0.0, top, k.TABLE)
    krpm = speed * 60.0 / (2000.0 * pi)
    # rubbing and auxiliaries, bar: Heywood's total motoring friction without its pumping part, a modern engine
    friction = e.friction * (size * (0.80 + 0.14 * krpm) + 0.033 * krpm**2)
    p[k.P_FRICTION : k.P_FRICTION + k.TABLE] = friction * BAR * p[k.P_TORQUE_PER_PRESSURE]
    # slow turning loses heat to the walls, fast turning burns late
    share = speed / e.max_power_speed
    relative = 1.0 - 0.14 * size * np.exp(-speed / 110.0) - 0.12 * np.maximum(share - 0.5, 0.0) ** 2 / 0.25
    p[k.P_SPEED_EFFICIENCY : k.P_SPEED_EFFICIENCY + k.TABLE] = relative
    back = (0.35 if e.turbocharged else 0.25) * BAR * share**2
    p[k.P_BACK_PRESSURE : k.P_BACK_PRESSURE + k.TABLE] = back


def _full_load(p: NDArray[np.float64], car: Car) -> None:
    """Largest brake torque through the published points: a smooth, shape-preserving curve."""
    e = car.engine
    at_power = e.max_power / e.max_power_speed
    low = (0.45 if e.turbocharged else 0.68) * e.max_torque
    points = [(0.0, 0.5 * low), (e.idle_speed, low)]
    if e.turbocharged:
        # a small turbine is awake from a little over half the speed of the largest torque
        points.append((max(0.50 * e.max_torque_speed, 1.5 * e.idle_speed), 0.90 * e.max_torque))
    else:
        points.append((0.5 * (e.idle_speed + e.max_torque_speed), 0.90 * e.max_torque))
    points += [(e.max_torque_speed, e.max_torque), (e.max_power_speed, at_power)]
    end = 1.15 * e.redline_speed
    points.append((end, at_power * max(0.55, 1.0 - 1.3 * (end - e.max_power_speed) / e.max_power_speed)))
    speeds, torques = np.array(points).T
    nodes = np.linspace(0.0, end, k.TABLE)
    p[k.P_FULL_LOAD : k.P_FULL_LOAD + k.TABLE] = PchipInterpolator(speeds, torques)(nodes)


def _accessories(p: NDArray[np.float64], car: Car, s: dict[str, float]) -> None:
    p[k.P_ALTERNATOR] = 0.67 * 0.80  # alternator and belt, CO2MPAS defaults
    p[k.P_ACCESSORY_NOMINAL] = car.driveline.electrical_power / p[k.P_ALTERNATOR]
    p[k.P_ELECTRICAL] = max(car.driveline.electrical_power + s["accessory_load.power"], 0.0)
    p[k.P_AC_POWER] = s["ac_cycling.power"]
    p[k.P_AC_RATE], p[k.P_AC_DUTY] = 1.0 / s["ac_cycling.period"], s["ac_cycling.duty"]


def _closed_throttle(p: NDArray[np.float64], car: Car) -> None:
    """A closed throttle leaves less air than the warm engine's idle needs, so that idle is the governor's to hold."""
    shaft = float(
        np.interp(p[k.P_IDLE] * p[k.P_TABLE_RATE], np.arange(k.TABLE), p[k.P_FRICTION : k.P_FRICTION + k.TABLE])
    )
    shaft += car.driveline.electrical_power / p[k.P_ALTERNATOR] / p[k.P_IDLE]
    indicated, _ = k.indicated_torque(p, p[k.P_IDLE], shaft)
    p[k.P_CLOSED_PRESSURE] = 0.75 * indicated / (p[k.P_TORQUE_PER_PRESSURE] * p[k.P_PRESSURE_GAIN])


def check_idle(p: NDArray[np.float64], source: object) -> None:
    """Raise `BadInput` where the engine's full load at idle speed does not carry friction and accessories."""
    place = p[k.P_IDLE] * p[k.P_TABLE_RATE]
    nodes = np.arange(k.TABLE)
    full = float(np.interp(place, nodes, p[k.P_FULL_LOAD : k.P_FULL_LOAD + k.TABLE]))
    warm = (p[k.P_START_TEMPERATURE] / p[k.P_TARGET_TEMPERATURE]) ** -p[k.P_FRICTION_EXPONENT]
    friction = float(np.interp(place, nodes, p[k.P_FRICTION : k.P_FRICTION + k.TABLE])) * (warm - 1.0)
    extra = (p[k.P_ELECTRICAL] / p[k.P_ALTERNATOR] - p[k.P_ACCESSORY_NOMINAL] + p[k.P_AC_POWER]) / p[k.P_IDLE]
    margin = full - friction - extra
    if margin <= 0.02 * full:
        raise BadInput(
            source,
            "engine idle",
            f"cannot hold its own idle: {friction + extra:.1f} N m to carry at {p[k.P_IDLE]:.0f} rad/s, "
            f"expected less than {0.98 * full:.1f} N m",
        )
