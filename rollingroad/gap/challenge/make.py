"""Make a blind set: cases as folders, the key sealed by a salted hash that is written before any log.

DIR/manifest.json            seed, cases, what each case hides from the catalogue, sha256 of the key
DIR/key/key.json, salt       the key, and the salt of its hash; readable by the owner alone; only `score` opens them
DIR/case_000/car.xml, road.osm, reference/*.dat, logs/*.dat
"""

import hashlib
import json
import os
import secrets
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rollingroad.gap.challenge import box, cars, effects, limits, routes, truth
from rollingroad.gap.challenge.effects import BY_ID, EFFECTS, HIDEABLE, NOVEL, Effect, Settings
from vehicle_model.car.errors import BadInput
from vehicle_model.car.randomness import generator

KINDS = {
    "gap_free": 0.34, "single": 0.20, "sensor": 0.10, "other_way": 0.06, "hidden": 0.16, "pair": 0.06,
    "confusable": 0.05,
    "traffic": 0.03,
}  # fmt: skip
"""Kinds of case and their shares."""
STRENGTHS, STRENGTH_SHARES = (0.5, 1.0, 2.0, 4.0), (0.15, 0.15, 0.50, 0.20)
HEAT = 745.0 * 43e6
"""J/m3 of the declared fuel."""


@dataclass(frozen=True)
class Part:
    """One effect of a case."""

    effect: str
    size: float
    limit: float
    strength: float
    other: bool
    seed: int


@dataclass(frozen=True)
class Key:
    """What is true of one case."""

    case: str
    kind: str
    parts: tuple[Part, ...]
    hidden: bool
    regimes: dict[str, float] = field(default_factory=dict)
    """Where the (single) effect is loud: shares of its signal."""
    early: float = 0.0
    """Share of its signal in the first ten minutes of each trip."""


@dataclass(frozen=True)
class Plan:
    """Everything that the logs of one case are made from."""

    key: Key
    hide: tuple[str, ...]
    seed: int
    references: int
    logs: int
    straight: bool
    traffic: bool


def make(cases: int, seed: int, out: Path, *, workers: int = 2) -> dict[str, Any]:
    """Make `cases` cases under `seed` in the folder `out`; return the manifest. Raises BadInput for a folder in use."""
    if out.exists() and any(out.iterdir()):
        raise BadInput(out, "", "a new or empty folder")
    if cases < 1:
        raise BadInput("--cases", str(cases), "at least 1")
    out.mkdir(parents=True, exist_ok=True)
    kinds = _kinds(cases, generator(seed, "kinds"))
    with ProcessPoolExecutor(workers) as pool:
        plans = list(pool.map(_plan, range(cases), kinds, [seed] * cases, chunksize=4))
        salt = secrets.token_hex(32)
        body = json.dumps([asdict(plan.key) for plan in plans], sort_keys=True)
        manifest = {
            "seed": seed,
            "cases": [{"case": plan.key.case, "hide": list(plan.hide)} for plan in plans],
            "key_sha256": hashlib.sha256((salt + body).encode()).hexdigest(),
        }
        (out / "manifest.json").write_text(json.dumps(manifest, indent=1))
        _seal(out / "key", body, salt)
        list(pool.map(_write, plans, [out] * cases, chunksize=2))
    return manifest


def _seal(folder: Path, body: str, salt: str) -> None:
    """The key, and apart from it the salt that its committed hash needs: for their owner's eyes only.

    The salt comes from the system and not from the seed, so that the hash in the manifest cannot be tried against
    guesses of the key. Who holds the seed can make the set again, key and all: keep the seed of a set for others.
    """
    folder.mkdir(mode=0o700)
    for name, text in (("key.json", body), ("salt", salt)):
        with os.fdopen(os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o400), "w") as file:
            file.write(text)


def _kinds(cases: int, rng: np.random.Generator) -> list[str]:
    """Kinds in their shares (largest remainders), in random order."""
    names = list(KINDS)
    ideal = np.array([KINDS[n] for n in names]) * cases
    count = np.floor(ideal).astype(int)
    for i in np.argsort(-(ideal - count))[: cases - int(count.sum())]:
        count[i] += 1
    return [str(k) for k in rng.permutation(np.repeat(names, count))]


