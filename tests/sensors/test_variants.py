"""Other fuel measurements, road roughness, injection that switches, and the thesis' file names."""

import dataclasses
import zipfile

import numpy as np
import pytest
from scipy.io import loadmat
from trips import drive, drive_along, smart, winding_route

from sensors import fuel_meters, injector
from sensors.box import BoxSettings, record
from sensors.log import SensorLog
from sensors.manifest import write_manifest
from sensors.packets import decode, nmea_text
from sensors.roadmap import from_route
from sensors.roughness import road_roughness


def used(rows) -> float:
    return float(rows["power"].sum() / fuel_meters.RATE)


def test_a_thermometer_takes_the_fuels_expansion_out_of_the_volume(car):
    trip = drive(2400.0, step=0.05)
    truth = np.interp(trip.time[-1] - 0.1, trip.time, trip.fuel_energy)
    with_it, without = (used(fuel_meters.volume_meter(trip, car, 0, thermometer=flag)) for flag in (True, False))
    assert with_it == pytest.approx(truth, rel=2e-3)
    # 1,200 s constant towards 20 K more: on average over 40 min 11.3 K, 1.08 % of the volume.
    assert without / truth - 1.0 == pytest.approx(0.0108, abs=0.002)


def test_fuel_from_air_and_oxygen_is_right_in_the_sum_and_late_in_the_change(car, trip):
    rows = fuel_meters.air_meter(trip, car, 0)
    assert used(rows) == pytest.approx(trip.fuel_energy[-1], rel=0.04)
    lags = np.arange(0.0, 0.5, 0.02)
    misfit = [np.mean((rows["power"] - np.interp(rows["t"] - lag, trip.time, trip.fuel_power)) ** 2) for lag in lags]
    assert 0.04 < lags[int(np.argmin(misfit))] < 0.25


def test_at_a_mixture_of_one_the_power_is_the_airs():
    car = smart()
    assert fuel_meters.power_from_air(np.array([14.6e-3]), np.array([1.0]), car)[0] == pytest.approx(43.0e3)


def test_simultaneous_injection_above_a_speed_makes_more_and_shorter_pulses(trip, car):
    limit = 250.0
    box = dataclasses.replace(BoxSettings(), injector_noise=0.0, injector_simultaneous_above=limit)
    rows = injector.measure(trip, car, box, 0)
    energy = car.injector_power * (rows["width"] + car.injector.lag)
    assert energy.sum() == pytest.approx(trip.fuel_energy[-1], rel=3e-3), "the fuel stays the same"
    turned = np.diff(np.interp(rows["t"], trip.time, trip.engine_angle))
    speed = np.interp(rows["t"][:-1], trip.time, trip.engine_speed)
    assert np.median(turned[speed > limit + 5]) == pytest.approx(4 * np.pi / 3, rel=1e-3)
    assert np.median(turned[speed < limit - 5]) == pytest.approx(4 * np.pi, rel=1e-3)


def test_a_bad_stretch_of_road_stands_out(car):
    trip = drive(600.0)
    log = decode(record(trip, car))
    rows = log["accelerometer"].copy()
    s = np.interp(rows["t"], trip.time, trip.distance)
    bad = (s > 3000.0) & (s < 3500.0)
    rows["z"][bad] += 1.5 * np.random.default_rng(0).standard_normal(int(bad.sum()))
    found = road_roughness(SensorLog(log.streams | {"accelerometer": rows}), car)
    inside = (found["distance"] > 3050) & (found["distance"] < 3450)
    assert found["relative"][inside].min() > 1.7
    assert np.median(found["relative"][~inside]) == pytest.approx(1.0, abs=0.1)


def test_the_manifest_has_the_thesis_names(tmp_path, car):
    route = winding_route(2000.0)
    card = record(drive_along(route), car)
    log = decode(card, "2009-10-27.dat")
    text = nmea_text(card)
    speed = np.arange(3.0)
    made = write_manifest(
        tmp_path, "2009-10-27.dat", log, text, {"speed": speed}, from_route(route), car.metres_per_tick
    )
    names = {"data.mat", "extract.mat", "results.mat", "DEM.mat", "gps.txt", "spd.kmz"}
    assert {path.name for path in made} == {f"2009-10-27.dat, {name}" for name in names}
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in made}
    data = loadmat(tmp_path / "2009-10-27.dat, data.mat", simplify_cells=True)
    assert np.array_equal(data["wheel"]["t"], log["wheel"]["t"])
    assert "gps" not in data
    assert loadmat(tmp_path / "2009-10-27.dat, extract.mat", simplify_cells=True)["gps"]["utc"].size == log["gps"].size
    assert text.count(b"$GPGGA") == log["gps"].size
    assert (tmp_path / "2009-10-27.dat, gps.txt").read_bytes() == text
    with zipfile.ZipFile(tmp_path / "2009-10-27.dat, spd.kmz") as archive:
        assert archive.namelist() == ["doc.kml"]
        assert b"LineString" in archive.read("doc.kml")
