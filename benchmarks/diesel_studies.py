"""The tables of seeds 001 and 002: `rollingroad.diesel_studies` printed, and how robust the map adaptation is.

`python -m benchmarks.diesel_studies [--seed 0]`: transient cycles of 1,800 s.
"""

import argparse

import numpy as np

from observer import bias_augmentation as bias
from observer.diesel import SCALE, DieselObserver, run_filter
from rollingroad.diesel_studies import (
    A_Q,
    AIR_ALONE,
    AIR_NOISE,
    ERROR,
    NODES,
    STEP,
    VARIANTS,
    WALK,
    map_study,
    map_study_wrong_compressor,
    measured,
    shown,
    two_biases,
    wrong_engine,
)
from vehicle_model.car.diesel_engine import DieselParameters
from vehicle_model.plant.diesel import transient_cycle


def augmentation_tables(seed: int) -> None:
    """Seed 001, 6.1 and 6.2."""
    for title, study in (
        ("001, 6.1: two biases, all states measured", two_biases(seed)),
        ("001, 6.2: a wrong engine, exhaust pressure measured in design only", wrong_engine(seed)),
    ):
        augmentation = study.augmentation
        print(f"\n{title}\nsingular values {np.round(augmentation.singular_values, 3)}, order {augmentation.order}")
        if title.startswith("001, 6.1"):
            angle = bias.subspace_angle(augmentation.basis / SCALE[:, None], A_Q / SCALE[:, None])
            print(f"angle to the true space {angle:.4f} rad")
        for name, found in study.found.items():
            error = found - study.truth
            print(f"{name} mean error {np.round(error.mean(axis=0), 1)}  max {np.round(np.abs(error).max(axis=0))}")


def map_tables(seed: int) -> None:
    """Seed 002: convergence, tables 1 and 2."""
    study = map_study(seed)
    print("\n002, table 1: max |error| and mean |error| of p_im, p_em, n_trb, W_air")
    for name, estimate in study.estimates.items():
        error = np.abs(shown(estimate, study.run))
        print(f"{name} {np.round(error.max(axis=0), 4)}  {np.round(error.mean(axis=0), 5)}")
        if name == "Map.":
            for second in (10, 60, 300, 900, 1799):
                off = np.abs(estimate.nodes[round(second / STEP)] - ERROR)[study.visits > 5.0] / np.ptp(ERROR)
                print(f"  after {second:4d} s: worst visited node off by {off.max():.1%} of the map's range")
    print("\n002, table 2: mean error of p_im, p_em, n_trb, W_air; engine with a wrong compressor")
    for own in (True, False):
        wrong = map_study_wrong_compressor(seed, own_bias=own)
        for name, estimate in wrong.estimates.items():
            error = shown(estimate, wrong.run).mean(axis=0)
            print(f"{'with' if own else 'without':7} Delta_W {name} {np.round(error, 4)}")
    _robustness(seed, study.visits)


def _robustness(seed: int, visits: np.ndarray) -> None:
    nominal, cycle = DieselParameters(), transient_cycle(seed, 1800.0)
    rng = np.random.default_rng(seed)
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
        observer = DieselObserver(**{**AIR_ALONE, **VARIANTS["Map."], **settings})
        estimate = run_filter(observer, cycle, sensor[:, None], STEP, run.state[0])
        off = np.abs(estimate.nodes[-1] - ERROR)[visits > 5.0] / np.ptp(ERROR)
        print(f"{name:34} {off.max():6.1%}  {np.linalg.eigvalsh(estimate.covariance)[0]:.1e}")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    augmentation_tables(options.seed)
    map_tables(options.seed)


if __name__ == "__main__":
    main()
