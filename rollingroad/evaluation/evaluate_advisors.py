"""The advisors that an evaluation knows by name: the shipped ones, and one's own (entry points `rollingroad.advisors`).

An entry point is called with a `sim.advisor.Context` and returns a `sim.advisor.Advisor`.
"""

from dataclasses import replace
from importlib.metadata import entry_points

from controller.advice import Advice
from controller.route import plan_route
from sim.advisor import Advisor, Context
from sim.advisors import ADVISORS, FINE, FIXED, make
from sim.receding_horizon import NODES, WHOLE_STEP
from vehicle_model.car.errors import BadInput

__all__ = ["FIXED", "PACED", "PLANNERS", "UNHURRIED", "advisor", "advisor_names", "at_price", "pace", "plan"]

GROUP = "rollingroad.advisors"
PLANNERS = ("pontryagin",)
"""Those whose loss to the map and to the planner can be told apart on paper."""
PACED = ("acceleration", "coach")
"""Those that plan no route: only their pace makes their trips longer (`pace`)."""
UNHURRIED = 100.0
"""W: below it time costs next to nothing, and a slower trip takes lower speeds than the limits (`pace`)."""


def pace(price: float) -> float:
    """Share of the limits that is driven at `price` (W, > 0): 1 from `UNHURRIED` up, 0.79 at a tenth of it.

    Even the drive that burns least may be quicker than a baseline that idles at every signal; to be compared at equal
    time it must be held back.
    """
    return min((price / UNHURRIED) ** 0.1, 1.0)


def at_price(known: Context, price: float) -> Context:
    """`known` with a second worth `price` (W), and the road at the `pace` that goes with it."""
    share, road = pace(price), known.road
    paced = replace(road, speed_max=share * road.speed_max, speed_min=share * road.speed_min)
    return replace(known, road=paced, time_value=price)


def plan(known: Context, *, fine: bool = False) -> Advice:
    """The optimal drive over the whole road by what is `known`, on the planner's grid or on the oracle's."""
    finer = FINE if fine else 1
    step = WHOLE_STEP / finer
    return plan_route(
        known.road,
        known.fuel_map,
        known.car,
        start_speed=known.start_speed,
        end_speed=known.end_speed,
        time_value=known.time_value,
        step=step,
        nodes=NODES * finer,
        policy_step=step,
        certify=False,
    )


def advisor_names() -> list[str]:
    """Shipped and plugged-in advisors."""
    return [*ADVISORS, *(point.name for point in entry_points(group=GROUP))]


def advisor(name: str, known: Context) -> Advisor:
    """Make the advisor `name`. Raises BadInput with the names that there are."""
    if name in ADVISORS:
        return make(name, known)
    for point in entry_points(group=GROUP):
        if point.name == name:
            return point.load()(known)
    raise BadInput("--advisors", name, f"expected one of {', '.join(advisor_names())}")
