"""Advisors against baseline drivers, fairly: DESIGN.md, "Fair comparisons".

For each scenario, car, advisor and baseline one price of time is sought at which the mean trip time over the seeds is
within 1 % of the baseline's, in steps of 1.78 and then half a step (`price_search`): of the prices driven that are, the
lowest counts. What the drives are late within that 1 % is charged at that price (at most `LATE`), to each seed its
share; being early earns nothing. Where no price comes that near, fuel is interpolated between the two prices that
bracket the baseline's time, with the share that makes the *mean* times equal. That interpolation alone is reported
beside the fair figure (`exact_time_saving_percent`): at signals trip time falls in steps, and the last seconds may cost
more fuel than they are worth to anybody. Seeds are paired: the same traffic with and without advice.

The regret account says where advised - oracle went, in percent of the baseline's fuel and in joules:
- `estimation`, `fit`, `optimiser`: on the empty road, one ingredient replaced at a time (see
  `evaluate_drives.planned_losses`);
- `driver`: the oracle's advice followed by the scenario's driver, minus the same followed exactly, both in traffic and
  at the baseline's mean time;
- `traffic`: what is left. The advised drive and the oracle's advice with the same driver differ in map and planner
  alone; whatever that difference is in traffic beyond what it is on the empty road, traffic made of it. It may be
  negative.
The five sum to advised - oracle. An advisor that plans no route loses to its method: all in `optimiser`.
"""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import t as student

from rollingroad.evaluation.engine import Outcome, opened, run_units
from rollingroad.evaluation.equal_time import Account, Found, at_equal_time, relative_time
from rollingroad.evaluation.evaluate_advisors import FIXED, PACED, PLANNERS, UNHURRIED, advisor_names
from rollingroad.evaluation.price_search import ROUNDS, seek
from rollingroad.evaluation.store import Store, Unit
from rollingroad.task import Task
from vehicle_model.car.errors import BadInput

DRIVES = "rollingroad.evaluation.evaluate_drives"
SCOUTS = 4
"""Seeds that the price is sought with first where there are at least twice as many: the others are then driven at its
neighbours alone."""
SEARCHES = 32
"""Searches side by side."""
LOSSES = ("fit", "estimation", "optimiser", "driver", "traffic")

Run = Callable[[Sequence[Unit]], list[Outcome]]


@dataclass(frozen=True)
class World:
    """A scenario, a car and a baseline driver, over seeds. `tasks` are the units' arguments, by seed."""

    scenario: str
    car: str
    baseline: str
    tasks: Mapping[int, Mapping[str, Any]]


@dataclass(frozen=True)
class Way:
    """How the advised drives are made: by which advisor, on which map, how well followed."""

    advisor: str
    knowledge: str = "estimated"
    perfect: bool = False


ORACLE = Way("oracle", "true", True)
HUMAN_ORACLE = Way("oracle", "true", False)