def _car(seed: int) -> cars.Car:
    return cars.draw(generator(seed, "car"))


def _road(plan_seed: int, role: str, number: int, straight: bool, traffic: bool) -> truth.Road:
    rng = generator(plan_seed, f"road {role} {number}")
    shares = rng.dirichlet([2.0, 2.0, 1.6])
    if traffic:
        shares = np.array([0.8, 0.15, 0.05])
    mix = dict(zip(("town", "rural", "motorway"), shares, strict=True))
    return routes.draw(rng, rng.uniform(8000, 14000), mix, straight=straight, hills=rng.uniform(0.5, 1.2))


def _drive(plan_seed: int, role: str, number: int, car: cars.Car, road: truth.Road, settings: Settings, traffic: bool):
    """One drive: its driver, its weather inside the tolerance, and the effects on top."""
    rng = generator(plan_seed, f"drive {role} {number}")
    driver = {
        "accel": rng.uniform(1.1, 2.1), "decel": rng.uniform(1.0, 1.6), "up_rpm": rng.uniform(2300, 3300),
        "down_rpm": rng.uniform(1350, 1750), "speed_factor": rng.uniform(0.9, 1.06), "shift_time": rng.uniform(0.35,
            0.7),
        "gain": rng.uniform(0.5, 0.8), "launch_speed": rng.uniform(135, 175), "lift_time": rng.uniform(2, 8),
    }  # fmt: skip
    if traffic:
        driver |= {"speed_factor": 0.7, "accel": 0.9}
    psi, wind = rng.uniform(0, 2 * np.pi), cars.TOLERANCE["wind"] * rng.uniform(0, 1)
    effect = dict(settings.truth)
    effect["wind_n"] = effect.get("wind_n", 0.0) + wind * np.cos(psi)
    effect["wind_e"] = effect.get("wind_e", 0.0) + wind * np.sin(psi)
    seconds = 6000
    gusts = 1.0 + settings.gusts * _process(rng, seconds, 25.0)
    wobble = (2.2 if traffic else 0.6) * _process(rng, seconds, 8.0 if traffic else 15.0)
    return truth.simulate(car.true, car.ratios, driver, road, effect, gusts, wobble)


def _process(rng: np.random.Generator, n: int, tau: float) -> np.ndarray:
    return box._correlated(n, 1.0, 1.0, tau, rng)


def _settings(parts: tuple[Part, ...]) -> Settings:
    """The parts' settings together."""
    total = Settings()
    for part in parts:
        new = BY_ID[part.effect].make(part.size, part.other, np.random.default_rng(part.seed))
        total = Settings(
            total.truth | new.truth,
            total.box | new.box,
            total.road | new.road,
            total.heat * new.heat,
            max(total.gusts, new.gusts),
        )
    return total


