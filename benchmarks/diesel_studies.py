"""The studies of seeds 001 and 002 on the benchmark diesel: bias augmentation, and the sensor map found while driving.

`python -m benchmarks.diesel_studies [--seed 0]`. The transient cycle is made up (1,800 s, a third each town, rural and
motorway); numbers compare with the printed ones in kind, not digit by digit.
"""

import argparse
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from observer import bias_augmentation as bias
from observer.diesel import SCALE, DieselEstimate, DieselObserver, run_filter
from vehicle_model.car.diesel_engine import DieselParameters
from vehicle_model.plant.diesel import DieselRun, schedule, simulate_diesel, transient_cycle

STEP = 0.01
NOISE = np.array([500.0, 500.0, 20.0])
WALK = (1e3, 1e3, 20.0)
AIR_NOISE = 0.002
A_Q = np.array([[1.0, -2.0], [2.0, 1.0], [0.0, 0.0]])
NODES = np.arange(1, 13) * 0.05
ERROR = np.array([-0.02, 0.01, 0.05, 0.07, 0.06, 0.03, 0.0, -0.03, -0.05, -0.04, -0.02, 0.0])
TO_SHOWN = np.array([1.0, 1.0, 30.0 / np.pi, 1.0])


def held_cycle(seed: int, points: int = 40) -> NDArray[np.float64]:
    """Operating points held for 12 s, ramps of 3 s between."""
    rng = np.random.default_rng(seed)
    goals = np.column_stack([rng.uniform(40, 200, points), rng.uniform(1000, 1900, points)])
    parts: list[NDArray[np.float64]] = []
    for now, after in pairwise(goals):
        parts += [np.tile(now, (1200, 1)), np.linspace(now, after, 300)]
    driven = np.vstack(parts)
    return np.column_stack([driven, schedule(driven[:, 0], driven[:, 1])])


def slow_bias(n: int) -> NDArray[np.float64]:
    """Two slow biases of the pressures, up to about a tenth of them."""
    time = np.arange(n) * STEP
    q = 2500.0 * np.stack([1.0 + np.sin(time / 63.7), np.sin(time / 43.0 + 1.0)], axis=1)
    return q @ A_Q.T


def measured(inputs: NDArray, seed: int, **plant) -> tuple[DieselRun, NDArray[np.float64]]:
    """A run with system noise, and its three states with sensor noise."""
    rng = np.random.default_rng(seed)
    run = simulate_diesel(inputs, disturbance=rng.normal(size=(len(inputs), 3)) * [100.0, 100.0, 2.0], **plant)
    return run, run.state + rng.normal(size=(len(inputs), 3)) * NOISE


def found_augmentation(inputs: NDArray, seen: NDArray, start: NDArray, share: float) -> bias.Augmentation:
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


def augmentation_study(seed: int) -> None:
    """Seed 001, 6.1 and 6.2."""
    inputs, cycle = held_cycle(seed), transient_cycle(seed + 3, 1800.0)
    nominal = DieselParameters()
    wrong = nominal._replace(
        c_vol3=0.97 * nominal.c_vol3,
        A_vgtmax=0.94 * nominal.A_vgtmax,
        A_egrmax=1.1 * nominal.A_egrmax,
        eta_sc=1.02 * nominal.eta_sc,
    )
    for title, sensors, design, drive, share in (
        (
            "001, 6.1: two biases, all states measured",
            (0, 1, 2),
            {"bias": slow_bias(len(inputs)), "actuators": False},
            {"bias": slow_bias(len(cycle)), "actuators": False},
            0.1,
        ),
        (
            "001, 6.2: a wrong engine, exhaust pressure measured in design only",
            (0, 2),
            {"parameters": wrong},
            {"parameters": wrong},
            0.2,
        ),
    ):
        run, seen = measured(inputs, seed + 1, **design)
        augmentation = found_augmentation(inputs, seen, run.state[0], share)
        print(f"\n{title}\nsingular values {np.round(augmentation.singular_values, 3)}, order {augmentation.order}")
        if "bias" in design:
            angle = bias.subspace_angle(augmentation.basis / SCALE[:, None], A_Q / SCALE[:, None])
            print(f"angle to the true space {angle:.4f} rad")
        truth, seen = measured(cycle, seed + 2, **drive)
        for name, basis in (("Def.", np.zeros((3, 0))), ("Aug.", augmentation.basis)):
            observer = DieselObserver(
                sensors=sensors,
                noise=tuple(NOISE[list(sensors)]),
                walk=WALK,
                augmentation=basis,
                augmentation_walk=0.02,
                augmentation_start=0.3,
            )
            estimate = run_filter(observer, cycle, seen[:, list(sensors)], STEP, truth.state[0])
            error = estimate.state - truth.state
            print(f"{name} mean error {np.round(error.mean(axis=0), 1)}  max {np.round(np.abs(error).max(axis=0))}")


