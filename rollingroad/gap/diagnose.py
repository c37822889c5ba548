"""The diagnosis: logs of a real car in, where the gap lies, which effect causes it and how far it shrinks out."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from rollingroad.gap import evidence
from rollingroad.gap.blocks import prepare
from rollingroad.gap.calibration import Calibration, Reduced, calibrate, doubted, reduce
from rollingroad.gap.door import read_road, read_trips, split_restarts
from rollingroad.gap.evidence import Posterior
from rollingroad.gap.fits import fit
from rollingroad.gap.identify import unseen
from rollingroad.gap.plausible import check
from rollingroad.gap.reconstruct import reconstruct
from rollingroad.gap.refit import refit
from rollingroad.gap.regret import regret
from rollingroad.gap.replay import vector_of
from rollingroad.gap.result import as_json
from rollingroad.gap.road import Road
from rollingroad.gap.shrinkage import Shrinkage, leading, shrink
from rollingroad.gap.thresholds import load as load_thresholds
from rollingroad.gap.trips import Layout, Lexicon, Trip, columns_of, layout_of, marginal_gram, total_gram, whiten
from rollingroad.gap.where import EARLY, Place, locate
from rollingroad.gap.without_reference import foreign_floor, without_reference
from sensors.log import SensorLog
from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car
from vehicle_model.car.parameters import Car


@dataclass(frozen=True)
class Restart:
    """A start after a rest within one log against the first start: `scale` of that one's effect, with deviation."""

    name: str
    rest_s: float
    effect: str
    probability: float
    """Of the effect being there again, against nothing."""
    scale: float
    scale_sd: float


@dataclass(frozen=True)
class Diagnosis:
    """Everything that was found: the JSON's content, and what a report draws."""

    car: Car
    reference: tuple[Trip, ...]
    logs: tuple[Trip, ...]
    lexicon: Lexicon
    layout: Layout
    calibration: Calibration
    reduced: Reduced
    posterior: Posterior
    where: tuple[Place, ...]
    shrinkage: Shrinkage
    not_testable: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    coarse: bool
    hidden: tuple[str, ...]
    detected_after_km: float | None
    """Distance of the diagnosed trips, in order, after which "none" first loses for good."""
    control: dict[str, float]
    restarts: tuple[Restart | None, ...] = ()
    advice_regret: tuple[float | None, float | None] = (None, None)
    """Fuel, percent, that a plan wastes for want of the leading effect: without it, and with it (held out)."""


