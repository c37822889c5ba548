"""Sensor selection: the programme against the Kalman filter, choices against brute force, the car's list."""

from itertools import pairwise

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from observer.selection import LinearSystem, SparseDesign, best_sets, brute_force, kalman_h2, process_noise
from observer.selection.car_sensors import SENSORS, STATES, car_systems, cost
from observer.selection.search import agrees, joint_h2
from vehicle_model.car.files import read_car
from vehicle_model.car.randomness import generator


@pytest.fixture(autouse=True)
def one_thread():
    with threadpool_limits(1):
        yield


def system(seed: int, n: int = 4, m: int = 5) -> LinearSystem:
    """A random system, stable or slightly unstable, of which two states are wanted."""
    rng = generator(seed, "random systems")
    a = rng.standard_normal((n, n)) / np.sqrt(n)
    a -= (np.linalg.eigvals(a).real.max() - rng.uniform(-0.3, 0.1)) * np.eye(n)
    c = rng.standard_normal((m, n)) * (rng.random((m, n)) < 0.5) + 1e-3 * rng.standard_normal((m, n))
    return LinearSystem.one_row_each(a, np.diag(rng.uniform(0.3, 1.0, n)), c, rng.uniform(0.3, 1.5, m), np.eye(n)[:2])


@pytest.mark.parametrize("seed", range(4))
def test_without_penalty_the_programme_is_the_kalman_filter(seed):
    s = system(seed)
    design = SparseDesign([s]).design(0.0)
    norm, gain = kalman_h2(s, range(5))
    assert np.sqrt(design.trace) == pytest.approx(norm, rel=1e-5)
    assert np.linalg.eigvals(s.a - design.gains[0] @ s.c).real.max() < 0.0
    # of the wanted states; the others' gain is not determined by the norm alone
    assert s.weight @ design.gains[0] == pytest.approx(s.weight @ gain, abs=0.02)


def test_the_norm_is_the_steady_variance_of_a_simulated_observer():
    s, dt = system(1), 0.01
    norm, gain = kalman_h2(s, range(5))
    rng, closed = np.random.default_rng(0), s.a - gain @ s.c
    e, squares = np.zeros((4, 400)), []
    for k in range(6000):
        w, v = rng.standard_normal((4, 400)), rng.standard_normal((5, 400))
        shaken = s.noise @ w - gain @ (s.deviation[:, None] * v)
        e = e + dt * closed @ e + np.sqrt(dt) * shaken
        if k > 2000:
            squares.append(np.sum((s.weight @ e) ** 2, axis=0).mean())
    assert np.sqrt(np.mean(squares)) == pytest.approx(norm, rel=0.03)


def test_more_penalty_means_fewer_sensors_down_to_none():
    programme = SparseDesign([system(2)])
    counts = [len(programme.design(alpha).chosen) for alpha in (0.0, 0.1, 0.5, 0.95)]
    assert counts[0] == 5 and counts == sorted(counts, reverse=True) and counts[-1] <= 1


def test_every_further_sensor_lowers_the_norm():
    s = system(3)
    norms = [kalman_h2(s, range(k))[0] for k in range(6)]
    assert all(a >= b - 1e-9 for a, b in pairwise(norms))


def test_a_system_that_a_set_cannot_observe_has_no_finite_norm():
    drifting = LinearSystem.one_row_each(np.zeros((2, 2)), np.eye(2), np.eye(2), np.ones(2), np.eye(2))
    assert kalman_h2(drifting, ())[0] == np.inf == kalman_h2(drifting, (0,))[0]
    # two integrators, each with its own sensor: X = 1 each
    assert kalman_h2(drifting, (0, 1))[0] == pytest.approx(np.sqrt(2.0))


@pytest.mark.parametrize("seed", range(3))
def test_choices_are_never_better_than_brute_force_and_as_good_on_these(seed):
    s = system(seed, m=6)
    found, best = best_sets([s], 3, alphas=(0.03, 0.3)), brute_force([s], 3)
    assert all(a.h2 >= b.h2 * (1.0 - 1e-9) for a, b in zip(found, best, strict=True))
    assert agrees(found, best)


def test_brute_force_refuses_more_than_ten_sensors():
    with pytest.raises(ValueError, match="at most 10"):
        brute_force([system(0, m=11)])


def test_a_useless_sensor_is_the_last_to_be_chosen():
    s = system(4)
    deaf = LinearSystem(s.a, s.noise, s.c, np.where(np.arange(5) == 2, 1e4, s.deviation), s.weight, s.sensors, s.names)
    chosen = best_sets([deaf], 4, alphas=(0.1,))[-1].sensors
    assert 2 not in chosen


def test_scaling_of_states_changes_nothing():
    s = system(0)
    scaled = s.scaled(np.array([1.0, 10.0, 0.1, 3.0]))
    assert kalman_h2(scaled, (0, 2))[0] == pytest.approx(kalman_h2(s, (0, 2))[0])


def test_process_noise_is_the_deviation_where_residuals_are_gaussian_and_corrected_where_not():
    rng = np.random.default_rng(0)
    gaussian = 3.0 + 2.0 * rng.standard_normal(20_000)
    exponential = rng.exponential(1.0, 20_000)  # skewness 2, mean 1, deviation 1: one sign
    shifted = exponential - 3.0  # skewed against its mean of -2
    two_valued = rng.choice([-1.0, 1.0], 20_000)  # excess kurtosis -2
    found = process_noise(np.column_stack([gaussian, exponential, shifted, two_valued, np.zeros(20_000)]))
    assert found == pytest.approx([2.0, 0.0, 3.0, np.sqrt(3.0), 0.0], abs=0.06)


def test_of_the_cars_sensors_an_accelerometer_with_the_wheel_beats_every_other_pair_and_all_beat_any():
    systems = car_systems(read_car("smart"))
    assert all(s.a.shape == (STATES, STATES) for s in systems)
    pair = tuple(SENSORS.index(name) for name in ("accelerometer_x", "wheel"))
    others = [tuple(SENSORS.index(n) for n in names) for names in (("gps", "wheel"), ("gps", "compass"))]
    norm = joint_h2(systems, pair)
    assert norm < min(joint_h2(systems, other) for other in others)
    assert joint_h2(systems, range(9)) < norm < joint_h2(systems, ())


def test_the_cars_lateral_sensors_buy_nothing_of_thrust_and_pitch():
    systems = car_systems(read_car("smart"))
    every = joint_h2(systems, range(9))
    without = {
        name: joint_h2(systems, [i for i in range(9) if SENSORS[i] != name])
        for name in ("compass", "accelerometer_y", "accelerometer_x")
    }
    assert without["compass"] == pytest.approx(every, rel=1e-3)
    assert without["accelerometer_y"] == pytest.approx(every, rel=1e-3)
    assert without["accelerometer_x"] > 1.2 * every
    assert cost(("gps", "wheel")) == cost(("gps",)) + cost(("wheel",))
