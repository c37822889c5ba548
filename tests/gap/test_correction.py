"""The calibrated correction of the simulator's fuel: it must move with the torque as the car that it stands for."""

from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from rollingroad.gap.blocks import REGIMES
from rollingroad.gap.design import map_correction
from rollingroad.gap.replay import Motion, replay_vector, vector_of
from vehicle_model.car.files import read_car
from vehicle_model.plant import kernel as k


@pytest.mark.parametrize("car_name", ["smart", "peugeot"])
def test_a_car_that_is_not_enriched_and_does_not_knock_has_the_slope_of_one(car_name: str) -> None:
    """Given references that show neither enrichment nor knock, when the road asks for more and more up to full load,
    then the corrected simulator's fuel is that of the plant with neither within 1 %, at every load."""
    car = read_car(Path(str(resources.files("vehicle_model.cars").joinpath(f"{car_name}.xml"))))
    n = 200
    zero, one = np.zeros(n), np.ones(n)
    engine_speed = 350.0
    speed = engine_speed / car.gear_ratios[3] * car.wheel_radius
    motion = Motion(
        np.linspace(600.0, 700.0, n), 1e4 * one, speed * one, zero, np.linspace(0.0, 2.5, n), engine_speed * one,
        np.full(n, 4), zero, zero, 1e9 * one, zero,
    )  # fmt: skip
    nominal = vector_of(car)
    plain = nominal.copy()
    plain[k.P_ENRICHMENT], plain[k.P_KNOCK] = 0.0, 1e-9
    shown = {"plant.enrichment.amount": -float(nominal[k.P_ENRICHMENT]), "map.knock": -float(nominal[k.P_KNOCK])}
    found = replay_vector(nominal, motion)
    driving = np.full(n, REGIMES.index("drive"))
    corrected = found.fuel + map_correction(car, shown)(found, motion, driving)
    within = found.load < 1.0
    assert found.load[within].max() > 0.9
    np.testing.assert_allclose(corrected[within], replay_vector(plain, motion).fuel[within], rtol=0.01)
    assert (found.fuel > 1.05 * corrected)[within].any()
