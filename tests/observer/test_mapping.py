"""The efficiency map from driving: selection, grid, validity, merging, files, limits, the planner's table."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_drive import CAR, FULL_LOAD, IDLE_POWER, OVERRUN, RPM, drive, true_efficiency

from observer.efficiency_map import SPEED_STEP
from observer.envelope import DRAGGED_SHARE, default_overrun, drag_of_lines
from observer.estimate import STATES
from observer.fit_form import Fit
from observer.fits import default_fit, fit_all
from observer.mapping import centres, fit_error, fuel_map, map_engine, map_error, read, shared_torque_error, write
from observer.operating_points import operating_points
from vehicle_model.car.errors import BadInput


@pytest.fixture(scope="module")
def drives():
    return [drive(seed) for seed in range(3)]


@pytest.fixture(scope="module")
def merged(drives):
    return map_engine(drives, CAR)


def test_a_perfect_estimate_gives_the_true_map():
    clean = drive(7, seconds=600.0, thrust_noise=1e-9, fuel_noise=0.0)
    found = map_engine([clean], CAR)
    # what is left is the 10 Hz derivative of engine speed and the cell's width
    assert found.valid.sum() > 100
    assert map_error(found, true_efficiency) < 0.002


def test_noise_is_averaged_down_by_more_trips(drives, merged):
    one = map_engine(drives[:1], CAR)
    assert map_error(merged, true_efficiency) < map_error(one, true_efficiency)
    assert merged.fuel_share > one.fuel_share
    assert merged.trips == 3


def test_merging_does_not_depend_on_the_order_of_the_trips(drives, merged):
    other = map_engine(drives[::-1], CAR)
    np.testing.assert_allclose(other.mean, merged.mean, rtol=1e-12)
    assert np.array_equal(other.valid, merged.valid)


def test_grid_is_fifty_rpm_by_two_newton_metres(merged):
    assert np.allclose(np.diff(merged.engine_speed), 50 * RPM) and np.allclose(np.diff(merged.torque), 2.0)
    assert merged.engine_speed[0] == pytest.approx(25 * RPM) and merged.torque[0] == pytest.approx(1.0)
    assert np.array_equal(np.isfinite(merged.mean), merged.count > 0)


def test_valid_cells_have_half_a_second_two_visits_and_little_spread(merged):
    rule = (merged.seconds >= 0.5 - 1e-9) & (merged.visits >= 2) & (np.nan_to_num(merged.deviation, nan=1.0) <= 0.05)
    assert np.array_equal(merged.valid, rule)
    assert np.allclose(merged.seconds, 0.1 * merged.count)
    assert (merged.count[merged.valid] >= 5).all()


def test_a_single_long_stay_is_never_valid():
    """Given the same operating point for ten minutes, then one visit: no cell is valid."""
    n, step = 6000, 0.1
    rows = np.zeros((n, len(STATES)))
    speed = 20.0
    omega = CAR.gear_ratios[3] / CAR.wheel_radius * speed
    thrust = 40.0 * omega / speed
    for name, value in {"speed": speed, "thrust": thrust, "engine_speed": omega, "fuel_power": 45e3}.items():
        rows[:, STATES.index(name)] = value
    steady = replace(drive(0, seconds=60.0), time=np.arange(n) * step, state=rows, smoothed=rows,
                     variance=np.full_like(rows, 1e-6), smoothed_variance=np.full_like(rows, 1e-6))  # fmt: skip
    found = map_engine([steady], CAR)
    assert found.count.sum() > 5000 and found.visits.max() == 1
    assert not found.valid.any() and np.isnan(map_error(found, true_efficiency)) and found.fuel_share == 0.0


def test_fuel_share_counts_only_fuel_burnt_in_valid_cells(drives, merged):
    burnt = sum(d.column("fuel_energy")[-1] - d.column("fuel_energy")[0] for d in drives)
    assert merged.fuel_total == pytest.approx(burnt)
    assert 0.3 < merged.fuel_share < merged.fuel.sum() / merged.fuel_total <= 1.0


def test_shifts_standstill_and_overrun_are_not_mapped(drives):
    points = operating_points(drives[0], CAR)
    clean = drive(0, thrust_noise=1e-9, fuel_noise=0.0)
    fuel, omega, speed = (clean.column(name) for name in ("fuel_power", "engine_speed", "speed"))
    assert not points.mapped[fuel == 0.0].any()
    assert not points.mapped[speed < 1.0].any()
    slipping = (
        np.abs(omega / np.maximum(speed, 0.1) * CAR.wheel_radius - np.array(CAR.gear_ratios)[:, None])
        / (np.array(CAR.gear_ratios)[:, None])
    )
    assert not points.mapped[slipping.min(axis=0) > 0.04].any()
    assert points.mapped.mean() > 0.3


def test_the_engines_inertia_is_added_to_the_thrusts_torque():
    """Erratum 1.13: in a low gear the thrust misses J_e d(omega)/dt."""
    clean = drive(3, seconds=600.0, thrust_noise=1e-9, fuel_noise=0.0)
    weightless = replace(CAR, engine=replace(CAR.engine, inertia=0.0))
    assert map_error(map_engine([clean], CAR), true_efficiency) < 0.3 * map_error(
        map_engine([clean], weightless), true_efficiency
    )


def test_intervals_cover_the_truth():
    """Given cars that differ from their file as the tolerances say, each seen in one trip: 90 % intervals cover it."""
    rng, inside, inside_fit = np.random.default_rng(5), [], []
    for seed in range(8):
        absolute, relative = shared_torque_error(CAR, 1)
        force = absolute * min(CAR.gear_ratios) / CAR.wheel_radius
        seen = drive(seed, seconds=500.0, trip_error=relative * rng.normal(), offset=force * rng.normal())
        found = map_engine([seen], CAR)
        truth = true_efficiency(*centres(found))
        inside.append(np.abs(found.mean[found.valid] - truth) < 1.645 * found.standard_error[found.valid])
        fit = default_fit(fit_all(found, CAR))
        inside_fit.append(np.abs(fit.efficiency(*centres(found)) - truth) < 1.645 * fit.deviation(*centres(found)))
    assert 0.80 <= np.mean(np.concatenate(inside)) <= 0.98
    assert 0.75 <= np.mean(np.concatenate(inside_fit)) <= 0.99


def test_a_copied_trip_adds_less_certainty_than_a_new_one_of_its_length(drives):
    """A stay twice as long within the errors' correlation time is not twice the information."""
    one = map_engine(drives[:1], CAR)
    slow = drives[0]
    doubled = replace(slow, time=np.arange(2 * len(slow.time)) * 0.05,
                      **{name: np.repeat(getattr(slow, name), 2, axis=0)
                         for name in ("state", "variance", "smoothed", "smoothed_variance")})  # fmt: skip
    again = map_engine([doubled], CAR)
    both = one.valid & (again.count > 0)
    # twenty samples a second instead of ten, of the same drive: no cell becomes more certain by more than a little
    assert np.median(again.standard_error[both] / one.standard_error[both]) > 0.9


