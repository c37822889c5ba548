"""Which sensors the car is worth having: cost against H2 norm, confirmed by the nonlinear observer on one drive."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from observer.observe import observe
from observer.selection.car_sensors import SENSORS, car_systems, cost
from observer.selection.search import agrees, best_sets, brute_force, joint_h2
from observer.settings import DEFAULT
from rollingroad.evaluation.scores import observer_scores
from sensors.box import BoxSettings, record
from sensors.log import SensorLog
from sensors.packets import decode
from sensors.roadmap import RoadMap, from_route
from vehicle_model.car.parameters import Car
from vehicle_model.car.route import Route
from vehicle_model.car.trip import Trip
from vehicle_model.plant.session import Plant

ALPHAS = (0.003, 0.03, 0.3)
"""Penalties of the relaxation: enough for sets of one to all nine sensors."""
STREAMS = {"gps": "gps", "wheel": "wheel", "gyroscope": "gyroscope", "compass": "compass"}
NOT_FITTED = ("barometer",)
"""Candidates that the simulated box does not have: sets with one have no nonlinear figure."""
DEAF = 1e6
"""m/s2: a deviation that lets a reading say nothing."""


def winding_road(length: float = 4000.0) -> Route:
    """Bends and hills to 5 %, without a tunnel: what the sets are compared on."""
    s = np.arange(0.0, length + 1.0)
    straightness = 0.004 * np.sin(2.0 * np.pi * s / 700.0)
    heading = 0.7 + np.cumsum(straightness)
    pitch = 0.05 * np.sin(2.0 * np.pi * s / 1300.0)
    flat = np.cos(pitch)
    return Route(
        s,
        np.cumsum(np.cos(heading) * flat),
        np.cumsum(np.sin(heading) * flat),
        300.0 + np.cumsum(np.sin(pitch)),
        heading,
        pitch,
        straightness,
        np.gradient(pitch, s),
        np.full(s.size, 25.0),
        np.zeros(s.size, dtype=np.int8),
        (49.61, 6.13, 0.0),
    )


def drive_along(car: Car, route: Route) -> Trip:
    """Drive `route` at speeds that rise and fall between 8 and 20 m/s, shifting to keep the engine near 2,600 rpm."""
    plant = Plant(car, route, speed=10.0)
    gear = 3
    while plant.distance < route.length - 30.0 and plant.time < 900.0:
        wanted = 14.0 + 6.0 * np.sin(2.0 * np.pi * plant.time / 50.0)
        error = wanted - plant.speed
        force = car.accelerated_mass * np.clip(0.4 * error, -1.5, 1.5) + max(plant.road_load, 0.0)
        if not plant.shifting:
            gear = plant.gear or gear
            if plant.engine_speed > 340.0 and gear < len(car.gear_ratios):
                gear += 1
            elif plant.engine_speed < 180.0 and gear > 1:
                gear -= 1
        plant.advance(force, gear)
    return plant.trip()


def learnt_before(car: Car, road_map: RoadMap, box: BoxSettings, trip: Trip, seed: int) -> dict[str, float]:
    """What an earlier drive with every sensor taught of the accelerometer's biases, to what they change by since."""
    log = decode(record(trip, car, box, seed=seed))
    learnt = dict(observe(log, car, road_map).learnt)
    return learnt | {f"bias_{axis}_variance": box.accelerometer_bias_trip**2 for axis in "xyz"}


def confirmed(
    log: SensorLog,
    trip: Trip,
    car: Car,
    road_map: RoadMap,
    names: Sequence[str],
    learnt: Mapping[str, float] | None = None,
) -> float | None:
    """Thrust error (N, causal, rms) of the nonlinear observer with the sensors `names`; None where it cannot be told.

    The other streams are taken out of `log`. The observer has one setting for the accelerometer's x and y, so y is
    heard wherever x is; a set with y alone has no figure.
    """
    if set(names) & set(NOT_FITTED) or ("accelerometer_y" in names and "accelerometer_x" not in names):
        return None
    gone = [stream for name, stream in STREAMS.items() if name not in names]
    streams = {name: rows[:0] if name in gone else rows for name, rows in log.streams.items()}
    settings = DEFAULT
    if "accelerometer_x" not in names:
        settings = replace(settings, accelerometer_floor=DEAF)
    if "accelerometer_z" not in names:
        settings = replace(settings, accelerometer_vertical_floor=DEAF)
    estimate = observe(replace(log, streams=streams), car, road_map if "road_map" in names else None, learnt, settings)
    error = observer_scores(estimate, trip)["thrust_rmse_N"]
    return error if error is not None and np.isfinite(error) else None


def price_list(
    car: Car, largest: int = 5, seed: int = 0, tell: Callable[[str], None] = lambda text: None
) -> dict[str, Any]:
    """Return the object of `select --json`: the best set of each size, from none to `largest`, and brute force's word.

    `h2` is the root of the mean squared norm over the operating points, in units of `car_sensors` (40 N, 2 mrad, two
    points of efficiency). The injector's pulses are in every set and cost nothing.
    """
    largest = min(largest, len(SENSORS))
    with threadpool_limits(1):  # small matrices run many times slower on several threads
        systems = car_systems(car)
        tell("semidefinite programmes")
        choices = best_sets(systems, largest, ALPHAS)
        tell("brute force over all sets")
        best = brute_force(systems, largest)
        nothing = joint_h2(systems, ())
    tell("driving")
    route = winding_road()
    trip = drive_along(car, route)
    box = BoxSettings(gyroscope=True, compass=True)
    log = decode(record(trip, car, box, seed=seed))
    road_map = from_route(route, seed, box)
    learnt = learnt_before(car, road_map, box, trip, seed + 1)
    rows = []
    for sensors, norm in [((), nothing), *((choice.sensors, choice.h2) for choice in choices)]:
        names = tuple(SENSORS[i] for i in sensors)
        tell(f"observing with {', '.join(names) or 'the injector alone'}")
        rows.append(
            {
                "sensors": list(names),
                "cost": cost(names),
                "h2": norm,
                "thrust_rmse_N": confirmed(log, trip, car, road_map, names, learnt),
            }
        )
    return {"sets": rows, "agrees_with_brute_force": agrees(choices, best)}
