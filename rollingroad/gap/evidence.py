"""Evidence for each hypothesis: nothing, one effect, two, or something that the catalogue does not hold.

Linear and Gaussian throughout, after the signatures: with whitened residuals y, nuisance columns N (map, tolerances,
weather) of known prior and effect columns S of prior deviation s, the evidence is closed form. Everything needed is in
one Gram matrix per trip, so that held-out trips, pairs and cross-validation are sums of small matrices.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from rollingroad.gap import generic, signatures
from rollingroad.gap.channels import CHANNELS, REGIMES, Prepared, block_means, values
from rollingroad.gap.design import (
    FUEL,
    LONGER,
    Columns,
    Noise,
    calibration_columns,
    default_noise,
    log_likelihood,
    map_correction,
    tolerance_columns,
    trip_columns,
    whitener,
)
from rollingroad.gap.replay import replay_vector
from rollingroad.gap.signatures import Column, Context, Variant
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trip:
    """One trip's columns over its blocks, not yet whitened."""

    p: Prepared
    y: Array
    calibration: Columns
    tolerance: Columns
    own: Columns
    effects: Array
    generic: Array


@dataclass(frozen=True)
class Library:
    """What may be named: variants and regressors, and where their columns stand."""

    variants: tuple[Variant, ...]
    regressors: tuple[generic.Regressor, ...]

    @classmethod
    def of(cls, car: Car) -> "Library":
        """Everything that may be named for `car`."""
        return cls(tuple(signatures.variants(car)), tuple(generic.library(car)))

    @property
    def places(self) -> list[slice]:
        """Columns of each variant within the effects' block."""
        ends = np.cumsum([0] + [len(v.columns) for v in self.variants])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    @property
    def sd(self) -> Array:
        """Prior deviation of every effect column."""
        return np.array([c.sd for v in self.variants for c in v.columns])


def columns_of(
    p: Prepared,
    car: Car,
    vector: Array,
    library: Library,
    *,
    coarse: bool,
    correction: Mapping[str, float] | None = None,
) -> Trip:
    """Compute every column of one trip: the costly part. `correction` are the calibration's coefficients by name."""
    base = values(p, car, vector)
    calibration = calibration_columns(p, car, vector)
    nominal = block_means(p, "fuel_power", replay_vector(vector, p.samples.motion).fuel)
    burnt = nominal
    if correction:
        known = np.array([correction.get(name, 0.0) for name in calibration.names])
        burnt = burnt + (calibration.matrix @ known) * (p.layout.channel == FUEL)
    slope = map_correction(car, correction) if correction else None
    context = Context(p, car, vector, base, np.maximum(burnt, 0.0), slope)
    effects = [v.make(context) for v in library.variants]
    regressors = generic.columns(context)
    # what is fitted to the references must mean the same in the diagnosed trips: never the corrected simulator
    plain = generic.columns(Context(p, car, vector, base, np.maximum(nominal, 0.0))) if correction else regressors
    state = [
        (f"state.{g.name}", plain[:, i], 0.5 * g.sd)
        for i, g in enumerate(library.regressors)
        if g.name in generic.STATE
    ]
    more = Columns.of(state, len(base))
    calibration = Columns(
        calibration.names + more.names, np.concatenate([calibration.matrix, more.matrix], axis=1),
        np.concatenate([calibration.sd, more.sd]),
    )  # fmt: skip
    return Trip(
        p, base, calibration, tolerance_columns(p, car, vector, context.fuel, slope),
        trip_columns(p, car, vector, context.fuel, coarse, slope), np.concatenate(effects, axis=1), regressors,
    )  # fmt: skip


@dataclass(frozen=True)
class Layout:
    """Order of the shared columns of a Gram matrix; the residual itself is the last."""

    calibration: tuple[str, ...]
    calibration_sd: Array
    tolerance: tuple[str, ...]
    tolerance_sd: Array
    effects: int
    generics: int

    @property
    def nuisance(self) -> int:
        """Number of nuisance columns; they stand first."""
        return len(self.calibration) + len(self.tolerance)


