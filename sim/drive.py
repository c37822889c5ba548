"""One drive: SUMO carries the traffic, the plant is the car, a driver sits in between; with or without advice."""

import math
import tempfile
import time
from collections import deque
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenarios.effects import EFFECTS
from scenarios.schema import Scenario
from sim.accessories import AccessorySchedule
from sim.advisor import Advisor, Suggestion, View
from sim.demand import EGO_DEPART, demand
from sim.display import Display
from sim.drivers import ADVISED_ACCELERATION, STYLES, Foot, Gearbox, Style, free_acceleration
from sim.network import Network, build
from sim.route import edge_starts, true_route
from sim.signals import programmes
from sim.traffic import PERIOD, Traffic
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator
from vehicle_model.car.route import Route
from vehicle_model.car.trip import Trip
from vehicle_model.plant.session import Plant

OVER_LIMIT = 3.0 / 3.6
"""m/s above the limit that counts as a violation."""
HARSH = 3.5
"""m/s2 of braking that counts as harsh."""
IDLE_BEFORE, IDLE_AFTER = 2.0, 3.0
"""s parked with the engine running before and after the journey."""
BEND_BRAKING = 1.5
"""m/s2 by which he slows down for a bend or a lower limit."""
START = 0.3
"""m/s2: a standing car stays where it is for less."""
CRAWL = 5.0
"""m/s that a driver rolling up to a stop keeps until he must brake."""
SPEEDOMETER = 1.04
"""Displayed over true speed: ECE R39 forbids a dial to show less and allows 10 % + 4 km/h more."""
WALKING = 1.4
"""m/s of closing in below which a time to collision says nothing: rolling up in a queue."""
HELD_UP = 0.3
"""m/s2 less than advised from which traffic, not the advice, sets the gear."""
ALARMING = 1.5
"""m/s2 of needed braking that makes him look up from the display: brake lights in the corner of the eye."""
STOP_SHORT = 1.0
"""m before a signal's line where he stops."""
STOPPING = 3.0
"""m/s2: a light that turns yellow is driven through where stopping would take more. The yellow phases of the network
are as long as that asks for (netconvert's `tls.yellow.min-decel`)."""
HASHED = 3_000
"""Steps after the first advice whose traffic is still hashed: that takes as long as driver and car together."""
LEAST_ROOM = 0.3
"""m to a line below which the braking that is needed is not computed any more."""
WARNED_TIME = 3.5
"""s to collision at which the device of an advised driver warns of the car in front."""
WARNED_BRAKING = 1.2
"""m/s2 by which he then brakes to stay above it, while there is room."""
WARNED_GAIN = 1.5
"""1/s: how soon he is back below the warning."""
WARNED_AT_MOST = 2.5
"""m/s2 that a warning asks for; what is more urgent than that he sees himself."""


@dataclass(frozen=True)
class Compliance:
    """What became of the advice, measured; all nan in a drive without any."""

    followed_share: float
    """Share of the time with advice in which it, and neither refusal nor traffic, set what was done."""
    refused_share: float
    """Share of the time with advice in which he did as he liked."""
    missed_rms: float
    """m/s2 between advised and true acceleration while it was followed, gear changes included."""
    changes_per_minute: float
    """How often arrow (up, hold, down) or gear of the display change: what there is to look at. See 5.1.3."""
    eyes_off_road_share: float = math.nan
    """Share of the time with advice in which he looks at the display, his foot as it was."""


@dataclass(frozen=True)
class Drive:
    """A drive and what it took."""

    trip: Trip
    route: Route
    vehicles: float
    """Mean number of vehicles in the network while the ego drove."""
    step_hashes: tuple[int, ...]
    """One per step of SUMO over all vehicles: equal hashes, equal traffic. Up to `HASHED` steps after the first
    advice: what it changed is no longer compared."""
    first_advice_step: int | None
    """Step at which advice first reached the driver."""
    advised_share: float
    """Share of the steps in which advice, not traffic or refusal, set the wish."""
    costate: NDArray[np.float64]
    """Costate shown at each step (J per m/s, nan where none was)."""
    min_time_to_collision: float
    """s: bumper to bumper over the speed of closing in, the least over all steps with a leader in sight who is being
    caught up with by more than walking pace (1.4 m/s); inf where there were none."""
    limit_violations: int
    """Times the limit was exceeded by more than 3 km/h."""
    harsh_braking: int
    """Times it was braked harder than 3.5 m/s2."""
    parked_s: float
    """s at rest before setting out and after arriving: not part of the trip's time."""
    arrived: bool
    collisions: int
    red_lights_run: int
    simulated_s: float
    """s that SUMO simulated."""
    wall_s: float
    """s that it took."""
    notes: tuple[str, ...] = ()
    compliance: Compliance = Compliance(math.nan, math.nan, math.nan, math.nan)
    owed_fuel: float = 0.0
    """J that accessories which were scheduled still cost after the trip; to be added to its fuel."""


