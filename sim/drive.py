"""One drive: SUMO carries the traffic, the plant is the car, a driver sits in between; with or without advice."""

import math
import tempfile
import time
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

import numpy as np

from scenarios.effects import EFFECTS
from scenarios.schema import Scenario
from sim.accessories import AccessorySchedule
from sim.advisor import Advisor, Suggestion, View
from sim.caution import SPEEDOMETER, must_stop, safe_wish, speed_cap, stop_ahead, warned
from sim.demand import EGO_DEPART, demand
from sim.display import Display
from sim.drive_record import Drive, Tally, complied, count_step
from sim.drivers import ADVISED_ACCELERATION, STYLES, Foot, Gearbox, Style, free_acceleration
from sim.network import Network, build
from sim.obedience import Obedience
from sim.route import edge_starts, true_route
from sim.signals import programmes
from sim.traffic import PERIOD, Traffic
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator
from vehicle_model.car.route import Route
from vehicle_model.plant.session import Plant

IDLE_BEFORE, IDLE_AFTER = 2.0, 3.0
"""s parked with the engine running before and after the journey."""
START = 0.3
"""m/s2: a standing car stays where it is for less."""
CRAWL = 5.0
"""m/s that a driver rolling up to a stop keeps until he must brake."""
HELD_UP = 0.3
"""m/s2 less than advised from which traffic, not the advice, sets the gear."""
ALARMING = 1.5
"""m/s2 of needed braking that makes him look up from the display: brake lights in the corner of the eye."""


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
    looks = f'treaction="{PERIOD:g}"' if style.looks_at_every_step else ""
    return (
        f'<vType id="ego" length="2.5" minGap="2.0" maxSpeed="60" speedFactor="1.0" speedDev="0" '
        f'carFollowModel="{style.model}" accel="{style.acceleration:g}" decel="{style.deceleration:g}" '
        f'emergencyDecel="8" tau="{style.headway:g}" timeToTeleport="-1" {noiseless} {looks}/>'
    )


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
    obedience = Obedience(scenario, seed, settings, perfect)
    display = None if perfect else Display(PERIOD)
    glance = 0.0 if perfect else driver.glance
    look_until, seen = -math.inf, 0
    before = 0.0, False
    cap = speed_cap(route, driver.lateral_comfort)
    # A driver holds the limit on the dial; advice comes from a device that knows the true speed.
    own_cap = speed_cap(replace(route, speed_limit=route.speed_limit / SPEEDOMETER), driver.lateral_comfort)
    limit = route.speed_limit
    destination = float(edge_starts(network)[0][-1] + network.arrival)
    tally = Tally()
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
            stopping = must_stop(state, light, speed, stopping and light <= signal_before[0] + 1.0)
            wish = safe_wish(traffic, style, speed, name, gap, leader_speed, light if stopping else math.inf, left)
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
                wish = min(wish, warned(speed, gap, leader_speed))
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
            elif style.coasts_before_stop and stop_ahead(stopping, light, left, gap, leader_speed, style):
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
            count_step(tally, traffic, plant, float(limit[index]), gap, leader_speed, signal_before)
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
        compliance=complied(tally, display),
        owed_fuel=0.0 if accessories is None else accessories.owed_fuel(),
    )


def _colour(state: str) -> str:
    if not state:
        return ""
    return "red" if state in "ru" else "yellow" if state in "yY" else "green"
