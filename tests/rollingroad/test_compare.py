"""Given two drivers on one route, savings are counted at equal time, equal distance and equal stored energy."""

import pytest

from rollingroad.evaluation.compare import Consumption, bracket, compare, search_bracket


def drive(fuel: float, time: float, *, end_energy: float = 0.0, price: float = 1.0) -> Consumption:
    return Consumption(fuel=fuel, time=time, distance=10_000.0, end_energy=end_energy, price=price)


def test_a_driver_who_is_only_slower_saves_nothing_at_equal_time():
    # One and the same trade-off curve fuel(time): the baseline lies on it, so the fair saving is zero.
    def fuel(t: float) -> float:
        return 20e6 - 10e3 * (t - 900.0)

    result = compare(drive(fuel(900.0), 900.0), [drive(fuel(880.0), 880.0), drive(fuel(960.0), 960.0)], 0.3)
    assert result.saving_percent == pytest.approx(0.0, abs=1e-9)
    assert result.naive_saving_percent == pytest.approx(100 * 600e3 / 20e6)


def test_the_naive_figure_never_counts_for_less_than_the_fair_one_when_the_slower_drive_is_thriftier():
    result = compare(drive(20e6, 900.0), [drive(19.5e6, 890.0), drive(18e6, 930.0)], 0.3)
    assert result.saving_percent is not None
    assert result.naive_saving_percent > result.saving_percent > 0.0


def test_arriving_with_less_kinetic_energy_is_not_a_saving():
    # 100 kJ less in the car at the end cost 100 kJ / 0.25 of fuel less to put there.
    arriving_slow = [drive(20e6 - 400e3, 890.0), drive(20e6 - 400e3, 910.0)]
    result = compare(drive(20e6, 900.0, end_energy=100e3), arriving_slow, 0.25)
    assert result.saving_percent == pytest.approx(0.0, abs=1e-9)


def test_without_a_bracket_there_is_no_fair_figure():
    result = compare(drive(20e6, 900.0), [drive(18e6, 950.0), drive(17e6, 1000.0)], 0.3)
    assert result.saving_percent is None and result.fuel is None
    assert result.time_difference_percent == pytest.approx(100 * 50 / 900)


def test_a_drive_at_exactly_the_baselines_time_brackets_itself():
    assert bracket([900.0], 900.0) == (0, 0)
    assert compare(drive(20e6, 900.0), [drive(19e6, 900.0)], 0.3).saving_percent == pytest.approx(5.0)


def test_the_search_ends_inside_the_wanted_width_when_time_falls_with_its_price():
    def driven(prices):
        return [drive(20e6, 700.0 + 400.0 / (1.0 + p / 1e4), price=p) for p in prices]

    done = search_bracket(driven, 900.0, (100.0, 200.0), rounds=6)
    pair = bracket([d.time for d in done], 900.0)
    assert pair is not None
    assert done[pair[1]].time - done[pair[0]].time <= 0.03 * 900.0


def test_the_search_gives_up_rather_than_inventing_a_bracket():
    done = search_bracket(lambda prices: [drive(20e6, 1000.0, price=p) for p in prices], 900.0, (1e3, 2e3), rounds=3)
    assert bracket([d.time for d in done], 900.0) is None
    assert len(done) == 6


def test_a_driver_who_is_early_even_when_time_is_worth_nothing_waits_parked():
    early = [drive(19e6, 880.0, price=5e3), drive(18e6, 890.0, price=0.0)]
    result = compare(drive(20e6, 900.0), early, 0.3)
    assert result.saving_percent == pytest.approx(10.0)


def test_an_early_driver_who_was_hurried_is_no_fair_comparison():
    assert compare(drive(20e6, 900.0), [drive(19e6, 880.0, price=5e3)], 0.3).saving_percent is None