@dataclass
class _Tally:
    """What is counted during a drive."""

    steps: int = 0
    hashes: list[int] = field(default_factory=list)
    costates: list[float] = field(default_factory=list)
    vehicles: int = 0
    advised: int = 0
    told: int = 0
    refused: int = 0
    missed: float = 0.0
    looking: int = 0
    first_advice: int | None = None
    min_ttc: float = math.inf
    over: bool = False
    violations: int = 0
    harsh: bool = False
    harsh_times: int = 0
    collisions: int = 0
    red_run: int = 0


def drive(
    scenario: Scenario,
    car: Car,
    seed: int,
    *,
    advisor: Advisor | None = None,
    network: Network | None = None,
    perfect: bool = False,
    schedule_accessories: bool = False,
) -> Drive:
    """Drive the scenario's route once in its traffic and return what happened.

    `advisor` None: the baseline driver alone. `perfect`: the driver follows advice at once and exactly (the oracle's).
    `schedule_accessories`: alternator and air conditioning run where fuel is cheap (`sim.accessories`).
    The network is built in a temporary folder unless one is given. Same scenario, car and seed: same bits; with an
    advisor, the same bits until its first advice. One libsumo per process: call it in a process of its own to run
    two at once. Raises BadInput (scenario), MirrorError (plant and SUMO disagree: a defect, never data).
    """
    if advisor is not None:
        advisor.reset()
    steps = journey(scenario, car, seed, network=network, perfect=perfect, schedule_accessories=schedule_accessories)
    suggestion: Suggestion | None = None
    try:
        while True:
            view, _ = steps.send(suggestion) if suggestion is not None else next(steps)
            suggestion = advisor.advise(view) if advisor is not None else None
    except StopIteration as end:
        return end.value


def journey(
    scenario: Scenario,
    car: Car,
    seed: int,
    *,
    network: Network | None = None,
    perfect: bool = False,
    schedule_accessories: bool = False,
) -> Generator[tuple[View, Plant], Suggestion | None, Drive]:
    """Drive step by step: yields what the dashboard shows (and the plant, for whoever keeps the score), takes a
    suggestion or None, and returns the `Drive`. Between setting out and arriving only; see `drive`.
    """
    with tempfile.TemporaryDirectory() as folder:
        if network is None:
            network = build(scenario, Path(folder))
        settings = _own_settings(scenario)
        density = settings["traffic_actuation.density_factor"]
        if density != 1.0:
            vehicles = round(scenario.traffic.vehicles * density)
            scenario = scenario.model_copy(
                update={"traffic": scenario.traffic.model_copy(update={"vehicles": vehicles})}
            )
        style = STYLES[scenario.driver.kind]
        route = true_route(network)
        horizon = EGO_DEPART + 600.0 + 4.0 * float((1.0 / route.speed_limit).sum())
        routes = Path(folder) / "demand.rou.xml"
        routes.write_text(demand(scenario, network, seed, _ego_type(style), horizon))
        signals = Path(folder) / "signals.add.xml"
        signals.write_text(programmes(network, seed))
        traffic = Traffic(network, routes, seed, signals)
        run = _run(
            scenario, car, seed, network, perfect, style, route, horizon, traffic, settings, schedule_accessories
        )
        return (yield from run)


def _own_settings(scenario: Scenario) -> dict[str, float]:
    neutral = {f"{effect.id}.{part.name}": part.neutral for effect in EFFECTS for part in effect.parameters}
    return neutral | {key: value for key, value in scenario.effects.items() if key in neutral}


def _ego_type(style: Style) -> str:
    # The models' own noise is off: SUMO plans at most what it was told; noise would only ever slow the ego down.
    # Krauss's dawdling is the driver's (`Style.dawdling`) instead.
    noiseless = {"Krauss": 'sigma="0"', "EIDM": 'sigmaleader="0" sigmagap="0" sigmaerror="0"'}.get(style.model, "")
    return (
        f'<vType id="ego" length="2.5" minGap="2.0" maxSpeed="60" speedFactor="1.0" speedDev="0" '
        f'carFollowModel="{style.model}" accel="{style.acceleration:g}" decel="{style.deceleration:g}" '
        f'emergencyDecel="8" tau="{style.headway:g}" timeToTeleport="-1" {noiseless}/>'
    )