def layout_of(trips: Sequence[Trip]) -> Layout:
    """The union of the trips' column names, in order."""

    def union(kind: str) -> tuple[tuple[str, ...], Array]:
        seen: dict[str, float] = {}
        for trip in trips:
            columns: Columns = getattr(trip, kind)
            for name, sd in zip(columns.names, columns.sd, strict=True):
                seen.setdefault(name, float(sd))
        return tuple(seen), np.array(list(seen.values()))

    names, sd = union("calibration")
    tolerance, tolerance_sd = union("tolerance")
    return Layout(names, sd, tolerance, tolerance_sd, trips[0].effects.shape[1], trips[0].generic.shape[1])


def stack(trip: Trip, layout: Layout) -> Array:
    """All shared columns and the residual, (m, K + 1)."""

    def placed(columns: Columns, names: tuple[str, ...]) -> Array:
        out = np.zeros((len(trip.y), len(names)))
        index = [names.index(name) for name in columns.names]
        out[:, index] = columns.matrix
        return out

    return np.concatenate(
        [
            placed(trip.calibration, layout.calibration), placed(trip.tolerance, layout.tolerance), trip.effects,
            trip.generic, trip.y[:, None],
        ],
        axis=1,
    )  # fmt: skip


@dataclass(frozen=True)
class Whitened:
    """A trip in units of its noise, its own nuisance projected out of `gram` (K + 1, K + 1)."""

    rows: Array
    own: Array
    own_sd: Array
    gram: Array
    apply: Callable[[Array], Array]
    """The whitening itself, for further columns."""


def marginal_gram(rows: Array, own: Array, own_sd: Array) -> Array:
    """Gram matrix of `rows` with the trip's own columns marginalised."""
    scaled = own * own_sd
    middle = np.linalg.inv(np.eye(scaled.shape[1]) + scaled.T @ scaled)
    cross = scaled.T @ rows
    return rows.T @ rows - cross.T @ middle @ cross


def whiten(trip: Trip, layout: Layout, noise: Noise) -> Whitened:
    """Whiten one trip and marginalise what it alone may have."""
    apply = whitener(trip.p, noise)
    both = apply(np.concatenate([stack(trip, layout), trip.own.matrix], axis=1))
    rows, own = both[:, : -trip.own.matrix.shape[1] or None], both[:, both.shape[1] - trip.own.matrix.shape[1] :]
    return Whitened(rows, own, trip.own.sd, marginal_gram(rows, own, trip.own.sd), apply)


ODD = 4.0
"""Robust deviations of its kind beyond which a block is an accident: a stalled launch, a foot on the brake."""
ACCIDENTS = (
    ("fuel_power", "launch"), ("fuel_power", "open"), ("fuel_power", "overrun"), ("coast_force", None),
    ("gear_ratio", None),
    ("launch_speed", None), ("shift_time", None), ("gnss_speed", None),
)  # fmt: skip
"""Channels and regimes in which accidents happen: a cut-off that comes late, for one. (Fuel in gear and at idle has
none; what is odd there is a gap.)"""


FEW = 5
"""Blocks of a kind below which an accident and an effect look the same, and neither is concluded from."""


def tamed(trips: Sequence[Trip], residuals: Sequence[Array]) -> list[Trip]:
    """`trips` with the accidents among their blocks doubted: their deviation is raised to what they are off by.

    `residuals` (m,) whitened, of each trip. An effect moves many blocks of its kind, over all trips, and raises their
    robust deviation with them.
    """
    sigmas = [trip.p.layout.sigma.copy() for trip in trips]
    for channel, regime in ACCIDENTS:
        kinds = [trip.p.layout.channel == CHANNELS.index(channel) for trip in trips]
        if regime is not None:
            kinds = [k & (t.p.layout.regime == REGIMES.index(regime)) for k, t in zip(kinds, trips, strict=True)]
        pooled = np.abs(np.concatenate([r[kind] for r, kind in zip(residuals, kinds, strict=True)]))
        usual = max(1.0, 1.48 * float(np.median(pooled))) if len(pooled) >= FEW else 1.0
        for sigma, residual, kind in zip(sigmas, residuals, kinds, strict=True):
            size = np.abs(residual[kind])
            sigma[kind] *= np.where(size > ODD * usual, size / (1.5 * usual), 1.0)
    return [
        replace(trip, p=replace(trip.p, layout=replace(trip.p.layout, sigma=sigma)))
        for trip, sigma in zip(trips, sigmas, strict=True)
    ]


