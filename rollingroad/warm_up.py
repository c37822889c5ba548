"""Compiling the kernels ahead of need, on a minute of steady driving: two halves, for two processes."""

import numpy as np

from controller.advice import RoadAhead
from controller.route import plan_route
from observer.efficiency_map import FuelMap
from observer.observe import observe
from sensors.box import record
from sensors.log import STREAMS, SensorLog
from sensors.matching import observations
from sensors.packets import decode
from sensors.projection import to_geodetic
from sensors.roadmap import from_route
from vehicle_model.car.files import read_car
from vehicle_model.car.route import Route
from vehicle_model.car.trip import CHANNELS, Trip

SPEED, DURATION, STEP = 12.0, 60.0, 0.01
ORIGIN = (49.6, 6.1, 300.0)


def warm_up() -> None:
    """Both halves, one after the other."""
    warm_up_observer()
    warm_up_planner()


def warm_up_observer() -> None:
    """Compile, or load from the cache, the box, the card's reader and the observer: the longest of it."""
    car = read_car("smart")
    observe(decode(record(_steady_trip(), car)), car)


def warm_up_planner() -> None:
    """Compile, or load from the cache, planning and map matching. For a process beside `warm_up_observer`'s.

    Planning first: the oracle, in a third process, needs it soonest, and would else compile it too.
    """
    car = read_car("smart")
    places = np.arange(0.0, 400.0, 20.0)
    road = RoadAhead(places, np.zeros(len(places)), np.full(len(places), 15.0), np.zeros(len(places)))
    plan_route(road, _flat_map(), car, start_speed=10.0, end_speed=10.0, time_value=8e3)
    observations(_driven_log(car.metres_per_tick), from_route(_straight_route()), car.metres_per_tick)


def _driven_log(metres_per_tick: float) -> SensorLog:
    """Wheel pulses and fixes along the straight route."""
    wheel = np.zeros(int(SPEED * DURATION / metres_per_tick), STREAMS["wheel"])
    wheel["t"] = np.arange(len(wheel)) * metres_per_tick / SPEED
    gps = np.zeros(int(5 * DURATION), STREAMS["gps"])
    gps["t"] = np.arange(len(gps)) / 5.0
    gps["latitude"], gps["longitude"] = to_geodetic(SPEED * gps["t"], np.zeros(len(gps)), ORIGIN)
    gps["utc"], gps["quality"], gps["hdop"], gps["speed"] = gps["t"], 1, 1.0, SPEED
    wheel["order"], gps["order"] = np.arange(len(wheel)), np.arange(len(gps))
    return SensorLog({"wheel": wheel, "gps": gps})


def _flat_map() -> FuelMap:
    """Fuel power of an engine with 30 kW of losses at 500 rad/s and a third of efficiency beyond them."""
    omega, torque = np.linspace(90.0, 640.0, 56), np.arange(0.0, 110.0, 2.0)
    power = 60.0 * omega[:, None] + 3.0 * omega[:, None] * torque
    return FuelMap(omega, torque, power, np.full(56, 100.0), np.full(56, -15.0), 5e3, 90.0)


def _steady_trip() -> Trip:
    time = np.arange(0.0, DURATION, STEP)
    channels = {name: np.zeros(len(time)) for name in CHANNELS}
    engine_speed, fuel_power = 250.0, 20e3
    channels |= {
        "time": time,
        "distance": SPEED * time,
        "north": SPEED * time,
        "altitude": np.full(len(time), ORIGIN[2]),
        "speed": np.full(len(time), SPEED),
        "gear": np.full(len(time), 4.0),
        "clutch": np.ones(len(time)),
        "thrust": np.full(len(time), 400.0),
        "engine_speed": np.full(len(time), engine_speed),
        "engine_angle": engine_speed * time,
        "fuel_power": np.full(len(time), fuel_power),
        "fuel_energy": fuel_power * time,
        "wheel_angle": SPEED / 0.2954 * time,
        "battery_voltage": np.full(len(time), 14.0),
    }
    return Trip(channels, STEP, ORIGIN)


def _straight_route() -> Route:
    s = np.arange(0.0, SPEED * DURATION + 50.0)
    zero = np.zeros(len(s))
    limit = np.full(len(s), 15.0)
    return Route(s, s, zero, zero + ORIGIN[2], zero, zero, zero, zero, limit, zero.astype(np.int8), ORIGIN)
