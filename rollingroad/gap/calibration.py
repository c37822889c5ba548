"""What the reference trips say: the nominal car's correction, the noise, and which blocks are accidents.

Everything downstream is weighed with the nuisance marginalised under the calibration's posterior (`reduce`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.blocks import CHANNELS, REGIMES
from rollingroad.gap.design import FUEL
from rollingroad.gap.noise import LONGER, Noise, default_noise, log_likelihood
from rollingroad.gap.trips import Layout, Lexicon, Trip, Whitened, settled, stack, total_gram, whiten

Array = NDArray[np.float64]


ODD = 4.0
"""Robust deviations of its kind beyond which a block is an accident: a stalled launch, a foot on the brake."""
ACCIDENTS = (
    ("fuel_power", "launch"), ("fuel_power", "open"), ("fuel_power", "overrun"), ("coast_force", None),
    ("gear_ratio", None),
    ("launch_speed", None), ("shift_time", None), ("gnss_speed", None), ("height_map", None),
)  # fmt: skip
"""Channels and regimes in which accidents happen: a cut-off that comes late, for one, or a crossing road taken for the
one that is driven. (Fuel in gear and at idle has none; what is odd there is a gap.)"""


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
    left, _ = settled(w, layout, w.rows[:, -1] - w.rows[:, : len(layout.calibration)] @ calibration.mean)
    return left


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
BOX = 0.03
"""Share of the freedom of receiver and wheel without reference trips: what they do beyond the tolerances is a gap."""
KEPT = ("bias_x", "gnss.lag", "gnss.scale", "launch_speed.offset", "shift_time.offset", "squat")
"""Calibration columns of the box and of the driver's habits, which are free without references too."""


def _free(name: str, freedom: float) -> float:
    """Share of the freedom of the calibration's column `name` where there is no reference."""
    if name in KEPT or name.startswith("launch"):
        return 1.0
    if name.startswith(("gnss.", "state.gnss")):  # another engine does not make another receiver or wheel
        return BOX
    return freedom


def calibrate(
    reference: Sequence[Trip], layout: Layout, lexicon: Lexicon, *, coarse: bool = False, freedom: float = FREEDOM[0]
) -> Calibration:
    """Fit the correction to the reference trips, and the noise to what each leaves when the others predict it.

    `coarse`: logs of speed and fuel alone. One such trip is no measure of another's map (a town cycle says nothing of
    full load), so there the noise is what the references leave of themselves, and never less than the declared
    repeatability. `freedom` of the correction where there is no reference.
    """
    noise = default_noise()
    if not reference:
        sd = layout.calibration_sd * np.array([_free(name, freedom) for name in layout.calibration])
        return Calibration(np.diag(sd**-2.0), np.zeros(len(sd)), noise, 1.3, 0)
    for _ in range(2):
        done = [whiten(trip, layout, noise) for trip in reference]
        if len(done) > 1 or coarse:
            noise = _rescaled(noise, reference, done, layout, leave_out=not coarse)
        if not coarse:
            total = total_gram(done)
            known = Calibration(*_information(total, layout), noise, 1.0, len(reference))
            reference = tamed(reference, [unexplained(w, layout, known) for w in done])
    done = [whiten(trip, layout, noise) for trip in reference]
    total = total_gram(done)
    information, vector = _information(total, layout)
    dispersion = 1.0 if coarse else _dispersion(done, layout, lexicon)
    return Calibration(information, vector, noise, dispersion, len(reference))


def _rescaled(
    noise: Noise, trips: Sequence[Trip], done: Sequence[Whitened], layout: Layout, *, leave_out: bool
) -> Noise:
    """Noise scales from leave-one-trip-out residuals, drawn towards the first idea where blocks are few."""
    total = total_gram(done)
    n = layout.nuisance
    squares, counts = np.zeros_like(noise.scale), np.zeros_like(noise.scale)
    plain: list[Array] = []
    for trip, w in zip(trips, done, strict=True):
        information, vector = _information(total - w.gram if leave_out else total, layout)
        c = len(layout.calibration)
        # tolerances and the trip's own are fitted to the left-out trip itself
        mean = np.linalg.solve(information, vector)
        left, free = settled(w, layout, w.rows[:, -1] - w.rows[:, :c] @ mean)
        residual = np.clip(left, -5.0, 5.0)
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


def _dispersion(done: Sequence[Whitened], layout: Layout, lexicon: Lexicon) -> float:
    """Mean squared score of the effects on reference trips left out in turn: 1 if the noise model holds."""
    if len(done) < 2:
        return 1.5
    total = total_gram(done)
    scores: list[float] = []
    for w in done:
        information, vector = _information(total - w.gram, layout)
        left = Calibration(information, vector, default_noise(), 1.0, len(done) - 1)
        r = reduce(w.gram, layout, left)
        size = np.diag(r.information)[: layout.effects]
        alone = size * lexicon.sd**2
        z2 = r.vector[: layout.effects] ** 2 / np.maximum(size, 1e-12)
        scores.append(float(np.mean(np.minimum(z2[alone > 1.0], 25.0))) if (alone > 1.0).any() else 1.0)
    mean, count = float(np.mean(scores)), len(scores)
    return float(np.clip((mean * count + 1.0 * 2.0) / (count + 2.0), 1.0, 4.0))