def unexplained(w: Whitened, layout: Layout, calibration: "Calibration") -> Array:
    """Whitened residual with the calibration taken off and the trip's own and the tolerances fitted away."""
    c, n = len(layout.calibration), layout.nuisance
    own = np.concatenate([w.rows[:, c:n] * layout.tolerance_sd, w.own * w.own_sd], axis=1)
    left = w.rows[:, -1] - w.rows[:, :c] @ calibration.mean
    return left - own @ np.linalg.solve(np.eye(own.shape[1]) + own.T @ own, own.T @ left)


@dataclass(frozen=True)
class Calibration:
    """What the reference trips say of the calibration columns: information matrix and vector, and the noise."""

    information: Array
    vector: Array
    noise: Noise
    dispersion: float
    trips: int

    @property
    def mean(self) -> Array:
        """Posterior mean of the calibration's coefficients."""
        return np.asarray(np.linalg.solve(self.information, self.vector), float)


def _information(gram: Array, layout: Layout, scale: float = 1.0) -> tuple[Array, Array]:
    """Information on the calibration, tolerances marginalised."""
    n, c = layout.nuisance, len(layout.calibration)
    prior = np.concatenate([(layout.calibration_sd * scale) ** -2.0, layout.tolerance_sd**-2.0])
    a = gram[:n, :n] + np.diag(prior)
    b = gram[:n, -1]
    inner = np.linalg.inv(a[c:, c:])
    return a[:c, :c] - a[:c, c:] @ inner @ a[c:, :c], b[:c] - a[:c, c:] @ inner @ b[c:]


def doubted(
    trips: Sequence[Trip], layout: Layout, calibration: Calibration, *, coarse: bool
) -> tuple[list[Trip], list[Whitened]]:
    """The diagnosed trips whitened, their accidents doubted first (`coarse` logs have too few blocks to tell one)."""
    done = [whiten(trip, layout, calibration.noise) for trip in trips]
    if coarse:
        return list(trips), done
    out = tamed(trips, [unexplained(w, layout, calibration) for w in done])
    again = [
        w if np.array_equal(new.p.layout.sigma, old.p.layout.sigma) else whiten(new, layout, calibration.noise)
        for new, old, w in zip(out, trips, done, strict=True)
    ]
    return out, again


FREEDOM = (0.12, 0.4, 1.0, 2.5)
"""Without reference trips: shares of the correction's freedom that are tried. The least takes the simulator's own map
for the car's; the most lets these very trips draw the map, and then little of the fuel is left to be explained."""
KEPT = ("bias_x", "gnss.lag", "gnss.scale", "launch_speed.offset", "shift_time.offset", "squat")
"""Calibration columns of the box and of the driver's habits, which are free without references too."""


def calibrate(
    reference: Sequence[Trip], layout: Layout, library: Library, *, coarse: bool = False, freedom: float = FREEDOM[0]
) -> Calibration:
    """Fit the correction to the reference trips, and the noise to what each leaves when the others predict it.

    `coarse`: logs of speed and fuel alone. One such trip is no measure of another's map (a town cycle says nothing of
    full load), so there the noise is what the references leave of themselves, and never less than the declared
    repeatability. `freedom` of the correction where there is no reference.
    """
    noise = default_noise()
    if not reference:
        free = np.array([1.0 if name in KEPT or name.startswith("launch") else freedom for name in layout.calibration])
        sd = layout.calibration_sd * free
        return Calibration(np.diag(sd**-2.0), np.zeros(len(sd)), noise, 1.3, 0)
    for _ in range(2):
        done = [whiten(trip, layout, noise) for trip in reference]
        if len(done) > 1 or coarse:
            noise = _rescaled(noise, reference, done, layout, leave_out=not coarse)
        if not coarse:
            total = sum((w.gram for w in done), np.zeros_like(done[0].gram))
            known = Calibration(*_information(total, layout), noise, 1.0, len(reference))
            reference = tamed(reference, [unexplained(w, layout, known) for w in done])
    done = [whiten(trip, layout, noise) for trip in reference]
    total = sum((w.gram for w in done), np.zeros_like(done[0].gram))
    information, vector = _information(total, layout)
    dispersion = 1.0 if coarse else _dispersion(done, layout, library)
    return Calibration(information, vector, noise, dispersion, len(reference))


