"""`rollingroad/HighwayEco-v0`: highway-env's road, traffic and lane changes; our car and its fuel."""

from typing import Any

import numpy as np
from highway_env.envs.highway_env import HighwayEnv
from highway_env.road.road import Road
from highway_env.vehicle.controller import MDPVehicle

from sim.drivers import STYLES, Foot, Gearbox
from vehicle_model.car.files import read_car
from vehicle_model.car.parameters import Car
from vehicle_model.car.route import Route
from vehicle_model.plant.session import Plant

FREQUENCY = 10
"""Hz of the simulation: a whole number of the plant's steps."""
ROAD_LENGTH = 30_000.0
"""m: longer than any episode."""


def level_road(limit: float) -> Route:
    """A straight, flat road with a speed limit, m/s: highway-env's."""
    s = np.arange(0.0, ROAD_LENGTH + 1.0, 10.0)
    zero = np.zeros_like(s)
    return Route(
        s=s,
        north=zero,
        east=s,
        altitude=zero,
        heading=zero + np.pi / 2.0,
        pitch=zero,
        straightness=zero,
        vertical_straightness=zero,
        speed_limit=zero + limit,
        sky=np.zeros(len(s), np.int8),
        origin=(0.0, 0.0, 0.0),
    )


class PlantVehicle(MDPVehicle):
    """highway-env's controlled vehicle whose acceleration is what our plant makes of the wish."""

    def attach(self, car: Car) -> None:
        """Put the plant in, at the present speed."""
        style = STYLES["good"]
        self.plant = Plant(car, level_road(30.0), None, self.speed)
        self.foot = Foot(car, 0.0, 0.0, 1.0 / FREQUENCY)
        self.gearbox = Gearbox(car, style, self.plant)

    def step(self, dt: float) -> None:
        """Advance by `dt` s: the controller's wish goes through foot, gearbox and plant."""
        wish = float(self.action["acceleration"])
        force = self.foot.force(wish, self.plant)
        gear = self.gearbox.gear(self.plant, force, wish, dt)
        self.plant.advance(force, gear, dt)
        self.action["acceleration"] = (self.plant.speed - self.speed) / dt
        super().step(dt)


class HighwayEco(HighwayEnv):
    """highway-env's `highway-v0` with a fuel bill.

    Observations and actions are highway-env's (`config`: Kinematics, DiscreteMetaAction by default). Reward per policy
    step: `collision_reward` if crashed, else 1 - (fuel burnt + time_value x time) / 100 kJ, so that it pays to survive.
    `info["fuel_J"]`, `info["distance_m"]` since the start.
    """

    def __init__(self, config: dict | None = None, render_mode: str | None = None, car: str = "smart") -> None:
        self._car = read_car(car)
        super().__init__(config or {}, render_mode)

    @classmethod
    def default_config(cls) -> dict:
        """highway-env's defaults; `time_value` in W."""
        config = super().default_config()
        config.update(simulation_frequency=FREQUENCY, time_value=8_000.0, normalize_reward=False, collision_reward=-1.0)
        return config

    def _create_vehicles(self) -> None:
        super()._create_vehicles()
        road: Road = self.road
        self._burnt = 0.0
        for i, plain in enumerate(self.controlled_vehicles):
            vehicle = PlantVehicle(
                road,
                plain.position,
                plain.heading,
                plain.speed,
                plain.target_lane_index,
                plain.target_speed,
                target_speeds=plain.target_speeds,
            )
            vehicle.attach(self._car)
            road.vehicles[road.vehicles.index(plain)] = vehicle
            self.controlled_vehicles[i] = vehicle

    def _reward(self, action: Any) -> float:
        vehicle: PlantVehicle = self.controlled_vehicles[0]
        if vehicle.crashed:
            return float(self.config["collision_reward"])
        period = 1.0 / self.config["policy_frequency"]
        burnt = vehicle.plant.fuel_energy - self._burnt
        self._burnt = vehicle.plant.fuel_energy
        return 1.0 - (burnt + self.config["time_value"] * period) / 1e5

    def _info(self, obs: Any, action: Any = None) -> dict:
        vehicle: PlantVehicle = self.controlled_vehicles[0]
        info = {
            "speed": vehicle.speed,
            "crashed": vehicle.crashed,
            "action": action,
            "fuel_J": vehicle.plant.fuel_energy,
            "distance_m": vehicle.plant.distance,
        }
        return info
