"""A car on its route, driven from outside: command a force and a gear, read where it is, take the trip home."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from vehicle_model.car.parameters import Car
from vehicle_model.car.route import Route
from vehicle_model.car.trip import Trip
from vehicle_model.plant import kernel as k
from vehicle_model.plant.parameters import plant_parameters


class Plant:
    """One drive of one car. `advance` is the only thing that changes it.

    Parameters: `settings` of the effects ("head_wind.speed": 4.0), start `speed` (m/s), `gear` (None: neutral at
    standstill, else the one that turns the engine near 2,200 rpm), `step` (s). Raises `BadInput` as `plant_parameters`.
    """

    def __init__(
        self,
        car: Car,
        route: Route,
        settings: Mapping[str, float] | None = None,
        speed: float = 0.0,
        gear: int | None = None,
        step: float = 0.01,
    ) -> None:
        self.car, self.route, self.step = car, route, step
        self.parameters = plant_parameters(car, settings)
        self.state = np.zeros(k.STATES)
        k.initial_state(
            self.parameters, self.state, float(speed), float(_start_gear(car, speed) if gear is None else gear)
        )
        self._road = np.ascontiguousarray(
            np.column_stack([route.pitch, route.straightness, route.vertical_straightness, route.heading])
        )
        self._start = float(route.s[0])
        self._rate = (len(route.s) - 1) / float(route.s[-1] - route.s[0])
        self.state[k.X_DISTANCE] = self._start
        self._record = np.empty((6000, k.COLUMNS))
        k.write_row(self.state, self._record[0])
        self._rows = 1

    def advance(self, force: float, gear: int, duration: float = 0.1) -> None:
        """Hold a command for `duration` s: `force` (N wanted at the wheels; negative brakes) and `gear` (0 neutral)."""
        steps = round(duration / self.step)
        if self._rows + steps > len(self._record):
            grown = np.empty((max(2 * len(self._record), self._rows + steps), k.COLUMNS))
            grown[: self._rows] = self._record[: self._rows]
            self._record = grown
        k.advance(
            self.parameters,
            self.state,
            float(force),
            float(gear),
            self._road,
            self._start,
            self._rate,
            steps,
            self.step,
            self._record,
            self._rows,
        )
        self._rows += steps

    def force_available(self) -> float:
        """Wheel force (N) at full load in the present gear at the present speed, steady; 0 in neutral."""
        return k.wheel_force_limits(self.parameters, self.state)[0]

    def overrun_force(self) -> float:
        """Wheel force (N, negative) of the engine's overrun in the present gear, brakes apart; 0 in neutral."""
        return k.wheel_force_limits(self.parameters, self.state)[1]

    @property
    def time(self) -> float:
        """s since the start."""
        return float(self.state[k.X_TIME])

    @property
    def distance(self) -> float:
        """m along the route."""
        return float(self.state[k.X_DISTANCE])

    @property
    def speed(self) -> float:
        """m/s."""
        return float(self.state[k.X_SPEED])

    @property
    def acceleration(self) -> float:
        """m/s2 over the last step."""
        return float(self.state[k.X_ACCELERATION])

    @property
    def gear(self) -> int:
        """Gear engaged, the old one while a shift is under way; 0 neutral."""
        return int(self.state[k.X_GEAR])

    @property
    def engine_speed(self) -> float:
        """rad/s."""
        return float(self.state[k.X_ENGINE_SPEED])

    @property
    def shifting(self) -> bool:
        """Whether a shift keeps the clutch open."""
        return bool(self.state[k.X_SHIFT] > 0.0)

    @property
    def clutch(self) -> float:
        """0 open, 0.5 slipping, 1 locked."""
        return 0.5 * float(self.state[k.X_CLUTCH])

    @property
    def thrust(self) -> float:
        """N over the last step."""
        return float(self.state[k.Y_THRUST])

    @property
    def road_load(self) -> float:
        """N over the last step: drag, rolling, grade and the rest that the wheels feel."""
        return float(self.state[k.Y_ROAD_LOAD])

    @property
    def fuel_power(self) -> float:
        """W over the last step."""
        return float(self.state[k.Y_FUEL_POWER])

    @property
    def fuel_energy(self) -> float:
        """J since the start."""
        return float(self.state[k.X_FUEL_ENERGY])

    def trip(self) -> Trip:
        """Everything that happened so far, in all channels of `vehicle_model.car.trip`."""
        return build_trip(self._record[: self._rows], self.step, self.route)


def build_trip(record: NDArray[np.float64], step: float, route: Route) -> Trip:
    """Return the trip of `record` (n, `kernel.COLUMNS`), whose road channels come from `route`."""
    channels = {name: record[:, n].copy() for n, name in enumerate(k.RECORD)}
    s = channels["distance"]
    for name in (
        "north",
        "east",
        "altitude",
        "heading",
        "pitch",
        "straightness",
        "vertical_straightness",
        "speed_limit",
    ):
        channels[name] = np.interp(s, route.s, getattr(route, name))
    nearest = np.clip(np.rint((s - route.s[0]) / (route.s[1] - route.s[0])).astype(int), 0, len(route.s) - 1)
    channels["sky"] = route.sky[nearest].astype(np.float64)
    return Trip(channels, step, route.origin)


def _start_gear(car: Car, speed: float) -> int:
    if speed < 2.0:
        return 0
    wheel = speed / car.wheel_radius
    return 1 + int(np.argmin([abs(np.log(ratio * wheel / 230.0)) for ratio in car.gear_ratios]))
