"""Given drives whose fuel and time are known formulas, then the evaluation finds what follows from them by hand."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rollingroad.evaluation.engine import run_units
from rollingroad.evaluation.evaluate import World, evaluate, interval
from rollingroad.evaluation.evaluate_advisors import UNHURRIED, at_price, pace, plan
from rollingroad.evaluation.price_search import halfway
from rollingroad.evaluation.store import Store
from sim.advisor import Context
from tests.rollingroad import evaluated as formula
from vehicle_model.car.errors import BadInput

DRIVES = "tests.rollingroad.evaluated"
PRICE = 10.0**2.75
"""W: the lowest price of the grid whose mean time is within 1 % of the baseline's."""
EARLY = float(np.log2(1000.0 / PRICE))
"""% that it saves beyond the 10 % at 1,000 W, and that it is late."""
FAIR = 10.0 + EARLY * (1.0 - PRICE / 1000.0)
"""% saved, lateness charged."""


def judged(tmp_path: Path, seeds: int = 3, advisors: tuple[str, ...] = ("pontryagin",), **task: Any) -> dict[str, Any]:
    world = World("town", "smart", "good", {seed: {"seed": seed, **task} for seed in range(seeds)})
    return evaluate([world], advisors, Store(tmp_path), workers=0, drives=DRIVES)


def test_fuel_is_compared_at_the_lowest_price_whose_mean_time_is_within_a_hundredth(tmp_path: Path) -> None:
    found = judged(tmp_path)
    (row,) = found["rows"]
    assert found["failed"] == []
    assert row["price_W"] == pytest.approx(PRICE, rel=1e-6)
    assert row["fair_saving_percent"] == pytest.approx(FAIR, abs=1e-6)
    assert row["time_difference_percent"] == pytest.approx(EARLY, abs=1e-9)
    assert row["seeds"] == 3


def test_what_is_late_within_a_hundredth_is_charged_at_the_price_of_time(tmp_path: Path) -> None:
    """Given drives 0.6 s late at 1,000 W, then 600 J of the 10 kJ saved are owed; further prices are not driven."""
    (row,) = judged(tmp_path, seeds=1, slowness=1.006)["rows"]
    assert row["price_W"] == pytest.approx(1000.0) and row["time_difference_percent"] == pytest.approx(0.6)
    assert row["fair_saving_percent"] == pytest.approx(9.4)


def test_the_figure_at_exactly_the_same_time_stands_beside_the_fair_one(tmp_path: Path) -> None:
    """Given a driver who needs 1.03 of the time, then by the formula the same time costs 2.9 doublings of the price."""
    (row,) = judged(tmp_path, seeds=1, slowness=1.03)["rows"]
    assert row["exact_time_saving_percent"] == pytest.approx(10.0 - 100.0 * (1.0 - 1.0 / 1.03), abs=1e-6)
    late = row["time_difference_percent"]
    doublings = np.log2(row["price_W"] / 1000.0)
    assert 0.0 < late < 1.0
    assert row["fair_saving_percent"] == pytest.approx(10.0 - doublings - late * row["price_W"] / 1000.0, abs=1e-6)


def test_the_naive_figure_takes_the_thriftiest_price_and_looks_at_no_clock(tmp_path: Path) -> None:
    (row,) = judged(tmp_path, first_price=500.0)["rows"]
    assert row["naive_saving_percent"] == pytest.approx(10.0 + np.log2(1000.0 / 10.0**2.25)), "the lowest price driven"


def test_all_prices_are_of_one_grid_so_that_more_seeds_find_the_drives_of_fewer_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged(tmp_path, seeds=2, first_price=333.0)
    driven = []

    def watched(units: Any, **more: Any) -> Any:
        outcomes = run_units(units, **more)
        driven.extend(outcome for outcome in outcomes if outcome.computed)
        return outcomes

    monkeypatch.setattr("rollingroad.evaluation.evaluate.run_units", watched)
    judged(tmp_path, seeds=3, first_price=333.0)
    assert {outcome.unit.arguments["task"]["seed"] for outcome in driven} == {2}


