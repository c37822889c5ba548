"""One trip's columns over its blocks, whitened by its noise and summed into Gram matrices.

With whitened residuals, nuisance columns of known prior and effect columns, all that evidence needs is in one Gram
matrix per trip, so that held-out trips, pairs and cross-validation are sums of small matrices.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap import generic, signatures
from rollingroad.gap.blocks import Prepared
from rollingroad.gap.channels import block_means, values
from rollingroad.gap.design import FUEL, Columns, calibration_columns, map_correction, tolerance_columns, trip_columns
from rollingroad.gap.noise import Noise, whitener
from rollingroad.gap.replay import replay_vector
from rollingroad.gap.signature_form import Context, Variant
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
class Lexicon:
    """What may be named: variants and regressors, and where their columns stand."""

    variants: tuple[Variant, ...]
    regressors: tuple[generic.Regressor, ...]

    @classmethod
    def of(cls, car: Car) -> "Lexicon":
        """Everything that may be named for `car`."""
        return cls(tuple(signatures.variants(car)), tuple(generic.lexicon(car)))

    @property
    def places(self) -> list[slice]:
        """Columns of each variant within the effects' block."""
        ends = np.cumsum([0] + [len(v.columns) for v in self.variants])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    def place_of(self, variant: Variant) -> slice:
        """Columns of `variant` (this very object) within the effects' block."""
        return next(place for one, place in zip(self.variants, self.places, strict=True) if one is variant)

    def index_of(self, variant: Variant) -> NDArray[np.int64]:
        """`place_of` as numbers."""
        place = self.place_of(variant)
        return np.arange(place.start, place.stop)

    @property
    def sd(self) -> Array:
        """Prior deviation of every effect column."""
        return np.array([c.sd for v in self.variants for c in v.columns])


def columns_of(
    p: Prepared,
    car: Car,
    vector: Array,
    lexicon: Lexicon,
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
    effects = [v.make(context) for v in lexicon.variants]
    regressors = generic.columns(context)
    # what is fitted to the references must mean the same in the diagnosed trips: never the corrected simulator
    plain = generic.columns(Context(p, car, vector, base, np.maximum(nominal, 0.0))) if correction else regressors
    state = [
        (f"state.{g.name}", plain[:, i], 0.5 * g.sd)
        for i, g in enumerate(lexicon.regressors)
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


def total_gram(whitened: Sequence[Whitened]) -> Array:
    """Gram matrix (K + 1, K + 1) of all the trips together."""
    return sum((w.gram for w in whitened), np.zeros_like(whitened[0].gram))


def settled(w: Whitened, layout: Layout, y: Array) -> tuple[Array, Array]:
    """`y` (m,), whitened, with the tolerances and the trip's own fitted away, and what was fitted, in deviations."""
    own = np.concatenate(
        [w.rows[:, len(layout.calibration) : layout.nuisance] * layout.tolerance_sd, w.own * w.own_sd], axis=1
    )
    free = np.linalg.solve(np.eye(own.shape[1]) + own.T @ own, own.T @ y)
    return y - own @ free, free


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
