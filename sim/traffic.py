"""The SUMO session: traffic around the ego, and the ego's mirror in it."""

import hashlib
import math
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path

import libsumo
import sumo

from sim.demand import EGO
from sim.network import Network

PERIOD = 0.1
"""s: SUMO's step."""
MIRROR_TOLERANCE = 1e-6
"""m and m/s: plant and mirror agree to this, or the drive is void."""
SIGHT = 150.0
"""m ahead that a driver looks for signals."""
TOLD_AHEAD = 120.0
"""s ahead for which a signal that tells does so."""


class MirrorError(RuntimeError):
    """The ego in SUMO is not where the plant is: advice would be for another car."""


class Traffic:
    """One simulation. One per process at a time: libsumo is a single global simulation (use as a context manager)."""

    def __init__(self, network: Network, routes: Path, seed: int, signals: Path | None = None) -> None:
        self._arguments = ["sumo", "--net-file", str(network.net), "--route-files", str(routes)]
        if signals is not None:
            self._arguments += ["--additional-files", str(signals)]
        self._arguments += ["--step-length", str(PERIOD), "--seed", str(seed % 2**31), "--no-step-log", "--no-warnings"]
        self._arguments += ["--collision.action", "warn", "--time-to-teleport", "120", "--max-depart-delay", "60"]
        self._arguments += ["--xml-validation", "never", "--xml-validation.net", "never"]
        self.distance = 0.0
        self.speed = 0.0
        self._before = 0.0
        self._commanded = 0.0
        self.released = 0.0
        self._phases: dict[str, list[tuple[float, str]]] = {}

    def __enter__(self) -> "Traffic":
        os.environ.setdefault("SUMO_HOME", sumo.SUMO_HOME)
        libsumo.start(self._arguments)
        return self

    def __exit__(self, *_: object) -> None:
        libsumo.close()

    def begin(self, limit: float) -> bool:
        """Step until the ego stands on the road; False if it found no place within `limit` s."""
        while libsumo.simulation.getTime() < limit:
            libsumo.simulation.step()
            if EGO in libsumo.simulation.getDepartedIDList():
                # 0: SUMO does as it is told; the driver alone keeps distance, and the mirror stays exact.
                libsumo.vehicle.setSpeedMode(EGO, 0)
                libsumo.vehicle.setSpeed(EGO, 0.0)
                self.distance = libsumo.vehicle.getDistance(EGO)
                return True
        return False

    def step(self, distance: float) -> None:
        """Move the ego's mirror to `distance` (m since the start) and everybody else by one step.

        Raises MirrorError if SUMO's ego does not arrive exactly there.
        """
        speed = (distance - self.distance) / PERIOD
        libsumo.vehicle.setSpeed(EGO, speed)
        libsumo.simulation.step()
        there, found = libsumo.vehicle.getDistance(EGO), libsumo.vehicle.getSpeed(EGO)
        if abs(there - distance) > MIRROR_TOLERANCE or abs(found - speed) > MIRROR_TOLERANCE:
            raise MirrorError(
                f"at {libsumo.simulation.getTime():.1f} s the plant is at {distance:.6f} m, its mirror at {there:.6f} m"
            )
        self._before, self._commanded = self.speed, speed
        self.distance, self.speed = distance, speed

    @property
    def time(self) -> float:
        """s of simulation."""
        return libsumo.simulation.getTime()

    def planned_acceleration(self) -> float:
        """What SUMO itself would have done in the last step where it wanted less than was done, else inf.

        Junctions, merging and lane ends speak through this; SUMO never plans for more than it was told.
        """
        planned = libsumo.vehicle.getSpeedWithoutTraCI(EGO)
        return (planned - self._before) / PERIOD if planned < self._commanded - 1e-6 else math.inf

    def leader(self, reach: float) -> tuple[str, float, float]:
        """Name, net gap (m, SUMO's minimum gap already taken off) and speed of the car in front; ("", inf, nan)."""
        found = libsumo.vehicle.getLeader(EGO, reach)
        if not found or not found[0]:
            return "", math.inf, math.nan
        return found[0], found[1], libsumo.vehicle.getSpeed(found[0])

    def follow_speed(self, speed: float, gap: float, leader: str, leader_speed: float, acceleration: float) -> float:
        """Speed of the ego's car-following model for the next step, at his own `acceleration` (m/s2).

        A driver who was told to launch harder (`release`) still follows and stops as he always does: in the IDM a
        larger acceleration also means to brake later.
        """
        decel = libsumo.vehicle.getDecel(leader)
        with self._own(acceleration):
            return libsumo.vehicle.getFollowSpeed(EGO, speed, gap, leader_speed, decel, leader)

    def stop_speed(self, speed: float, gap: float, acceleration: float) -> float:
        """Speed of the model in front of a place to stop at, `gap` m ahead, at his own `acceleration` (m/s2)."""
        with self._own(acceleration):
            return libsumo.vehicle.getStopSpeed(EGO, speed, max(gap, 0.0))

    @contextmanager
    def _own(self, acceleration: float) -> Iterator[None]:
        if not self.released:
            yield
            return
        libsumo.vehicle.setAccel(EGO, acceleration)
        yield
        libsumo.vehicle.setAccel(EGO, self.released)

    def signal(self) -> tuple[float, str]:
        """Distance (m) and state letter of the next signal within sight; (inf, "")."""
        ahead = libsumo.vehicle.getNextTLS(EGO)
        if not ahead or ahead[0][2] > SIGHT:
            return math.inf, ""
        return ahead[0][2], ahead[0][3]

    def told(self, reach: float) -> tuple[float, tuple[tuple[float, float], ...]]:
        """Distance (m) of the next signal within `reach` m and its green times to come (s from now); (inf, ()).

        For `TOLD_AHEAD` s of its programme, as such signals broadcast it (SPaT, SAE J2735).
        """
        if reach <= 0.0:  # none tells: not worth a call at every step
            return math.inf, ()
        ahead = libsumo.vehicle.getNextTLS(EGO)
        if not ahead or ahead[0][2] > reach:
            return math.inf, ()
        name, link, distance, _ = ahead[0]
        if name not in self._phases:
            running = libsumo.trafficlight.getProgram(name)
            logic = next(p for p in libsumo.trafficlight.getAllProgramLogics(name) if p.programID == running)
            self._phases[name] = [(phase.duration, phase.state) for phase in logic.phases]
        phases = self._phases[name]
        number, start = libsumo.trafficlight.getPhase(name), 0.0
        end = libsumo.trafficlight.getNextSwitch(name) - self.time
        found: list[tuple[float, float]] = []
        while start < TOLD_AHEAD:
            if phases[number][1][link] in "Gg":
                if found and found[-1][1] == start:
                    found[-1] = (found[-1][0], end)
                else:
                    found.append((start, end))
            number = (number + 1) % len(phases)
            start, end = end, end + phases[number][0]
        return distance, tuple(found)

    def may_enter(self, reach: float) -> tuple[bool, float]:
        """Whether the next junction within `reach` m lets the standing ego in, and how far it is."""
        lane = libsumo.vehicle.getLaneID(EGO)
        left = libsumo.lane.getLength(lane) - libsumo.vehicle.getLanePosition(EGO)
        if left > reach or lane.startswith(":"):
            return True, left
        links = libsumo.vehicle.getNextLinks(EGO)
        return (not links or bool(links[0][2])), left

    def state_hash(self) -> int:
        """64 bits over all vehicles' names and positions (x, y: lane changes too; a speed is how far one got)."""
        names = libsumo.vehicle.getIDList()
        places = list(chain.from_iterable(map(libsumo.vehicle.getPosition, names)))
        digest = hashlib.blake2b(struct.pack(f"{len(places)}d", *places), digest_size=8)
        digest.update("".join(names).encode())
        return int.from_bytes(digest.digest(), "little")

    @staticmethod
    def vehicles() -> int:
        """Vehicles in the network."""
        return libsumo.vehicle.getIDCount()

    @staticmethod
    def ego_collided() -> bool:
        """Whether the ego is in a collision that this step registered."""
        return any(EGO in (c.collider, c.victim) for c in libsumo.simulation.getCollisions())

    def release(self, acceleration: float) -> None:
        """Let the ego's model accelerate up to `acceleration` (m/s2) from now on (the advised driver)."""
        self.released = acceleration
        libsumo.vehicle.setAccel(EGO, acceleration)