def _rescaled(
    noise: Noise, trips: Sequence[Trip], done: Sequence[Whitened], layout: Layout, *, leave_out: bool
) -> Noise:
    """Noise scales from leave-one-trip-out residuals, drawn towards the first idea where blocks are few."""
    total = sum((w.gram for w in done), np.zeros_like(done[0].gram))
    n = layout.nuisance
    squares, counts = np.zeros_like(noise.scale), np.zeros_like(noise.scale)
    plain: list[Array] = []
    for trip, w in zip(trips, done, strict=True):
        information, vector = _information(total - w.gram if leave_out else total, layout)
        c = len(layout.calibration)
        # tolerances and the trip's own are fitted to the left-out trip itself
        own = np.concatenate([w.rows[:, c:n] * layout.tolerance_sd, w.own * w.own_sd], axis=1)
        mean = np.linalg.solve(information, vector)
        left = w.rows[:, -1] - w.rows[:, :c] @ mean
        free = np.linalg.solve(np.eye(own.shape[1]) + own.T @ own, own.T @ left)
        residual = np.clip(left - own @ free, -5.0, 5.0)
        rows = stack(trip, layout)
        known = np.concatenate([rows[:, c:n] * layout.tolerance_sd, trip.own.matrix * trip.own.sd], axis=1)
        plain.append((rows[:, -1] - rows[:, :c] @ mean - known @ free) / trip.p.layout.sigma)
        np.add.at(squares, (trip.p.layout.channel, trip.p.layout.regime), residual**2)
        np.add.at(counts, (trip.p.layout.channel, trip.p.layout.regime), 1.0)
    weight = 10.0
    if not leave_out:  # degrees of freedom that the correction took
        counts = np.maximum(counts - 25.0 * counts / max(counts.sum(), 1.0), 0.3 * counts)
    scale = np.sqrt((squares + weight) / (counts + weight))
    scale = noise.scale * np.clip(scale, 0.4, 4.0)
    return _correlated(Noise(scale, noise.correlated, noise.time), trips, plain) if leave_out else Noise(
        scale, noise.correlated, noise.time)  # fmt: skip


PLAIN = 3.0
"""Log units by which a longer correlation must be likelier than the default's."""


def _correlated(noise: Noise, trips: Sequence[Trip], plain: Sequence[Array]) -> Noise:
    """`noise` with the correlation that the fuel's errors at idle and in gear show: a fan or an alternator that comes
    and goes for minutes is many blocks and little evidence. `plain` (m,) errors of each trip in their first deviation.
    """
    correlated, time = noise.correlated.copy(), noise.time.copy()
    for regime in (REGIMES.index("idle"), REGIMES.index("drive")):
        kinds = [(t.p.layout.channel == FUEL) & (t.p.layout.regime == regime) for t in trips]
        blocks = sum(int(kind.sum()) for kind in kinds)
        if blocks < 20:
            continue
        logs = []
        for share, tau in LONGER:
            each = [
                log_likelihood(t.p.layout.time[kind], np.clip(x[kind], -5.0, 5.0), share, tau)
                for t, x, kind in zip(trips, plain, kinds, strict=True) if kind.any()
            ]  # fmt: skip
            square, determinant = np.sum(each, axis=0)
            logs.append(-0.5 * blocks * np.log(max(square, 1e-12)) - 0.5 * determinant)
        best = int(np.argmax(logs))
        if logs[best] > logs[0] + PLAIN:
            correlated[FUEL, regime], time[FUEL, regime] = LONGER[best]
    return Noise(noise.scale, correlated, time)


