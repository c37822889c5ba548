"""The challenge's own versions of the effects: what a size means to its car, its box and its map.

Ids are the catalogue's. `size` is the departure from neutral in the unit of the catalogue's leading parameter, so
that a
diagnosis can be judged on it. `other` is the same effect made differently: two time constants, gusts, a smooth
threshold.
Effects named `novel_...` stand in no catalogue.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Settings:
    """What one effect sets: fields of `truth`, of `box`, of the map, and of the fuel."""

    truth: dict[str, float] = field(default_factory=dict)
    box: dict[str, float] = field(default_factory=dict)
    road: dict[str, float] = field(default_factory=dict)
    heat: float = 1.0
    """True heating value / declared."""
    gusts: float = 0.0


@dataclass(frozen=True)
class Effect:
    """One row: `make(size, other, rng)`; sizes up to `largest`, of the `signs` that exist."""

    id: str
    subsystem: str
    make: Callable[[float, bool, np.random.Generator], Settings]
    step: float
    largest: float
    signs: tuple[int, ...]
    parameter: str | None
    """The catalogue's "effect.parameter" that size is a departure of; None where ours is made otherwise."""
    kind: str = "physics"


def _wind(size: float, other: bool, rng: np.random.Generator) -> Settings:
    psi = rng.uniform(0, 2 * np.pi)
    return Settings({"wind_n": size * np.cos(psi), "wind_e": size * np.sin(psi)}, gusts=0.35 if other else 0.0)


def _tyre(size: float, other: bool, rng: np.random.Generator) -> Settings:
    if other:
        return Settings({"tyre_k1": 0.5 * size, "tyre_d1": 1800.0, "tyre_k2": 0.5 * size, "tyre_t2": 900.0})
    return Settings({"tyre_k2": size, "tyre_t2": rng.uniform(500, 1000)})


def _cold(size: float, other: bool, rng: np.random.Generator) -> Settings:
    if other:
        return Settings({"cold_k1": 0.5 * size, "cold_e1": 5e6, "cold_k2": 0.6 * size, "cold_t2": 400.0})
    return Settings({"cold_k1": size, "cold_e1": rng.uniform(0.6e7, 1.6e7)})


def _accessory(size: float, other: bool, rng: np.random.Generator) -> Settings:
    return Settings({"acc_power": size / 0.536})


def _compressor(size: float, other: bool, rng: np.random.Generator) -> Settings:
    return Settings({"ac_power": size, "ac_period": rng.uniform(20, 55), "ac_duty": 0.35 if other else 0.5})


def _enrichment(size: float, other: bool, rng: np.random.Generator) -> Settings:
    return Settings({"enr_gain": size, "enr_from": rng.uniform(0.62, 0.75), "enr_width": 0.06 if other else 0.01})


def _drift(size: float, other: bool, rng: np.random.Generator) -> Settings:
    width = (80.0, 10.0) if other else (55.0, 16.0)
    return Settings({"drift_gain": size, "drift_n": rng.uniform(180, 300), "drift_t": rng.uniform(25, 70),
                     "drift_wn": width[0], "drift_wt": width[1]})  # fmt: skip


def _brake(size: float, other: bool, rng: np.random.Generator) -> Settings:
    return Settings({"brake_drag": 0.6 * size, "brake_heat": size} if other else {"brake_drag": size})


def _oil(size: float, other: bool, rng: np.random.Generator) -> Settings:
    return Settings({"oil_k": size, "oil_d": 3000.0 if other else 6000.0})


def _truth(name: str, neutral: float = 0.0) -> Callable[[float, bool, np.random.Generator], Settings]:
    return lambda size, other, rng: Settings({name: neutral + size})


def _box(name: str, neutral: float = 0.0) -> Callable[[float, bool, np.random.Generator], Settings]:
    return lambda size, other, rng: Settings(box={name: neutral + size})


