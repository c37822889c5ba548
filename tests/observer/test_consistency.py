"""On data drawn from the filter's own model its stated uncertainty is the true one."""

import entry
import numpy as np
import pytest
from scipy.stats import chi2
from synthetic import SMART

from observer import kernel, model
from observer.observe import start
from observer.settings import DEFAULT

RUNS, SECONDS, STEP = 50, 8.0, 0.025
SPREAD = np.array([0.3, 0.5, 300, 0.03, 0.02, 1.5, 1.5, 1.5, 1e-3, 1e-4, 20, 1e3, 0.5, 3, 0.1, 0.1, 0.1, 1.8, 1.8, 3.5])
SPREAD = np.concatenate([SPREAD, [2e-6, 1e-3]])
BEGIN = np.zeros(kernel.NX)
BEGIN[[1, 2, 3, 4, 9, 11, 13, 20]] = 20.0, 900.0, 0.4, 0.02, 2e-4, 3e4, 250.0, 7e-6
EVERY = {
    model.ACCELERATION_X: (1, 0.04),
    model.ACCELERATION_Y: (1, 0.04),
    model.ACCELERATION_Z: (1, 0.5),
    model.DISTANCE: (2, 1e-5),
    model.GPS_NORTH: (8, 0.2),
    model.GPS_EAST: (8, 0.2),
    model.GPS_ALTITUDE: (8, 0.5),
    model.GPS_SPEED: (8, 0.01),
    model.INJECTED_ENERGY: (3, 50.0),
    model.ENGINE_ANGLE: (3, 0.01),
}
"""Kind: every how many steps, variance."""


@pytest.fixture(scope="module")
def drawn() -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """NEES (runs, instants) and normalised innovations by kind (runs, count)."""
    errors = np.empty((RUNS, round(SECONDS / STEP)))
    innovations: dict[int, list[list[float]]] = {kind: [] for kind in EVERY}
    for run in range(RUNS):
        rng = np.random.default_rng([run, 9])
        f = start(SMART, DEFAULT, None, 0.0)
        f = f._replace(records=np.empty((20_000, 7)))
        f.counts[kernel.RECORDING] = 1
        f.memory[kernel.M_TICK_TIME] = f.memory[kernel.M_PULSE_TIME] = 1e9
        f.x[:], f.P[:] = BEGIN, np.diag(SPREAD**2)
        truth = BEGIN + SPREAD * rng.standard_normal(kernel.NX)
        noise = f.work[124 + 10 * kernel.NX : 124 + 11 * kernel.NX]
        n, moved = np.empty((7, 8)), np.empty(kernel.NX + 4)
        keep = np.exp(-STEP / np.array([DEFAULT.gps_drift_time] * 2 + [DEFAULT.gps_vertical_drift_time]))
        for k in range(errors.shape[1]):
            before = f.x[model.V]
            entry.move((k + 1) * STEP, f)
            f.x[model.OMEGA] *= before / f.x[model.V]  # the engine's tie to the car is an input, not part of the model
            entry.transition(truth, STEP, f.car, n, moved)
            truth = moved[: kernel.NX].copy()
            truth[17:20] *= keep
            truth += np.sqrt(noise) * rng.standard_normal(kernel.NX)
            for kind, (every, variance) in EVERY.items():
                if k % every == 0:
                    value, _ = entry.sparse_row(
                        np.int64(kind), truth, f.car, 0.0, np.zeros(10, np.int64), np.zeros(8), np.zeros(4)
                    )
                    entry.fuse(np.int64(kind), value + np.sqrt(variance) * rng.standard_normal(), variance, 0.0, f)
            unit = np.sqrt(np.diag(f.P))
            e = (f.x - truth) / unit
            errors[run, k] = e @ np.linalg.solve(f.P / np.outer(unit, unit), e)
        rows = f.records[: f.counts[kernel.RECORDS]]
        for kind in EVERY:
            mine = rows[rows[:, 1] == kind]
            innovations[kind].append(list(mine[:, 3] / np.sqrt(mine[:, 4])))
    return errors, {kind: np.array(values) for kind, values in innovations.items()}


def test_mean_nees_lies_in_its_band(drawn):
    """Average over 50 runs inside the 95 % band of chi-square at 93 % of the instants or more."""
    mean = drawn[0].mean(axis=0)
    low, high = chi2.ppf([0.025, 0.975], RUNS * kernel.NX) / RUNS
    inside = (mean > low) & (mean < high)
    assert inside.mean() >= 0.93, f"{inside.mean():.3f} inside, mean {mean.mean() / kernel.NX:.3f} per state"


@pytest.mark.parametrize("kind", EVERY, ids=[model.KINDS[kind] for kind in EVERY])
def test_innovations_are_chi_square_and_white(drawn, kind):
    values = drawn[1][kind]
    count = values.size
    low, high = chi2.ppf([0.0005, 0.9995], count) / count
    assert low < np.mean(values**2) < high
    correlation = np.mean(values[:, 1:] * values[:, :-1]) / np.mean(values**2)
    assert abs(correlation) < 3.3 / np.sqrt(count)