def log_evidence(gram: Array, layout: Layout, calibration: Calibration) -> float:
    """Log probability of the diagnosed trips under "none" and this calibration, up to a constant (no references)."""
    n, c = layout.nuisance, len(layout.calibration)
    prior = np.zeros((n, n))
    prior[:c, :c] = calibration.information
    prior[c:, c:] = np.diag(layout.tolerance_sd**-2.0)
    b = gram[:n, -1]
    both = gram[:n, :n] + prior
    fitted = 0.5 * float(b @ np.linalg.solve(both, b))
    occam = 0.5 * float(np.linalg.slogdet(both)[1] - np.linalg.slogdet(prior)[1])
    return (fitted - occam) / calibration.dispersion


@dataclass(frozen=True)
class Reduced:
    """Effects and regressors with all nuisance marginalised: information (k, k), vector (k,)."""

    information: Array
    vector: Array


def reduce(gram: Array, layout: Layout, calibration: Calibration, dispersion: float | None = None) -> Reduced:
    """Marginalise the nuisance of the summed `gram` of the diagnosed trips under the calibration's posterior."""
    n, c = layout.nuisance, len(layout.calibration)
    prior = np.zeros((n, n))
    prior[:c, :c] = calibration.information
    prior[c:, c:] = np.diag(layout.tolerance_sd**-2.0)
    b = gram[:n, -1].copy()
    b[:c] += calibration.vector
    cross = gram[n:-1, :n]
    solve = np.linalg.solve(gram[:n, :n] + prior, np.column_stack([cross.T, b]))
    d = calibration.dispersion if dispersion is None else dispersion
    return Reduced((gram[n:-1, n:-1] - cross @ solve[:, :-1]) / d, (gram[n:-1, -1] - cross @ solve[:, -1]) / d)


def _dispersion(done: Sequence[Whitened], layout: Layout, library: Library) -> float:
    """Mean squared score of the effects on reference trips left out in turn: 1 if the noise model holds."""
    if len(done) < 2:
        return 1.5
    total = sum((w.gram for w in done), np.zeros_like(done[0].gram))
    scores: list[float] = []
    for w in done:
        information, vector = _information(total - w.gram, layout)
        left = Calibration(information, vector, default_noise(), 1.0, len(done) - 1)
        r = reduce(w.gram, layout, left)
        size = np.diag(r.information)[: layout.effects]
        alone = size * library.sd**2
        z2 = r.vector[: layout.effects] ** 2 / np.maximum(size, 1e-12)
        scores.append(float(np.mean(np.minimum(z2[alone > 1.0], 25.0))) if (alone > 1.0).any() else 1.0)
    mean, count = float(np.mean(scores)), len(scores)
    return float(np.clip((mean * count + 1.0 * 2.0) / (count + 2.0), 1.0, 4.0))


@dataclass(frozen=True)
class Fit:
    """One hypothesis: log Bayes factor against none, explained chi square, coefficients and their covariance."""

    log_bayes: float
    explained: float
    value: Array
    covariance: Array


SCALES = (1.0, 0.3, 0.1)
"""Prior deviations of a size, in shares of the declared one, equally likely: effects are small more often than large,
and a single wide prior would charge a small one for all the sizes that it is not."""


def fit(r: Reduced, index: NDArray[np.int64] | list[int], sd: Array) -> Fit:
    """Evidence of the columns `index` with prior deviations `sd` (same length), averaged over SCALES; coefficients and
    covariance are the mixture's."""
    index = np.asarray(index, int)
    if not len(index):
        return Fit(0.0, 0.0, np.zeros(0), np.zeros((0, 0)))
    a, b = r.information[np.ix_(index, index)], r.vector[index]
    wide = np.outer(SCALES, sd)
    scaled = np.eye(len(index)) + wide[:, :, None] * a * wide[:, None, :]
    covariance = wide[:, :, None] * np.linalg.inv(scaled) * wide[:, None, :]
    values = covariance @ b
    explained = values @ b
    logs = 0.5 * explained - 0.5 * np.linalg.slogdet(scaled)[1]
    share = np.exp(logs - logs.max())
    log = float(logs.max() + np.log(share.mean()))
    share /= share.sum()
    value = share @ values
    apart = values - value
    spread = np.einsum("i,ijk->jk", share, covariance) + np.einsum("i,ij,ik->jk", share, apart, apart)
    return Fit(log, float(share @ explained), value, spread)


