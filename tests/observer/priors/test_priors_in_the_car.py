"""A learnt map as prior for the momentary efficiency; a road's heading and slope for the place without GPS."""

import numpy as np
import pytest

from observer.efficiency_map import FuelMap
from observer.estimate import STATES, Estimate
from observer.priors import GaussianPrior, LowPass, StaticPriorEstimator, Weighting
from observer.priors.localisation import Localiser, RoadShape
from observer.priors.momentary_efficiency import efficiency_by_fuel, with_map


def willans() -> FuelMap:
    speed, torque = np.linspace(80.0, 640.0, 57), np.arange(0.0, 121.0, 2.0)
    power = speed[:, None] * (torque[None, :] + 12.0) / 0.4
    return FuelMap(speed, torque, power, np.full(57, 110.0), np.full(57, -12.0), float(power[0, 0]), 85.0)


def test_efficiency_by_fuel_inverts_the_map():
    speed, torque = np.array([150.0, 300.0, 501.0]), np.array([20.0, 63.0, 100.0])
    fuel = speed * (torque + 12.0) / 0.4
    assert efficiency_by_fuel(willans(), speed, fuel) == pytest.approx(0.4 * torque / (torque + 12.0), rel=1e-9)
    assert efficiency_by_fuel(willans(), speed, 0.5 * speed * 12.0 / 0.4) == pytest.approx(0.0)


def estimate_of(worse: float, noise: float, seed: int) -> tuple[Estimate, np.ndarray]:
    """An engine of `worse` times the map's efficiency, seen through noisy thrust with outliers, fuel cut half-way."""
    rng = np.random.default_rng(seed)
    n = 1200
    torque = 50.0 + 25.0 * np.sin(np.arange(n) / 40.0)
    omega, speed = np.full(n, 300.0), np.full(n, 20.0)
    fuel = omega * (torque + 12.0) / 0.4
    truth = worse * torque * omega / fuel
    thrust = truth * fuel / speed * (1.0 + noise * rng.standard_normal(n))
    thrust[rng.random(n) < 0.03] *= 1.6
    fuel[500:520] = 0.0
    thrust[505] = np.nan
    state = np.zeros((n, len(STATES)))
    for name, values in (("thrust", thrust), ("speed", speed), ("fuel_power", fuel), ("engine_speed", omega)):
        state[:, STATES.index(name)] = values
    empty = np.zeros_like(state)
    return Estimate(0.1 * np.arange(n), state, empty, empty, empty, np.empty(0), (0.0, 0.0, 0.0), {}), truth


SPE = StaticPriorEstimator(GaussianPrior(0.0, 0.01, floor=0.1), Weighting.matched("negative_exponential", 0.97))


def errors(worse: float) -> dict[str, float]:
    estimate, truth = estimate_of(worse, 0.06, 3)
    use = np.ones(len(truth), bool)
    use[495:530] = False
    raw = estimate.column("thrust") * estimate.column("speed") / np.where(use, estimate.column("fuel_power"), np.nan)
    found = {
        "filter": raw,
        "SPE": with_map(estimate, willans(), SPE),
        "LP": with_map(estimate, willans(), LowPass(0.97)),
    }
    return {name: float(np.sqrt(np.mean((values - truth)[use] ** 2))) for name, values in found.items()}


def test_the_map_suppresses_outliers_of_the_momentary_efficiency():
    found = errors(1.0)
    assert found["SPE"] < 0.2 * found["filter"]
    assert found["SPE"] < found["LP"] < 0.5 * found["filter"]


def test_on_a_worn_engine_the_prior_must_be_left():
    """Twelve per cent worse than the map: the low-pass follows, the static prior holds on to the map and is worse."""
    found = errors(0.88)
    assert found["LP"] < found["SPE"]
    assert found["LP"] < found["filter"]


def test_the_residual_is_held_while_the_fuel_is_cut():
    estimate, _ = estimate_of(0.9, 0.0, 1)
    found = with_map(estimate, willans(), LowPass(0.9))
    assert np.all(np.isfinite(found))
    assert abs(found[530] / found[490] - 1.0) < 0.2


def winding(length: float = 6000.0, seed: int = 5) -> RoadShape:
    rng = np.random.default_rng(seed)
    s = np.arange(0.0, length, 10.0)
    bend = sum(0.003 * np.sin(s / wave + rng.uniform(0, 6)) for wave in (70.0, 150.0, 310.0))
    pitch = sum(0.02 * np.sin(s / wave + rng.uniform(0, 6)) for wave in (90.0, 190.0, 420.0))
    return RoadShape(s, np.cumsum(bend) * 10.0, pitch)


def drive(road: RoadShape, begin: float, steps: int, seed: int):
    """Readings of a car with an odometer 0.3 % short, a slope 20 mrad off and a compass 30 mrad off."""
    rng = np.random.default_rng(seed)
    true = begin + np.cumsum(np.full(steps, 14.0))
    moved = np.full(steps, 14.0) * 0.997
    middle = true - 7.0
    pitch = np.interp(middle, road.s, road.pitch) + 0.02 + 0.01 * rng.standard_normal(steps)
    heading = np.interp(middle, road.s, road.heading) - 0.03 + 0.03 * rng.standard_normal(steps)
    return true, moved, pitch, heading


@pytest.mark.parametrize("by", ["both", "slope", "heading"])
def test_the_place_is_found_from_anywhere_on_a_winding_hilly_road(by):
    road = winding()
    true, moved, pitch, heading = drive(road, 1500.0, 200, 1)
    found, spread = Localiser(particles=3000).follow(
        road, moved, None if by == "heading" else pitch, None if by == "slope" else heading
    )
    assert np.all(np.abs(found - true)[-50:] < 20.0)
    assert np.all(spread[-50:] < 20.0)


def test_from_a_known_start_it_removes_the_odometers_drift():
    road = winding()
    true, moved, pitch, heading = drive(road, 300.0, 300, 2)
    found, _ = Localiser().follow(road, moved, pitch, heading, (300.0, 3.0))
    assert abs(300.0 + moved.sum() - true[-1]) > 12.0
    assert np.abs(found - true)[-50:].max() < 6.0


def test_on_a_straight_level_road_it_does_not_pretend_to_know():
    s = np.arange(0.0, 6000.0, 10.0)
    road = RoadShape(s, np.zeros_like(s), np.zeros_like(s))
    _, moved, pitch, heading = drive(road, 1500.0, 100, 3)
    _, spread = Localiser().follow(road, moved, pitch, heading)
    assert spread[-1] > 800.0
