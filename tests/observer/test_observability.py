"""Observability: textbook cases, the table of 3.1.2.1 derived, and the asynchronous counter-example of note 18."""

import numpy as np
import pytest
from synthetic import SMART

from observer import model
from observer.observability import SCALE, hautus, kalman_matrix, lie_matrix, lost_states, rank, sensor_table


def test_rank_and_hautus_agree_on_textbook_cases():
    chain = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    first, last = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    assert rank(kalman_matrix(chain, first)) == 3
    assert hautus(chain, first)
    assert rank(kalman_matrix(chain, last)) == 1
    assert not hautus(chain, last)
    assert lost_states(kalman_matrix(chain, last)) == [0, 1]
    twins = np.diag([2.0, 2.0])
    assert not hautus(twins, np.array([[1.0, 1.0]])), "two equal modes need two sensors"


def test_linearised_car_agrees_with_its_lie_derivatives():
    """At a steady drive on a straight slope the first Lie terms are the linear test's."""
    x = np.zeros(17)
    x[[model.V, model.THETA, model.PIN, model.OMEGA]] = 20.0, 0.03, 2e4, 250.0
    a = model.dynamics_jacobian(x, SMART)
    kinds = (model.DISTANCE, model.ACCELERATION_X, model.GPS_NORTH)
    c = np.array([model.measurement_jacobian(kind, x, SMART) for kind in kinds])
    lie = lie_matrix(SMART, kinds, x, order=1)
    np.testing.assert_allclose(lie[:3], c * SCALE, atol=1e-12)
    np.testing.assert_allclose(lie[3], (c[0] @ a) * SCALE, atol=1e-12)


def test_what_a_lost_sensor_costs_while_driving():
    table = sensor_table(SMART, 20.0)
    assert table["none"] == []
    assert table["gps"] == ["heading", "north", "east", "down"]
    assert table["accelerometer"] == ["bias_x", "bias_y", "bias_z"]
    assert table["wheel"] == ["distance"], "only the odometer's zero"
    assert table["road_map"] == []
    assert table["engine_speed"] == ["engine_angle", "engine_speed"]
    assert table["fuel_flow"] == ["fuel_energy", "fuel_power"]


def test_a_known_gear_stands_in_for_the_engine_speed_sensor():
    assert "engine_speed" not in sensor_table(SMART, 20.0, shaft=12.5)["engine_speed"]


def test_standing_still_hides_the_road_and_the_biases():
    lost = sensor_table(SMART, 0.0)["none"]
    assert {"straightness", "vertical_straightness", "pitch", "bias_x"} <= set(lost)
    assert not {"speed", "distance", "north", "east", "down", "fuel_power", "engine_speed"} & set(lost)


def asynchronous_matrix(omega: float, dt: float, both: bool) -> np.ndarray:
    """Gradients of the samples of note 18's system by (angle, x3); y1 and y2 alternate, or come together."""
    rows = []
    angle, radius = 0.7, 1.3
    for k in range(12):
        phase = omega * dt * k + angle
        y1 = [-radius * np.sin(phase), np.cos(phase)]
        y2 = [radius * np.cos(phase), np.sin(phase)]
        rows += [y1, y2] if both else [y1 if k % 2 == 0 else y2]
    return np.array(rows)


@pytest.mark.parametrize(("both", "seen"), [(True, 2), (False, 1)])
def test_asynchronous_sampling_can_lose_what_synchronous_sampling_sees(both, seen):
    """Note 18: y1 and y2 taken in turn, a quarter of a turn apart, cannot tell radius from phase."""
    assert rank(asynchronous_matrix(np.pi / 2, 1.0, both), 1e-9) == seen
    assert rank(asynchronous_matrix(1.1, 1.0, both), 1e-9) == 2, "at another rate it can"