def physical(found: Fit, columns: Sequence[Column]) -> Fit:
    """`found` with its evidence times twice the probability that what has one sign only has that sign (the prior of the
    other sign's half is nothing). Columns of one parameter add up."""
    groups: dict[str, list[int]] = {}
    for i, column in enumerate(columns):
        if column.sign:
            groups.setdefault(column.parameter.split("~")[0], []).append(i)
    log = found.log_bayes
    for index in groups.values():
        total = columns[index[0]].sign * float(found.value[index].sum())
        deviation = float(np.sqrt(found.covariance[np.ix_(index, index)].sum()))
        log += float(np.log(2.0) + norm.logcdf(total / max(deviation, 1e-300)))
    return replace(found, log_bayes=log)


def cosine(r: Reduced, first: NDArray, second: NDArray) -> float:
    """Largest canonical correlation of two sets of columns, in units of the noise, nuisance projected out."""
    a, b = r.information[np.ix_(first, first)], r.information[np.ix_(second, second)]
    c = r.information[np.ix_(first, second)]
    ridge = 1e-9
    fa = np.linalg.cholesky(a + ridge * np.diag(np.diag(a)) + 1e-300 * np.eye(len(a)))
    fb = np.linalg.cholesky(b + ridge * np.diag(np.diag(b)) + 1e-300 * np.eye(len(b)))
    inner = np.linalg.solve(fa, np.linalg.solve(fb, c.T).T)
    return float(np.linalg.svd(inner, compute_uv=False)[0])


def visible(r: Reduced, library: Library) -> dict[str, float]:
    """Effect -> prior signal to noise ratio of its best variant: below 1 the trips cannot show it at all."""
    out: dict[str, float] = {}
    for variant, place in zip(library.variants, library.places, strict=True):
        index = np.arange(place.start, place.stop)
        size = np.diag(r.information)[index] * library.sd[index] ** 2
        out[variant.effect] = max(out.get(variant.effect, 0.0), float(np.sqrt(max(size.max(), 0.0))))
    return out


def log_mean_exp(x: Array, weights: Array | None = None) -> float:
    """log of the (weighted) mean of exp(x)."""
    x = np.asarray(x, float)
    top = float(x.max())
    w = np.full(len(x), 1.0 / len(x)) if weights is None else weights / weights.sum()
    return top + float(np.log(np.sum(w * np.exp(x - top))))


@dataclass(frozen=True)
class Thresholds:
    """Frozen on development data (`thresholds.json`): prior log odds, tempering, the allowed misfit of a signature."""

    prior_none: float = 0.5
    prior_single: float = 0.33
    prior_pair: float = 0.03
    prior_outside: float = 0.10
    misfit: float = 0.12
    temperature: float = 1.0
    alike: float = 0.85
    """Correlation with a named effect above which a regressor is that effect and not something else."""
    barrier: float = 3.5
    """log units that any cause must overcome before "nothing" loses: pays for looking everywhere."""
    floor: Mapping[str, float] = field(default_factory=dict)
    """"effect.parameter" -> deviation of what our own model's errors make of it on trips without a gap."""


@dataclass(frozen=True)
class Posterior:
    """Probabilities of {none, singles, pairs, outside} and the fits behind them."""

    none: float
    singles: Mapping[str, float]
    pairs: Mapping[tuple[str, str], float]
    outside: float
    fits: Mapping[str, tuple[Variant, Fit]]
    pair_fits: Mapping[tuple[str, str], tuple[Variant, Variant, Fit]]
    regressors: tuple[tuple[generic.Regressor, ...], Fit] | None