def speed_cap(route: Route, lateral_comfort: float, braking: float = BEND_BRAKING) -> NDArray[np.float64]:
    """Speed (m/s) over `route.s` that limits and bends ahead allow, slowing down in time by `braking` (m/s2)."""
    bend = np.sqrt(lateral_comfort / np.maximum(np.abs(route.straightness), 1e-6))
    square = np.minimum(route.speed_limit, bend) ** 2
    gained = 2.0 * braking * (route.s[1] - route.s[0])
    for i in range(len(square) - 2, -1, -1):
        square[i] = min(square[i], square[i + 1] + gained)
    return np.sqrt(square)


def _run(
    scenario: Scenario,
    car: Car,
    seed: int,
    network: Network,
    perfect: bool,
    style: Style,
    route: Route,
    horizon: float,
    simulation: Traffic,
    settings: dict[str, float],
    schedule_accessories: bool,
) -> Generator[tuple[View, Plant], Suggestion | None, Drive]:
    began = time.perf_counter()
    plant = Plant(car, route, scenario.effects, 0.0, 0)
    accessories = AccessorySchedule(plant, car, scenario.effects) if schedule_accessories else None
    driver = scenario.driver
    foot = Foot(car, driver.reaction_time, driver.pedal_step, PERIOD)
    gearbox = Gearbox(car, style, plant)
    obedience = _Obedience(scenario, seed, settings, perfect)
    display = None if perfect else Display(PERIOD)
    glance = 0.0 if perfect else driver.glance
    look_until, seen = -math.inf, 0
    before = 0.0, False
    cap = speed_cap(route, driver.lateral_comfort)
    # A driver holds the limit on the dial; advice comes from a device that knows the true speed.
    own_cap = speed_cap(replace(route, speed_limit=route.speed_limit / SPEEDOMETER), driver.lateral_comfort)
    limit = route.speed_limit
    destination = float(edge_starts(network)[0][-1] + network.arrival)
    tally = _Tally()
    dawdling = generator(seed, "driver")
    arrived_at: float | None = None
    force = 0.0
    with simulation as traffic:
        if not traffic.begin(EGO_DEPART + 120.0):
            raise BadInput(scenario.source or scenario.name, "traffic.vehicles", "so many that the ego finds no place")
        signal_before: tuple[float, str] = (math.inf, "")
        stopping = False
        while traffic.time < horizon:
            now = plant.time
            speed, place = plant.speed, plant.distance
            name, gap, leader_speed = traffic.leader(60.0 + speed * (speed / 3.0 + 2.0))
            light, state = traffic.signal()
            index = min(int(place + 0.5), len(cap) - 1)
            left = destination - place
            stopping = _must_stop(state, light, speed, stopping and light <= signal_before[0] + 1.0)
            wish = _safe_wish(traffic, style, speed, name, gap, leader_speed, light if stopping else math.inf, left)
            wanted = free_acceleration(style, speed, float(own_cap[min(index + int(0.5 * speed), len(cap) - 1)]))
            wanted = min(wanted, (float(own_cap[index]) - speed) / 0.5 if speed > cap[index] else math.inf)
            if style.dawdling and wanted > 0.0:
                wanted -= style.dawdling * style.acceleration * dawdling.random()
            advised_gear, coast, followed = 0, False, False
            suggestion: Suggestion | None = None
            if now >= IDLE_BEFORE and arrived_at is None:
                broadcast = traffic.told(scenario.traffic.signals_tell)
                view = View(now, place, speed, plant.gear, gap, leader_speed, light, _colour(state), left, *broadcast)
                told = yield view, plant
                if display is not None:
                    told = display.show(told)
                    if display.changes > seen:
                        look_until, seen = now + glance, display.changes
                suggestion = obedience.hear(told)
                if told is not None:
                    # From here on the two drives may differ: a display that is lit is looked at.
                    if tally.first_advice is None:
                        tally.first_advice = tally.steps
                    tally.told += 1
                    tally.refused += obedience.refusing
                    tally.looking += now < look_until
            if tally.first_advice is not None:
                wish = min(wish, _warned(speed, gap, leader_speed))
            if suggestion is not None:
                if not traffic.released:
                    traffic.release(ADVISED_ACCELERATION)
                coast = suggestion.coast
                if speed <= cap[index] and not suggestion.free:
                    missed = obedience.miss(suggestion.acceleration)
                    wanted = suggestion.acceleration if suggestion.automatic else missed
                followed = wanted < wish and not suggestion.free
                # The gear belongs to the acceleration: where traffic allows clearly less, he picks his own.
                advised_gear = suggestion.gear if wish > wanted - HELD_UP else 0
                tally.advised += followed
            elif style.coasts_before_stop and _stop_ahead(stopping, light, left, gap, leader_speed, style):
                coast = speed > CRAWL + 0.3
                wanted = min(wanted, (CRAWL - speed) / 1.5) if not coast else wanted
            if coast:
                wanted = min(wanted, 0.0)
            wish = min(wish, wanted)
            if now < look_until and wish > -ALARMING and speed <= cap[index]:
                wish, coast = before
            before = wish, coast
            if now < IDLE_BEFORE or (speed < 0.05 and wish < START):
                wish = -1.0
            force = foot.force(wish, plant, coast=coast)
            gear = gearbox.gear(plant, force, wish, PERIOD, advised_gear)
            if accessories is not None:
                accessories.switch(PERIOD, force)
            plant.advance(force, gear, PERIOD)
            traffic.step(plant.distance)
            if followed and suggestion is not None:
                tally.missed += (plant.acceleration - suggestion.acceleration) ** 2
            tally.costates.append(suggestion.costate if suggestion else math.nan)
            _count(tally, traffic, plant, float(limit[index]), gap, leader_speed, signal_before)
            signal_before = (light - (plant.distance - place), state)
            if arrived_at is None and left < 8.0 and plant.speed < 0.05:
                arrived_at = plant.time
            if arrived_at is not None and plant.time >= arrived_at + IDLE_AFTER:
                break
        simulated = traffic.time
    return Drive(
        trip=plant.trip(),
        route=route,
        vehicles=tally.vehicles / max(tally.steps, 1),
        step_hashes=tuple(tally.hashes),
        first_advice_step=tally.first_advice,
        advised_share=tally.advised / max(tally.steps, 1),
        costate=np.array(tally.costates),
        min_time_to_collision=tally.min_ttc,
        limit_violations=tally.violations,
        harsh_braking=tally.harsh_times,
        parked_s=IDLE_BEFORE + (plant.time - arrived_at if arrived_at is not None else 0.0),
        arrived=arrived_at is not None,
        collisions=tally.collisions,
        red_lights_run=tally.red_run,
        simulated_s=simulated,
        wall_s=time.perf_counter() - began,
        notes=network.notes,
        compliance=_compliance(tally, display),
        owed_fuel=0.0 if accessories is None else accessories.owed_fuel(),
    )


