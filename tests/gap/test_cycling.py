"""A compressor's period, phase and duty against a square wave made here."""

from types import SimpleNamespace

import numpy as np
import pytest

from rollingroad.gap.calibration import Calibration
from rollingroad.gap.cycling import tuned
from rollingroad.gap.design import FUEL, Columns
from rollingroad.gap.fits import Fit, physical
from rollingroad.gap.noise import default_noise
from rollingroad.gap.signature_form import COHERENT, Column, Variant
from rollingroad.gap.trips import Layout, Trip, Whitened

COLUMNS = (Column("power", "W", 0.0, 1500.0, 1), Column("power~1", "W", 0.0, 800.0), Column("power~2", "W", 0.0, 800.0))
PERIOD = 40.0
VARIANT = Variant("ac_cycling", COLUMNS, {"ac_cycling.period": PERIOD}, lambda c: np.zeros((0, 3)), swings=True)
LAYOUT = Layout((), np.zeros(0), ("offset",), np.array([1e-3]), 3, 0)
CALIBRATION = Calibration(np.zeros((0, 0)), np.zeros(0), default_noise(), 1.0, 1)
STEP, BLOCK = 0.2, 25


def _logged(duty: float, frequency: float, late: float, seed: int) -> tuple[Trip, Whitened, np.ndarray]:
    """Twenty minutes in blocks of 5 s, 2.5 W of fuel per W of a compressor of 200 W, noise of 20 W; the signal."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 1200.0, STEP)
    on = ((t * frequency - late) % 1.0 < duty).reshape(-1, BLOCK).mean(axis=1)
    n = len(on)
    signal = 2.5 * 200.0 * on
    y = signal + 20.0 * rng.normal(size=n)
    parts = {"fuel_power": (np.arange(len(t)), np.repeat(np.arange(n), BLOCK), np.full(n, BLOCK))}
    layout = SimpleNamespace(time=t.reshape(-1, BLOCK).mean(axis=1), channel=np.full(n, FUEL), parts=parts)
    p = SimpleNamespace(layout=layout, samples=SimpleNamespace(motion=SimpleNamespace(time=t)))
    effects = np.zeros((n, 3))
    effects[:, 0] = 0.5 * 2.5
    none = Columns.of([], n)
    trip = Trip(p, y, none, none, none, effects, np.zeros((n, 0)))  # type: ignore[arg-type]
    rows = np.column_stack([np.zeros(n), effects, y]) / 20.0
    return trip, Whitened(rows, np.zeros((n, 0)), np.zeros(0), rows.T @ rows, lambda x: x / 20.0), signal


def _left(columns: np.ndarray, signal: np.ndarray) -> float:
    """Share of the signal's energy about its mean that no mixture of `columns` gives."""
    value = np.linalg.lstsq(columns, signal, rcond=None)[0]
    return float(np.sum((signal - columns @ value) ** 2) / np.sum((signal - signal.mean()) ** 2))


@pytest.mark.parametrize("duty", [0.35, 0.5])
def test_off_the_grid_and_square_is_told_as_it_is(duty: float) -> None:
    """Given a compressor 0.4 of the grid's distance off the period, then its signal in two trips is one of the tuned
    columns' to 3 %, of which the grid's sine leaves more than a quarter."""
    frequency = 1.0 / PERIOD + 0.4 / COHERENT
    logged = [_logged(duty, frequency, 0.3, seed) for seed in (1, 2)]
    trips, whitened, signals = (list(column) for column in zip(*logged, strict=True))
    found = tuned(trips, whitened, LAYOUT, CALIBRATION, VARIANT, slice(0, 3))
    angle = 2.0 * np.pi * trips[0].p.layout.time / PERIOD
    sine = np.column_stack([np.ones(len(angle)), np.cos(angle), np.sin(angle)])
    assert max(_left(c, s) for c, s in zip(found, signals, strict=True)) < 0.03
    assert _left(sine, signals[0]) > 0.25


@pytest.mark.parametrize("swing, change", [(130.0, np.log(2.0) * 2.0), (10.0, -20.0)])
def test_what_does_not_swing_is_no_compressor(swing: float, change: float) -> None:
    """Given a mean of 200 W to 5 W, then a swing of 130 W doubles the evidence (as its sign does), and one of 10 W,
    which is another accessory, ends it."""
    covariance = np.diag([25.0, 25.0, 25.0])
    found = physical(Fit(100.0, 200.0, np.array([200.0, swing, 0.0]), covariance), VARIANT)
    if change > 0.0:
        assert found.log_bayes - 100.0 == pytest.approx(change, abs=1e-6)
    else:
        assert found.log_bayes - 100.0 < change
