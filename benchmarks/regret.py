"""What a found fuel map costs: the drive by the policy planned on it, on the true engine, against the best one there.

Both drivers do at each place what their own map advises for the speed that they have (feedback: who rolls farther or
shorter than foreseen goes on from there), at the same price of time, so that no difference in trip time is left out.
Cost: fuel, price of time, gear changes, restarts, dawdling. On the true map the cost of its own policy is the least,
up to the grid and to the price against pulse and glide: that belongs to the map it was planned on, hence not to the
cost, so that where the true map would reward swinging a regret can come out a little below zero.
"""

import numpy as np

from controller.advice import RoadAhead
from controller.route_kernel import IMPOSSIBLE, best_action, interval_time, table_fuel
from controller.route_problem import RouteProblem
from observer.efficiency_map import FuelMap
from vehicle_model.car.parameters import Car

END_SPEED = 5.0
"""m/s, at both ends."""


def problem_on(table: FuelMap, road: RoadAhead, car: Car) -> RouteProblem:
    """The planner's problem on a map, as it plans by default."""
    return RouteProblem.build(road, table, car, END_SPEED, END_SPEED, None, None, 20.0, 200, None)


def cost_of_policy(planned: RouteProblem, true: RouteProblem, time_value: float) -> tuple[float, float]:
    """J that the policy of `planned` costs on `true`, and J of fuel in it; the same road and car, `time_value` W."""
    arguments = planned.arguments(time_value, planned.value_function(time_value))
    stages, table, comfort = true.stages, true.table, true.comfort
    drag = true.car.air_density * true.car.drag_area
    energy, gear, cost, fuel = 0.5 * true.start_speed**2, -1, 0.0, 0.0

    def rolled(problem: RouteProblem, k: int, start: float) -> float:
        """Kinetic energy after rolling off the throttle through stage k."""
        row = min(int(2.0 * start / problem.table.energy_step + 0.5), len(problem.table.coast_force) - 1)
        force = problem.table.coast_force[row] - stages.grade_force[k] - drag * start
        return start + stages.ds[k] * force / problem.table.coast_mass[row]

    for k, d in enumerate(stages.ds):
        _, target, chosen, _ = best_action(energy, gear, k, *arguments)
        if chosen == 0:
            free = rolled(true, k, energy)
            braking = target < rolled(planned, k, energy) - 1e-6
            target = float(np.clip(min(target, free) if braking else free, 0.05, stages.top[k + 1]))
        acceleration, place = (target - energy) / d, (energy + target) / table.energy_step
        if chosen == 0:
            burnt = d * table.coast_fuel[min(int(place + 0.5), len(table.coast_fuel) - 1)]
        else:
            load = stages.grade_force[k] + drag * 0.5 * (energy + target)
            each = [d * table_fuel(table.fuel, table.force_low, table.force_high, g, place,
                                   table.mass[g] * acceleration + load) for g in range(len(table.mass))]  # fmt: skip
            # beyond what the true engine gives in this gear: the next best; weaker than its drag: no fuel
            burnt = each[chosen - 1] if each[chosen - 1] < IMPOSSIBLE else min(each)
            burnt = burnt if burnt < IMPOSSIBLE else 0.0
        seconds, dawdled = interval_time(energy, target, d, stages.slow_speed[k], comfort.dawdle_power)
        cost += time_value * seconds + dawdled
        if chosen > 0 and gear == 0:
            cost += comfort.restart_energy
        elif chosen > 0 and gear > 0 and chosen != gear:
            burnt += comfort.shift_energy
            cost += comfort.shift_time * time_value
        cost, fuel, energy, gear = cost + burnt, fuel + burnt, target, chosen
    return float(cost), float(fuel)


def regret(found: FuelMap, truth: FuelMap, road: RoadAhead, car: Car, time_value: float) -> float:
    """What planning on `found` instead of `truth` costs, as a share of the fuel of the best drive."""
    true = problem_on(truth, road, car)
    best, fuel = cost_of_policy(true, true, time_value)
    return (cost_of_policy(problem_on(found, road, car), true, time_value)[0] - best) / fuel
