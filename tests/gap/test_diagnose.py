"""The diagnosis end to end, on trips of the challenge's own car, which shares nothing with the plant."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rollingroad.gap.blocks import CHANNELS
from rollingroad.gap.calibration import tamed
from rollingroad.gap.challenge import box, cars, routes, truth
from rollingroad.gap.channels import values
from rollingroad.gap.diagnose import _one, diagnose, weigh
from rollingroad.gap.noise import default_noise, whitener
from rollingroad.gap.refit import context_of, refit
from rollingroad.gap.replay import vector_of
from rollingroad.gap.result import as_json
from rollingroad.gap.trips import whiten
from sensors.log import SensorLog
from sensors.packets import decode
from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car

HEAT = 745.0 * 43e6
DRIVER = {"accel": 1.6, "decel": 1.3, "up_rpm": 2800.0, "down_rpm": 1500.0, "speed_factor": 1.0, "shift_time": 0.5,
          "gain": 0.6, "launch_speed": 150.0, "lift_time": 6.0}  # fmt: skip


@pytest.fixture(scope="module")
def garage(tmp_path_factory: pytest.TempPathFactory):
    """A car, its file, and a maker of logged trips."""
    rng = np.random.default_rng(11)
    car = cars.draw(rng)
    path = tmp_path_factory.mktemp("car") / "car.xml"
    path.write_text(car.xml)

    def trip(seed: int, effects: dict[str, float], sensed: dict[str, float]) -> bytes:
        rng = np.random.default_rng(seed)
        road = routes.draw(rng, 7000, {"town": 0.3, "rural": 0.5, "motorway": 0.2})
        driver = {**DRIVER, "lift_time": rng.uniform(3, 8), "up_rpm": rng.uniform(2500, 3200)}
        drive = truth.simulate(car.true, car.ratios, driver, road, effects, np.ones(3000), np.zeros(3000))
        at = np.arange(len(road.north)) * road.step
        north, east = np.interp(drive["s"], at, road.north), np.interp(drive["s"], at, road.east)
        return box.record(drive, north, east, car.box, sensed, HEAT, rng)

    reference = [decode(trip(seed, {}, {}), f"reference_{seed}") for seed in (1, 2, 3)]
    return path, trip, reference


def _answer(garage, effects: dict[str, float], sensed: dict[str, float], hide: tuple[str, ...] = ()) -> dict:
    path, trip, reference = garage
    logs = [decode(trip(seed, effects, sensed), f"trip_{seed}") for seed in (21, 22)]
    return as_json(weigh(read_car(path), logs, reference, None, hide))


def _known(result: dict) -> list[str]:
    return next(c["effects"] for c in result["causes"] if c["effects"] != ["none"])


def test_without_a_gap_nothing_is_named(garage) -> None:
    """Given other trips of the same car, then the verdict is no gap, and the rows say so and sum to one."""
    result = _answer(garage, {}, {})
    assert result["verdict"] == "no_gap"
    assert sum(c["probability"] for c in result["causes"]) == pytest.approx(1.0)
    assert {"none", "outside_catalogue"} <= {e for c in result["causes"] for e in c["effects"]}
    json.dumps(result)


def test_a_wind_is_named_measured_and_shrinks_the_held_out_gap(garage) -> None:
    """Given a wind of 5 m/s from the north, then it is named within 15 %, in the road load, and most is recovered."""
    result = _answer(garage, {"wind_n": 5.0}, {})
    first = result["causes"][0]
    assert first["effects"] == ["head_wind"]
    assert first["parameters"]["head_wind.speed"]["value"] == pytest.approx(5.0, rel=0.15)
    assert result["where"][0]["subsystem"] == "road_load"
    assert result["shrinkage"]["held_out"]
    assert result["shrinkage"]["recovered"] > 0.6
    advice = result["advice"]
    assert 0.0 <= advice["fuel_regret_after_percent"] < advice["fuel_regret_before_percent"]


def test_a_hidden_compressor_is_told_by_its_period(garage) -> None:
    """Given a power that comes and goes every 31 s, with all that is alike out of the catalogue, then it is outside,
    and the hypothesis has the period, whatever the phase."""
    result = _answer(
        garage, {"ac_power": 2500.0, "ac_period": 31.0, "ac_duty": 0.4}, {},
        ("ac_cycling", "accessory_load", "injector_dead_time"),
    )  # fmt: skip
    assert result["verdict"] == "outside_catalogue"
    told = next(c for c in result["causes"] if c["effects"] == ["outside_catalogue"])["parameters"]
    periods = [float(name.split("every ")[1].split()[0]) for name in told if "a power that comes and goes" in name]
    assert any(abs(period - 31.0) < 0.7 for period in periods)


def test_a_hidden_effect_is_not_named_but_told_apart(garage) -> None:
    """Given overrun that burns, with that effect out of the catalogue, then it is outside, in engine and fuel."""
    seen = _answer(garage, {"cut_lost": 1.0}, {})
    hidden = _answer(garage, {"cut_lost": 1.0}, {}, ("fuel_cutoff",))
    assert _known(seen) == ["fuel_cutoff"]
    assert hidden["verdict"] == "outside_catalogue"
    assert not any("fuel_cutoff" in c["effects"] for c in hidden["causes"])
    assert hidden["where"][0]["subsystem"] == "engine_fuel"


def test_a_sensor_is_not_booked_to_physics(garage) -> None:
    """Given a smaller wheel, then the wheel is named with its size and nothing of the car."""
    result = _answer(garage, {}, {"radius": 0.985})
    first = result["causes"][0]
    assert first["effects"] == ["wheel_radius"]
    assert first["parameters"]["wheel_radius.change"]["value"] == pytest.approx(-0.015, abs=0.002)
    assert result["where"][0]["subsystem"] == "wheel"


def test_a_foreign_engine_without_references_is_no_effect(garage) -> None:
    """Given no reference trips and an engine that the simulator does not know, then nothing is named on trips without a
    gap, the notes say why, and a sensor that needs no engine is named all the same."""
    path, trip, _ = garage
    logs = [decode(trip(seed, {}, {}), f"trip_{seed}") for seed in (21, 22)]
    found = weigh(read_car(path), logs, [], None)
    assert as_json(found)["verdict"] == "no_gap"
    assert any("no reference trips" in note for note in found.notes)
    small = [decode(trip(seed, {}, {"radius": 0.985}), f"trip_{seed}") for seed in (21, 22)]
    assert as_json(weigh(read_car(path), small, [], None))["causes"][0]["effects"] == ["wheel_radius"]


def test_a_leading_cause_is_re_simulated_at_its_size(garage) -> None:
    """Given a strong wind, then the columns give the signal of the simulator run with that wind, and not of the linear
    one, which knows nothing of the wind's square."""
    path, trip, reference = garage
    car = read_car(path)
    logs = [decode(trip(seed, {"wind_n": 7.0}, {}), f"trip_{seed}") for seed in (21, 22)]
    found = weigh(car, logs, reference, None)
    variant, fit = found.posterior.fits["head_wind"]
    place = found.lexicon.place_of(variant)
    correction = dict(zip(found.layout.calibration, found.calibration.mean, strict=True))
    for one in found.logs:
        context = context_of(one, car, vector_of(car), correction)
        wanted = variant.at(context, fit.value)
        error = np.linalg.norm(one.effects[:, place] @ fit.value - wanted) / np.linalg.norm(wanted)
        linear = np.linalg.norm(variant.make(context) @ fit.value - wanted) / np.linalg.norm(wanted)
        assert error < 0.02 < linear


