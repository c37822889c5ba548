"""The pure one-dimensional acceleration of seed 004, 4.4: how to get up to the speed, and nothing about where to lift.

The found map is brought into the thesis' form (phi, a polynomial of six terms), the synthesis is tabulated once; each
speed then has its optimal torque and gear. With `Context.pedal_to_the_floor` the car takes the acceleration over, as
in 5.1.3: the driver presses, and limits, traffic and his own brake end it.
"""

import math
from dataclasses import dataclass

import numpy as np

from controller.acceleration import synthesis_table
from controller.controller_model import ControllerModel
from observer.efficiency_map import FuelMap
from sim.advisor import Context, Suggestion, View
from sim.rules_of_thumb import early_gear, rolling_cap
from vehicle_model.car.parameters import Car

LEAST_TORQUE = 5.0
"""N m: below it 1/efficiency has no meaning."""
SETTLED = 0.4
"""m/s below the limit at which the acceleration is over."""
STRONGEST = 2.5
"""m/s2."""
BRAKING = 1.0
"""m/s2 by which the speed aimed at falls towards a slower place."""


def model_from_map(fuel_map: FuelMap, car: Car) -> ControllerModel:
    """The controller's model with phi (table 4.1's form) fitted to `fuel_map`, relative errors, below full load."""
    w, t = np.meshgrid(fuel_map.engine_speed, fuel_map.torque, indexing="ij")
    use = (t >= LEAST_TORQUE) & (t <= fuel_map.torque_max[:, None]) & (w >= 1.2 * fuel_map.idle_speed)
    w, t, phi = w[use], t[use], (fuel_map.fuel_power[use] / (w[use] * t[use]))
    terms = np.column_stack([np.ones_like(w), w, t, w * t, w * w, t * t])
    fitted = np.linalg.lstsq(terms / phi[:, None], np.ones_like(phi), rcond=None)[0]
    return ControllerModel(
        mass=car.mass,
        accelerated_mass=car.accelerated_mass,
        gravity=car.gravity,
        rolling_resistance=car.rolling_resistance,
        drag_area=car.drag_area,
        air_density=car.air_density,
        ratios=tuple(ratio / car.wheel_radius for ratio in car.gear_ratios),
        phi=tuple(float(value) for value in fitted),
        engine_speed=(1.25 * fuel_map.idle_speed, min(car.engine.redline_speed, float(fuel_map.engine_speed[-1]))),
        torque=(LEAST_TORQUE, 0.9 * float(np.median(fuel_map.torque_max))),
    )


def _near_the_end(view: View) -> bool:
    return view.destination_distance < 150.0


@dataclass
class AccelerationSynthesis:
    """Accelerates by the synthesis up to what the road allows, holds it in a low-revving gear, says no more."""

    context: Context

    def reset(self) -> None:
        """Fit and tabulate."""
        c = self.context
        model = model_from_map(c.fuel_map, c.car)
        lowest = model.engine_speed[0] / model.ratios[0]
        self._speeds = np.linspace(1.001 * lowest, max(float(c.road.speed_max.max()), 2.0 * lowest), 200)
        # With a price of time W the minimised integral is of P_in + W: the Hamiltonian of P_in alone is then W.
        self._table = synthesis_table(model, self._speeds, c.time_value)
        self._cap = rolling_cap(c.road, BRAKING)

    def advise(self, view: View) -> Suggestion | None:
        """The optimal acceleration with room ahead, the limit held; None while braking, following or before a stop."""
        c = self.context
        target = float(np.interp(view.distance + view.speed, c.road.s, self._cap))
        stop_ahead = view.signal_state in ("red", "yellow") or view.leader_gap < 4.0 * view.speed
        if view.distance < c.begin or view.speed > target + SETTLED or stop_ahead or _near_the_end(view):
            return None
        if view.speed > target - SETTLED:
            gear = early_gear(c.car, view.speed, accelerating=False)
            return Suggestion(target - view.speed, gear)
        row = self._table[min(int(np.searchsorted(self._speeds, view.speed)), len(self._speeds) - 1)]
        costate, gear, _, _, acceleration, _ = row
        if not math.isfinite(acceleration):
            return None
        wanted = min(float(acceleration), STRONGEST, (target - view.speed) / 0.8)
        return Suggestion(wanted, int(gear), float(costate), automatic=c.pedal_to_the_floor)
