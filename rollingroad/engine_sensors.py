"""Seed 003's study: which sensors tell the burnt gas in the intake of an engine with low-pressure EGR.

`python -m rollingroad.engine_sensors` prints the table: each set's expected and simulated error, the observer linear,
the engine not.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from observer.kalman import observe_luenberger
from observer.selection.engine import (
    ACCURACY,
    INTAKE_BURNT,
    NOMINAL,
    SCALE,
    SENSORS,
    STATES,
    engine_system,
    equilibrium,
    linearised,
)
from observer.selection.h2 import kalman_h2
from observer.selection.process_noise import process_noise
from vehicle_model.car.randomness import generator
from vehicle_model.plant.si_engine_egr import drive_cycle, run

Array = NDArray[np.float64]
STEP, EVERY = 2e-4, 25
PERIOD = STEP * EVERY
SETTLED = 3.3
"""s left out at the start (the paper's)."""


@dataclass(frozen=True)
class Study:
    """`sets` of sensors with `expected` H2 norms and `simulated` RMSE, both in percent burnt gas, rows alike."""

    sets: tuple[tuple[str, ...], ...]
    expected: Array
    simulated: Array
    time: Array
    """(n,), s."""
    truth: Array
    """(n,), percent burnt gas in the intake."""
    found: Array
    """(sets, n), percent."""


def study(duration: float = 40.0, seed: int = 0, swing: float = 1.0) -> Study:
    """Run the truth once, take the process noise from the linear model's residuals, and judge all 16 sets."""
    rest = equilibrium()
    commands = drive_cycle(duration, STEP, swing)
    truth = run(rest, commands, STEP, EVERY)
    a, b = linearised(rest)
    x = (truth - rest) / SCALE
    u = commands[::EVERY] - np.array(NOMINAL)
    rates = np.gradient(x, PERIOD, axis=0)
    sigma = process_noise(rates - x @ a.T - u @ b.T)
    # actuators and sensors lag as modelled: no noise of their own (3.2.2)
    sigma[13:] = 0.0
    order = [STATES.index(name) for name in ("egr_dp", "maf_air", "maf_high", "maf")]
    largest = {name: float(np.abs(truth[:, i] - rest[i]).max()) for name, i in zip(SENSORS, order, strict=True)}
    system = engine_system(a, sigma, largest)
    rng = generator(seed, "engine sensors")
    noise = np.array([ACCURACY[name] * largest[name] for name in SENSORS]) / SCALE[order]
    y = x[:, order] + noise * rng.standard_normal((len(x), 4))
    use = np.arange(len(x)) * PERIOD >= SETTLED
    sets, expected, simulated, tracks = [], [], [], []
    for count in range(5):
        for chosen in combinations(range(4), count):
            norm, gain = kalman_h2(system, chosen)
            rows = list(chosen)
            # known inputs enter beside the measurements
            both = np.column_stack([y[:, rows], u])
            c = system.c[rows]
            found = _observed(a, b, c, gain, x[0], both, len(rows))
            error = (found - x)[use, INTAKE_BURNT] * SCALE[INTAKE_BURNT]
            tracks.append(100.0 * (rest + found * SCALE)[:, INTAKE_BURNT])
            sets.append(tuple(SENSORS[i] for i in rows))
            expected.append(norm * SCALE[INTAKE_BURNT] * 100.0)
            simulated.append(100.0 * float(np.sqrt(np.mean(error**2))))
    time, burnt = np.arange(len(x), dtype=np.float64) * PERIOD, 100.0 * truth[:, INTAKE_BURNT]
    return Study(
        tuple(sets), np.array(expected), np.array(simulated), time, np.asarray(burnt, np.float64), np.array(tracks)
    )


def _observed(a: Array, b: Array, c: Array, gain: Array, start: Array, both: Array, rows: int) -> Array:
    """dx/dt = A x + B u + L (y - C x), the inputs as further columns of the gain."""
    wide = np.column_stack([gain, b])
    heard = np.vstack([c, np.zeros((both.shape[1] - rows, a.shape[0]))])
    return observe_luenberger(a, heard, wide, start, both, PERIOD)


def table(found: Study) -> str:
    """Markdown rows, by number of sensors and expected error."""
    lines = ["| sensors | expected RMSE, % | simulated RMSE, % |", "|---|---|---|"]
    for i in sorted(range(len(found.sets)), key=lambda i: (len(found.sets[i]), found.expected[i])):
        lines.append(f"| {' + '.join(found.sets[i]) or 'none'} | {found.expected[i]:.4f} | {found.simulated[i]:.4f} |")
    return "\n".join(lines)


if __name__ == "__main__":
    for share in (1.0, 0.2):
        print(f"departures from the operating point x {share:g}\n\n{table(study(swing=share))}\n")
