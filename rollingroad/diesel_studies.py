"""The studies of seeds 001 and 002 on the benchmark diesel: bias augmentation, and the sensor map found while driving.

The transient cycle is made up (a third each town, rural and motorway); numbers compare with the printed ones in kind,
not digit by digit. `benchmarks.diesel_studies` prints their tables, `rollingroad gallery` draws their figures.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer import bias_augmentation as bias
from observer.diesel import SCALE, DieselEstimate, DieselObserver, run_filter
from vehicle_model.car.diesel_engine import DieselParameters
from vehicle_model.plant.diesel import DieselRun, schedule, simulate_diesel, transient_cycle

Array = NDArray[np.float64]
STEP = 0.01
"""s."""
NOISE = np.array([500.0, 500.0, 20.0])
"""Of the sensors of the three states: Pa, Pa, rad/s."""
WALK = (1e3, 1e3, 20.0)
AIR_NOISE = 0.002
"""kg/s."""
A_Q = np.array([[1.0, -2.0], [2.0, 1.0], [0.0, 0.0]])
NODES: Array = np.arange(1, 13).astype(np.float64) * 0.05
ERROR = np.array([-0.02, 0.01, 0.05, 0.07, 0.06, 0.03, 0.0, -0.03, -0.05, -0.04, -0.02, 0.0])
"""The air-flow sensor's relative error at `NODES` kg/s."""
TO_SHOWN = np.array([1.0, 1.0, 30.0 / np.pi, 1.0])
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "Def.": {},
    "Aug.": {"additive": True, "augmentation_walk": 0.02, "augmentation_start": 0.02},
    "Map.": {"nodes": NODES, "node_walk": 1e-4, "node_start": 0.05},
}
"""Seed 002's observers: as they are, with one fast bias of the air flow, with a map of it."""
AIR_ALONE: Mapping[str, Any] = {"sensors": (3,), "noise": (AIR_NOISE,), "walk": WALK}
THREE: Mapping[str, Any] = {"sensors": (0, 2, 3), "noise": (500.0, 20.0, AIR_NOISE), "walk": WALK}


def held_cycle(seed: int, points: int = 40) -> Array:
    """Operating points held for 12 s, ramps of 3 s between."""
    rng = np.random.default_rng(seed)
    goals = np.column_stack([rng.uniform(40, 200, points), rng.uniform(1000, 1900, points)])
    parts: list[Array] = []
    for now, after in pairwise(goals):
        parts += [np.tile(now, (1200, 1)), np.linspace(now, after, 300)]
    driven = np.vstack(parts)
    return np.column_stack([driven, schedule(driven[:, 0], driven[:, 1])])


def slow_bias(n: int) -> Array:
    """Two slow biases of the pressures, up to about a tenth of them."""
    time = np.arange(n) * STEP
    q = 2500.0 * np.stack([1.0 + np.sin(time / 63.7), np.sin(time / 43.0 + 1.0)], axis=1)
    return q @ A_Q.T


def measured(inputs: Array, seed: int, **plant) -> tuple[DieselRun, Array]:
    """A run with system noise, and its three states with sensor noise."""
    rng = np.random.default_rng(seed)
    run = simulate_diesel(inputs, disturbance=rng.normal(size=(len(inputs), 3)) * [100.0, 100.0, 2.0], **plant)
    return run, run.state + rng.normal(size=(len(inputs), 3)) * NOISE


def found_augmentation(inputs: Array, seen: Array, start: Array, share: float) -> bias.Augmentation:
    """Approach 2 on the stretches that the rule calls stationary."""
    default = DieselObserver(sensors=(0, 1, 2), noise=tuple(NOISE), walk=WALK)
    estimate = run_filter(default, inputs, seen, STEP, start)
    parts = bias.stationary_parts(inputs[:, :2], 300, np.array([2.0, 5.0]), settle=400)
    residuals = np.array([estimate.residual[a:b].mean(axis=0) for a, b in parts])
    gains = np.array(
        [
            bias.residual_gain(np.eye(3), estimate.transition[a:b].mean(axis=0), estimate.gain[a:b].mean(axis=0))
            for a, b in parts
        ]
    )
    return bias.decompose(bias.from_residuals(residuals, gains), scale=SCALE, share=share)


@dataclass(frozen=True)
class AugmentationStudy:
    """Seed 001: the augmentation found on held points, and two observers on a transient cycle; rows every STEP s."""

    augmentation: bias.Augmentation
    truth: Array
    """(n, 3): p_im, p_em (Pa), omega_t (rad/s)."""
    found: Mapping[str, Array]
    """"Def." and "Aug.", (n, 3) each."""


def two_biases(seed: int, seconds: float = 1800.0) -> AugmentationStudy:
    """Seed 001, 6.1: two slow biases of the pressures, all states measured."""
    return _augmentation_study(seed, seconds, (0, 1, 2), 0.1, biased=True)