def _outside(
    r: Reduced,
    library: Library,
    layout: Layout,
    by_effect: Mapping[str, list[tuple[Variant, Fit, NDArray]]],
    t: Thresholds,
) -> tuple[tuple[list[int], Fit], float]:
    """Best regressors and the evidence of "something else": regressors that no named effect could stand for."""
    offset = layout.effects
    sd = np.array([g.sd for g in library.regressors])
    candidates = np.array(
        [i for i in range(layout.generics) if r.information[offset + i, offset + i] * sd[i] ** 2 > 1.0], int
    )
    if not len(candidates):
        return ([], Fit(0.0, 0.0, np.zeros(0), np.zeros((0, 0)))), -30.0
    columns = offset + candidates
    known = np.zeros(len(candidates))
    for rows in by_effect.values():
        for _, _, index in rows:
            a = r.information[np.ix_(index, index)]
            c = r.information[np.ix_(index, columns)]
            inner = np.linalg.solve(a + 1e-9 * np.diag(np.diag(a)) + 1e-300 * np.eye(len(a)), c)
            known = np.maximum(known, np.sum(c * inner, axis=0) / np.diag(r.information)[columns])
    new = [int(i) for i, square in zip(candidates, known, strict=True) if np.sqrt(max(square, 0.0)) < t.alike]
    if not new:
        return ([], Fit(0.0, 0.0, np.zeros(0), np.zeros((0, 0)))), -30.0
    alone: dict[tuple[int, ...], Fit] = {(i,): fit(r, [offset + i], sd[[i]]) for i in new}
    families: dict[str, list[int]] = {}
    for i in new:
        if library.regressors[i].family:
            families.setdefault(library.regressors[i].family, []).append(i)
    for members in families.values():
        if len(members) > 1:
            alone[tuple(members)] = fit(r, [offset + i for i in members], sd[members])
    chosen = max(alone, key=lambda i: alone[i].log_bayes)
    found, penalty = alone[chosen], 0.0
    log = log_mean_exp(np.array([f.log_bayes for f in alone.values()]))
    for _ in range(MORE):
        more: dict[tuple[int, ...], Fit] = {}
        for extra in alone:
            if not set(extra) & set(chosen):
                both = [*chosen, *extra]
                more[extra] = fit(r, [offset + n for n in both], sd[both])
        if not more:
            break
        # what was chosen before was sought among all: averaged over them it is one in as many
        penalty += float(np.log(len(alone)))
        log = float(np.logaddexp(log, log_mean_exp(np.array([f.log_bayes for f in more.values()])) - penalty))
        best = max(more, key=lambda i: more[i].log_bayes)
        if more[best].log_bayes < found.log_bayes + 2.0:
            break
        chosen, found = (*chosen, *best), more[best]
    return (list(chosen), found), log


MORE = 2
"""Regressors, or families of them, that may join the first."""


def floored(r: Reduced, library: Library, floor: Mapping[str, float]) -> Reduced:
    """`r` with what the model's own errors make of each effect marginalised: below that there is nothing to explain."""
    names = [f"{v.effect}.{c.parameter.split('~')[0]}" for v in library.variants for c in v.columns]
    sd = np.array([floor.get(name, 0.0) for name in names])
    index = np.flatnonzero(sd > 0.0)
    if not len(index):
        return r
    cross = r.information[:, index] * sd[index]
    middle = np.eye(len(index)) + sd[index, None] * r.information[np.ix_(index, index)] * sd[None, index]
    solve = np.linalg.solve(middle, np.column_stack([cross.T, r.vector[index] * sd[index]]))
    return Reduced(r.information - cross @ solve[:, :-1], r.vector - cross @ solve[:, -1])


LEADING = 8
"""Pairs have one of this many leading single effects in them; two effects that are both weaker are never the answer."""


def _part(found: Fit, at: slice) -> Fit:
    """The coefficients `at` of a fit."""
    return replace(found, value=found.value[at], covariance=found.covariance[at, at])