def test_drag_follows_from_the_lines_where_no_fuel_cut_was_seen_and_yields_to_it(drives):
    """Lines that say 1.5 times the default's drag at the speeds driven, of which `DRAGGED_SHARE` is dragged, and
    anything where the car never ran: the drag has the default's form and the lines' size."""

    class Lines(Fit):
        def __init__(self, beyond):
            self.beyond = beyond

        def fuel_power(self, engine_speed, torque):
            omega = np.asarray(engine_speed)
            nothing = -1.5 * 2.8 * default_overrun(omega, CAR) * np.where(omega > self.beyond, 3.0, 1.0)
            return omega * (nothing + 2.8 * np.asarray(torque))

    centre = (np.arange(100) + 0.5) * SPEED_STEP
    unseen = drag_of_lines([], Lines(1e9), CAR, 100)
    np.testing.assert_allclose(unseen, 1.5 * DRAGGED_SHARE * default_overrun(centre, CAR))
    trips = [operating_points(drive, CAR) for drive in drives]
    seen = drag_of_lines(trips, Lines(1e9), CAR, 100)
    never_driven = max(trip.engine_speed[trip.firing].max() for trip in trips)
    np.testing.assert_allclose(drag_of_lines(trips, Lines(never_driven), CAR, 100), seen)
    longer = drag_of_lines(10 * trips, Lines(1e9), CAR, 100)
    turning = np.concatenate([trip.engine_speed[trip.cut] for trip in trips])
    lowest = np.quantile(OVERRUN / default_overrun(turning, CAR), 0.2)
    error = [abs((drag / default_overrun(centre, CAR)).mean() - lowest) for drag in (longer, seen, unseen)]
    assert error[0] < error[1] < error[2]


