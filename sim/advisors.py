"""The advisors that ship, by name."""

from collections.abc import Callable

from sim.acceleration_advisor import AccelerationSynthesis
from sim.advisor import Advisor, Context
from sim.receding_horizon import NODES, WHOLE_STEP, RecedingHorizon
from sim.rules_of_thumb import Coach, GlideToStop
from vehicle_model.car.errors import BadInput

__all__ = ["ADVISORS", "FIXED", "Context", "make"]

FINE = 2
"""How much finer the oracle's grid is."""


def _oracle(context: Context) -> Advisor:
    return RecedingHorizon(context, step=WHOLE_STEP / FINE, nodes=NODES * FINE)


ADVISORS: dict[str, Callable[[Context], Advisor]] = {
    "pontryagin": RecedingHorizon,
    "acceleration": AccelerationSynthesis,
    "glide": GlideToStop,
    "coach": Coach,
    "oracle": _oracle,
}
"""`oracle` is dynamic programming on half the step with twice the speeds: its context holds the true map, and its
driver follows exactly (`drive(..., perfect=True)`)."""
FIXED = ("glide",)
"""Those that neither a price of time nor the pace changes."""


def make(name: str, context: Context) -> Advisor:
    """Make the advisor `name`. It can be sent to another process; what it must prepare, it prepares in `reset`.

    Raises BadInput with the names that there are.
    """
    if name not in ADVISORS:
        raise BadInput("advisor", name, f"expected one of {', '.join(ADVISORS)}")
    return ADVISORS[name](context)
