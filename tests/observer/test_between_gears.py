"""Between two gears the engine drives nothing: what the accelerometer reads there is drag, grade and its own bias."""

import numpy as np
import pytest

from observer import kernel, model
from observer.observe import pulse_angle, start
from observer.settings import DEFAULT
from tests.observer.synthetic import SMART

SPEED, THRUST, BIAS = 12.0, 900.0, 0.25
IN_GEAR, IDLE = 2.4e-3, 0.9e-3
"""s: how long the injector opens for a pulse with the engine driving, and idling."""


def shifted(fall: float, brake: float = 0.0, seed: int = 0) -> kernel.Filter:
    """The filter after a second in gear and 0.4 s with the fuel of idling: the engine loses `fall` of its speed.

    `brake` m/s2 act all through those 0.4 s. The car keeps its speed to some cm/s; pulses tell it.
    """
    rng = np.random.default_rng(seed)
    f = start(SMART, DEFAULT, None, 0.0)
    f = f._replace(records=np.empty((2000, 7)))
    f.counts[kernel.RECORDING] = 1
    omega = SPEED * SMART.gear_ratios[2] / SMART.wheel_radius
    f.x[[kernel.V, 2, kernel.OMEGA]] = SPEED, THRUST, omega
    f.P[:] = np.diag(np.full(kernel.NX, 1e-12))
    f.P[[1, 2, 4, 13, 14], [1, 2, 4, 13, 14]] = 1e-4, 50.0**2, 1e-8, 25.0, 0.18**2
    f.memory[kernel.M_ENERGY_ANCHORED] = 0.0

    def reads(thrust: float, v: float) -> float:
        x = np.zeros(17)
        x[[model.V, model.F]] = v, thrust
        return model.measurement(model.ACCELERATION_X, x, SMART, squat=DEFAULT.body_squat) + BIAS

    angle, told, rows = 0.0, 0.0, []
    for k in range(1, 1400):
        t = 1e-3 * k
        open_for = t - 1.0
        engine = omega * (1.0 - fall * min(max(open_for, 0.0) / 0.3, 1.0))
        angle += engine * 1e-3
        thrust = THRUST if open_for < 0.0 else model.open_thrust(SPEED, SMART)
        if k % 25 == 0:
            forward = reads(thrust, SPEED) - (brake if open_for > 0.0 else 0.0) + rng.normal(0.0, 0.12)
            rows.append([t, kernel.ACCELEROMETER, forward, 0.12 * rng.normal(), 9.8 + 0.3 * rng.normal()])
        if angle - told >= pulse_angle(SMART):
            told += pulse_angle(SMART)
            rows.append([t, kernel.INJECTOR, IN_GEAR if open_for < 0.0 else IDLE, 0.0, 0.0])
    kernel.advance(np.pad(np.array(rows), ((0, 0), (0, kernel.COLUMNS - 5))), 0, len(rows), f)
    return f


def told(f: kernel.Filter) -> np.ndarray:
    """Records of what was read between two gears."""
    records = f.records[: f.counts[kernel.RECORDS]]
    return records[records[:, 1] == kernel.OPEN_CLUTCH]


def test_a_shift_tells_the_bias():
    """Given biases unknown to 0.18 m/s2, when gears change once, then this one is known to 0.09, rightly (30 boxes)."""
    errors = []
    for seed in range(30):
        f = shifted(fall=0.25, seed=seed)
        deviation = np.sqrt(f.P[kernel.BIAS_X, kernel.BIAS_X])
        assert len(told(f)) > 0
        assert deviation < 0.09
        errors.append((f.x[kernel.BIAS_X] - BIAS) / deviation)
    assert np.abs(errors).max() < 4.0
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


@pytest.mark.parametrize("fall", [0.0, 0.03])
def test_a_foot_that_lifts_in_gear_is_no_shift(fall):
    """Given an engine that keeps to the gear's ratio, then nothing is concluded: it brakes, nobody knows how hard."""
    assert len(told(shifted(fall=fall))) == 0


@pytest.mark.parametrize("brake", [0.8, 3.0])
def test_a_brake_between_gears_is_not_taken_for_a_bias(brake):
    """Given `brake` m/s2 of braking with the clutch open, then the bias is not what gives."""
    f = shifted(fall=0.25, brake=brake)
    assert np.all(told(f)[:, 6] == kernel.GATED)
    assert abs(f.x[kernel.BIAS_X]) < 3.0 * np.sqrt(f.P[kernel.BIAS_X, kernel.BIAS_X])


def test_drag_with_the_clutch_open_is_half_of_what_the_driveline_loses_at_any_load():
    """Given 6 N m at the axle (its default), then 3 of them, and as much again at 60 rad/s of the axle."""
    assert model.open_thrust(0.0, SMART) == pytest.approx(-3.0 / SMART.wheel_radius)
    assert model.open_thrust(60.0 * SMART.wheel_radius, SMART) == pytest.approx(-6.0 / SMART.wheel_radius)
