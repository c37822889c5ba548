"""Do the prior estimators of seed 000 improve what an ion current tells? Peak-pressure location and air-fuel ratio.

`python -m rollingroad.ion_study` prints the tables of docs/priors.md. Calibrated, tuned and the priors learnt on seeds
that are not judged.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from observer.priors import (
    AdaptivePriorEstimator,
    Bootstrap,
    GaussianPrior,
    GaussianSum,
    LowPass,
    MixturePrior,
    StaticPriorEstimator,
    Weighting,
    histogram_prior,
)
from observer.priors.combustion import Calibration, flame_slope, two_gaussians
from observer.priors.estimators import Estimator
from observer.priors.evaluation import interval
from vehicle_model.car.randomness import generator
from vehicle_model.plant.ion_current import ANGLE, IonSettings, ion_cycles

Array = NDArray[np.float64]
PARAMETERS = ("peak pressure location, degrees", "lambda")
POINT = (15.0, 1.0)
"""What the engine map asks for: the middle of the priors."""
TRACKS = {
    "steady": (POINT,) * 6,
    "steps": (POINT, (18.0, 1.0), POINT, (15.0, 0.92), (12.0, 1.06), POINT),
}
"""Operating points (location, lambda): at the map's, and with departures from it."""
SPREAD = (1.5, 0.03)
"""Deviations of the operating points about the map's, as logged: what the priors are made of."""
HOLD = 60
"""Cycles of each."""
FORGETTING = (0.7, 0.8, 0.9, 0.95)
SEEDS = range(100, 120)
"""Judged; seeds below 100 serve for calibration and tuning."""


@dataclass(frozen=True)
class Measured:
    """One run: measurements and operating points (n, 2) of PARAMETERS, before any filter."""

    measured: Array
    setpoint: Array


def calibrate(settings: IonSettings) -> Calibration:
    """On a bench: locations from 9 to 21 degrees and mixtures from 0.85 to 1.15, 40 cycles each."""
    places_by, mixtures_by = np.meshgrid(np.linspace(9.0, 21.0, 5), np.linspace(0.85, 1.15, 5))
    location, mixture = np.repeat(places_by.ravel(), 40), np.repeat(mixtures_by.ravel(), 40)
    cycles = ion_cycles(location, mixture, generator(0, "ion current on the bench"), settings)
    places, slopes = two_gaussians(ANGLE, cycles.current)[:, 4], flame_slope(ANGLE, cycles.current)
    return Calibration.of(places, slopes, location, mixture)


def measure(name: str, seed: int, calibration: Calibration, settings: IonSettings) -> Measured:
    """Cycles of a track, each measured by itself."""
    points = np.repeat(np.array(TRACKS[name]), HOLD, axis=0)
    cycles = ion_cycles(points[:, 0], points[:, 1], generator(seed, f"ion current, {name}"), settings)
    places, slopes = two_gaussians(ANGLE, cycles.current)[:, 4], flame_slope(ANGLE, cycles.current)
    return Measured(np.stack([calibration.locations(places), calibration.mixtures(slopes)], axis=1), points)


def estimators(noise: float, axis: int) -> dict[str, list[Estimator]]:
    """Each family over its one setting; `noise` is the deviation of one cycle's measurement."""
    mean, spread = POINT[axis], SPREAD[axis]
    logged = mean + spread * generator(0, "logged operating points").standard_normal(2000)
    gauss = GaussianPrior(mean, spread, floor=0.1 / spread)
    weights = [Weighting.matched("negative_exponential", a) for a in FORGETTING]
    drifts = [noise * (1.0 - a) for a in FORGETTING]
    return {
        "low-pass": [LowPass(a) for a in FORGETTING],
        "SPE, Gaussian prior": [StaticPriorEstimator(gauss, w) for w in weights],
        "SPE, histogram prior": [StaticPriorEstimator(histogram_prior(logged, floor=0.1 / spread), w) for w in weights],
        "APE": [AdaptivePriorEstimator(mean, spread, w, least=0.5 * noise, floor=0.02 / noise) for w in weights],
        "bootstrap": [Bootstrap(drift, noise) for drift in drifts],
        "Gaussian sum": [_outliers(drift, noise) for drift in drifts],
    }


def _outliers(drift: float, noise: float) -> GaussianSum:
    """Measurements of two kinds: nine in ten good, one in ten three times as noisy."""
    both = MixturePrior([0.9, 0.1], [GaussianPrior(0.0, 0.8 * noise), GaussianPrior(0.0, 2.4 * noise)])
    return GaussianSum(GaussianPrior(0.0, drift), both)


def rmse(estimator: Estimator, runs: list[Measured], axis: int) -> Array:
    """RMSE against the operating point of each run (len(runs),)."""
    y = np.stack([run.measured[:, axis] for run in runs], axis=1)[..., None]
    wanted = np.stack([run.setpoint[:, axis] for run in runs], axis=1)
    return np.sqrt(np.mean((estimator.estimate(y)[..., 0] - wanted) ** 2, axis=0))


def study(settings: IonSettings | None = None) -> list[str]:
    """Markdown table: RMSE per track, parameter and estimator, tuned on other seeds, and the gain over the low-pass.

    Each estimator's one setting is tuned on both tracks together: at the wheel nobody knows which is being driven.
    """
    settings = settings or IonSettings()
    calibration = calibrate(settings)
    tuning = {name: [measure(name, seed, calibration, settings) for seed in range(5)] for name in TRACKS}
    judged = {name: [measure(name, seed, calibration, settings) for seed in SEEDS] for name in TRACKS}
    lines = [
        "| parameter | track | estimator | setting | RMSE [95 % of the mean] | less than the low-pass, % [95 %] |",
        "|---|---|---|---|---|---|",
    ]
    for axis, parameter in enumerate(PARAMETERS):
        rest = np.concatenate([run.measured - run.setpoint for run in tuning["steady"]])[:, axis]
        families = estimators(float(rest.std()), axis)
        best = {
            family: int(np.argmin([sum(rmse(one, runs, axis).mean() for runs in tuning.values()) for one in tried]))
            for family, tried in families.items()
        }
        for name, runs in judged.items():
            raw = [np.sqrt(np.mean((run.measured[:, axis] - run.setpoint[:, axis]) ** 2)) for run in runs]
            lines.append(f"| {parameter} | {name} | none | – | {_told(np.array(raw), 4)} | – |")
            base = rmse(families["low-pass"][best["low-pass"]], runs, axis)
            for family, tried in families.items():
                values = rmse(tried[best[family]], runs, axis)
                gain = "–" if family == "low-pass" else _told(100.0 * (1.0 - values / base), 1)
                lines.append(
                    f"| {parameter} | {name} | {family} | {FORGETTING[best[family]]:g} | {_told(values, 4)} | {gain} |"
                )
    return lines


def _told(values: Array, digits: int) -> str:
    found = interval(values)
    return f"{found.mean:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"


if __name__ == "__main__":
    print("\n".join(study()))
    print("\nAt 4000 rpm, where the coil's ringing covers the flame front:\n")
    print("\n".join(study(replace(IonSettings(), engine_speed=4000.0 * 2.0 * np.pi / 60.0))))
