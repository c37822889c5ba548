"""A small run made of closed forms, to test the views: a smooth hilly road, an analytic map, a noisy estimate."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pymap3d

from controller.advice import Advice, RoadAhead
from observer.efficiency_map import SPEED_STEP, TORQUE_STEP, EfficiencyMap
from observer.estimate import STATES, Estimate
from rollingroad.run import Run
from sensors.log import STREAMS, SensorLog
from vehicle_model.car.parameters import Car, Engine, Injector
from vehicle_model.car.route import CANYON, TUNNEL, Route
from vehicle_model.car.trip import CHANNELS, Trip

ORIGIN = (49.6, 6.13, 300.0)
RPM = 2 * np.pi / 60


def efficiency(engine_speed, torque):
    """Willans-like: losses of 9 N m growing with speed, 38 % indicated efficiency."""
    torque = np.maximum(torque, 0.0)
    return 0.38 * torque / (torque + 9.0 + 6.0 * (engine_speed / 400.0) ** 2)


@dataclass(frozen=True)
class WillansFit:
    name: str = "willans"
    r2: float = 0.98

    def efficiency(self, engine_speed, torque):
        return efficiency(engine_speed, torque) + 0.003


def car():
    return Car(
        name="smart",
        wet_mass=760.0,
        drag_coefficient=0.37,
        frontal_area=1.95,
        rolling_resistance=0.0125,
        wheel_radius=0.272,
        wheel_inertia=0.6,
        gear_ratios=(14.0, 8.8, 6.0, 4.2, 3.2, 2.6),
        metres_per_tick=0.27,
        engine=Engine(600e-6, 3, 9.5, 40e3, 5250 * RPM, 80.0, 2000 * RPM, 850 * RPM, 6000 * RPM, 0.1, True),
        injector=Injector(12e-6, -0.4e-3, "sequential"),
    )


def road(length=6000.0):
    s = np.arange(0.0, length + 1.0, 5.0)
    heading = 0.8 * np.sin(s / 900.0) + s / 4000.0
    altitude = 320.0 + 25.0 * np.sin(s / 700.0)
    pitch = np.arctan(np.gradient(altitude, s))
    sky = np.zeros(len(s), np.int8)
    sky[(s > 3000) & (s < 3600)] = TUNNEL
    sky[(s > 500) & (s < 800)] = CANYON
    limit = np.where(s < 1500, 50 / 3.6, np.where(s < 4000, 90 / 3.6, 130 / 3.6))
    step = np.diff(s, prepend=0.0)
    return Route(
        s=s,
        north=np.cumsum(step * np.cos(heading)),
        east=np.cumsum(step * np.sin(heading)),
        altitude=altitude,
        heading=heading,
        pitch=pitch,
        straightness=np.gradient(heading, s),
        vertical_straightness=np.gradient(pitch, s),
        speed_limit=limit,
        sky=sky,
        origin=ORIGIN,
    )


def drive(route, share_of_limit, step=0.02):
    """A trip that follows a smoothed share of the limit and stops once; every channel of CHANNELS is filled."""
    kernel = np.hanning(61) / np.hanning(61).sum()
    target = share_of_limit * np.convolve(np.pad(route.speed_limit, 30, mode="edge"), kernel, mode="valid")
    target *= 1.0 - 0.97 * np.exp(-(((route.s - 1000.0) / 60.0) ** 2))
    target *= np.clip(0.1 + route.s / 150.0, 0.0, 1.0)
    time_at = np.concatenate([[0.0], np.cumsum(np.diff(route.s) / (0.5 * (target[1:] + target[:-1])))])
    t = np.arange(0.0, time_at[-1], step)
    s = np.interp(t, time_at, route.s)
    v = np.gradient(s, t)
    a = np.gradient(v, t)
    at = {
        name: np.interp(s, route.s, getattr(route, name)) for name in ("north", "east", "altitude", "heading", "pitch")
    }
    load = 0.43 * v**2 + 100.0 + 836 * 9.805 * np.sin(at["pitch"])
    force = load + 860.0 * a
    gear = np.digitize(v, [4.0, 8.0, 12.0, 17.0, 23.0]) + 1.0
    ratio = np.array(car().gear_ratios)[gear.astype(int) - 1] / car().wheel_radius
    omega = np.maximum(v * ratio, 850 * RPM)
    torque = np.clip(np.maximum(force, 0.0) / ratio, 0.0, 78.0)
    power = np.maximum(omega * torque / np.maximum(efficiency(omega, torque), 0.02), 3000.0) * (force > -200)
    zero = np.zeros_like(t)
    channels = (
        dict.fromkeys(CHANNELS, zero)
        | at
        | {
            "time": t,
            "distance": s,
            "speed": v,
            "acceleration": a,
            "thrust": np.maximum(force, 0.0),
            "brake_force": np.maximum(-force, 0.0),
            "road_load": load,
            "gear": gear,
            "clutch": zero + 1.0,
            "engine_speed": omega,
            "engine_torque": torque,
            "fuel_power": power,
            "fuel_energy": np.cumsum(power) * step,
            "engine_angle": np.cumsum(omega) * step,
            "speed_limit": np.interp(s, route.s, route.speed_limit),
            "sky": route.sky[np.searchsorted(route.s, s, side="right") - 1].astype(float),
        }
    )
    return Trip({name: np.asarray(values, float) for name, values in channels.items()}, step, route.origin)


def sense(trip, rng):
    """GPS at 5 Hz with gaps in the tunnel, wheel pulses, and nothing else that the views would look at."""
    rows = np.arange(0, len(trip.time), int(0.2 / trip.step))
    rows = rows[trip.sky[rows] != TUNNEL]
    gps = np.zeros(len(rows), STREAMS["gps"])
    gps["t"] = trip.time[rows] + 0.1
    gps["order"] = np.arange(len(rows))
    noise = rng.normal(0, 2, (2, len(rows)))
    gps["latitude"], gps["longitude"], _ = pymap3d.enu2geodetic(
        trip.east[rows] + noise[0], trip.north[rows] + noise[1], 0 * rows, *trip.origin
    )
    gps["altitude"] = trip.altitude[rows] + rng.normal(0, 3, len(rows))
    gps["hdop"] = np.where(trip.sky[rows] == CANYON, 3.5, 1.1)
    gps["speed"] = trip.speed[rows]
    gps["utc"] = trip.time[rows] + trip.gps_epoch
    gps["quality"] = 1
    ticks = np.arange(0.27, trip.distance[-1], 0.27)
    wheel = np.zeros(len(ticks), STREAMS["wheel"])
    wheel["t"] = np.interp(ticks, trip.distance, trip.time)
    return SensorLog({"gps": gps, "wheel": wheel}, {"bad_check": 3, "bytes_skipped": 41}, "log.dat")


def observe(trip, rng):
    rows = np.arange(0, len(trip.time), round(0.1 / trip.step))
    deviation = np.array([1, 0.05, 50, 0.01, 2e-3, 1.5, 1.5, 2, 1e-4, 1e-4, 1e3, 300, 1, 2, 0.02, 0.02, 0.02])
    sources = {"down": -trip.altitude + trip.origin[2]}
    sources |= {"thrust": trip.thrust - trip.brake_force, "engine_angle": trip.engine_angle}
    sources |= {f"bias_{axis}": np.full_like(trip.time, 0.1) for axis in "xyz"}
    truth = np.column_stack([sources.get(name, trip.channels.get(name, trip.time * 0))[rows] for name in STATES])
    kinds = ["gps_north", "gps_east", "accelerometer_x", "distance", "fuel_energy"]
    count = 5000
    records = np.zeros(
        count,
        [
            ("t", "f8"),
            ("kind", "U16"),
            ("value", "f8"),
            ("innovation", "f8"),
            ("variance", "f8"),
            ("nis", "f8"),
            ("fused", "?"),
            ("reason", "U16"),
        ],
    )
    records["t"] = np.sort(rng.uniform(0, trip.time[-1], count))
    records["kind"] = rng.choice(kinds, count)
    records["variance"] = 1.0
    records["innovation"] = rng.normal(0, 1, count)
    records["nis"] = records["innovation"] ** 2
    records["fused"] = records["nis"] < 7
    records["reason"] = np.where(records["fused"], "", "gate")
    noise = rng.normal(0, 1, truth.shape)
    variance = np.broadcast_to(deviation**2, truth.shape).copy()
    return Estimate(
        trip.time[rows],
        truth + noise * deviation,
        variance,
        truth + 0.5 * noise * deviation,
        0.25 * variance,
        records,
        trip.origin,
        {"bias_x": 0.1},
    )


def map_engine(trip, rng):
    speed_edges = np.arange(850 * RPM, 6000 * RPM, SPEED_STEP)
    torque_edges = np.arange(0, 86, TORQUE_STEP)
    driven = trip.thrust > 0
    torque = trip.thrust * trip.speed / trip.engine_speed
    count, _, _ = np.histogram2d(trip.engine_speed[driven], torque[driven], [speed_edges, torque_edges])
    fuel, _, _ = np.histogram2d(
        trip.engine_speed[driven],
        torque[driven],
        [speed_edges, torque_edges],
        weights=trip.fuel_power[driven] * trip.step,
    )
    centres = 0.5 * (speed_edges[1:] + speed_edges[:-1]), 0.5 * (torque_edges[1:] + torque_edges[:-1])
    truth = efficiency(centres[0][:, None], centres[1][None, :])
    seen = count > 0
    found = np.where(seen, truth + rng.normal(0, 0.006, truth.shape), np.nan)
    found_map = EfficiencyMap(
        *centres,
        mean=found,
        deviation=np.where(seen, 0.02, np.nan),
        count=count.astype(np.int64),
        visits=np.where(seen, 3, 0),
        seconds=count * trip.step,
        fuel=fuel,
        valid=count > 25,
        fuel_total=float(trip.fuel_energy[-1]),
    )
    return found_map, truth


def plan(route, time_value=9000.0):
    trip = drive(route, 0.86)
    s = np.arange(0.0, route.length, 25.0)
    over = {
        name: np.interp(s, trip.distance, trip.channels[name])
        for name in ("speed", "engine_torque", "time", "fuel_energy")
    }
    policy_speed = np.linspace(1.0, 36.0, 30)
    shape = (len(s[::3]), len(policy_speed))
    costate = 900.0 * over["speed"] * (1.2 - s / s[-1])
    return Advice(
        s=s,
        speed=over["speed"],
        torque=over["engine_torque"],
        gear=np.digitize(over["speed"], [4.0, 8.0, 11.0, 15.0, 19.0]) + 1,
        costate=costate,
        time=over["time"],
        fuel=over["fuel_energy"],
        policy_speed=policy_speed,
        policy_s=s[::3],
        policy_acceleration=np.clip(0.2 * (over["speed"][::3, None] - policy_speed), -1, 1.2),
        policy_gear=np.broadcast_to(np.digitize(policy_speed, [4.0, 8.0, 11.0, 15.0, 19.0]) + 1, shape),
        policy_costate=np.broadcast_to(costate[::3, None], shape),
        time_value=time_value,
    )


def results(baseline, advised):
    fuel = float(baseline.fuel_energy[-1]), float(advised.fuel_energy[-1])
    return {
        "scenario": "synthetic",
        "car": "smart",
        "seed": 3,
        "distance_m": float(baseline.distance[-1]),
        "vehicles": 61,
        "baseline": {"fuel_J": fuel[0], "time_s": baseline.duration},
        "advised": {"fuel_J": 0.953 * fuel[0], "time_s": baseline.duration},
        "saving_percent": 4.7,
        "saving_ci95": None,
        "time_difference_percent": 0.1,
        "naive_saving_percent": 12.3,
        "oracle_saving_percent": 8.9,
        "observer": {
            "events": 48213,
            "thrust_rmse_N": 58.2,
            "thrust_rmse_smoothed_N": 25.1,
            "thrust_rms_N": 812.0,
            "efficiency_rmse": 0.024,
            "nis_mean_per_dof": 1.08,
            "microseconds_per_event": 2.6,
            "gps_outage_s": 41.0,
            "rejected": {"gps": 12, "accelerometer": 31},
        },
        "map": {
            "cells": 214,
            "fuel_share": 0.412,
            "rmse": 0.0071,
            "fit": "willans",
            "fit_rmse": 0.0043,
            "r2": 0.981,
            "peak_value_error": 0.004,
        },
        "wall_s": {"drive": 9.1, "observe": 0.8, "plan": 1.9, "total": 22.4},
        "real_time_factor": 71.0,
        "files": {},
    }


def synthetic_run(folder: Path) -> Run:
    rng = np.random.default_rng(11)
    route = road()
    baseline, advised = drive(route, 0.95), drive(route, 0.85)
    found, truth = map_engine(baseline, rng)
    return Run(
        results=results(baseline, advised),
        car=car(),
        route=route,
        baseline=baseline,
        advised=advised,
        log=sense(baseline, rng),
        estimate=observe(baseline, rng),
        efficiency_map=found,
        fits={"willans": WillansFit()},
        advice=plan(route),
        true_efficiency=truth,
        road_ahead=RoadAhead(
            s=route.s, pitch=route.pitch, speed_max=route.speed_limit, speed_min=0.3 * route.speed_limit
        ),
        folder=folder,
    )