def test_a_re_simulation_that_fits_worse_is_not_taken(garage) -> None:
    """Given a wind that is re-simulated from the side, then its columns stay as they were."""
    path, trip, reference = garage
    car = read_car(path)
    logs = [decode(trip(seed, {"wind_n": 7.0}, {}), f"trip_{seed}") for seed in (21, 22)]
    found = weigh(car, logs, reference, None)
    variant, fitted = found.posterior.fits["head_wind"]
    astray = replace(variant, settings=lambda x: variant.settings(np.array([-x[1], x[0]])))
    lexicon = replace(found.lexicon, variants=tuple(astray if v is variant else v for v in found.lexicon.variants))
    posterior = replace(found.posterior, singles={"head_wind": 1.0}, pairs={}, fits={"head_wind": (astray, fitted)})
    whitened = [whiten(one, found.layout, found.calibration.noise) for one in found.logs]
    after, again = refit(found.logs, whitened, found.layout, found.calibration, lexicon, posterior, car)
    for old, new, w, v in zip(found.logs, after, whitened, again, strict=True):
        np.testing.assert_array_equal(new.effects, old.effects)
        np.testing.assert_allclose(v.gram, w.gram)


def test_references_can_show_that_a_car_has_no_cornering_drag(garage) -> None:
    """Given a trip, then what the simulator's cornering drag does to the residuals is within what the calibration may
    take off, or a car that has none would look as if it had a negative one for ever."""
    path, trip, _ = garage
    car = read_car(path)
    one, _ = _one((decode(trip(21, {}, {}), "trip"), car, None, None))
    assert one is not None
    without = values(one.p, car, vector_of(car, {"cornering_drag.factor": 0.0})) - values(one.p, car, vector_of(car))
    columns = one.calibration.matrix
    left = without - columns @ np.linalg.lstsq(columns, without, rcond=None)[0]
    assert np.linalg.norm(left) < 1e-6 * np.linalg.norm(without)