def wrong_engine(seed: int, seconds: float = 1800.0) -> AugmentationStudy:
    """Seed 001, 6.2: a wrong engine in place of a real one; the exhaust pressure is measured in the design only."""
    nominal = DieselParameters()
    engine = nominal._replace(
        c_vol3=0.97 * nominal.c_vol3,
        A_vgtmax=0.94 * nominal.A_vgtmax,
        A_egrmax=1.1 * nominal.A_egrmax,
        eta_sc=1.02 * nominal.eta_sc,
    )
    return _augmentation_study(seed, seconds, (0, 2), 0.2, parameters=engine)


def _augmentation_study(
    seed: int, seconds: float, sensors: tuple[int, ...], share: float, *, biased: bool = False, **plant
) -> AugmentationStudy:
    inputs, cycle = held_cycle(seed), transient_cycle(seed + 3, seconds)

    def departures(n: int) -> dict:
        return {"bias": slow_bias(n), "actuators": False} if biased else plant

    run, seen = measured(inputs, seed + 1, **departures(len(inputs)))
    augmentation = found_augmentation(inputs, seen, run.state[0], share)
    truth, seen = measured(cycle, seed + 2, **departures(len(cycle)))
    found = {}
    for name, basis in (("Def.", np.zeros((3, 0))), ("Aug.", augmentation.basis)):
        observer = DieselObserver(
            sensors=sensors,
            noise=tuple(NOISE[list(sensors)]),
            walk=WALK,
            augmentation=basis,
            augmentation_walk=0.02,
            augmentation_start=0.3,
        )
        found[name] = run_filter(observer, cycle, seen[:, list(sensors)], STEP, truth.state[0]).state
    return AugmentationStudy(augmentation, truth.state, found)


def shown(estimate: DieselEstimate, run: DieselRun) -> Array:
    """Errors of p_im, p_em (Pa), n_trb (rpm) and air flow (kg/s), (n, 4)."""
    error = np.column_stack([estimate.state - run.state, estimate.air_flow - run.flows[:, 0]])
    return error * TO_SHOWN


def wrong_air_flow(air: Array, rng: np.random.Generator) -> Array:
    """What a sensor with the error map ERROR reads of `air` (n,), kg/s."""
    return (1.0 + np.interp(air, NODES, ERROR)) * air + AIR_NOISE * rng.normal(size=len(air))


@dataclass(frozen=True)
class MapStudy:
    """Seed 002: observers of a diesel whose air-flow sensor has an error map; rows every STEP s."""

    air: Array
    """(n,), kg/s, true."""
    sensor: Array
    """(n,), kg/s, as read."""
    run: DieselRun
    estimates: Mapping[str, DieselEstimate]
    """By the names of VARIANTS."""

    @property
    def visits(self) -> Array:
        """(nodes,): s spent within half a node's distance of each."""
        return np.array([STEP * np.sum(np.abs(self.air - node) < 0.025) for node in NODES])


def map_study(seed: int, seconds: float = 1800.0) -> MapStudy:
    """Seed 002, 5.2: the air flow alone is measured, the engine is the observers' own."""
    cycle, rng = transient_cycle(seed, seconds), np.random.default_rng(seed)
    run, _ = measured(cycle, seed, actuators=False)
    sensor = wrong_air_flow(run.flows[:, 0], rng)
    estimates = {
        name: run_filter(DieselObserver(**AIR_ALONE, **settings), cycle, sensor[:, None], STEP, run.state[0])
        for name, settings in VARIANTS.items()
    }
    return MapStudy(run.flows[:, 0], sensor, run, estimates)


def map_study_wrong_compressor(seed: int, seconds: float = 1800.0, *, own_bias: bool = True) -> MapStudy:
    """Seed 002, 5.3: three sensors, an engine with a wrong compressor; `own_bias` gives its flow a bias of its own."""
    cycle, rng = transient_cycle(seed, seconds), np.random.default_rng(seed)
    nominal = DieselParameters()
    engine = nominal._replace(
        c_wphi3=1.08 * nominal.c_wphi3, c_vol3=0.99 * nominal.c_vol3, A_vgtmax=1.02 * nominal.A_vgtmax
    )
    run, states = measured(cycle, seed, parameters=engine)
    sensor = wrong_air_flow(run.flows[:, 0], rng)
    seen = np.column_stack([states[:, 0], states[:, 2], sensor])
    estimates = {
        name: run_filter(
            DieselObserver(**THREE, **settings, compressor_error=own_bias), cycle, seen, STEP, run.state[0]
        )
        for name, settings in VARIANTS.items()
    }
    return MapStudy(run.flows[:, 0], sensor, run, estimates)