def test_limits_are_found(merged):
    limits = merged.limits
    assert limits.idle_power == pytest.approx(IDLE_POWER, rel=0.01)
    assert limits.idle_speed == pytest.approx(CAR.engine.idle_speed, rel=0.01)
    drag = limits.overrun_torque[np.isfinite(limits.overrun_torque)]
    assert len(drag) > 5 and np.median(drag) == pytest.approx(OVERRUN, abs=1.5)
    fast = merged.engine_speed > CAR.engine.max_torque_speed
    pulled = limits.torque_max[fast & np.isfinite(limits.torque_max)]
    if len(pulled):
        assert np.median(pulled) == pytest.approx(FULL_LOAD * CAR.engine.max_torque, rel=0.06)


def test_the_planners_table_is_finite_positive_and_rises_with_torque(merged):
    fits = fit_all(merged, CAR)
    for fit in fits.values():
        table = fuel_map(merged, CAR, fit)
        assert np.isfinite(table.fuel_power).all(), fit.name
        assert (table.fuel_power[:, 0] > 0).all() and (np.diff(table.fuel_power, axis=1) >= 0).all(), fit.name
        assert (table.overrun_torque < 0).all() and (table.torque_max > 0).all()
        assert table.torque[0] == 0.0 and table.torque[-1] > table.torque_max.max()
    assert fuel_map(merged, CAR, default_fit(fits)).idle_power == pytest.approx(IDLE_POWER, rel=0.01)


def test_no_driving_at_all_still_gives_a_table():
    parked = map_engine([replace_speed(drive(0, seconds=60.0))], CAR)
    assert not parked.valid.any()
    table = fuel_map(parked, CAR, default_fit(fit_all(parked, CAR)))
    assert np.isfinite(table.fuel_power).all() and table.idle_power > 0


def replace_speed(estimate):
    rows = estimate.smoothed.copy()
    rows[:, STATES.index("speed")] = 0.0
    return replace(estimate, state=rows, smoothed=rows)


def test_default_fit_beats_the_cells_it_was_made_from(merged):
    fit = default_fit(fit_all(merged, CAR))
    assert fit.name.startswith("P_in")
    assert fit_error(merged, fit, true_efficiency) < 0.6 * map_error(merged, true_efficiency)


def test_a_map_comes_back_from_its_files_with_the_same_bytes(merged, tmp_path):
    write(merged, tmp_path / "a")
    back = read(tmp_path / "a")
    for name in ("mean", "deviation", "standard_error", "seconds"):
        np.testing.assert_array_equal(getattr(back, name), getattr(merged, name))
    assert back.valid.dtype == bool and np.array_equal(back.valid, merged.valid)
    assert back.fuel_total == merged.fuel_total and back.trips == merged.trips
    np.testing.assert_array_equal(back.limits.torque_max, merged.limits.torque_max)
    write(back, tmp_path / "b")
    for name in ("map.json", "map.parquet"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_missing_or_broken_map_is_told_in_one_line(merged, tmp_path):
    with pytest.raises(BadInput, match=r"map\.json"):
        read(tmp_path)
    write(merged, tmp_path)
    (tmp_path / "map.json").write_text("{}")
    with pytest.raises(BadInput, match="expected"):
        read(tmp_path)


def test_the_planners_table_is_convex_in_torque(merged):
    for fit in fit_all(merged, CAR).values():
        steps = np.diff(fuel_map(merged, CAR, fit).fuel_power, axis=1)
        assert (np.diff(steps, axis=1) >= -1e-6 * steps.max()).all(), fit.name
