"""Drives that several benchmarks of the observer share: driven once and kept, with the box that logs them."""

import pickle
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rollingroad.task import make_task
from sensors.box import box_settings, record
from sensors.log import SensorLog
from sensors.packets import decode
from sensors.roadmap import RoadMap, from_route
from sensors.settings import BoxSettings
from sim.drive import drive
from sim.network import Network, build
from vehicle_model.car.parameters import Car
from vehicle_model.car.route import Route
from vehicle_model.car.trip import Trip

DEVELOPMENT, HELD_OUT = tuple(range(10)), tuple(range(120, 130))
"""Seeds: the observer's settings were chosen on some of the first; figures are of the second."""


@dataclass(frozen=True)
class Saved:
    """A drive: the truth, its road, the car, and the box that the scenario declares."""

    scenario: str
    seed: int
    trip: Trip
    route: Route
    car: Car
    box: BoxSettings

    def log(self) -> SensorLog:
        """What the box logs of it."""
        return decode(record(self.trip, self.car, self.box, self.seed))

    def road_map(self) -> RoadMap:
        """The map on board."""
        return from_route(self.route, self.seed, self.box)


@cache
def _network(scenario: str) -> Network:
    folder = Path(tempfile.mkdtemp(prefix="rollingroad-network-"))
    return build(make_task(scenario).scenario, folder)


def saved_drive(scenario: str, seed: int, folder: Path) -> Saved:
    """Return the drive from `folder`, or drive it and keep it there. Empty the folder when plant or drivers changed."""
    path = folder / f"{scenario}-{seed}.pickle"
    if not path.exists():
        task = make_task(scenario)
        driven = drive(task.scenario, task.car, seed, network=_network(scenario))
        found = Saved(scenario, seed, driven.trip, driven.route, task.car, box_settings(task.scenario.sensors, {}))
        folder.mkdir(parents=True, exist_ok=True)
        aside = path.with_suffix(".part")
        aside.write_bytes(pickle.dumps(found))
        aside.replace(path)
    return pickle.loads(path.read_bytes())
