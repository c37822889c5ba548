"""Alternator and air conditioning switched where fuel is cheap (seed 004, 5.1.3).

While the car brakes in gear, the fuel cut, the alternator's and the compressor's work costs nothing: the brakes have
the less to do. (Rolling in gear it does cost: the car would have rolled farther.) So they run then with all they have,
and rest while the engine drives (not while it idles: there it saves less than it will cost), as far as the battery and
the cabin bear it: each is a store that may run down or up by so much around where it was. Near the lower end it is
topped up whatever it costs. What is missing at the end of the trip is charged to it (`owed_fuel`).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_model.car.parameters import Car
from vehicle_model.plant import kernel as k
from vehicle_model.plant import steady
from vehicle_model.plant.parameters import plant_parameters
from vehicle_model.plant.session import Plant

ALTERNATOR_MOST = 1_050.0
"""W, electrical: 75 A at 14 V."""
BATTERY_SWING = 150e3
"""J: 42 Wh either way, 7 % of a 50 Ah battery."""
CHARGING = 0.9
"""J given back for a joule charged beyond what is used at once."""
CABIN_SWING = 60.0
"""s of the compressor's mean power that the cabin bears either way."""
BRAKING = 100.0
"""N beyond the engine's drag that are braking."""
TYPICAL_SPEED, TYPICAL_LOAD = 2_000.0 * 2.0 * np.pi / 60.0, 0.4
"""rad/s, and share of full load, at which a debt is paid back."""


@dataclass
class AccessorySchedule:
    """Call `switch` before each step of `plant`. Battery and cabin begin in the middle of what they bear.

    `settings` are those that the plant was made with. The accessories' load is part of the plant's parameters (its idle
    speed control and its full load know of it), so there is one set of them for each state, made beforehand.
    """

    plant: Plant
    car: Car
    settings: Mapping[str, float]

    def __post_init__(self) -> None:
        p = self.plant.parameters
        self._load = float(p[k.P_ELECTRICAL])
        self._cooling, power = float(p[k.P_AC_POWER] * p[k.P_AC_DUTY]), float(p[k.P_AC_POWER])
        base = self.car.driveline.electrical_power
        self._sets = {
            (electrical, cooled): self._parameters(electrical - base, power * cooled)
            for electrical in (0.0, self._load, max(ALTERNATOR_MOST, self._load))
            for cooled in ((False, True) if power > 0.0 else (False,))
        }
        self.battery, self.cabin = 0.0, 0.0
        self._now = (self._load, False)
        self._charging, self._compressing = True, False

    def _parameters(self, electrical_more: float, compressor: float) -> NDArray[np.float64]:
        more = {"accessory_load.power": electrical_more, "ac_cycling.power": compressor}
        if compressor > 0.0:
            more["ac_cycling.duty"] = 1.0
        return plant_parameters(self.car, {**self.settings, **more})

    def switch(self, period: float, force: float) -> None:
        """Account for the last `period` (s), then set alternator and compressor for the next, in which `force` (N) is
        wanted at the wheels."""
        electrical, cooled = self._now
        surplus = (electrical - self._load) * period
        self.battery += surplus * (CHARGING if surplus > 0.0 else 1.0)
        if self._cooling > 0.0:
            power = self._sets[self._now][k.P_AC_POWER] if cooled else 0.0
            self.cabin += (power - self._cooling) * period
        plant = self.plant
        free = plant.fuel_power <= 0.0 and plant.gear > 0 and force < plant.overrun_force() - BRAKING
        self._charging = _wanted(free, self.battery, BATTERY_SWING, self._charging)
        self._compressing = _wanted(free, self.cabin, CABIN_SWING * self._cooling, self._compressing)
        idles = plant.gear == 0
        electrical = 0.0 if not (self._charging or idles) else max(ALTERNATOR_MOST, self._load) if free else self._load
        self._now = (electrical, self._compressing and self._cooling > 0.0)
        plant.parameters[:] = self._sets[self._now]

    def owed_fuel(self) -> float:
        """J of fuel that it takes to bring battery and cabin back while driving (negative: a surplus)."""
        most, none = (self._sets[electrical, False] for electrical in (max(ALTERNATOR_MOST, self._load), 0.0))
        gear = max(len(self.car.gear_ratios) - 2, 1)
        torque = TYPICAL_LOAD * float(steady.full_load(none, gear, np.array([TYPICAL_SPEED]))[0])
        fuel = [
            float(steady.fuel_power(p, gear, np.array([TYPICAL_SPEED]), np.array([torque]))[0]) for p in (most, none)
        ]
        shaft = (most[k.P_ELECTRICAL] - none[k.P_ELECTRICAL]) / most[k.P_ALTERNATOR]
        debt = -self.battery / most[k.P_ALTERNATOR] - self.cabin
        return float(debt * (fuel[0] - fuel[1]) / shaft)


def _wanted(free: bool, store: float, swing: float, on: bool) -> bool:
    """Full: off. Free: on. Nearly empty: on until half way back. Else off."""
    if store >= swing:
        return False
    if free or store <= -swing:
        return True
    return on and store < -0.5 * swing