def _plan(number: int, kind: str, seed: int) -> Plan:
    """Draw a case of `kind`; its sizes come from the detection limits on its own neutral drives."""
    case_seed = int(generator(seed, f"case {number}").integers(2**31))
    rng = generator(case_seed, "key")
    car = _car(case_seed)
    references, logs = int(rng.integers(3, 6)), int(rng.integers(2, 5))
    straight = kind == "confusable" and rng.random() < 0.5
    traffic = kind == "traffic"
    drives = [
        _drive(case_seed, "log", i, car, _road(case_seed, "log", i, straight, traffic), Settings(), traffic)
        for i in range(logs)
    ]
    understood = [
        _drive(case_seed, "reference", i, car, _road(case_seed, "reference", i, False, False), Settings(), False)
        for i in range(references)
    ]
    shown = limits.bound(car, drives, understood)
    strength = float(rng.choice(STRENGTHS, p=STRENGTH_SHARES))

    def drawn(pool: list[Effect], strength: float, other: bool) -> Part | None:
        for _ in range(40):
            effect = pool[int(rng.integers(len(pool)))]
            part_seed = int(rng.integers(2**31))
            limit = shown.limit(effect, other, part_seed)
            size = strength * limit
            if 0.0 < size <= effect.largest:
                return Part(effect.id, float(size * rng.choice(effect.signs)), float(limit), strength, other, part_seed)
        return None

    physics = [e for e in EFFECTS if e.kind == "physics"]
    sensors = [e for e in EFFECTS if e.kind == "sensor"]
    hidden = False
    hide: tuple[str, ...] = ()
    parts: tuple[Part | None, ...] = ()
    ids: tuple[str, ...]
    if kind == "single":
        parts = (drawn(physics, strength, False),)
    elif kind == "sensor":
        parts = (drawn(sensors, strength, False),)
    elif kind == "other_way":
        ids = (
            "head_wind",
            "tyre_warm_up",
            "cold_start",
            "enrichment",
            "brake_drag",
            "gearbox_oil_cold",
            "ac_cycling",
            "map_drift",
        )
        parts = (drawn([BY_ID[i] for i in ids], strength, True),)
    elif kind == "hidden":
        strength = float(rng.choice([2.0, 4.0], p=[0.6, 0.4]))
        hidden = True
        if rng.random() < 0.5:
            parts = (drawn(list(NOVEL), strength, False),)
        else:
            parts = (drawn([BY_ID[i] for i in HIDEABLE], strength, False),)
    elif kind == "pair":
        first = drawn(physics, 4.0, False)
        rest = [e for e in (*physics, *sensors) if first and not effects.same_class(e.id, first.effect)]
        parts = (first, drawn(rest, 4.0, False))
    elif kind == "confusable":
        ids = (
            ("head_wind", "drag_area")
            if straight
            else ("head_wind", "drag_area", "air_density", "rolling_resistance", "brake_drag")
        )
        parts = (drawn([BY_ID[i] for i in ids], strength, False),)
    kept = tuple(p for p in parts if p is not None)
    if hidden:
        # with its whole class, and with what could stand for it on these very drives at this size, as the generator's
        # own car shows them: a twin left in the catalogue would be a right answer
        alike = {e.id for e in EFFECTS for p in kept if effects.same_class(e.id, p.effect)}
        for p in kept:
            alike |= set(shown.twins(BY_ID[p.effect], p.other, p.seed, p.size, EFFECTS))
        hide = tuple(e.id for e in EFFECTS if e.id in alike)
    elif rng.random() < 0.12:  # a decoy: hiding says nothing
        absent = [i for i in HIDEABLE if not any(effects.same_class(i, p.effect) for p in kept)]
        hide = (str(rng.choice(absent)),)
    label = kind if kept or kind in ("gap_free", "traffic") else "gap_free"
    loud = shown.regimes(BY_ID[kept[0].effect], kept[0].other, kept[0].seed) if len(kept) == 1 else ({}, 0.0)
    key = Key(f"case_{number:04d}", label, kept, hidden and bool(kept), *loud)
    return Plan(key, hide, case_seed, references, logs, straight, traffic)


def _write(plan: Plan, out: Path) -> None:
    """Drive and log one case."""
    folder = out / plan.key.case
    (folder / "reference").mkdir(parents=True)
    (folder / "logs").mkdir()
    car = _car(plan.seed)
    (folder / "car.xml").write_text(car.xml)
    settings = _settings(plan.key.parts)
    roads = []
    for role, count in (("reference", plan.references), ("log", plan.logs)):
        for i in range(count):
            now = settings if role == "log" else Settings()
            straight, traffic = plan.straight and role == "log", plan.traffic and role == "log"
            road = _road(plan.seed, role, i, straight, traffic)
            drive = _drive(plan.seed, role, i, car, road, now, traffic)
            at = np.arange(len(road.north)) * road.step
            north, east = np.interp(drive["s"], at, road.north), np.interp(drive["s"], at, road.east)
            card = box.record(
                drive, north, east, car.box, now.box, HEAT * now.heat, generator(plan.seed, f"box {role} {i}")
            )
            (folder / ("logs" if role == "log" else "reference") / f"trip_{i}.dat").write_bytes(card)
            roads.append((road, now.road))
    text = [
        routes.osm([road], generator(plan.seed, f"map {i}"), bias=change.get("bias", 0.0), first=1 + 100_000 * i)
        for i, (road, change) in enumerate(roads)
    ]
    (folder / "road.osm").write_text(routes.joined(text))