def test_many_seeds_are_driven_only_near_the_price_that_a_few_found(tmp_path: Path) -> None:
    """Given twelve seeds and a first guess far off, the answer is that of driving all of them everywhere, for a third
    fewer drives."""
    (row,) = judged(tmp_path / "far", seeds=12, first_price=64_000.0)["rows"]
    (near,) = judged(tmp_path / "near", seeds=12, first_price=1_000.0)["rows"]
    assert row["fair_saving_percent"] == pytest.approx(near["fair_saving_percent"], abs=1e-9)
    assert row["price_W"] == near["price_W"] and row["seeds"] == 12
    driven = [json.loads(path.read_text()) for path in (tmp_path / "far").rglob("*.json")]
    advised = [unit["arguments"] for unit in driven if unit["function"].endswith("advised_drive")]
    prices = [asked["price"] for asked in advised if asked["knowledge"] == "estimated"]
    assert len(prices) < 12 * len(set(prices)) * 2 / 3


@pytest.mark.parametrize(("slowness", "half", "driven"), [(0.997, True, 12), (1.0, False, 4)])
def test_the_price_half_a_step_below_counts_where_it_is_in_time_and_is_left_where_a_few_seeds_are_late(
    tmp_path: Path, slowness: float, half: bool, driven: int
) -> None:
    """Given a price that is 1.4 or 1.7 % late and the next, 0.5 or 0.8 % late, when half a step between them is 0.9 or
    1.2 % late, then it counts in the first case, and in the second only the scouts drive it."""
    found = judged(tmp_path, seeds=12, slowness=slowness)
    (row,) = found["rows"]
    between = PRICE / 10.0**0.125
    price = between if half else PRICE
    late = 100.0 * (slowness * (1.0 - 0.01 * np.log2(price / 1000.0)) - 1.0)
    assert row["price_W"] == pytest.approx(price)
    assert row["time_difference_percent"] == pytest.approx(late) and 0.0 < late < 1.0
    saved = 10.0 - np.log2(price / 1000.0) - late * price / 1000.0
    assert row["fair_saving_percent"] == pytest.approx(saved, abs=1e-6)
    kept = [json.loads(path.read_text()) for path in tmp_path.rglob("*.json")]
    advised = [unit["arguments"] for unit in kept if unit["function"].endswith("advised_drive")]
    finer = [asked for asked in advised if asked["price"] == pytest.approx(between)]
    for way in (("pontryagin", False), ("oracle", False), ("oracle", True)):
        same = [asked for asked in finer if (asked["advisor_name"], asked["perfect"]) == way]
        assert len(same) == driven, way


def test_no_finer_price_is_driven_where_none_is_late() -> None:
    assert halfway({100.0: 0.99, 10.0**2.25: 0.97}) is None
    assert halfway({100.0: 1.05, 10.0**2.25: 1.02}) is None, "nor where all are"
    assert halfway({100.0: 1.05, 10.0**2.5: 1.0}) is None, "nor where the neighbour was not driven"
    assert halfway({10.0: 1.05, 100.0: 1.02, 10.0**2.25: 1.0}) == pytest.approx(10.0**2.125)


def test_without_the_oracle_nothing_is_measured_against_it(tmp_path: Path) -> None:
    world = World("town", "smart", "eidm", {seed: {"seed": seed} for seed in range(2)})
    (row,) = evaluate([world], ["pontryagin"], Store(tmp_path), workers=0, drives=DRIVES, oracle=False)["rows"]
    assert row["fair_saving_percent"] == pytest.approx(FAIR, abs=1e-6)
    assert row["oracle_saving_percent"] is None and row["oracle_fraction"] is None and row["regret"] is None


def test_one_price_for_all_seeds_makes_only_the_mean_equal_and_nobody_is_dropped(tmp_path: Path) -> None:
    (row,) = judged(tmp_path, seeds=2, luck=0.2)["rows"]
    assert row["seeds"] == 2
    assert row["time_difference_percent"] == pytest.approx(EARLY, abs=1e-9)
    assert row["seeds_not_bracketed"] == [0, 1]
    assert row["fair_saving_percent"] == pytest.approx(FAIR, abs=1e-6)


def test_energy_left_in_the_car_is_worth_the_fuel_that_put_it_there(tmp_path: Path) -> None:
    (row,) = judged(tmp_path, stored=5.0)["rows"]
    assert row["fair_saving_percent"] == pytest.approx(FAIR + 100.0 * (5.0 / 0.25) / formula.BASE_FUEL, abs=1e-6)
    assert row["naive_saving_percent"] < row["fair_saving_percent"] + 5.0


