"""The advisors that an evaluation knows by name, and how one's own is added (entry points `rollingroad.advisors`)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import entry_points

from controller.advice import Advice, RoadAhead
from controller.route import plan_route
from observer.efficiency_map import FuelMap
from rollingroad.arrows import ADVICE_BEGINS, PLAN_STEP
from sim.advisor import AdviceFollower, Advisor
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

FINE = 2
"""The oracle plans on half the step and with twice the speeds."""
NODES = 200
"""Speeds of the planner's grid."""
UNHURRIED = 100.0
"""W: below it time costs next to nothing, and a slower trip takes lower speeds than the limits (`pace`)."""


@dataclass(frozen=True)
class Knowledge:
    """What an advisor may go by before it sets out; it never holds the truth, the oracle's map apart."""

    road: RoadAhead
    fuel_map: FuelMap
    car: Car
    start_speed: float
    """m/s."""
    end_speed: float
    price: float
    """W: what a second is worth. It is set so that the mean trip takes as long as the baseline's."""

    @property
    def paced_road(self) -> RoadAhead:
        """The road with its speeds times `pace`."""
        share = pace(self.price)
        return replace(self.road, speed_max=share * self.road.speed_max, speed_min=share * self.road.speed_min)


Maker = Callable[[Knowledge], Advisor]


def pace(price: float) -> float:
    """Share of the limits that is driven at `price` (W, > 0): 1 from `UNHURRIED` up, 0.79 at a tenth of it.

    Even the drive that burns least may be quicker than a baseline that idles at every signal; to be compared at equal
    time it must be held back.
    """
    return min((price / UNHURRIED) ** 0.1, 1.0)


def plan(known: Knowledge, *, fine: bool = False) -> Advice:
    """The optimal drive by what is `known`, on the planner's grid or on the oracle's."""
    step = PLAN_STEP / FINE if fine else PLAN_STEP
    return plan_route(
        known.paced_road,
        known.fuel_map,
        known.car,
        start_speed=known.start_speed,
        end_speed=known.end_speed,
        time_value=known.price,
        step=step,
        nodes=NODES * FINE if fine else NODES,
        policy_step=step,
        certify=False,
    )


def pontryagin(known: Knowledge) -> Advisor:
    """Follows the plan of the whole route and the policy around it."""
    return AdviceFollower(plan(known), begin=ADVICE_BEGINS)


def oracle(known: Knowledge) -> Advisor:
    """Dynamic programming on the fine grid; the evaluation hands it the true map and a driver who follows exactly."""
    return AdviceFollower(plan(known, fine=True), begin=ADVICE_BEGINS)


ADVISORS: dict[str, Maker] = {"pontryagin": pontryagin, "oracle": oracle}
"""The shipped ones."""
FIXED: tuple[str, ...] = ()
"""Those that a price of time does not change."""
PLANNERS = ("pontryagin",)
"""Those whose loss to the map and to the planner can be told apart on paper."""


def advisor_names() -> list[str]:
    """Shipped and plugged-in advisors."""
    return [*ADVISORS, *(point.name for point in entry_points(group="rollingroad.advisors"))]


def advisor(name: str, known: Knowledge) -> Advisor:
    """Make the advisor `name`. Raises BadInput with the names that there are."""
    if name in ADVISORS:
        return ADVISORS[name](known)
    for point in entry_points(group="rollingroad.advisors"):
        if point.name == name:
            return point.load()(known)
    raise BadInput("--advisors", name, f"expected one of {', '.join(advisor_names())}")
