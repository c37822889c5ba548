"""Compiling the kernels ahead of need: a minute of steady driving is sensed, observed, mapped and planned for."""

import numpy as np

from controller.advice import RoadAhead
from controller.route import plan_route
from observer.observe import observe
from rollingroad.arrows import map_found
from sensors.box import record
from sensors.packets import decode
from sensors.roadmap import from_route
from vehicle_model.car.files import read_car
from vehicle_model.car.route import Route
from vehicle_model.car.trip import CHANNELS, Trip

SPEED, DURATION, STEP = 12.0, 60.0, 0.01
ORIGIN = (49.6, 6.1, 300.0)


def warm_up() -> None:
    """Compile, or load from the cache, every kernel between the card and the plan."""
    car = read_car("smart")
    trip, route = _steady_trip(), _straight_route()
    road_map = from_route(route)
    estimate = observe(decode(record(trip, car)), car, road_map)
    places = np.arange(0.0, 400.0, 20.0)
    road = RoadAhead(places, np.zeros(len(places)), np.full(len(places), 15.0), np.zeros(len(places)))
    plan_route(road, map_found([estimate], car).fuel_map, car, start_speed=10.0, end_speed=10.0, time_value=8e3)


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
