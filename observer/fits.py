"""All the smooth forms of an efficiency map: the polynomials of seed 004, 3.4, and those that do better."""

from observer.efficiency_map import EfficiencyMap
from observer.fit_average import fit_average
from observer.fit_form import Fit, valid_cells
from observer.fit_polynomial import fit_polynomials
from observer.fit_willans import FRICTION_STEP, fit_kernel, fit_smooth, fit_willans
from vehicle_model.car.parameters import Car

DEFAULT_FIT = "P_in willans+kernel"
"""What is closest to the engine."""
PLANNER_FIT = "P_in average"
"""What the planner gets: the mean of two forms that share no shape. It steers into every dent, and one's are not the
other's: over eight development hours of the Smart and three of the Peugeot its regret is about 0.16 % (reaches of 10
and 15 cells), where either form alone has 0.32 and 0.21, or 0.24 and 0.19."""
PLANNER_MEMBERS = ("P_in smooth", "P_in full 2")
LEAST_CELLS = 3
"""Below it the kernel has nothing to go by, and the default is the Willans form alone (mostly its prior)."""


def fit_all(efficiency_map: EfficiencyMap, car: Car) -> dict[str, Fit]:
    """Return every fit that the valid cells can carry, by name; see `default_fit` and `planner_fit`.

    `P_in willans` is always there (from the prior if need be); a polynomial needs over twice as many cells as terms.
    """
    cells = valid_cells(efficiency_map)
    willans = fit_willans(cells, car, efficiency_map.limits)
    fits: dict[str, Fit] = {willans.name: willans}
    if len(cells.torque) >= LEAST_CELLS:
        fits[DEFAULT_FIT] = fit_kernel(willans, cells)
        fits["P_in smooth"] = fit_smooth(fit_willans(cells, car, efficiency_map.limits, FRICTION_STEP), cells)
        fits |= fit_polynomials(cells, car)
        members = tuple(fits[name] for name in PLANNER_MEMBERS if name in fits)
        fits[PLANNER_FIT] = fit_average(PLANNER_FIT, members, cells)
    return fits


def default_fit(fits: dict[str, Fit]) -> Fit:
    """The fit that is closest to the engine: constrained fuel power with the kernel on it, if there is one."""
    return fits.get(DEFAULT_FIT, fits["P_in willans"])


def planner_fit(fits: dict[str, Fit]) -> Fit:
    """The fit that the planner gets: the average of two smooth ones, if there is one."""
    return fits.get(PLANNER_FIT, fits["P_in willans"])
