"""What optimal control costs in time, each figure beside a reference measured in the same process.

Plain functions that return rows of `rollingroad bench`. By hand: `python -m benchmarks.controller`. Each figure is the
minimum over repeats, compilation apart.
"""

import numpy as np
from scipy.optimize import minimize_scalar

from benchmarks.timing import Row, least, row
from controller import acceleration, hill_road, route_reference
from controller.acceleration import shoot
from controller.advice import RoadAhead
from controller.controller_model import THESIS
from controller.direct import solve_phases
from controller.problem import acceleration_problem
from controller.route import plan_route, plan_route_in_time
from controller.route_problem import RouteProblem
from observer.efficiency_map import FuelMap
from vehicle_model.car.parameters import Car, Engine, Injector

RPM = 2.0 * np.pi / 60.0


def synthesis_table(repeats: int = 20) -> list[Row]:
    """The 1-D optimal synthesis of the six-speed car on 500 speeds; reference: scipy, gear by gear."""
    speeds = np.linspace(3.0, 45.0, 500)
    acceleration.synthesis_table(THESIS, speeds)
    value = least(lambda: acceleration.synthesis_table(THESIS, speeds), repeats)

    def reference() -> None:
        for v in speeds[::10]:
            for n in THESIS.ratios:
                w = n * v
                if THESIS.engine_speed[0] <= w <= THESIS.engine_speed[1]:
                    floor = max(THESIS.torque[0], 1.001 * THESIS.road_load(v) / n)
                    minimize_scalar(
                        lambda t, w=w, n=n, v=v: THESIS.fuel_power(w, t) / (t * n - THESIS.road_load(v)),
                        bounds=(floor, THESIS.torque[1]),
                        method="bounded",
                    )

    return [row("synthesis_table", 1e3 * value, "ms", "scipy, per speed and gear", 1e3 * 10 * least(reference, 2))]


def shooting_six_speed(repeats: int = 50) -> list[Row]:
    """36 -> 100 km/h by shooting; references: IPOPT on the winning gear sequence, at equal cost, and fixed time."""
    shoot(THESIS, 10.0, 100 / 3.6, None, certify=False)
    value = least(lambda: shoot(THESIS, 10.0, 100 / 3.6, None, certify=False), repeats)
    free = acceleration_problem(THESIS, 10.0, 100 / 3.6, None)
    ends = [np.array([v]) for v in (10.6, 14.5, 19.0, 26.6, 100 / 3.6)]

    def programme() -> None:
        solve_phases(free, (1, 2, 3, 4, 5), intervals=8, guess=ends, guess_control=(80.0,), shortest=0.02)

    rows = [row("shooting_six_speed", 1e3 * value, "ms", "CasADi and IPOPT", 1e3 * least(programme, 3))]
    fixed_value = least(lambda: shoot(THESIS, 10.0, 140 / 3.6, 30.0, certify=False), 5)
    fixed = acceleration_problem(THESIS, 10.0, 140 / 3.6, 30.0)
    ends = [np.array([v]) for v in (9.4, 10.4, 14.2, 18.6, 26.0, 140 / 3.6)]

    def fixed_programme() -> None:
        solve_phases(fixed, (6, 1, 2, 3, 4, 5), intervals=8, guess=ends, guess_control=(80.0,), shortest=0.02)

    rows.append(
        row(
            "shooting_six_speed",
            1e3 * fixed_value,
            "ms",
            "CasADi and IPOPT, fixed time",
            1e3 * least(fixed_programme, 2),
        )
    )
    return rows


def dp_sweep_5km(repeats: int = 15) -> list[Row]:
    """One sweep of 5 km: 200 stages x 200 energies x 6 gears; reference: the same sweep in numpy."""
    problem = RouteProblem.build(_road(5000.0), _willans(), _car(), 0.0, 0.0, None, None, 25.0, 200, None)
    problem.value_function(1e4)
    value = least(lambda: problem.value_function(1e4), repeats)
    table = problem.value_function(1e4)
    reference = least(lambda: route_reference.sweep(*problem.arguments(1e4, table)), 1)
    return [row("dp_sweep_5km", 1e3 * value, "ms", "numpy", 1e3 * reference)]