def test_one_stalled_launch_is_doubted_and_a_slipping_clutch_is_not(garage) -> None:
    """Given one launch far off, then its deviation is raised and no other's; given all launches off alike, none."""
    path, trip, reference = garage
    one = weigh(read_car(path), [decode(trip(21, {}, {}), "trip")], reference, None).logs[0]
    kind = np.flatnonzero(one.p.layout.channel == CHANNELS.index("launch_speed"))
    assert len(kind) >= 5
    calm = np.zeros(len(one.p.layout.channel))
    stalled = calm.copy()
    stalled[kind[1]] = 30.0
    raised = tamed([one], [stalled])[0].p.layout.sigma / one.p.layout.sigma
    assert raised[kind[1]] > 10.0
    assert np.delete(raised, kind[1]) == pytest.approx(1.0)
    slipping = calm.copy()
    slipping[kind] = 30.0
    assert tamed([one], [slipping])[0].p.layout.sigma == pytest.approx(one.p.layout.sigma)


def test_a_crossing_road_for_ten_seconds_is_no_shifted_map(garage) -> None:
    """Given heights of which one is off by 12 m, as where the matcher takes the road that crosses, then it is doubted,
    and what it says of all the others is a twentieth of what it said."""
    path, trip, _ = garage
    one, _ = _one((decode(trip(21, {}, {}), "trip"), read_car(path), None, None))
    assert one is not None
    layout = one.p.layout
    heights = layout.channel == CHANNELS.index("height_gps")
    mapped = replace(
        one.p, layout=replace(layout, channel=np.where(heights, CHANNELS.index("height_map"), layout.channel))
    )
    error = np.zeros(len(layout.channel))
    error[np.flatnonzero(heights)[20]] = 12.0
    before = whitener(mapped, default_noise())(error)
    doubted = tamed([replace(one, p=mapped)], [before])[0].p
    after = whitener(doubted, default_noise())(error)
    assert np.linalg.norm(before) > 8.0
    assert np.linalg.norm(after) < 0.3 * np.linalg.norm(before)
    assert np.linalg.norm(np.delete(after, np.flatnonzero(heights)[20])) < 0.05 * np.linalg.norm(before)


def test_another_car_is_refused_by_name(garage, tmp_path: Path) -> None:
    """Given logs of a car with other gears, then one line names the log and what was expected."""
    path, trip, reference = garage
    other = tmp_path / "other.xml"
    text = path.read_text()
    ratios = [line for line in text.splitlines() if "gear=" in line and 'gear=""' not in line]
    for line in ratios:
        value = float(line.split('"')[1])
        text = text.replace(line, line.replace(f"{value:.3f}", f"{value * 1.13:.3f}"))
    other.write_text(text)
    with pytest.raises(BadInput, match="another car"):
        weigh(read_car(other), [decode(trip(21, {}, {}), "trip")], reference, None)


def test_too_short_and_empty_input(garage, tmp_path: Path) -> None:
    """Given seconds of driving, an empty folder, an unknown effect, then each is refused in words."""
    path, trip, _ = garage
    log = decode(trip(21, {}, {}), "short")
    rows = {n: part[part["t"] < part["t"][0] + 20.0] for n, part in log.streams.items() if len(part)}
    cut = SensorLog(rows, {}, "short")
    with pytest.raises(BadInput, match="too short"):
        weigh(read_car(path), [cut], [], None)
    with pytest.raises(BadInput, match="at least one"):
        diagnose(path, tmp_path)
    with pytest.raises(BadInput, match="one of"):
        weigh(read_car(path), [log], [], None, ("no_such_effect",))
