"""Where the fuel went: the energy account of a drive, from its true record."""

from dataclasses import dataclass

import numpy as np

from vehicle_model.car.parameters import Car
from vehicle_model.car.trip import Trip

PARTS = ("engine", "driveline", "air drag", "rolling", "brakes", "stored")


@dataclass(frozen=True)
class EnergyAccount:
    """J over a drive. The parts sum to `fuel` up to the error of the time integration.

    `parts`: "engine" heat, friction, accessories; "driveline" losses, slipping clutch, what spins the drivetrain;
    "air drag" and "rolling" (and what else resists: wind, curves), told apart by the car file's drag area; "brakes";
    "stored" kinetic and potential energy gained from start to end.
    """

    fuel: float
    parts: dict[str, float]
    standing: float
    """J of fuel burnt below 0.5 m/s."""


def energy_account(trip: Trip, car: Car) -> EnergyAccount:
    """Integrate the powers of `trip` (trapezoids on its own clock)."""

    def energy(power: np.ndarray) -> float:
        return float(np.trapezoid(power, trip.time))

    fuel = float(trip.fuel_energy[-1] - trip.fuel_energy[0])
    crank = energy(trip.engine_torque * trip.engine_speed)
    thrust, brakes = energy(trip.thrust * trip.speed), energy(trip.brake_force * trip.speed)
    grade = car.mass * car.gravity * np.sin(trip.pitch)
    resistance = energy((trip.road_load - grade) * trip.speed)
    drag = energy(0.5 * car.air_density * car.drag_area * trip.speed**3)
    parts = {
        "engine": fuel - crank,
        "driveline": crank - thrust,
        "air drag": drag,
        "rolling": resistance - drag,
        "brakes": brakes,
        "stored": thrust - brakes - resistance,
    }
    standing = energy(np.where(trip.speed < 0.5, trip.fuel_power, 0.0))
    return EnergyAccount(fuel, parts, standing)