BOTH, UP, DOWN = (1, -1), (1,), (-1,)
EFFECTS: tuple[Effect, ...] = (
    Effect("head_wind", "road_load", _wind, 0.5, 9.0, UP, "head_wind.speed"),
    Effect("rolling_resistance", "road_load", _truth("crr", 1.0), 0.05, 0.45, BOTH, "rolling_resistance.factor"),
    Effect("tyre_warm_up", "road_load", _tyre, 0.05, 0.8, UP, "tyre_warm_up.amount"),
    Effect("mass", "road_load", _truth("mass", 1.0), 0.03, 0.3, BOTH, "mass.factor"),
    Effect("drag_area", "road_load", _truth("cd_a", 1.0), 0.03, 0.4, BOTH, "drag_area.factor"),
    Effect("air_density", "road_load", _truth("rho", 1.0), 0.03, 0.22, BOTH, "air_density.factor"),
    Effect("cornering_drag", "road_load", _truth("corner"), 2e-6, 4e-5, UP, None),
    Effect("brake_drag", "road_load", _brake, 5.0, 100.0, UP, "brake_drag.force"),
    Effect("cold_start", "engine_fuel", _cold, 0.1, 2.5, UP, None),
    Effect("cranking_fuel", "engine_fuel",
           lambda size, other, rng: Settings({"crank_gain": size, "crank_rpm": 0.0 if other else 400.0 * min(1.0, size),
                                              "crank_t": rng.uniform(35, 70)}), 0.1, 2.0, UP, None),
    Effect("gearbox_oil_cold", "driveline", _oil, 5.0, 90.0, UP, None),
    Effect("accessory_load", "accessory", _accessory, 50.0, 1500.0, UP, "accessory_load.power"),
    Effect("ac_cycling", "accessory", _compressor, 100.0, 4500.0, UP, None),
    Effect("enrichment", "engine_fuel", _enrichment, 0.02, 0.35, UP, None),
    Effect("fuel_cutoff", "engine_fuel", _truth("cut_lost"), 0.1, 1.0, UP, None),
    Effect("idle_fuel", "engine_fuel", _truth("idle_gain"), 0.05, 0.7, BOTH, None),
    Effect("fuel_energy", "engine_fuel", lambda size, other, rng: Settings(heat=1.0 + size), 0.01, 0.2, DOWN,
        "fuel_energy.factor"),
    Effect("map_drift", "engine_fuel", _drift, 0.02, 0.2, BOTH, None),
    Effect("driveline_loss", "driveline",
           lambda size, other, rng: Settings({"eta_loss": size, "eta_gear_no": 0.0}), 0.01, 0.08, UP,
           "driveline_loss.share"),
    Effect("injector_dead_time", "injector", _box("dead_time"), 2e-5, 4e-4, BOTH, "injector_dead_time.extra", "sensor"),
    Effect("injector_fouling", "injector", lambda size, other, rng: Settings(box={"flow": 1.0 - size}), 0.01, 0.15, UP,
           "injector_fouling.flow_lost", "sensor"),
    Effect("wheel_radius", "wheel", lambda size, other, rng: Settings(box={"radius": 1.0 + size}), 0.002, 0.03, BOTH,
           "wheel_radius.change", "sensor"),
    Effect("wheel_slip", "wheel", lambda size, other, rng: Settings(box={"slip": size * 6.6e-6}), 0.3, 4.0, UP,
           "wheel_slip.factor", "sensor"),
    Effect("grade_map_error", "road_map", lambda size, other, rng: Settings(road={"bias": size}), 0.001, 0.012, BOTH,
           "grade_map_error.bias", "sensor"),
    Effect("accelerometer_mount", "accelerometer", _box("acc_pitch"), 0.002, 0.1, BOTH, "accelerometer_mount.pitch",
        "sensor"),
    Effect("gps_lag", "gps", _box("gps_lag", 0.2), 0.05, 1.8, UP, "gps_lag.seconds", "sensor"),
    Effect("clock_skew", "clock", _box("skew"), 2e-5, 5e-4, BOTH, "clock_skew.rate", "sensor"),
)  # fmt: skip

NOVEL: tuple[Effect, ...] = (
    Effect("novel_sector", "road_load",
           lambda size, other, rng: Settings({"sector_k": size, "sector_psi": rng.uniform(0, 2 * np.pi)}), 0.03, 0.6,
           UP, None),
    Effect("novel_wet", "road_load",
           lambda size, other, rng: Settings({"wet_k": size, "wet_period": rng.uniform(120, 420)}), 0.02, 0.5, UP,
           None),
    Effect("novel_bearing", "road_load", _truth("bearing"), 0.5, 12.0, UP, None),
    Effect("novel_heat", "engine_fuel", _truth("heat_gain"), 0.05, 1.2, UP, None),
    Effect("novel_fan", "accessory", _truth("low_fan"), 60.0, 2000.0, UP, None),
)  # fmt: skip
HIDEABLE = ("cold_start", "fuel_cutoff", "ac_cycling", "cornering_drag", "head_wind", "idle_fuel", "enrichment")
"""Effects that stay recognisable as "none of the others" once they are hidden."""
CLASSES: tuple[frozenset[str], ...] = (
    frozenset({"drag_area", "air_density"}),
    frozenset({"rolling_resistance", "brake_drag"}),
    frozenset({"fuel_energy", "injector_fouling", "driveline_loss"}),
    frozenset({"accessory_load", "injector_dead_time", "ac_cycling"}),
    frozenset({"tyre_warm_up", "gearbox_oil_cold"}),
    frozenset({"cold_start", "cranking_fuel"}),
    frozenset({"enrichment", "map_drift"}),
    frozenset({"gps_lag", "clock_skew"}),
)
"""What one set of ordinary trips may leave unseparated (EFFECTS.md, "Closest")."""
BY_ID = {e.id: e for e in (*EFFECTS, *NOVEL)}


def same_class(a: str, b: str) -> bool:
    """Whether `a` and `b` are the same effect or members of one class."""
    return a == b or any(a in members and b in members for members in CLASSES)
