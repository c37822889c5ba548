"""Drivers: what they want beyond what traffic allows, how their foot does it, when they shift."""

from collections import deque
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vehicle_model.car.parameters import Car
from vehicle_model.plant import steady
from vehicle_model.plant.session import Plant

RPM = 2.0 * np.pi / 60.0


@dataclass(frozen=True)
class Style:
    """A baseline driver. Frozen before any advice is measured against him."""

    model: str
    """SUMO's car-following model that sets what he wants."""
    acceleration: float
    """m/s2, at most."""
    deceleration: float
    """m/s2, comfortable."""
    headway: float
    """s."""
    upshift: float
    """Engine speed (share of the way from idle to redline) at which he shifts up under light load."""
    downshift: float
    dawdling: float = 0.0
    """Share of his acceleration that Krauss's driver drops at random."""
    cheapest_gear: bool = False
    """Picks the gear that burns least for the power he needs, on the true map."""
    coasts_before_stop: float = 0.0
    """m before a stop in sight from which he lets the car roll in gear."""
    looks_at_every_step: bool = False
    """SUMO's model looks at the road at each step and not at action points of its own (the EIDM's, every 0.5 s). In
    between it reckons with the acceleration that *it* wanted, which a car driven by a foot and an engine does not
    have."""


STYLES: dict[str, Style] = {
    "eidm": Style("EIDM", 2.0, 2.5, 1.2, 0.40, 0.16),
    "alert": Style("EIDM", 2.0, 2.5, 1.2, 0.40, 0.16, looks_at_every_step=True),
    "krauss": Style("Krauss", 2.0, 2.5, 1.2, 0.40, 0.16, dawdling=0.5),
    "soft": Style("IDM", 1.0, 1.5, 1.6, 0.28, 0.12),
    "brisk": Style("IDM", 2.6, 3.0, 1.0, 0.62, 0.26),
    "good": Style("IDM", 1.5, 2.0, 1.3, 0.30, 0.12, cheapest_gear=True, coasts_before_stop=150.0),
}
OUT_OF_REACH = 1e7
"""W: cost of a gear that does not give the force; the less it gives, the more."""
SPEED_NODE, FORCE_NODE = 1.0, 100.0
"""m/s and N between the nodes of the table of gears."""
FULL, RESERVE = 0.95, 0.80
"""Share of full load up to which `good` stays in a gear, and up to which he changes into one."""
ADVISED_ACCELERATION = 3.0
"""m/s2 that an advised driver may ask for: his plan limits it, not his habit."""


def free_acceleration(style: Style, speed: float, wanted: float) -> float:
    """What he would do on an empty road, m/s2: launch at his acceleration, close in on `wanted` (m/s) within 2 s."""
    return min(max((wanted - speed) / 2.0, -style.deceleration), style.acceleration)


class Foot:
    """Turns a wished acceleration into a wheel force: with the car's weight in his feel, late, in steps of the pedal.

    Reaction time delays what he wishes *more* of; lifting off and braking are not delayed, since SUMO's safe speed
    presumes an attentive driver.
    """

    LOAD_LAG = 0.4
    """s: he feels the road's pull through the seat, not at once."""
    BACK = -0.5
    """Times the overrun force (negative): the push that brings a lifted foot back on the pedal."""

    def __init__(self, car: Car, reaction_time: float, pedal_step: float, period: float) -> None:
        self._mass = car.accelerated_mass
        self._inertia = car.engine.inertia / car.wheel_radius**2
        self._ratios = (0.0, *car.gear_ratios)
        self._late: deque[float] = deque([0.0] * max(round(reaction_time / period), 0))
        self._step = pedal_step
        self._gain = period / self.LOAD_LAG
        self._load = 0.0
        self._pedal = 0.0
        self._lifted = False

    def force(self, wish: float, plant: Plant, *, coast: bool = False) -> float:
        """Return the force wanted at the wheels (N) for `wish` (m/s2); `coast`: foot off, only the brake may help."""
        self._late.append(wish)
        acceleration = min(wish, self._late.popleft())
        self._load += self._gain * (plant.road_load - self._load)
        mass = self._mass + self._inertia * self._ratios[plant.gear] ** 2
        force = mass * acceleration + self._load
        overrun = plant.overrun_force()
        # Who wants about what the engine's drag gives takes his foot off: the fuel is cut. It comes back only for a
        # push, not for a little less drag: else foot and drag chase each other.
        if coast or 1.25 * overrun < force < (self.BACK * overrun if self._lifted else 0.5 * overrun):
            self._pedal, self._lifted = 0.0, True
            return min(force, overrun) if coast else overrun
        self._lifted = force <= overrun
        if force <= 0.0 or self._step == 0.0:
            self._pedal = 0.0
            return force
        full = max(plant.force_available(), 500.0)
        wanted = min(force / full, 1.0)
        # The pedal moves when it is wrong by more than its step: a foot rests.
        if abs(wanted - self._pedal) > self._step:
            self._pedal = self._step * round(wanted / self._step)
        return self._pedal * full