def route_50km(repeats: int = 3) -> list[Row]:
    """50 km with slopes and limits in a given time; reference: IPOPT on 50 km of hills, one gear, one time value.

    Second row: like for like, both on those hills with that one gear and time value, and a plan alone (no policy at
    other speeds, no certificate: IPOPT gives neither). The plan costs 0.15 % more there, on a grid of 200 speeds.
    """
    road, fuel_map, car = _road(50_000.0), _willans(), _car()

    def plan() -> None:
        plan_route_in_time(road, fuel_map, car, start_speed=0.0, end_speed=0.0, trip_time=2400.0)

    plan()
    value = least(plan, repeats)
    hills = hill_road.HillRoad(length=50_000.0)
    reference = least(lambda: hill_road.direct(hills, intervals=2500), 1)
    same_car, same_map = hill_road.car_and_map(hills)
    s = np.arange(0.0, hills.length + 1.0, 10.0)
    slope = hills.grade * np.sin(2.0 * np.pi * s / hills.wave)
    same_road = RoadAhead(s, slope, np.full_like(s, 40.0), np.zeros_like(s))

    def same() -> None:
        plan_route(
            same_road, same_map, same_car, start_speed=hills.speed, end_speed=hills.speed,
            time_value=hills.time_value, policy_step=None, certify=False,
        )  # fmt: skip

    same()
    return [
        row("route_50km", value, "s", "IPOPT, one gear, time value given", reference),
        row("route_50km", least(same, repeats), "s", "IPOPT, the same one-gear problem", reference),
    ]


def _road(length: float) -> RoadAhead:
    s = np.arange(0.0, length + 1.0, 10.0)
    pitch = 0.03 * np.sin(2 * np.pi * s / 1700) + 0.015 * np.sin(2 * np.pi * s / 610)
    limit = np.select([s < 0.2 * length, s < 0.7 * length], [50 / 3.6, 90 / 3.6], 130 / 3.6)
    return RoadAhead(s, pitch, limit, np.zeros_like(s))


def _willans() -> FuelMap:
    """A Willans engine of the Smart's size."""
    speed, torque = np.linspace(800, 6000, 53) * RPM, np.arange(0.0, 121.0, 2.0)
    friction = 7.0 + 8.0 * (speed / (6000 * RPM)) ** 1.5
    power = speed[:, None] * (torque[None, :] + friction[:, None]) / 0.38
    full = np.interp(speed / RPM, [800, 1500, 2500, 4500, 6000], [45.0, 75.0, 100.0, 108.0, 90.0])
    return FuelMap(speed, torque, power, full, -friction, float(power[0, 0]), 850 * RPM)


def _car() -> Car:
    """The Smart of appendix C.1.2."""
    engine = Engine(698e-6, 3, 9.0, 60e3, 5250 * RPM, 110.0, 4500 * RPM, 850 * RPM, 6000 * RPM, 0.061, True)
    ratios = (13.25, 9.604, 7.37, 5.796, 4.208, 3.23)
    injector = Injector(8e-6, -0.0004, "sequential")
    return Car("smart", 844.0, 0.39, 1.93, 0.0125, 0.2954, 0.62, ratios, 0.27, engine, injector)


BENCHMARKS = {
    "synthesis_table": synthesis_table,
    "shooting_six_speed": shooting_six_speed,
    "dp_sweep_5km": dp_sweep_5km,
    "route_50km": route_50km,
}
"""Name of `rollingroad bench` -> the function that measures it."""

if __name__ == "__main__":
    for measure in BENCHMARKS.values():
        for row in measure():
            print(row)