def _compliance(tally: _Tally, display: Display | None) -> Compliance:
    if not tally.told:
        return Drive.compliance
    return Compliance(
        followed_share=tally.advised / tally.told,
        refused_share=tally.refused / tally.told,
        missed_rms=math.sqrt(tally.missed / tally.advised) if tally.advised else math.nan,
        changes_per_minute=display.changes / (tally.told * PERIOD / 60.0) if display is not None else math.nan,
        eyes_off_road_share=tally.looking / tally.told,
    )


def _must_stop(state: str, distance: float, speed: float, stopping: bool) -> bool:
    """Whether the signal asks to stop: red, or yellow that can be obeyed or that he is `stopping` for."""
    if state in ("r", "u"):
        return True
    return state in ("y", "Y") and (stopping or speed**2 / (2.0 * STOPPING) < distance - STOP_SHORT)


def _colour(state: str) -> str:
    if not state:
        return ""
    return "red" if state in "ru" else "yellow" if state in "yY" else "green"


def _safe_wish(
    traffic: Traffic, style: Style, speed: float, leader: str, gap: float, leader_speed: float, stop: float, left: float
) -> float:
    """The acceleration (m/s2) that SUMO's model and the junctions ahead allow at most."""
    allowed = math.inf
    if leader:
        # Also told to launch harder he follows as he always does: whoever closes up harder brakes more.
        follow = traffic.follow_speed(speed, gap, leader, leader_speed, style.acceleration)
        allowed = (follow - speed) / PERIOD
    planned = traffic.planned_acceleration()
    if stop < math.inf:
        # The model brakes ever harder than needed where a place to stop appears late: a person brakes evenly.
        needed = -(speed**2) / (2.0 * max(stop - STOP_SHORT, LEAST_ROOM))
        evenly = min(needed, -style.deceleration)
        modelled = (traffic.stop_speed(speed, stop - STOP_SHORT, style.acceleration) - speed) / PERIOD
        allowed = min(allowed, max(modelled, evenly))
        planned = max(planned, evenly)  # SUMO's own plan, at the same line
    if left < 30.0 + speed * speed / (2.0 * 1.0):
        allowed = min(allowed, _halt(speed, left - 1.5))
    if speed < 1.5:
        may, gap_to_line = traffic.may_enter(8.0)
        if not may:
            allowed = min(allowed, _halt(speed, gap_to_line - STOP_SHORT))
    return min(allowed, planned)


