"""What the gap costs the advice: fuel of a plan made with the wrong simulator above that of one made with the right.

The plan is Pontryagin's on each 500 m of road by itself: with W (J/s) the worth of a second, the speed and the gear
that minimise (P + W) / v, W such that the whole takes the time that the driver took. P is the calibrated simulator's
fuel power at that speed, gear, grade and state of warmth. Judged by the simulator with the effect as *this* trip alone
shows it; planned without the effect, and with it as the *other* trips show it. A stationary plan: it says what the
choice of speed and gear loses, not what pulse, glide or foresight might.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.blocks import REGIMES
from rollingroad.gap.calibration import Calibration, reduce
from rollingroad.gap.design import map_correction
from rollingroad.gap.evidence import Posterior
from rollingroad.gap.fits import fit
from rollingroad.gap.replay import Motion, replay_vector, vector_of
from rollingroad.gap.signature_form import Variant
from rollingroad.gap.trips import Layout, Lexicon, Trip, Whitened, total_gram
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]
PIECE = 500.0
"""m of road with one speed and one gear."""
SLOWEST, FASTEST, SPEED_STEP = 8.0, 40.0, 0.25
"""m/s of the speeds to choose from."""


def regret(
    trips: Sequence[Trip], whitened: Sequence[Whitened], layout: Layout, calibration: Calibration, lexicon: Lexicon,
    posterior: Posterior, chosen: Sequence[str], car: Car,
) -> tuple[float | None, float | None]:  # fmt: skip
    """Mean regret over the trips, percent of fuel, before and after; None where the answer is no effect of the
    simulator's, or with one trip alone."""
    if len(trips) < 2 or len(chosen) != 1 or chosen[0] not in posterior.fits:
        return None, None
    variant = posterior.fits[chosen[0]][0]
    if variant.settings is None:
        return None, None
    index = lexicon.index_of(variant)
    correction = dict(zip(layout.calibration, calibration.mean, strict=True)) if calibration.trips else {}
    total = total_gram(whitened)
    rows = []
    for trip, w in zip(trips, whitened, strict=True):
        pieces = _pieces(trip, car)
        if pieces is None:
            continue
        alone = fit(reduce(w.gram, layout, calibration), index, lexicon.sd[index]).value
        others = fit(reduce(total - w.gram, layout, calibration), index, lexicon.sd[index]).value
        try:
            true = _power(pieces, variant, alone, car, correction)
            planned = [_power(pieces, variant, value, car, correction) for value in (0.0 * alone, others)]
        except BadInput:  # a size that the simulator refuses
            continue
        wanted = pieces[1]
        best = _burnt(true, true, wanted)
        rows.append([_burnt(power, true, wanted) / best - 1.0 for power in planned])
    if not rows:
        return None, None
    before, after = 100.0 * np.mean(rows, axis=0)
    return float(before), float(after)


def _pieces(trip: Trip, car: Car) -> tuple[Motion, float] | None:
    """Every speed and gear on every piece of the trip, as one motion (pieces, speeds, gears flattened), and the time
    that the driver took for them, s; None where he never cruised."""
    m = trip.p.samples.motion
    which = (m.distance / PIECE).astype(int)
    count = np.maximum(np.bincount(which), 1)

    def mean(x: Array) -> Array:
        return np.bincount(which, np.nan_to_num(x)) / count

    steady = mean(m.speed) > SLOWEST
    if steady.sum() < 3:
        return None
    speeds = np.arange(SLOWEST, FASTEST, SPEED_STEP)
    gears = np.arange(1, len(car.gear_ratios) + 1)
    shape = (int(steady.sum()), len(speeds), len(gears))

    def wide(x: Array) -> Array:
        return np.broadcast_to(mean(x)[steady][:, None, None], shape).ravel()

    v = np.broadcast_to(speeds[None, :, None], shape).ravel()
    gear = np.broadcast_to(gears[None, None, :], shape).ravel()
    ratio = np.asarray(car.gear_ratios)[gear - 1] / car.wheel_radius
    zero = np.zeros(len(v))
    north, east = wide(np.cos(np.nan_to_num(m.heading))), wide(np.sin(np.nan_to_num(m.heading)))
    motion = Motion(
        wide(m.time), wide(m.distance), v, zero, wide(m.force - m.acceleration), v * ratio, gear,
        np.arctan2(east, north), zero, wide(m.burnt), wide(m.brake_heat),
    )  # fmt: skip
    return motion, float(np.sum(PIECE / mean(m.speed)[steady]))


def _power(
    pieces: tuple[Motion, float], variant: Variant, value: Array, car: Car, correction: Mapping[str, float]
) -> Array:
    """(pieces, speeds, gears), W; infinite where the gear cannot be used."""
    motion = pieces[0]
    assert variant.settings is not None
    nominal = replay_vector(vector_of(car), motion)
    drive = np.full(len(motion.speed), REGIMES.index("drive"))
    power = nominal.fuel + map_correction(car, correction)(nominal, motion, drive)
    power = power + sum(
        (replay_vector(vector_of(car, one), motion).fuel - nominal.fuel for one in variant.settings(value)),
        np.zeros(len(power)),
    )
    w, engine = motion.engine_speed, car.engine
    usable = (w > 1.2 * engine.idle_speed) & (w < engine.max_power_speed) & (nominal.load < 0.95)
    gears = len(car.gear_ratios)
    speeds = len(np.arange(SLOWEST, FASTEST, SPEED_STEP))
    return np.where(usable, np.maximum(power, 500.0), np.inf).reshape(-1, speeds, gears)


def _burnt(believed: Array, true: Array, wanted: float) -> float:
    """J burnt (by `true`) on the plan that is best by `believed` and takes `wanted` s."""
    speeds = np.arange(SLOWEST, FASTEST, SPEED_STEP)
    gear = np.argmin(believed, axis=2)
    by_speed = np.min(believed, axis=2)
    paid = np.take_along_axis(true, gear[:, :, None], axis=2)[:, :, 0]
    low, high = 0.0, 3e5
    curve = []
    for _ in range(30):
        worth = 0.5 * (low + high)
        pick = np.argmin((by_speed + worth) / speeds, axis=1)
        time = float(np.sum(PIECE / speeds[pick]))
        curve.append(
            (time, float(np.sum(PIECE * np.take_along_axis(paid, pick[:, None], axis=1)[:, 0] / speeds[pick])))
        )
        low, high = (worth, high) if time > wanted else (low, worth)
    # speeds come in steps: between the plans on both sides of the wanted time
    times, fuels = np.array(sorted(curve)).T
    return float(np.interp(wanted, times, fuels))