@dataclass(frozen=True)
class Hypotheses:
    """Evidence (log Bayes factors against "none") of everything that may be the answer, before any prior."""

    singles: Mapping[str, float]
    fits: Mapping[str, tuple[Variant, Fit]]
    pairs: Mapping[tuple[str, str], tuple[Variant, Variant, Fit]]
    outside: float
    regressors: tuple[tuple[generic.Regressor, ...], Fit] | None

    @property
    def explained(self) -> float:
        """Chi square that the best of them explains."""
        fits = [f for _, f in self.fits.values()] + [f for *_, f in self.pairs.values()]
        fits += [self.regressors[1]] if self.regressors is not None else []
        return max((f.explained for f in fits), default=0.0)


def hypotheses(
    r: Reduced, library: Library, layout: Layout, hidden: Sequence[str], t: Thresholds, pairs: bool = True
) -> Hypotheses:
    """Fit every hypothesis; `pairs` False leaves those out."""
    r = floored(r, library, t.floor)
    sd, places = library.sd, library.places
    by_effect: dict[str, list[tuple[Variant, Fit, NDArray]]] = {}
    seen = visible(r, library)
    for variant, place in zip(library.variants, places, strict=True):
        if variant.effect in hidden or seen[variant.effect] < 1.0:
            continue
        index = np.arange(place.start, place.stop)
        found = physical(fit(r, index, sd[index]), variant.columns)
        by_effect.setdefault(variant.effect, []).append((variant, found, index))
    singles = {name: log_mean_exp(np.array([f.log_bayes for _, f, _ in rows])) for name, rows in by_effect.items()}
    best = {name: max(rows, key=lambda row: row[1].log_bayes) for name, rows in by_effect.items()}
    both: dict[tuple[str, str], tuple[Variant, Variant, Fit]] = {}
    names = sorted(best, key=lambda n: -singles[n])
    for i, first in enumerate(names[: LEADING if pairs else 0]):
        for second in names[i + 1 :]:
            (v1, _, i1), (v2, _, i2) = best[first], best[second]
            if cosine(r, i1, i2) > 0.97:
                continue
            index = np.concatenate([i1, i2])
            found = fit(r, index, sd[index])
            log = sum(
                physical(_part(found, at), v.columns).log_bayes - found.log_bayes
                for v, at in ((v1, slice(0, len(i1))), (v2, slice(len(i1), None)))
            )
            both[(first, second)] = (v1, v2, replace(found, log_bayes=found.log_bayes + log))
    regressors, outside = _outside(r, library, layout, by_effect, t)
    return Hypotheses(
        singles, {n: (v, f) for n, (v, f, _) in best.items()}, both, float(outside),
        (tuple(library.regressors[i] for i in regressors[0]), regressors[1]) if regressors[0] else None,
    )  # fmt: skip


def weighed(h: Hypotheses, t: Thresholds) -> Posterior:
    """Probabilities of `h` under the frozen priors. A signature is right to a share `misfit` of its size only, so the
    evidence of a loud effect is tempered; `barrier` is what any cause must overcome."""
    squeeze = t.temperature * (1.0 + 0.5 * t.misfit**2 * h.explained)
    rows: list[tuple[object, float]] = [("none", np.log(t.prior_none))]
    single = np.log(t.prior_single / max(len(h.singles), 1)) - t.barrier
    rows += [(n, single + x / squeeze) for n, x in h.singles.items()]
    pair = np.log(t.prior_pair / max(len(h.pairs), 1)) - t.barrier
    rows += [(n, pair + f.log_bayes / squeeze) for n, (*_, f) in h.pairs.items()]
    rows.append(("outside", np.log(t.prior_outside) - t.barrier + h.outside / squeeze))
    logs = np.array([x for _, x in rows])
    probability = np.exp(logs - logs.max())
    probability /= probability.sum()
    table = {name: float(q) for (name, _), q in zip(rows, probability, strict=True)}
    return Posterior(
        table["none"], {n: table[n] for n in h.singles}, {n: table[n] for n in h.pairs}, table["outside"],
        h.fits, h.pairs, h.regressors,
    )  # fmt: skip


def posterior(r: Reduced, library: Library, layout: Layout, hidden: Sequence[str], t: Thresholds) -> Posterior:
    """Weigh all hypotheses."""
    return weighed(hypotheses(r, library, layout, hidden, t), t)