def _warned(speed: float, gap: float, leader_speed: float) -> float:
    """Acceleration (m/s2) that heeds the device's warning of the car in front; inf where there is nothing to warn of.

    Closing in is allowed by what constant braking takes back, and near the car by `WARNED_TIME`: the parabola
    c^2 = 2 b (d - d0) and the line c = d / tau touch at d = 2 d0, d0 = b tau^2 / 2. A beep needs no look at the
    display: it is heeded at once, whatever becomes of the other advice.
    """
    if not gap < math.inf:
        return math.inf
    room = max(gap, 0.0) + 2.0
    reserve = 0.5 * WARNED_BRAKING * WARNED_TIME**2
    if room < 2.0 * reserve:
        closing = room / WARNED_TIME
        braking = closing / WARNED_TIME
    else:
        closing = math.sqrt(2.0 * WARNED_BRAKING * (room - reserve))
        braking = WARNED_BRAKING
    asked = WARNED_GAIN * (leader_speed + max(closing, WALKING) - speed) - braking
    return max(asked, -WARNED_AT_MOST)


def _halt(speed: float, room: float) -> float:
    """Acceleration that brings the car to rest within `room` m, gently at the end."""
    if room <= 0.2:
        return -1.5 if speed > 0.0 else -0.5
    # Roll up to the place at a walking pace rather than stopping short of it.
    target = math.sqrt(2.0 * 1.0 * room)
    return min((target - speed) / 0.6, 1.0)


def _stop_ahead(stopping: bool, light: float, left: float, gap: float, leader_speed: float, style: Style) -> bool:
    """Whether a stop lies within the distance from which this driver rolls."""
    reach = style.coasts_before_stop
    return (stopping and light < reach) or left < reach or (gap < reach and leader_speed < 0.5)


def _count(
    tally: _Tally,
    traffic: Traffic,
    plant: Plant,
    limit: float,
    gap: float,
    leader_speed: float,
    signal_before: tuple[float, str],
) -> None:
    if tally.first_advice is None or tally.steps < tally.first_advice + HASHED:
        tally.hashes.append(traffic.state_hash())
    tally.steps += 1
    tally.vehicles += traffic.vehicles()
    closing = plant.speed - leader_speed
    if gap < math.inf and closing > WALKING:
        tally.min_ttc = min(tally.min_ttc, (gap + 2.0) / closing)
    over = plant.speed > limit + OVER_LIMIT
    tally.violations += over and not tally.over
    tally.over = over
    harsh = plant.acceleration < -HARSH
    tally.harsh_times += harsh and not tally.harsh
    tally.harsh = harsh
    tally.collisions += traffic.ego_collided()
    distance, state = signal_before
    tally.red_run += state in ("r", "u") and distance < -0.5 and plant.speed > 0.5


class _Obedience:
    """How well advice is followed: heard late, missed a little, sometimes ignored; what is automatic only ignored."""

    def __init__(self, scenario: Scenario, seed: int, settings: dict[str, float], perfect: bool) -> None:
        driver = scenario.driver
        self._rng = generator(seed, "obedience")
        delay = 0.0 if perfect else driver.advice_delay + settings["driver_lag.extra_delay"]
        self._late: deque[Suggestion | None] = deque([None] * round(delay / PERIOD))
        self._error = 0.0 if perfect else driver.tracking_error
        refusal = 0.0 if perfect else max(driver.refusal, settings["driver_lag.ignored"])
        self._gain = 1.0 if perfect else settings["driver_lag.gain"]
        # Refusal comes in spells of 12 s on average.
        self._end_spell = PERIOD / 12.0
        self._begin_spell = self._end_spell * refusal / max(1.0 - refusal, 1e-9)
        self.refusing = False
        self._miss = 0.0
        self._last = 0.0

    def hear(self, suggestion: Suggestion | None) -> Suggestion | None:
        """Return the suggestion that he acts upon now, None if he does as he likes."""
        self._late.append(suggestion)
        heard = self._late.popleft()
        chance = self._rng.random()
        self.refusing = chance >= self._end_spell if self.refusing else chance < self._begin_spell
        if suggestion is not None and suggestion.automatic:
            heard = suggestion
        return None if self.refusing else heard

    def miss(self, acceleration: float) -> float:
        """Return what he makes of an advised acceleration (m/s2): correlated error over 2 s."""
        keep = math.exp(-PERIOD / 2.0)
        self._miss = keep * self._miss + math.sqrt(1.0 - keep * keep) * self._error * self._rng.standard_normal()
        return self._gain * acceleration + self._miss