class Gearbox:
    """Which gear he wants: by engine speed, or the cheapest for the power."""

    DWELL = 1.2
    """s between two shifts, unless the engine asks for one."""
    WORTH = 0.03
    """Relative saving of fuel below which `good` does not bother to shift."""

    def __init__(self, car: Car, style: Style, plant: Plant) -> None:
        engine = car.engine
        span = engine.redline_speed - engine.idle_speed
        self._ratios = np.array([0.0, *car.gear_ratios]) / car.wheel_radius
        self._low = engine.idle_speed + style.downshift * span
        self._high = engine.idle_speed + style.upshift * span
        self._floor = max(1.15 * engine.idle_speed, 1_150.0 * RPM)
        self._ceiling = 0.92 * engine.redline_speed
        self._table = cheapest_gears(plant) if style.cheapest_gear else None
        self._since = np.inf

    def gear(self, plant: Plant, force: float, wish: float, period: float, advised: int = 0) -> int:
        """Return the gear to be engaged: `advised` where the engine can (0: his own choice)."""
        self._since += period
        speed, gear = plant.speed, plant.gear
        top = len(self._ratios) - 1
        if speed < 1.5:
            # Neutral at standstill; first to move off.
            return 1 if wish > 0.05 or (gear == 1 and speed > 0.3) else 0
        if plant.shifting:
            return self._wanted(gear)
        turning = self._ratios * speed
        lowest = 1 if gear <= 1 else 2
        # The gear that is in may turn a little lower before it is given up.
        floors = [self._floor * (0.9 if g == gear else 1.0) for g in range(top + 1)]
        possible = [g for g in range(lowest, top + 1) if floors[g] <= turning[g] <= self._ceiling] or [
            lowest if turning[lowest] < self._floor else top
        ]
        current = gear if gear in possible else None
        if advised:
            choice = min(possible, key=lambda g: abs(g - advised))
        elif self._table is not None:
            choice = self._cheapest(speed, force, possible, current)
        else:
            choice = self._by_speed(turning, possible, current, plant, force)
        if current is not None and choice != current and self._since < self.DWELL:
            choice = current
        if choice != gear:
            self._since = 0.0
        self._target = choice
        return choice

    _target: int = 0

    def _wanted(self, gear: int) -> int:
        return self._target or gear

    def _by_speed(
        self, turning: NDArray[np.float64], possible: list[int], current: int | None, plant: Plant, force: float
    ) -> int:
        if current is None:
            middle = 0.5 * (self._low + self._high)
            return min(possible, key=lambda g: abs(turning[g] - middle))
        demand = force / max(plant.force_available(), 1.0)
        # Under load he lets it rev: up to a third more of the thresholds.
        late = 1.0 + 0.5 * float(np.clip(demand - 0.5, 0.0, 0.5)) * 2.0
        if turning[current] > self._high * late and current + 1 in possible:
            return current + 1
        if (turning[current] < self._low or demand > 0.97) and current - 1 in possible:
            lower = turning[current - 1]
            if lower < 0.8 * self._ceiling and (turning[current] < self._low or lower < self._high * 2.0):
                return current - 1
        return current

    def _cheapest(self, speed: float, force: float, possible: list[int], current: int | None) -> int:
        assert self._table is not None
        costs, load = self._table.at(speed, force)
        # A gear that is in may be used to the full; one to change into must have something in reserve.
        costs = np.where(
            load > [FULL if g == current else RESERVE for g in range(len(load))], OUT_OF_REACH + load, costs
        )
        best = min(possible, key=lambda g: costs[g])
        if current is not None and costs[current] < min((1.0 + self.WORTH) * costs[best], OUT_OF_REACH):
            return current
        return best


@dataclass(frozen=True)
class GearTable:
    """Fuel power (W) and load (share of full load) of every gear over speed and wheel force."""

    speed: NDArray[np.float64]
    force: NDArray[np.float64]
    cost: NDArray[np.float64]
    """(speeds, forces, gears + 1); gear 0 is never chosen."""
    load: NDArray[np.float64]
    """(speeds, forces, gears + 1)."""

    def at(self, speed: float, force: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Cost and load of each gear at the nearest node, (gears + 1,) each."""
        i = min(max(round(speed / SPEED_NODE) - 1, 0), len(self.speed) - 1)
        j = min(max(round(force / FORCE_NODE), 0), len(self.force) - 1)
        return self.cost[i, j], self.load[i, j]


def cheapest_gears(plant: Plant) -> GearTable:
    """Tabulate what each gear burns on the *true* map: the baseline `good` knows his car perfectly."""
    car = plant.car
    return _gear_table(plant.parameters.tobytes(), car.gear_ratios, car.wheel_radius, car.engine.redline_speed)


@lru_cache(maxsize=8)
def _gear_table(parameters: bytes, ratios: tuple[float, ...], radius: float, redline: float) -> GearTable:
    p = np.frombuffer(parameters)
    speed = SPEED_NODE * np.arange(1.0, 56.0)
    force = FORCE_NODE * np.arange(0.0, 51.0)
    cost = np.full((len(speed), len(force), len(ratios) + 1), OUT_OF_REACH)
    load = np.full(cost.shape, 99.0)
    for gear, ratio in enumerate(ratios, start=1):
        turning = speed * ratio / radius
        torque = np.outer(speed / turning, force)
        full = np.maximum(steady.full_load(p, gear, turning), 1.0)
        load[:, :, gear] = np.where(turning[:, None] <= redline, torque / full[:, None], 99.0)
        cost[:, :, gear] = steady.fuel_power(p, gear, turning[:, None], torque)
    return GearTable(speed, force, cost, load)
