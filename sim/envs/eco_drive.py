"""`rollingroad/EcoDrive-v0`: drive a scenario's route in SUMO's traffic, on little fuel and in good time."""

import tempfile
from collections.abc import Generator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from scenarios import files
from scenarios.schema import Scenario
from sim.advisor import Suggestion, View
from sim.drive import journey
from sim.drive_record import Drive
from sim.network import build
from sim.route import true_route
from vehicle_model.car.files import read_car
from vehicle_model.plant.session import Plant

AHEAD = (0.0, 50.0, 100.0, 200.0, 400.0)
"""m ahead at which limit and pitch are shown."""
SIGHT = 200.0
"""m: farther leaders and signals show as this."""
ACCELERATION = (-3.0, 2.5)
"""m/s2: what an action may ask for."""


class EcoDrive(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """The agent is the driver's right foot; SUMO's safety rules, the gearbox of the baseline and the plant stay.

    Observation, Box (8 + 10,) float32: speed (m/s), gear, gap to the leader (m, at most 200), leader's speed minus own
    (m/s), distance of the next signal (m, at most 200), whether it is red or yellow (0, 1), distance to go (km), fuel
    power (10 kW); then speed limit (m/s) and pitch (rad) at 0, 50, 100, 200 and 400 m ahead.
    Action, Box (1,) in [-1, 1]: the acceleration wanted, -3 to 2.5 m/s2; the car does at most what traffic allows.
    Reward per step: -(fuel burnt + `time_value` x time) / 10 kJ. Ends on arrival; truncated if it never arrives.
    `info`: fuel_J, time_s, distance_m since the start; at the end also the `Drive`.

    Parameters: `scenario` name, file or Scenario; `car` as in the command; `period` s between actions; `time_value` W.
    One libsumo per process: two of these in one process cannot drive at the same time; vectorise by processes.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - gymnasium's own convention

    def __init__(
        self,
        scenario: str | Path | Scenario = "mixed",
        car: str = "smart",
        period: float = 1.0,
        time_value: float = 8_000.0,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = render_mode
        self._scenario = scenario if isinstance(scenario, Scenario) else files.load(scenario)
        self._car = read_car(car)
        self._folder = tempfile.TemporaryDirectory(prefix="eco-drive-")
        self._network = build(self._scenario, Path(self._folder.name))
        self._route = true_route(self._network)
        self._steps_per_action = max(round(period / 0.1), 1)
        self._time_value = time_value
        top = 100.0
        low = [0, 0, 0, -top, 0, 0, 0, 0] + [0.0] * len(AHEAD) + [-0.5] * len(AHEAD)
        high = [top, 12, SIGHT, top, SIGHT, 1, 1000, 100] + [top] * len(AHEAD) + [0.5] * len(AHEAD)
        self._low, self._high = np.array(low, np.float32), np.array(high, np.float32)
        self.observation_space = spaces.Box(self._low, self._high, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._drive: Generator[tuple[View, Plant], Suggestion | None, Drive] | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start anew. `seed` is the traffic's; without one, a fresh one is drawn from the environment's generator."""
        super().reset(seed=seed)
        self._stop()
        traffic_seed = seed if seed is not None else int(self.np_random.integers(2**31))
        self._drive = journey(self._scenario, self._car, traffic_seed, network=self._network, perfect=True)
        self._view, self._plant = next(self._drive)
        return self._observation(), self._info()

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold the wanted acceleration for one period."""
        if self._drive is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        low, high = ACCELERATION
        wanted = low + (high - low) * 0.5 * (float(np.clip(action[0], -1.0, 1.0)) + 1.0)
        fuel, time = self._plant.fuel_energy, self._plant.time
        finished: Drive | None = None
        for _ in range(self._steps_per_action):
            try:
                self._view, self._plant = self._drive.send(Suggestion(wanted, 0))
            except StopIteration as end:
                finished, self._drive = end.value, None
                break
        cost = self._plant.fuel_energy - fuel + self._time_value * (self._plant.time - time)
        info = self._info()
        if finished is not None:
            info["drive"] = finished
        arrived = finished is not None and finished.arrived
        return self._observation(), -cost / 1e4, arrived, finished is not None and not arrived, info

    def close(self) -> None:
        """End the simulation and remove the compiled road."""
        self._stop()
        self._folder.cleanup()

    def _stop(self) -> None:
        if self._drive is not None:
            self._drive.close()
            self._drive = None

    def _info(self) -> dict[str, Any]:
        plant = self._plant
        return {"fuel_J": plant.fuel_energy, "time_s": plant.time, "distance_m": plant.distance}

    def _observation(self) -> NDArray[np.float32]:
        view, plant, route = self._view, self._plant, self._route
        leader = np.isfinite(view.leader_speed)
        place = np.clip(plant.distance + np.array(AHEAD), route.s[0], route.s[-1])
        values = [
            plant.speed,
            plant.gear,
            min(max(view.leader_gap, 0.0), SIGHT),
            view.leader_speed - plant.speed if leader else 0.0,
            min(max(view.signal_distance, 0.0), SIGHT),
            float(view.signal_state in ("red", "yellow")),
            max(view.destination_distance, 0.0) / 1e3,
            plant.fuel_power / 1e4,
            *np.interp(place, route.s, route.speed_limit),
            *np.interp(place, route.s, route.pitch),
        ]
        return np.clip(np.array(values, np.float32), self._low, self._high)
