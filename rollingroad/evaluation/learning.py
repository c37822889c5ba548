"""The learning loop: the map improves trip by trip, and with it the advice.

Trip 0 is driven by the baseline driver; every later one with the advice of the map that the trips before it left, in
traffic of its own. After each trip the map is made of all of them, and judged by what its plan loses: the difference in
fuel + price x time on the true map, on the empty road, between the plan by this map and the plan by the true one, split
as in `evaluate_drives.planned_losses`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from observer.estimate import Estimate
from observer.observe import observe
from rollingroad.arrows import ADVICE_BEGINS, first_prices, map_found, sense
from rollingroad.evaluation.evaluate_advisors import UNHURRIED, advisor, at_price, plan
from rollingroad.evaluation.evaluate_drives import account, map_of_the_truth, true_fuel
from rollingroad.task import Task
from sim.advisor import Context
from sim.drive import drive
from sim.full_load import enriched
from sim.network import build
from sim.road_ahead import road_ahead
from sim.truth import true_fuel_map
from vehicle_model.car.trip import Trip


@dataclass(frozen=True)
class Lesson:
    """What is known after so many trips."""

    trips: int
    fuel_share: float
    """Of the fuel of these trips, that valid cells of the map cover."""
    estimation: float
    """Percent of the true plan's fuel that is lost because cells hold wrong values."""
    fit: float
    """Percent lost because cells are missing, or the form of the fit does not hold them."""
    litres_per_100km: float
    """On the last trip (other traffic each time: no saving by itself)."""

    @property
    def regret(self) -> float:
        """Percent of fuel that the map costs in all."""
        return self.estimation + self.fit


def learning_curve(
    task: Task, trips: int, *, advisor_name: str = "pontryagin", tell: Callable[[str], None] = lambda text: None
) -> tuple[list[Lesson], float]:
    """Drive `trips` trips of `task`, seeds from its own on; return what is known after each, and the price of time (W).

    The price is that of the first trip's plan, the same for every map. Raises RuntimeError where one does not arrive.
    """
    truth = true_fuel_map(task.car, task.plant_settings)
    estimates: list[Estimate] = []
    driven: list[Trip] = []
    lessons: list[Lesson] = []
    known: Context | None = None
    price = UNHURRIED
    litre = 1e-3 * task.car.fuel.density * task.car.fuel.heating_value
    with TemporaryDirectory(prefix="learning-") as folder:
        network = build(task.scenario, Path(folder))
        for number in range(trips):
            tell(f"trip {number + 1} of {trips}")
            chosen = None if known is None else advisor(advisor_name, replace(known, fuel_map=enriched(known.fuel_map)))
            done = drive(task.scenario, task.car, task.seed + number, advisor=chosen, network=network)
            cost = account(done, task.car)
            sensed = sense(replace(task, seed=task.seed + number), done)
            estimates.append(observe(sensed.log, task.car, sensed.road_map))
            driven.append(done.trip)
            learnt = map_found(estimates, task.car)
            if known is None:
                road = road_ahead(done.route, sensed.road_map)
                speed = done.trip.channels["speed"]
                price = max(first_prices(road, learnt.fuel_map, task.car, done.trip)[0], UNHURRIED)
                base = Context(
                    road, truth, task.car, start_speed=float(speed[0]), end_speed=float(speed[-1]), begin=ADVICE_BEGINS
                )
                base = at_price(base, price)
            known = replace(base, fuel_map=learnt.fuel_map)
            through_fit = replace(base, fuel_map=map_of_the_truth(learnt, driven, task).fuel_map)
            costs = []
            for context in (known, through_fit, base):
                found = plan(context)
                costs.append(true_fuel(found, truth, task.car) + price * found.trip_time)
                best = true_fuel(found, truth, task.car)
            lessons.append(
                Lesson(
                    trips=number + 1,
                    fuel_share=learnt.efficiency_map.fuel_share,
                    estimation=100.0 * (costs[0] - costs[1]) / best,
                    fit=100.0 * (costs[1] - costs[2]) / best,
                    litres_per_100km=cost["fuel"] / litre / (cost["distance"] / 1e5),
                )
            )
    return lessons, price
