"""The replay of a car's trips: every tyre that goes soft is one event, every call of a sound one a false call."""

import numpy as np
import pytest

from benchmarks.soft_tyre import BETWEEN, SOFT_TRIPS, is_soft, replay
from observer.by_products import LEARNING, SOFT_RADIUS, SOFT_ROLLING, USUAL_RADIUS, TripCar
from vehicle_model.car.files import read_car

CAR = read_car("smart")
KM = 23e3


def trip(radius: float, rolling: float = 0.0) -> TripCar:
    return TripCar(np.array([0.0, rolling * CAR.rolling_resistance, 0.0]), np.eye(3), radius, KM)


def life(trips: int, seed: int = 0) -> list[tuple[bool, TripCar]]:
    scatter = USUAL_RADIUS * np.random.default_rng(seed).normal(size=trips)
    soft = [is_soft(n) for n in range(trips)]
    return [(s, trip(SOFT_RADIUS * s + error, SOFT_ROLLING * s)) for s, error in zip(soft, scatter, strict=True)]


def test_every_soft_tyre_is_one_event_and_is_called_within_100_km():
    distances, false_calls, watched = replay(life(4 * (BETWEEN + SOFT_TRIPS)))
    assert len(distances) == 4 and max(distances) <= 100e3 and min(distances) >= KM
    assert false_calls == 0
    assert watched == pytest.approx((4 * BETWEEN - LEARNING) * KM), "what is learnt from is not watched"


def test_a_tyre_that_shows_nothing_is_never_called():
    silent = [(soft, trip(1e-5 * (-1) ** n)) for n, (soft, _) in enumerate(life(2 * (BETWEEN + SOFT_TRIPS)))]
    distances, false_calls, _ = replay(silent)
    assert distances == [np.inf, np.inf] and false_calls == 0


def test_a_sound_tyre_that_looks_soft_is_a_false_call_each_time():
    looks = (False, trip(3.0 * SOFT_RADIUS))
    trips = [*life(LEARNING), looks, (False, trip(0.0)), looks]
    distances, false_calls, watched = replay(trips)
    assert distances == [] and false_calls == 2 and watched == pytest.approx(3 * KM)