def shown(estimate: DieselEstimate, run: DieselRun) -> NDArray[np.float64]:
    """Errors of p_im, p_em (Pa), n_trb (rpm) and air flow (kg/s), (n, 4)."""
    error = np.column_stack([estimate.state - run.state, estimate.air_flow - run.flows[:, 0]])
    return error * TO_SHOWN


def map_study(seed: int) -> None:
    """Seed 002: convergence, tables 1 and 2, robustness."""
    cycle = transient_cycle(seed, 1800.0)
    rng = np.random.default_rng(seed)
    variants = {
        "Def.": {},
        "Aug.": {"additive": True, "augmentation_walk": 0.02, "augmentation_start": 0.02},
        "Map.": {"nodes": NODES, "node_walk": 1e-4, "node_start": 0.05},
    }
    run, _ = measured(cycle, seed, actuators=False)
    air = run.flows[:, 0]
    sensor = (1.0 + np.interp(air, NODES, ERROR)) * air + AIR_NOISE * rng.normal(size=len(air))
    visits = np.array([STEP * np.sum(np.abs(air - node) < 0.025) for node in NODES])
    alone = {"sensors": (3,), "noise": (AIR_NOISE,), "walk": WALK}
    print("\n002, table 1: max |error| and mean |error| of p_im, p_em, n_trb, W_air")
    for name, settings in variants.items():
        estimate = run_filter(DieselObserver(**alone, **settings), cycle, sensor[:, None], STEP, run.state[0])
        error = np.abs(shown(estimate, run))
        print(f"{name} {np.round(error.max(axis=0), 4)}  {np.round(error.mean(axis=0), 5)}")
        if name == "Map.":
            for second in (10, 60, 300, 900, 1799):
                off = np.abs(estimate.nodes[round(second / STEP)] - ERROR)[visits > 5.0] / np.ptp(ERROR)
                print(f"  after {second:4d} s: worst visited node off by {off.max():.1%} of the map's range")

    nominal = DieselParameters()
    wrong = nominal._replace(
        c_wphi3=1.08 * nominal.c_wphi3, c_vol3=0.99 * nominal.c_vol3, A_vgtmax=1.02 * nominal.A_vgtmax
    )
    run, states = measured(cycle, seed, parameters=wrong)
    air = run.flows[:, 0]
    sensor = (1.0 + np.interp(air, NODES, ERROR)) * air + AIR_NOISE * rng.normal(size=len(air))
    seen = np.column_stack([states[:, 0], states[:, 2], sensor])
    three = {"sensors": (0, 2, 3), "noise": (500.0, 20.0, AIR_NOISE), "walk": WALK}
    print("\n002, table 2: mean error of p_im, p_em, n_trb, W_air; engine with a wrong compressor")
    for own in (True, False):
        for name, settings in variants.items():
            observer = DieselObserver(**three, **settings, compressor_error=own)
            error = shown(run_filter(observer, cycle, seen, STEP, run.state[0]), run)
            print(f"{'with' if own else 'without':7} Delta_W {name} {np.round(error.mean(axis=0), 4)}")

    print("\n002, robustness: worst visited node, share of the map's range; smallest eigenvalue of P")
    for name, changed, sensor_noise, settings in (
        ("nominal", {}, 1.0, {}),
        ("EGR area +20 %", {"A_egrmax": 1.2}, 1.0, {}),
        ("volumetric efficiency -2 %", {"c_vol3": 0.98}, 1.0, {}),
        ("sensor noise x 4, not told", {}, 4.0, {}),
        ("R told / 16", {}, 1.0, {"noise": (AIR_NOISE / 4,)}),
        ("Q x 100", {}, 1.0, {"walk": tuple(10 * w for w in WALK)}),
        ("Q / 100", {}, 1.0, {"walk": tuple(w / 10 for w in WALK)}),
        ("1 % outliers of 0.2 kg/s, gated", {}, 1.0, {"gate": 5.0}),
    ):
        real = nominal._replace(**{key: factor * getattr(nominal, key) for key, factor in changed.items()})
        run, _ = measured(cycle, seed, parameters=real, actuators=False)
        air = run.flows[:, 0]
        sensor = (1.0 + np.interp(air, NODES, ERROR)) * air
        sensor = sensor + sensor_noise * AIR_NOISE * rng.normal(size=len(air))
        if "gate" in settings:
            hit = rng.choice(len(air), len(air) // 100, replace=False)
            sensor[hit] += rng.choice([-0.2, 0.2], len(hit))
        observer = DieselObserver(**{**alone, **variants["Map."], **settings})
        estimate = run_filter(observer, cycle, sensor[:, None], STEP, run.state[0])
        off = np.abs(estimate.nodes[-1] - ERROR)[visits > 5.0] / np.ptp(ERROR)
        print(f"{name:34} {off.max():6.1%}  {np.linalg.eigvalsh(estimate.covariance)[0]:.1e}")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    augmentation_study(options.seed)
    map_study(options.seed)


if __name__ == "__main__":
    main()