def test_the_regret_account_sums_to_advised_minus_oracle_and_names_each_part(tmp_path: Path) -> None:
    (row,) = judged(tmp_path)["rows"]
    regret = row["regret"]
    assert sum(regret.values()) == pytest.approx(row["oracle_saving_percent"] - row["fair_saving_percent"], abs=1e-9)
    assert regret["driver"] == pytest.approx(100.0 * formula.PERFECT / formula.BASE_FUEL, abs=1e-6)
    assert regret["fit"] == pytest.approx(100.0 * formula.FIT / formula.BASE_FUEL)
    assert regret["estimation"] == pytest.approx(100.0 * formula.ESTIMATION / formula.BASE_FUEL)
    planned = formula.FIT + formula.ESTIMATION + formula.OPTIMISER
    assert regret["traffic"] == pytest.approx(100.0 * (formula.TRUE - planned) / formula.BASE_FUEL, abs=1e-6)
    # Seeds 0 to 2 burn 1, 2 and 3 kJ: joules are means over them.
    assert row["regret_J"]["driver"] == pytest.approx(2.0 * formula.PERFECT, rel=1e-6)
    assert row["oracle_fraction"] == pytest.approx(FAIR / (FAIR + 7.0), abs=1e-6)


def test_the_oracle_as_an_advisor_regrets_nothing(tmp_path: Path) -> None:
    rows = judged(tmp_path, advisors=("pontryagin", "oracle"))["rows"]
    assert [row["advisor"] for row in rows] == ["oracle", "pontryagin"], "sorted"
    assert rows[0]["oracle_fraction"] == pytest.approx(1.0) and set(rows[0]["regret"].values()) == {0.0}


def test_a_drive_that_fails_is_told_with_its_seed_and_the_others_are_still_compared(tmp_path: Path) -> None:
    found = judged(tmp_path, crash=1)
    (row,) = found["rows"]
    assert row["seeds"] == 2 and row["fair_saving_percent"] == pytest.approx(FAIR, abs=1e-6)
    assert {entry["seed"] for entry in found["failed"]} == {1}
    assert all("teleported" in entry["error"] and "evaluated.py" in entry["log"] for entry in found["failed"])


def test_a_scenario_that_no_price_makes_fast_enough_is_told_and_has_no_figure(tmp_path: Path) -> None:
    found = judged(tmp_path, slowness=3.0)
    (row,) = found["rows"]
    assert row["fair_saving_percent"] is None and row["regret"] is None and row["ci95"] is None
    assert row["time_difference_percent"] > 100.0, "what is left is told"
    assert any("no price of time" in entry["error"] for entry in found["failed"])


def test_violations_beyond_the_baselines_are_counted(tmp_path: Path) -> None:
    (row,) = judged(tmp_path, violations=2)["rows"]
    assert row["limit_violations"] == 6, "two in each of three seeds"


def test_a_second_evaluation_drives_nothing_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = judged(tmp_path)
    driven = []

    def watched(units: Any, **more: Any) -> Any:
        outcomes = run_units(units, **more)
        driven.extend(outcome for outcome in outcomes if outcome.computed)
        return outcomes

    monkeypatch.setattr("rollingroad.evaluation.evaluate.run_units", watched)
    assert judged(tmp_path) == first and driven == []


def test_the_interval_is_students(tmp_path: Path) -> None:
    values = [1.0, 2.0, 4.0, 3.5]
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert interval(values) == pytest.approx([expected.low, expected.high])
    assert interval(values[:1]) is None


def test_an_unknown_advisor_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="expected one of pontryagin"):
        judged(tmp_path, advisors=("clairvoyant",))


def test_below_the_least_price_the_plan_keeps_below_the_limits() -> None:
    from benchmarks.controller import _car, _road, _willans

    assert pace(1e5) == pace(UNHURRIED) == 1.0 > pace(0.5 * UNHURRIED) > pace(0.1 * UNHURRIED)
    known = Context(_road(2000.0), _willans(), _car())
    slow, quick = (plan(at_price(known, price)) for price in (0.1 * UNHURRIED, UNHURRIED))
    assert slow.trip_time > quick.trip_time
    assert np.all(slow.speed <= pace(0.1 * UNHURRIED) * 130 / 3.6 + 1e-9)
