"""What a drive costs has several components; what one price buys of them (4.1, with an emission map that is optional).

Four plans of one road: fuel and time alone; gear changes dear; gentle (comfort); and an emission priced in. Each row's
notes tell all components, so that the trade can be seen. The emission map is an example, a rate that rises with the
fourth power of torque: the thesis gives none, and nothing is measured here.
"""

import time as clock
from dataclasses import dataclass, replace

import numpy as np

from controller import speed_limit
from controller.advice import RoadAhead
from controller.costs import blended_map, trip_costs
from controller.route import plan_route
from controller.route_problem import Comfort
from controller.solution import Certificate, Solution
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

LENGTH, GRADE, WAVE = 4000.0, 0.02, 1500.0
TIME_VALUE = 15_000.0
"""W."""
NOX_PRICE = 5e9
"""J/kg."""


@dataclass(frozen=True)
class _Trade:
    """One way to weigh the components."""

    name: str
    comfort: Comfort
    nox_price: float = 0.0


TRADES = (
    _Trade("dp", Comfort()),
    _Trade("dp-few-shifts", replace(Comfort(), shift_energy=60_000.0)),
    _Trade("dp-gentle", replace(Comfort(), acceleration=0.6, braking=0.5)),
    _Trade("dp-emissions", Comfort(), NOX_PRICE),
)


def trades(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """Fuel, time, gear changes, comfort and an emission: what pricing each one does to all.

    By dp only: raises BadInput where that is not asked for.
    """
    if "dp" not in methods:
        raise BadInput("method", ", ".join(methods), "dp: vector-cost is planned on a map")
    _, fuel_map = speed_limit.car_and_map(speed_limit.LimitedRoad() if car is None else speed_limit.car_road(car))
    driven = car or speed_limit.car_and_map(speed_limit.LimitedRoad())[0]
    nox = 1e-6 * fuel_map.engine_speed[:, None] / 300.0 * (fuel_map.torque[None, :] / 60.0) ** 4
    ratios = tuple(r / driven.wheel_radius for r in driven.gear_ratios)
    s = np.arange(0.0, LENGTH + 1.0, 10.0)
    slope = GRADE * np.sin(2.0 * np.pi * s / WAVE)
    road = RoadAhead(s, slope, np.full_like(s, 25.0), np.zeros_like(s))
    found = []
    for trade in TRADES:
        began = clock.perf_counter()
        priced = blended_map(fuel_map, {"nox": nox}, {"nox": trade.nox_price})
        advice = plan_route(
            road, priced, driven, start_speed=10.0, end_speed=20.0, time_value=TIME_VALUE, comfort=trade.comfort
        )
        told = trip_costs(advice, fuel_map, ratios, {"nox": nox})
        burnt = advice.trip_fuel - trade.nox_price * told.emissions["nox"]
        notes = {
            "fuel_J": burnt,
            "shifts": float(told.shifts),
            "discomfort_m2_s4": told.discomfort,
            "nox_kg": told.emissions["nox"],
        }
        found.append(
            Solution(
                "vector-cost", trade.name, burnt + TIME_VALUE * advice.trip_time, advice.trip_time, LENGTH,
                advice.time, np.stack([advice.s, advice.speed], axis=1), advice.torque[:, None],
                np.stack([np.full(len(advice.s), np.nan), advice.costate], axis=1), advice.gear,
                wall=clock.perf_counter() - began,
                certificate=Certificate(
                    maximum_gap=advice.certificate["maximum_gap"], hull_gain=advice.certificate["hull_gain"]
                ),
                notes=notes,
            )
        )  # fmt: skip
    return found
