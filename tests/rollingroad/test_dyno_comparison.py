"""The road's map against the dynamometer's."""

from dataclasses import replace

import numpy as np
import pytest

from observer.efficiency_map import EfficiencyMap
from observer.fit_form import Fit
from rollingroad.evaluation.dyno import compare_with_dyno


def efficiency(omega, torque):
    return 0.35 * np.exp(-(((omega - 350.0) / 400.0) ** 2) - ((torque - 70.0) / 80.0) ** 2)


class TheFit(Fit):
    name, r2, r2_efficiency = "the truth", 1.0, 1.0

    def fuel_power(self, engine_speed, torque):
        return engine_speed * torque / efficiency(engine_speed, torque)


def road_map(scale=1.0):
    omega, torque = np.arange(2.6, 650.0, 5.236), np.arange(1.0, 120.0, 2.0)
    mean = scale * efficiency(omega[:, None], torque)
    counts = np.full(mean.shape, 10)
    return EfficiencyMap(omega, torque, mean, 0.01 * mean, counts, counts, counts / 10.0, counts * 1e3,
                         np.ones(mean.shape, bool), 1e9)  # fmt: skip


BENCH = np.arange(2500.0, 6001.0, 100.0) * np.pi / 30.0, np.arange(25.0, 81.0, 5.0)


def test_equal_maps_agree_inside_the_dynamometers_range_only():
    found = compare_with_dyno(road_map(), TheFit(), *BENCH, efficiency(BENCH[0][:, None], BENCH[1]))
    columns = (road_map().engine_speed > BENCH[0][0]) & (road_map().engine_speed < BENCH[0][-1])
    assert found.cells == 28 * columns.sum()
    assert found.rmse < 5e-4 and found.scale == pytest.approx(1.0, abs=2e-3)
    assert abs(found.peak_value_error) < 1e-3


def test_a_scale_error_is_told_from_a_wrong_form():
    """3.5: "there is a scaling effect", the form is identical."""
    found = compare_with_dyno(road_map(1.05), TheFit(), *BENCH, efficiency(BENCH[0][:, None], BENCH[1]))
    assert found.scale == pytest.approx(1 / 1.05, abs=2e-3)
    assert found.rmse > 0.01 and found.scaled_rmse < 5e-4


def test_nothing_in_common_is_said():
    bench = efficiency(BENCH[0][:, None], BENCH[1]) * np.nan
    found = compare_with_dyno(road_map(), TheFit(), *BENCH, bench)
    assert found.cells == 0 and np.isnan(found.rmse)


def test_a_run_in_each_gear_weighs_as_the_road_used_them():
    """Given a road that turns to a lower gear, with more losses, as the engine turns faster: the dynamometer in both
    gears, weighted as the road used them, agrees; in one alone it does not; a gear that nobody used may be empty."""

    def low_gear_share(omega, torque):
        low = np.clip((omega - BENCH[0][0]) / (BENCH[0][-1] - BENCH[0][0]), 0.0, 1.0)
        return np.stack([low, 1.0 - low, np.zeros_like(low)], axis=-1)

    truth = efficiency(BENCH[0][:, None], BENCH[1])
    runs = np.stack([0.96 * truth, truth, np.full_like(truth, np.nan)])
    road = road_map()
    omega, torque = np.meshgrid(road.engine_speed, road.torque, indexing="ij")
    mixed = road.mean * (1.0 - 0.04 * low_gear_share(omega, torque)[..., 0])
    road = replace(road, mean=mixed)
    alone = compare_with_dyno(road, TheFit(), *BENCH, truth)
    weighted = compare_with_dyno(road, TheFit(), *BENCH, runs, low_gear_share)
    assert weighted.cells == alone.cells
    assert weighted.rmse < 5e-4 < 3e-3 < alone.rmse
