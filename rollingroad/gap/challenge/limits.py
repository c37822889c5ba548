"""Detection limit of an effect on a case: three Cramer-Rao deviations of its size, what is not known of the car free.

Derivatives by finite differences of the generator's own car along the case's own drives. Channels and deviations of the
bound: fuel over 5 s (20 N of force error, 1 % and 100 W), force while coasting (40 N), receiver less wheel speed over
1 s (0.06 m/s). The errors are correlated; the information is divided by `CORRELATION` for that. Bounds of the box's
other sensors are closed forms of the default box's noise.

Free are the nominal parameters inside their tolerances, the wind of each trip, and the engine: nobody has disclosed its
map, so it is a free smooth surface that the case's reference trips show as well as they can (with tolerances of their
own). Without that the bound would credit a diagnosis with a map that it cannot have.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.challenge.cars import TOLERANCE, Car
from rollingroad.gap.challenge.effects import Effect, Settings
from rollingroad.gap.challenge.truth import along

CORRELATION = 3.0
BLOCK = 50
SHAPES = 4
"""Draws of a rival's shape (its place on the map, its direction, its times) that are tried."""
EARLY = 600.0
"""s: the first ten minutes of a trip."""
REGIMES = ("idle", "launch", "shift", "deceleration", "climb", "acceleration", "cruise", "moving")
TOLERANCES = ("mass", "rolling_resistance", "drag_area", "air_density", "fuel", "wheel_radius")
MAP_SPEEDS, MAP_LOADS = (120.0, 200.0, 280.0, 360.0, 450.0), (0.05, 0.25, 0.5, 0.75, 1.0)
MAP_FREEDOM = 0.06
"""Share of the fuel by which the map may differ from the declared engine's at each of its 25 places."""

Array = NDArray[np.float64]
Drive = dict[str, Array]


@dataclass(frozen=True)
class Bound:
    """What one case's drives can show: whitened nuisance columns of each log, and the information of all drives."""

    car: Car
    logs: tuple[Drive, ...]
    bases: tuple[Array, ...]
    sigmas: tuple[Array, ...]
    nuisances: tuple[Array, ...]
    """Per log (m, k)."""
    information: Array
    """(k, k), priors and references included."""
    references: int

    def limit(self, effect: Effect, other: bool, seed: int) -> float:
        """Return three deviations of the effect's size (infinite where the drives cannot show it)."""
        closed = _closed_form(effect.id, self.logs, self.references)
        if closed is not None:
            return closed
        left = self._information([self._columns(effect, other, seed)])[0, 0]
        return 3.0 / float(np.sqrt(left)) if left > 1e-12 else float("inf")

    def twins(self, effect: Effect, other: bool, seed: int, size: float, rivals: Sequence[Effect]) -> list[str]:
        """Ids of those `rivals` that could stand for `effect` at `size` on these drives: with the rival's own size free
        (of the signs it has), what is left of the effect's signal stays below its detection limit."""
        if _closed_form(effect.id, self.logs, self.references) is not None:
            return []
        own, out = self._columns(effect, other, seed), []
        for rival in rivals:
            if _closed_form(rival.id, self.logs, self.references) is not None:
                continue
            drawn = [rival.make(rival.step, False, np.random.default_rng(shape)) for shape in range(SHAPES)]
            for shape in range(1 if drawn[0] == drawn[1] else SHAPES):  # place on the map, times, directions
                both = self._information([own, self._columns(rival, False, shape)])
                if both[1, 1] * rival.largest**2 < 1e-9 or np.sign(both[0, 1]) * np.sign(size) not in rival.signs:
                    continue
                if size**2 * (both[0, 0] - both[0, 1] ** 2 / both[1, 1]) < 9.0:
                    out.append(rival.id)
                    break
        return out

    def _information(self, effects: Sequence[list[Array]]) -> Array:
        """(k, k): information on the sizes of `effects` (columns per log), all nuisance free."""
        own, cross = np.zeros((len(effects),) * 2), np.zeros((len(self.information), len(effects)))
        for columns, nuisance in zip(zip(*effects, strict=True), self.nuisances, strict=True):
            both = np.stack(columns, axis=1)
            own += both.T @ both / CORRELATION
            cross += nuisance.T @ both / CORRELATION
        return own - cross.T @ np.linalg.solve(self.information, cross)

    def regimes(self, effect: Effect, other: bool, seed: int) -> tuple[dict[str, float], float]:
        """Shares of the effect's whitened signal over REGIMES (what tolerances and wind swallow taken off), and the
        share within the first ten minutes."""
        shares, early = dict.fromkeys(REGIMES, 0.0), 0.0
        if _closed_form(effect.id, self.logs, self.references) is not None:
            return shares | {"moving": 1.0}, 0.0
        columns = self._columns(effect, other, seed)
        for column, nuisance, drive in zip(columns, self.nuisances, self.logs, strict=True):
            free = nuisance[:, : len(TOLERANCES) + 2 * len(self.logs)] / np.sqrt(CORRELATION)
            prior = np.diag(_prior(len(self.logs)))
            power = (column - free @ np.linalg.solve(free.T @ free + prior, free.T @ column)) ** 2
            names, time = _places(drive)
            for name in REGIMES:
                shares[name] += float(power[names == name].sum())
            early += float(power[time < EARLY].sum())
        total = sum(shares.values()) or 1.0
        return {name: share / total for name, share in shares.items()}, early / total

    def _columns(self, effect: Effect, other: bool, seed: int) -> list[Array]:
        settings = effect.make(effect.step, other, np.random.default_rng(seed))
        return [
            (_features(self.car, settings, drive) - base) / effect.step / sigma
            for drive, base, sigma in zip(self.logs, self.bases, self.sigmas, strict=True)
        ]