def evaluate(
    worlds: Sequence[World],
    advisors: Sequence[str],
    store: Store,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    timeout: float | None = 900.0,
    drives: str = DRIVES,
    oracle: bool = True,
    tell: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Return the object of `evaluate --json`; what `store` holds is not driven again. Raises BadInput.

    `drives` is the module of the units; `oracle` False leaves the oracle's drives out, and with them what is measured
    against it. A drive that fails is told in `failed` with its seed, and its seed is missing
    from the row's `seeds`; a row without a fair figure has null there, and the reason in `failed`.
    """
    known = advisor_names()
    for name in advisors:
        if name not in known:
            raise BadInput("--advisors", name, f"expected one of {', '.join(known)}")
    done = [0]

    def count(outcome: Outcome) -> None:
        done[0] += 1
        tell(f"{done[0]} drives done")

    with opened(workers, cluster) as client:
        run = functools.partial(run_units, store=store, workers=workers, client=client, timeout=timeout, done=count)
        # Inline, SUMO allows one drive at a time.
        with ThreadPoolExecutor(SEARCHES if client is not None else 1) as pool:
            judged = list(pool.map(lambda world: _World(world, run, drives), worlds))
            wanted = [Way(name) if name != "oracle" else ORACLE for name in advisors]
            # The oracle's search begins at the price that the advised drives ended with.
            oracles = [way for way in (HUMAN_ORACLE, ORACLE) if oracle and way not in wanted]
            for ways in (list(dict.fromkeys(wanted)), oracles):
                list(pool.map(lambda pair: pair[0].search(pair[1]), [(world, way) for world in judged for way in ways]))
            rows = list(
                pool.map(
                    lambda pair: pair[0].row(pair[1]),
                    [(world, way) for world in judged for way in dict.fromkeys(wanted)],
                )
            )
    rows.sort(key=lambda row: (row["scenario"], row["car"], row["advisor"], row["baseline"]))
    failed = [entry for world in judged for entry in world.failed]
    failed.sort(key=lambda entry: [str(value) for value in entry.values()])
    return {"rows": rows, "failed": failed}


class _World:
    """A world with what was driven in it so far."""

    def __init__(self, world: World, run: Run, drives: str) -> None:
        self.world = world
        self.failed: list[dict[str, Any]] = []
        self._run, self._drives = run, drives
        self._found: dict[Way, Found] = {}
        self._tasks = dict(world.tasks)
        outcomes = self._do([("baseline_drive", seed, {}) for seed in self._tasks], "baseline")
        self.baseline = {
            seed: outcome.result for seed, outcome in zip(self._tasks, outcomes, strict=True) if outcome.result
        }
        prices = sorted(account["first_price"] for account in self.baseline.values())
        self._first_price = max(prices[len(prices) // 2] if prices else 0.0, UNHURRIED)

    def _do(self, asked: Sequence[tuple[str, int, Mapping[str, Any]]], advisor: str) -> list[Outcome]:
        units = [Unit(f"{self._drives}:{name}", {"task": self._tasks[seed], **more}) for name, seed, more in asked]
        outcomes = self._run(units)
        for (name, seed, more), outcome in zip(asked, outcomes, strict=True):
            if outcome.error:
                self._fail(advisor, outcome.error, seed=seed, drive=name, log=outcome.log, **more)
        return outcomes

    def _fail(self, advisor: str, error: str, **more: Any) -> None:
        world = self.world
        self.failed.append(
            {"scenario": world.scenario, "car": world.car, "advisor": advisor, "baseline": world.baseline, **more}
            | {"error": error}
        )

    def search(self, way: Way) -> None:
        """Drive `way` at prices of time until the baseline's mean time is bracketed."""
        if not self.baseline:
            return
        driven: dict[float, dict[int, Account]] = {}
        rounds, seeds = 1 if way.advisor in FIXED else ROUNDS, list(self.baseline)
        many = len(seeds) >= 2 * SCOUTS and rounds > 1
        scouts = self._at(way, seeds[:SCOUTS], {}) if many else None
        seek(self._at(way, seeds, driven), self._begin_with(way), rounds, scouts)
        found = at_equal_time(self.baseline, driven)
        if found is None or not found.equal:
            self._fail(way.advisor, "no price of time makes the mean trip as long as the baseline's", drive=str(way))
        if found is not None:
            self._found[way] = found

    def _at(
        self, way: Way, seeds: Sequence[int], driven: dict[float, dict[int, Account]]
    ) -> Callable[[float], float | None]:
        """What drives `seeds` at a price of time, adds the accounts to `driven`, and returns the relative time."""

        def at(price: float) -> float | None:
            how = {"advisor_name": way.advisor, "knowledge": way.knowledge, "price": price, "perfect": way.perfect}
            asked = [("advised_drive", seed, how) for seed in seeds]
            for (_, seed, _), outcome in zip(asked, self._do(asked, way.advisor), strict=True):
                if outcome.result is not None:
                    driven.setdefault(price, {})[seed] = outcome.result
            return relative_time(self.baseline, driven[price]) if price in driven else None

        return at

    def _begin_with(self, way: Way) -> float:
        """A price (W) to begin with: what another planner ended with, the plan's, or full pace for who plans none."""
        if way.advisor in PACED:
            return UNHURRIED
        ended = [found.price for done, found in self._found.items() if way.knowledge == "true" and _planned(done)]
        return ended[0] if ended else self._first_price

    def row(self, way: Way) -> dict[str, Any]:
        """A row of `evaluate --json`; without equal mean times the figures that need them are None."""
        world, found, oracle = self.world, self._found.get(way), self._found.get(ORACLE)
        base = {seed: account["fuel"] for seed, account in self.baseline.items()}
        head = {"scenario": world.scenario, "car": world.car, "advisor": way.advisor, "baseline": world.baseline}
        if found is None:
            empty = dict.fromkeys(
                ("fair_saving_percent", "ci95", "time_difference_percent", "naive_saving_percent", "oracle_fraction",
                 "limit_violations", "min_time_to_collision_s", "oracle_saving_percent", "regret", "regret_J")
            )  # fmt: skip
            return head | {"seeds": 0} | empty | {"safety": None, "seeds_not_bracketed": [], "price_W": None}
        seeds = list(found.fuel)
        saving = [100.0 * (1.0 - found.fuel[s] / base[s]) for s in seeds]
        fair = float(np.mean(saving)) if found.equal else None
        oracle = oracle if oracle is not None and oracle.equal else None
        paired = [s for s in seeds if oracle is not None and s in oracle.fuel]
        best = float(np.mean([100.0 * (1.0 - oracle.fuel[s] / base[s]) for s in paired])) if oracle and paired else None
        regret = self._regret(way, found, oracle, paired)
        mean_base = np.mean([base[s] for s in seeds])
        return head | {
            "seeds": len(seeds),
            "fair_saving_percent": fair,
            "ci95": interval(saving) if found.equal else None,
            "time_difference_percent": found.time_difference_percent,
            "exact_time_saving_percent": found.exact
            and float(np.mean([100.0 * (1.0 - found.exact[s] / base[s]) for s in found.exact])),
            "naive_saving_percent": float(np.mean([100.0 * (1.0 - found.naive[s] / base[s]) for s in seeds])),
            "oracle_fraction": fair / best if fair is not None and best is not None and best > 0.0 else None,
            "limit_violations": self._beyond(found, "limit_violations"),
            "min_time_to_collision_s": _least([found.nearer[s] for s in seeds]),
            "oracle_saving_percent": best,
            "regret": None if regret is None else {k: v[0] for k, v in regret.items()},
            "regret_J": None if regret is None else {k: v[1] for k, v in regret.items()},
            "safety": {
                "baseline_min_time_to_collision_s": _least([self.baseline[s] for s in seeds]),
                "harsh_braking": self._beyond(found, "harsh_braking"),
                "collisions": self._beyond(found, "collisions"),
                "red_lights_run": self._beyond(found, "red_lights_run"),
            },
            "seeds_not_bracketed": list(found.not_bracketed),
            "price_W": found.price,
            "baseline_fuel_J": float(mean_base),
        }  # fmt: skip

    def _beyond(self, found: Found, key: str) -> int:
        """How many more than the baseline's, summed over the seeds in which there were more."""
        return sum(max(found.nearer[s][key] - self.baseline[s][key], 0) for s in found.fuel)

    def _regret(
        self, way: Way, found: Found, oracle: Found | None, paired: Sequence[int]
    ) -> dict[str, tuple[float, float]] | None:
        """Each loss in percent of the baseline's fuel and in J, means over the paired seeds; None without an oracle."""
        human = self._found.get(HUMAN_ORACLE)
        if not found.equal or human is None or not human.equal:
            return None
        if way == ORACLE:
            return dict.fromkeys(LOSSES, (0.0, 0.0))
        seeds = [s for s in paired if s in human.fuel]
        if oracle is None or len(seeds) < len(found.fuel):
            return None
        losses = {s: dict.fromkeys(LOSSES, 0.0) for s in seeds}
        if way.advisor in PLANNERS:
            asked = [("planned_losses", s, {"price": found.price}) for s in seeds]
            for s, outcome in zip(seeds, self._do(asked, way.advisor), strict=True):
                if outcome.result is None:
                    return None
                losses[s] |= outcome.result
        for s, loss in losses.items():
            loss["driver"] = human.fuel[s] - oracle.fuel[s]
            left = found.fuel[s] - human.fuel[s] - loss["estimation"] - loss["fit"] - loss["optimiser"]
            loss["traffic" if way.advisor in PLANNERS else "optimiser"] += left
        base = {s: self.baseline[s]["fuel"] for s in seeds}
        return {
            name: (
                float(np.mean([100.0 * losses[s][name] / base[s] for s in seeds])),
                float(np.mean([losses[s][name] for s in seeds])),
            )
            for name in LOSSES
        }


def _planned(way: Way) -> bool:
    return way.advisor in PLANNERS or way.advisor == "oracle"


def interval(values: Sequence[float]) -> list[float] | None:
    """Student's 95 % interval of the mean of paired differences; None for fewer than two."""
    if len(values) < 2:
        return None
    half = float(student.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values)))
    mean = float(np.mean(values))
    return [mean - half, mean + half]


def worlds_of(
    tasks: Callable[[str, str, int], Task],
    scenarios: Sequence[str],
    cars: Sequence[str],
    baselines: Sequence[str],
    seeds: Iterable[int],
) -> list[World]:
    """Every combination; `tasks(scenario, car, seed)` reads and checks one."""
    from rollingroad.evaluation.evaluate_drives import arguments

    found = []
    for scenario in scenarios:
        for car in cars:
            made = {seed: tasks(scenario, car, seed) for seed in seeds}
            one = next(iter(made.values()))
            for baseline in baselines:
                units = {seed: arguments(task, car, baseline) for seed, task in made.items()}
                found.append(World(one.scenario.name, one.car.name, baseline, units))
    return found


def _least(accounts: Sequence[Account]) -> float | None:
    times = [a["min_time_to_collision"] for a in accounts if a["min_time_to_collision"] is not None]
    return min(times, default=None)