def diagnose(
    car_path: Path,
    logs_dir: Path,
    reference_dir: Path | None = None,
    road: Path | None = None,
    hide: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the object of `diagnose --json` (CLI.md). Raises BadInput for unusable input."""
    return as_json(investigate(car_path, logs_dir, reference_dir, road, hide))


def investigate(
    car_path: Path, logs_dir: Path, reference_dir: Path | None = None, road: Path | None = None, hide: Sequence[str]
    = (),
    *, workers: int = 1,
) -> Diagnosis:  # fmt: skip
    """Read, compare, weigh. `workers` processes share the trips."""
    car = read_car(Path(car_path))
    logs, notes = read_trips(Path(logs_dir))
    references, more = read_trips(Path(reference_dir)) if reference_dir is not None else ([], [])
    folders = [Path(logs_dir), *([Path(reference_dir)] if reference_dir else []), Path(car_path).parent]
    ways, told = read_road(road, folders)
    pieces = [piece for log in logs for piece in split_restarts(log)]
    warm = [piece for piece in pieces if piece[0] > 0.0]
    references = [log for reference in references for _, log in split_restarts(reference)]
    first = [log for rest, log in pieces if rest == 0.0]
    found = weigh(car, first, references, ways, hide, notes=[*notes, *more, *told], workers=workers)
    return replace(found, restarts=tuple(_restart(found, rest, log, ways) for rest, log in warm))


def _restart(d: Diagnosis, rest: float, log: SensorLog, road: Road | None) -> Restart | None:
    """The restart after `rest` s, under the same calibration, given what the car's first start was found to have."""
    known = {effect: p for effect, p in d.posterior.singles.items()}
    for pair, p in d.posterior.pairs.items():
        for effect in pair:
            known[effect] = known.get(effect, 0.0) + p
    if not known or d.posterior.none >= 0.5:
        return None
    effect = max(known, key=lambda e: known[e])
    correction = dict(zip(d.layout.calibration, d.calibration.mean, strict=True))
    trip, _ = _one((log, d.car, road, correction))
    if trip is None:
        return None
    with threadpool_limits(1):
        gram = whiten(trip, d.layout, d.calibration.noise).gram
        reduced = reduce(gram, d.layout, d.calibration)
        variant, before = d.posterior.fits[effect]
        index = d.lexicon.index_of(variant)
        # the first start's course, scaled: one coefficient, 1 as large as then
        direction = before.value
        information = float(direction @ reduced.information[np.ix_(index, index)] @ direction)
        score = float(direction @ reduced.vector[index])
        scaled = 1.0 + information * 0.5**2
        log_bayes = 0.5 * score**2 * 0.5**2 / scaled - 0.5 * np.log(scaled)
    probability = float(1.0 / (1.0 + np.exp(-log_bayes)))
    return Restart(log.name, rest, effect, probability, score * 0.25 / scaled, float(0.5 / np.sqrt(scaled)))


def weigh(
    car: Car, logs: Sequence[SensorLog], references: Sequence[SensorLog], road: Road | None, hide: Sequence[str] = (),
    *, notes: Sequence[str] = (), workers: int = 1,
) -> Diagnosis:  # fmt: skip
    """The diagnosis of logs in memory."""
    lexicon = Lexicon.of(car)
    known = {v.effect for v in lexicon.variants} | set(NEVER)
    for effect in hide:
        if effect not in known and not effect.startswith("novel"):
            raise BadInput("--hide", effect, f"one of {', '.join(sorted(known))}")
    thresholds = load_thresholds()
    with threadpool_limits(1):
        jobs = [(log, car, road, None) for log in references]
        before, bad = _columns(jobs, workers)
        coarse = False
        reference = [t for t in before if t is not None]
        if reference:
            layout = layout_of(reference)
            coarse = not np.isfinite(reference[0].p.trace.engine_speed).any()
            calibration = calibrate(reference, layout, lexicon, coarse=coarse)
            correction = dict(zip(layout.calibration, calibration.mean, strict=True))
        else:
            correction = None
        found, more = _columns([(log, car, road, correction) for log in logs], workers)
        trips = [t for t in found if t is not None]
        notes = [*notes, *bad, *more]
        if not trips:
            raise BadInput(
                "--logs", "", "at least one trip of 45 s with speed; " + "; ".join(more or ["none was readable"])
            )
        coarse = not np.isfinite(trips[0].p.trace.engine_speed).any()
        both = layout_of([*reference, *trips])
        if not reference or both.calibration != layout.calibration or both.tolerance != layout.tolerance:
            calibration = calibrate(reference, both, lexicon, coarse=coarse)
        layout = both
        if not reference:
            calibration, told = without_reference(trips, layout, lexicon, hide, thresholds, coarse)
            notes += told
            if told:
                thresholds = replace(thresholds, floor={**thresholds.floor, **foreign_floor(lexicon)})
        trips, whitened = doubted(trips, layout, calibration, coarse=coarse)
        gram = total_gram(whitened)
        reduced = reduce(gram, layout, calibration)
        posterior = evidence.posterior(reduced, lexicon, layout, hide, thresholds)
        for _ in range(REFITS if posterior.none < 0.9 else 0):
            trips, whitened = refit(trips, whitened, layout, calibration, lexicon, posterior, car)
            gram = total_gram(whitened)
            reduced = reduce(gram, layout, calibration)
            posterior = evidence.posterior(reduced, lexicon, layout, hide, thresholds)
        where = locate(trips, whitened, layout, calibration, posterior, lexicon, reduced)
        early = EARLY if where and where[0].regime == "first_600_s" else None
        shrinkage = shrink(
            trips, whitened, reference, layout, calibration, posterior, lexicon, hide, until=early, coarse=coarse
        )
        waste = regret(trips, whitened, layout, calibration, lexicon, posterior, leading(posterior), car)
        dumb = unseen(trips, reduced, lexicon, coarse)
        delay = _delay(trips, whitened, layout, calibration, lexicon, hide, thresholds)
        control = _controls(trips, whitened, layout, calibration, lexicon, posterior)
    return Diagnosis(
        car, tuple(reference), tuple(trips), lexicon, layout, calibration, reduced, posterior, tuple(where), shrinkage,
        tuple(dumb), tuple(notes), coarse, tuple(hide), delay, control, advice_regret=waste,
    )  # fmt: skip


def _delay(trips, whitened, layout, calibration, lexicon, hide, thresholds) -> float | None:
    total, driven, since = np.zeros_like(whitened[0].gram), 0.0, None
    for trip, w in zip(trips, whitened, strict=True):
        total = total + w.gram
        driven += float(trip.p.samples.motion.distance[-1]) / 1e3
        # pairs are left out: their prior is small, and with a single that detects first they decide nothing
        h = evidence.hypotheses(reduce(total, layout, calibration), lexicon, layout, hide, thresholds, pairs=False)
        found = evidence.weighed(h, thresholds).none < 0.5
        since = (since if since is not None else driven) if found else None
    return since


def _controls(trips, whitened, layout, calibration, lexicon, posterior) -> dict[str, float]:
    """Evidence that is left when the leading signature is put against the wrong data: shuffled blocks, another trip."""
    if not posterior.fits:
        return {}
    leading = max(posterior.singles, key=lambda e: posterior.singles[e])
    variant = posterior.fits[leading][0]
    index = lexicon.index_of(variant)
    own = posterior.fits[leading][1].log_bayes
    rng = np.random.default_rng(0)
    out = {}
    for name in ("shuffled_none", "other_trip_explained"):
        gram = np.zeros_like(whitened[0].gram)
        for number, (trip, w) in enumerate(zip(trips, whitened, strict=True)):
            rows = w.rows.copy()
            columns = layout.nuisance + index
            channel = trip.p.layout.channel
            for one in np.unique(channel):
                at = np.flatnonzero(channel == one)
                if name == "shuffled_none":
                    rows[np.ix_(at, columns)] = rows[np.ix_(rng.permutation(at), columns)]
                else:
                    other = (number + 1) % len(trips)
                    far = np.flatnonzero(trips[other].p.layout.channel == one)
                    if len(far):
                        take = far[np.linspace(0, len(far) - 1, len(at)).astype(int)][:: -1 if other == number else 1]
                        rows[np.ix_(at, columns)] = whitened[other].rows[np.ix_(take, columns)]
            gram += marginal_gram(rows, w.own, w.own_sd)
        r = reduce(gram, layout, calibration)
        out[name] = fit(r, index, lexicon.sd[index]).log_bayes / max(own, 1.0)
    return out


REFITS = 2
"""Re-simulations of the leading hypotheses."""
SHORTEST = 45.0
"""s: what a trip must last to be compared at all."""
NEVER: Mapping[str, str] = {
    "turbo_lag": "no throttle position in the logs",
    "driver_lag": "no advice in the logs",
    "traffic_actuation": "no distance to the leader in the logs",
}
"""Effects that these logs cannot show, and why."""


def _columns(
    jobs: Sequence[tuple[SensorLog, Car, Road | None, Mapping[str, float] | None]], workers: int
) -> tuple[list[Trip | None], list[str]]:
    if workers > 1 and len(jobs) > 1:
        with ProcessPoolExecutor(workers) as pool:
            rows = list(pool.map(_one, jobs))
    else:
        rows = [_one(job) for job in jobs]
    return [row for row, _ in rows], [note for _, note in rows if note]


def _one(job: tuple[SensorLog, Car, Road | None, Mapping[str, float] | None]) -> tuple[Trip | None, str]:
    """One trip's columns; None and the reason where it cannot be used."""
    log, car, road, correction = job
    with threadpool_limits(1):
        vector = vector_of(car)
        lexicon = Lexicon.of(car)
        trace = reconstruct(log, car, road)
        if trace.time[-1] - trace.time[0] < SHORTEST:
            return (
                None,
                f"{log.name}: {trace.time[-1] - trace.time[0]:.0f} s, too short to tell anything "
                f"({SHORTEST:.0f} s are needed)",
            )
        told = check(log, trace, car)
        p = prepare(trace, car, vector)
        if not len(p.layout.time):
            return None, f"{log.name}: nothing to compare (no fuel and no second speed)"
        coarse = not np.isfinite(trace.engine_speed).any()
        return columns_of(p, car, vector, lexicon, coarse=coarse, correction=correction), "; ".join(told)