def bound(car: Car, logs: Sequence[Drive], references: Sequence[Drive] = ()) -> Bound:
    """Return the bound of a case from its neutral drives; without `references` the map is known."""
    count = len(logs) + len(references)
    own = len(TOLERANCES) + 2 * len(logs)
    free = 0 if not references else _engine(car, logs[0]).shape[1]
    apart = 0 if not references else len(TOLERANCES) + 2 * len(references)
    bases, sigmas, nuisances = [], [], []
    information = np.zeros((own + free + apart,) * 2)
    for number, drive in enumerate((*logs, *references)):
        sigma = _sigma(drive)
        base = _features(car, Settings(), drive)
        known, log = _tolerances(car, drive, base), number < len(logs)
        columns = np.zeros((len(base), own + free + apart))
        start, trip = (0, number) if log else (own + free, number - len(logs))
        columns[:, start : start + len(TOLERANCES)] = known[:, :-2]
        wind = start + len(TOLERANCES) + 2 * trip
        columns[:, wind : wind + 2] = known[:, -2:]
        if references:
            columns[:, own : own + free] = _engine(car, drive)
        columns /= sigma[:, None]
        information += columns.T @ columns / CORRELATION
        if log:
            bases.append(base)
            sigmas.append(sigma)
            nuisances.append(columns)
    prior = np.concatenate([_prior(len(logs)), np.ones(free), _prior(count - len(logs)) if references else []])
    return Bound(
        car, tuple(logs), tuple(bases), tuple(sigmas), tuple(nuisances), information + np.diag(prior), len(references)
    )


def detection_limit(
    effect: Effect, other: bool, seed: int, car: Car, logs: Sequence[Drive], references: Sequence[Drive] = ()
) -> float:
    """Return three deviations of the effect's size on `logs` (infinite where they cannot show it)."""
    return bound(car, logs, references).limit(effect, other, seed)


def _tolerances(car: Car, drive: Drive, base: Array) -> Array:
    """(m, 8): change per unit of each nominal parameter and of the wind's two components."""
    settings = [(Settings({name: 1.01}), 0.01) for name in ("mass", "crr", "cd_a", "rho")]
    settings += [(Settings(heat=0.99), 0.01), (Settings(box={"radius": 1.01}), 0.01)]
    settings += [(Settings({name: 1.0}), 1.0) for name in ("wind_n", "wind_e")]
    return np.stack([(_features(car, change, drive) - base) / step for change, step in settings], axis=1)


