"""By-products of a known map (3.6): mass, rolling resistance, drag, wheel radius; trends, alarms; online fits."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_drive import CAR, drive, true_efficiency, true_power

from observer.by_products import LEARNING, Trend, fuel_table, torque_of_fuel, trip_car, tyre_score, watch
from observer.coefficients import learn_coefficients
from observer.estimate import STATES
from observer.fit_form import Fit
from observer.mapping import centres, map_engine
from observer.operating_points import rate


class TrueFit(Fit):
    name, r2, r2_efficiency = "true", 1.0, 1.0

    def fuel_power(self, engine_speed, torque):
        return true_power(np.asarray(engine_speed), np.maximum(np.asarray(torque), 0.0))


def heavier(estimate, mass=0.0, rolling=0.0, drag=0.0):
    """The same engine work in a car that differs from its file: the observer accounts for the declared car only."""
    rows = estimate.smoothed.copy()
    speed = rows[:, STATES.index("speed")]
    extra = mass * (rate(speed, 0.1) + CAR.gravity * CAR.rolling_resistance)
    extra += rolling * CAR.mass * CAR.gravity + 0.5 * CAR.air_density * drag * speed**2
    rows[:, STATES.index("thrust")] -= extra
    return replace(estimate, smoothed=rows, state=rows)


def test_torque_of_fuel_inverts_the_map():
    omega, torque = np.array([150.0, 300.0, 450.0]), np.array([10.0, 60.0, 95.0])
    found = torque_of_fuel(fuel_table(TrueFit(), CAR), omega, true_power(omega, torque), np.array([30.0, 30.0, 30.0]))
    np.testing.assert_allclose(found, torque, rtol=1e-4)


@pytest.mark.parametrize(
    "change", [(75.0, 0.0, 0.0), (0.0, 0.0015, 0.0), (0.0, 0.0, 0.11), (40.0, -0.001, 0.05)], ids=str
)
def test_a_passenger_a_tyre_and_a_roof_are_told_apart(change):
    found = trip_car(heavier(drive(2, thrust_noise=10.0), *change), CAR, TrueFit())
    usual = trip_car(drive(2, thrust_noise=10.0), CAR, TrueFit())
    moved, sigma = found.change - usual.change, np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(moved - change) < 3.0 * sigma)
    assert np.all(np.abs(usual.change) < 4.0 * sigma)
    assert sigma[0] < 15.0 and sigma[1] < 0.001 and sigma[2] < 0.04


def test_wheel_radius_from_engine_speed():
    estimate = drive(2, thrust_noise=10.0)
    rows = estimate.smoothed.copy()
    rows[:, STATES.index("speed")] *= 0.995
    small = trip_car(replace(estimate, smoothed=rows, state=rows), CAR, TrueFit())
    assert small.radius == pytest.approx(-0.005, abs=2e-4)
    assert trip_car(estimate, CAR, TrueFit()).radius == pytest.approx(0.0, abs=2e-4)


def test_the_tyres_score_hardly_moves_in_rain():
    """Given rolling resistance up by 8 % from rain, the score stays; a smaller wheel with it moves the score."""
    trip = trip_car(drive(2, seconds=600.0), CAR, TrueFit())
    wet = replace(trip, change=trip.change + np.array([0.0, 0.08 * CAR.rolling_resistance, 0.0]))
    soft = replace(wet, radius=trip.radius - 0.0025)
    assert tyre_score(wet, CAR) - tyre_score(trip, CAR) < 0.5
    assert tyre_score(soft, CAR) - tyre_score(trip, CAR) > 5.0


def test_a_step_is_called_soon_and_a_sound_car_is_left_alone():
    rng = np.random.default_rng(0)
    delays, false = [], 0
    for _ in range(40):
        trend = Trend()
        for _ in range(150):
            trend = watch(trend, 3.0 + rng.normal(), least_spread=0.5)
        false += trend.alarm != 0
        trend = Trend(trend.usual, trend.spread, trend.trips)
        delay = 0
        while not trend.alarm:
            trend, delay = watch(trend, 3.0 - 2.5 + rng.normal(), least_spread=0.5), delay + 1
        assert trend.alarm == -1
        delays.append(delay)
    assert np.median(delays) <= 8 and max(delays) < 30 and false <= 2


def test_nothing_is_called_while_learning():
    trend = Trend()
    for value in [0.0] * (LEARNING - 1) + [50.0]:
        trend = watch(trend, value, least_spread=0.5)
    assert trend.alarm == 0 and trend.trips == LEARNING


def test_coefficients_learnt_online_come_near_the_fit_of_the_map():
    drives = [drive(seed, seconds=900.0) for seed in (4, 5)]
    learnt = learn_coefficients(drives, CAR)
    found = map_engine(drives, CAR)
    omega, torque = centres(found)
    truth = true_efficiency(omega, torque)
    error = np.sqrt(np.mean((learnt.efficiency(omega, torque) - truth) ** 2))
    assert error < 0.008
    # the bump that no quadratic holds stays unseen
    assert learnt.efficiency(320.0, 60.0) < true_efficiency(320.0, 60.0)
