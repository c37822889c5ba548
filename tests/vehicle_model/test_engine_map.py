"""The engine map has the shape that engines have, and that measured ones show."""

import csv
from pathlib import Path

import numpy as np
import pytest

from vehicle_model.car.files import read_car
from vehicle_model.plant import steady
from vehicle_model.plant.parameters import plant_parameters

MEASURED = Path(__file__).parents[3] / "shared" / "data" / "engine_maps"
BOTH = pytest.mark.parametrize("name", ["smart", "peugeot"])


def brake_efficiency(p, omega: float, torque: np.ndarray) -> np.ndarray:
    return omega * torque / steady.engine_fuel_power(p, omega, torque)


@BOTH
def test_peak_island_and_falls(name):
    """The issue's list: the peak's value, the island, the fall towards low torque, the fall at the redline."""
    car = read_car(name)
    p = plant_parameters(car)
    omega = np.linspace(car.engine.idle_speed, car.engine.redline_speed, 100)
    torque = np.linspace(0.02, 1.0, 100) * car.engine.max_torque
    grid_w, grid_t = np.meshgrid(omega, torque)
    gear = 4
    eta = steady.true_efficiency(p, gear, grid_w, grid_t)
    eta[grid_t > steady.full_load(p, gear, grid_w)] = np.nan
    peak = np.nanmax(eta)
    row, column = np.unravel_index(np.nanargmax(eta), eta.shape)
    assert 0.28 <= peak <= 0.38
    # an island: medium speed, high load, and down from it on every side
    assert 0.2 < (omega[column] - omega[0]) / (omega[-1] - omega[0]) < 0.7
    assert 0.55 < torque[row] / car.engine.max_torque < 0.95
    assert eta[:, column][0] < 0.35 * peak, "low torque"
    assert np.nanmax(eta[:, -1]) < 0.85 * peak, "redline"
    assert np.nanmax(eta[:, 0]) < 0.95 * peak, "idle speed"
    full = steady.full_load(p, gear, omega[column])
    assert steady.true_efficiency(p, gear, omega[column], full) < 0.98 * peak, "enriched full load"


@BOTH
def test_zero_torque_costs_fuel_and_more_torque_costs_more(name):
    car = read_car(name)
    p = plant_parameters(car)
    for omega in np.linspace(car.engine.idle_speed, car.engine.redline_speed, 12):
        for gear in range(1, len(car.gear_ratios) + 1):
            torque = np.linspace(0.0, float(steady.full_load(p, gear, omega)), 60)
            power = steady.fuel_power(p, gear, omega, torque)
            assert power[0] > 0.0
            assert np.all(np.diff(power) > 0.0)
        assert steady.overrun(p, 3, omega) < 0.0


@BOTH
def test_fuel_over_load_is_nearly_a_willans_line(name):
    """Given one engine speed, then below knock and enrichment fuel is straight in torque within 4 % of full load's."""
    car = read_car(name)
    p = plant_parameters(car)
    for share in (0.3, 0.5, 0.8):
        omega = share * car.engine.max_power_speed
        torque = np.linspace(0.05, 0.7, 40) * float(steady.engine_full_load(p, omega))
        power = steady.engine_fuel_power(p, omega, torque)
        line = np.polynomial.Polynomial.fit(torque, power, 1)
        assert np.max(np.abs(power - line(torque))) < 0.04 * power[-1]
        assert line(0.0) > 0.0


@BOTH
def test_lower_gears_lose_no_less_than_the_middle_ones(name):
    """Per-gear losses: efficiency to the wheels is behind the engine's own by a few per cent, by gear."""
    car = read_car(name)
    p = plant_parameters(car)
    omega, torque = 300.0, 0.5 * car.engine.max_torque
    engine = brake_efficiency(p, omega, np.array([torque]))[0]
    wheel = np.array([float(steady.true_efficiency(p, g, omega, torque)) for g in range(1, len(car.gear_ratios) + 1)])
    assert np.all(wheel < engine) and np.all(wheel > 0.85 * engine)
    assert np.ptp(wheel) > 0.002, "gears differ"


def measured_curves(name: str) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """(share of the last speed, load share, brake efficiency) at each speed of a measured map."""
    with (MEASURED / f"FC_{name}.csv").open() as file:
        rows = [{key: float(value or "nan") for key, value in row.items()} for row in csv.DictReader(file)]
    with (MEASURED / f"FC_{name}_wot.csv").open() as file:
        limit = np.array([[float(value) for value in row.values()] for row in csv.DictReader(file)])
    key = next(key for key in rows[0] if key.startswith("brake_eff"))
    curves = []
    for rpm in sorted({row["rpm"] for row in rows}):
        full = np.interp(rpm, limit[:, 0], limit[:, 1])
        points = np.array(
            [(r["torque_Nm"] / full, r[key]) for r in rows if r["rpm"] == rpm and 0 < r["torque_Nm"] <= full]
        )
        if len(points) > 3:
            curves.append((rpm / limit[-1, 0], points[:, 0], points[:, 1]))
    return curves


@pytest.mark.skipif(not MEASURED.is_dir(), reason="measured engine maps are not at ../shared/data/engine_maps")
@BOTH
def test_the_shape_is_that_of_measured_engines(name):
    """Given four measured petrol engines at three speeds, then ours lies in their band widened by 0.05, load by load,
    and rises from low to high load like theirs."""
    car = read_car(name)
    p = plant_parameters(car)
    for share in (0.3, 0.5, 0.8):
        theirs = []
        load = np.linspace(0.2, 0.8, 13)
        for engine in ("SI41_emis", "SI63_emis", "SI95", "SI102_emis"):
            _, at, eta = min(measured_curves(engine), key=lambda curve: abs(curve[0] - share))
            theirs.append(np.interp(load, at, eta))
        low, high = np.min(theirs, axis=0), np.max(theirs, axis=0)
        omega = share * car.engine.max_power_speed
        ours = brake_efficiency(p, omega, load * float(steady.engine_full_load(p, omega)))
        assert np.all(ours > low - 0.05) and np.all(ours < high + 0.05), (share, ours - low, high - ours)
        assert np.corrcoef(ours, np.mean(theirs, axis=0))[0, 1] > 0.95