def _engine(car: Car, drive: Drive) -> Array:
    """(m, k): the freedom of an engine that nobody has disclosed, in units of its prior deviation."""
    burnt, w, load = drive["burnt"], drive["engine_speed"], drive["throttle"]
    firing, locked = burnt > 0, drive["clutch"] == 1
    moving = drive["speed"] > 0.3
    rows: list[tuple[NDArray[np.floating] | None, NDArray[np.floating] | None]] = []
    for speed in MAP_SPEEDS:
        for share in MAP_LOADS:
            place = np.exp(-0.5 * ((w - speed) / 60.0) ** 2 - 0.5 * ((load - share) / 0.18) ** 2)
            rows.append((burnt * locked * place * MAP_FREEDOM, None))
    for gear in range(1, len(car.ratios) + 1):
        rows.append((burnt * locked * (drive["gear"] == gear) * 0.02, None))
    rows.append((burnt * ~locked * ~moving * 0.15, None))
    rows.append((burnt * ~locked * moving * 0.2, None))
    coasting = ~firing & (drive["brake"] <= 0)
    lever = np.asarray(car.ratios)[np.maximum(drive["gear"], 1).astype(int) - 1] / car.true["radius"]
    rows += [(None, lever * (w / 250.0) ** power * coasting * sd) for power, sd in ((0, 6.0), (1, 4.0))]
    rows.append((None, 25.0 * coasting))
    zero = np.zeros(len(burnt))
    rest = np.zeros(len(burnt) // 10)
    return np.stack(
        [np.concatenate([_means(zero if f is None else f), _means(zero if c is None else c), rest]) for f, c in rows],
        axis=1,
    )


def _prior(trips: int) -> Array:
    return np.array([3.0 / TOLERANCE[n] ** 2 for n in TOLERANCES] + [3.0 / TOLERANCE["wind"] ** 2] * (2 * trips))


def _means(x: NDArray[np.floating]) -> Array:
    n = len(x) // BLOCK
    return x[: n * BLOCK].reshape(n, BLOCK).mean(axis=1)


def _features(car: Car, settings: Settings, drive: Drive) -> Array:
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


def _sigma(drive: Drive) -> Array:
    v, burnt = _means(drive["speed"]), _means(drive["burnt"])
    open_clutch = _means((drive["clutch"] < 1).astype(float) * (drive["speed"] > 0.3))
    fuel = np.sqrt((20.0 * 2.7 * v) ** 2 + (0.01 * burnt) ** 2 + 100.0**2) * np.where(open_clutch > 0.2, 4.0, 1.0)
    share = _means(((drive["burnt"] <= 0) & (drive["brake"] <= 0)).astype(float))
    coast = np.where(share > 0.2, 40.0, 1e9)
    n = len(drive["speed"]) // 10
    moving = drive["speed"][: n * 10].reshape(n, 10).min(axis=1) > 3.0
    return np.concatenate([fuel, coast, np.where(moving, 0.06, 1e9)])


def _places(drive: Drive) -> tuple[NDArray[np.str_], Array]:
    """Name of the regime and time (s) of each row of `_features`."""
    v, clutch = drive["speed"], drive["clutch"]
    samples = np.select(
        [
            (clutch < 1) & (v < 0.3), (clutch == 0.5), clutch < 1, drive["burnt"] <= 0, drive["pitch"] > 0.02,
            drive["acceleration"] > 0.35,
        ],
        [0, 1, 2, 3, 4, 5], 6,
    )  # fmt: skip
    n = len(samples) // BLOCK
    blocks = samples[: n * BLOCK].reshape(n, BLOCK)
    fuel = np.array([np.bincount(row, minlength=7).argmax() for row in blocks], int)
    rest = len(samples) // 10
    names = np.array(REGIMES)
    kinds = np.concatenate([names[fuel], np.full(n, "deceleration"), np.full(rest, "moving")])
    step = 0.1
    middle = (np.arange(n) + 0.5) * BLOCK * step
    return kinds, np.concatenate([middle, middle, (np.arange(rest) + 0.5) * 10 * step])


def _closed_form(effect: str, logs: Sequence[Mapping[str, Array]], references: int) -> float | None:
    trips = len(logs)
    lengths = np.array([d["s"][-1] for d in logs])
    altitude = 3.5 * np.sqrt(12.0 / 4.0) / lengths * 2.0
    if effect == "clock_skew":
        return 3.0 * 12e-6 / np.sqrt(trips)
    if effect == "accelerometer_mount":  # receiver's altitude over the trip, and the bias' change from trip to trip
        each = np.hypot(altitude, 0.012 / 9.805)
        before = float(np.mean(each)) ** 2 / references if references else 0.0
        return 3.0 * float(np.sqrt(1.0 / np.sum(each**-2.0) + before))
    if effect == "grade_map_error":
        return 3.0 / float(np.sqrt(np.sum(altitude**-2.0)))
    return None
