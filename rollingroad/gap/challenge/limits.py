"""Detection limit of an effect on a case: three Cramer-Rao deviations of its size, the nominal parameters free.

Derivatives by finite differences of the generator's own car along the case's own drives. Channels and deviations of the
bound: fuel over 5 s (20 N of force error, 1 % and 100 W), force while coasting (40 N), receiver less wheel speed over
1 s (0.06 m/s). The errors are correlated; the information is divided by `CORRELATION` for that. Bounds of the box's
other sensors are closed forms of the default box's noise.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.challenge.cars import TOLERANCE, Car
from rollingroad.gap.challenge.effects import Effect, Settings
from rollingroad.gap.challenge.truth import along

CORRELATION = 3.0
BLOCK = 50


def detection_limit(effect: Effect, other: bool, seed: int, car: Car, drives: Sequence[dict[str, NDArray]]) -> float:
    """Return three deviations of the effect's size on `drives` (infinite where they cannot show it)."""
    closed = _closed_form(effect.id, drives)
    if closed is not None:
        return closed
    rows, prior = [], _prior(len(drives))
    for number, drive in enumerate(drives):
        sigma = _sigma(drive)
        base = _features(car, Settings(), drive)
        columns = [
            (_features(car, effect.make(effect.step, other, np.random.default_rng(seed)), drive) - base) / effect.step
        ]
        for name in ("mass", "crr", "cd_a", "rho"):
            columns.append((_features(car, Settings({name: 1.01}), drive) - base) / 0.01)
        columns.append((_features(car, Settings(heat=0.99), drive) - base) / 0.01)
        columns.append((_features(car, Settings(box={"radius": 1.01}), drive) - base) / 0.01)
        for other_trip in range(len(drives)):
            for wind in ("wind_n", "wind_e"):
                own = (
                    (_features(car, Settings({wind: 1.0}), drive) - base)
                    if other_trip == number
                    else np.zeros_like(base)
                )
                columns.append(own)
        rows.append(np.stack(columns, axis=1) / sigma[:, None])
    j = np.concatenate(rows)
    information = j.T @ j / CORRELATION + np.diag(prior)
    if information[0, 0] < 1e-12:
        return float("inf")
    return 3.0 * float(np.sqrt(np.linalg.inv(information)[0, 0]))


def _prior(trips: int) -> NDArray:
    limits = [TOLERANCE[n] for n in ("mass", "rolling_resistance", "drag_area", "air_density", "fuel", "wheel_radius")]
    return np.array([0.0] + [3.0 / d**2 for d in limits] + [3.0 / TOLERANCE["wind"] ** 2] * (2 * trips))


def _means(x: NDArray) -> NDArray:
    n = len(x) // BLOCK
    return x[: n * BLOCK].reshape(n, BLOCK).mean(axis=1)


def _features(car: Car, settings: Settings, drive: dict[str, NDArray]) -> NDArray:
    fuel, coast = along(car.true, car.ratios, settings.truth, drive)
    flow = settings.box.get("flow", 1.0)
    measured = fuel / settings.heat / flow
    dead = settings.box.get("dead_time", 0.0)
    rotation = drive["engine_speed"] / (4 * np.pi)
    firing = drive["burnt"] > 0
    measured = measured + firing * rotation * dead * car.box["flow"] * 1e-3 * 745.0 * 43e6
    ratio = (1.0 + settings.box.get("slip", 0.0) * drive["thrust"]) / settings.box.get("radius", 1.0)
    lag = settings.box.get("gps_lag", 0.2) - 0.2
    gnss = drive["speed"] * (1.0 - ratio) - lag * drive["acceleration"]
    n = len(gnss) // 10
    coasting = (drive["burnt"] <= 0) & (drive["brake"] <= 0)
    return np.concatenate([_means(measured), _means(coast * coasting), gnss[: n * 10].reshape(n, 10).mean(axis=1)])


def _sigma(drive: dict[str, NDArray]) -> NDArray:
    v, burnt = _means(drive["speed"]), _means(drive["burnt"])
    open_clutch = _means((drive["clutch"] < 1).astype(float) * (drive["speed"] > 0.3))
    fuel = np.sqrt((20.0 * 2.7 * v) ** 2 + (0.01 * burnt) ** 2 + 100.0**2) * np.where(open_clutch > 0.2, 4.0, 1.0)
    share = _means(((drive["burnt"] <= 0) & (drive["brake"] <= 0)).astype(float))
    coast = np.where(share > 0.2, 40.0, 1e9)
    n = len(drive["speed"]) // 10
    moving = drive["speed"][: n * 10].reshape(n, 10).min(axis=1) > 3.0
    return np.concatenate([fuel, coast, np.where(moving, 0.06, 1e9)])


def _closed_form(effect: str, drives: Sequence[dict[str, NDArray]]) -> float | None:
    trips = len(drives)
    lengths = np.array([d["s"][-1] for d in drives])
    if effect == "clock_skew":
        return 3.0 * 12e-6 / np.sqrt(trips)
    if effect == "accelerometer_mount":  # receiver's altitude over the trip, and the bias' change from trip to trip
        each = np.hypot(3.5 * np.sqrt(12.0 / 4.0) / lengths * 2.0, 0.012 / 9.805)
        return 3.0 / np.sqrt(np.sum(each**-2.0))
    if effect == "grade_map_error":
        each = 3.5 * np.sqrt(12.0 / 4.0) / lengths * 2.0
        return 3.0 / np.sqrt(np.sum(each**-2.0))
    return None
