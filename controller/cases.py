"""The cases of `rollingroad solve`: each solved by every method that applies, each answer with its certificate."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from controller import acceleration, distance, hill_road, reference_cases, speed_limit, vector_cost
from controller.acceleration_direct import direct
from controller.acceleration_multiple import shoot_multiple
from controller.acceleration_programme import dynamic_programming
from controller.controller_model import RPM, THESIS, THESIS_CVT, ControllerModel, model_of
from controller.pulse_and_glide import pulse_and_glide
from controller.soft_driving import compare
from controller.solution import Solution, failed
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car

METHODS = ("indirect", "direct", "dp")
"""What a case is solved by unless told otherwise."""
VARIANTS = ("indirect-multiple", "direct-single", "direct-multiple")
"""Of the accelerations only, when asked for: indirect multiple shooting (fixed time), direct single and multiple
shooting in place of collocation."""
KMH = 1.0 / 3.6


def solve(case: str, methods: Sequence[str] = METHODS, car: Car | None = None) -> list[Solution]:
    """Solve `case` by `methods` (of METHODS, VARIANTS); without `car`, the thesis' controller model (CLI.md).

    A solution that fails its certificate keeps its row, refused. Raises BadInput for an unknown case or method.
    """
    if case not in CASES:
        raise BadInput("case", case, f"one of {', '.join(CASES)}")
    known = METHODS + (VARIANTS if case in ACCELERATIONS else ())
    for method in methods:
        if method not in known:
            raise BadInput("method", method, f"one of {', '.join(known)}")
    return [solution.judged() for solution in CASES[case](tuple(methods), car)]


def _gearbox(car: Car | None) -> ControllerModel:
    return THESIS if car is None else model_of(car)


def _stepless(car: Car | None) -> ControllerModel:
    return THESIS_CVT if car is None else model_of(car, cvt=True)


def _accelerate(
    case: str, model: ControllerModel, start: float, target: float, duration: float | None, methods: tuple[str, ...]
) -> list[Solution]:
    solvers: dict[str, Callable[..., Solution]] = {
        "indirect": acceleration.shoot,
        "indirect-multiple": shoot_multiple,
        "direct": direct,
        "direct-single": partial(direct, transcription="single"),
        "direct-multiple": partial(direct, transcription="multiple"),
        "dp": dynamic_programming,
    }
    return [replace(solvers[m](model, start, target, duration, case=case), method=m) for m in methods]


def cvt_free(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.4.1.1: CVT, 1 m/s to 100 km/h, free time."""
    return _accelerate("cvt-free", _stepless(car), 1.0, 100.0 * KMH, None, methods)


def cvt_fixed(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """CVT, 1 m/s to 100 km/h in nine tenths of the free time: H is constant above zero, the price of the hurry."""
    model = _stepless(car)
    free = acceleration.shoot(model, 1.0, 100.0 * KMH, None, certify=False).duration
    return _accelerate("cvt-fixed", model, 1.0, 100.0 * KMH, 0.9 * free, methods)


def six_speed_free(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.4.2.1: gears, 36 to 100 km/h, free time."""
    return _accelerate("six-speed-free", _gearbox(car), 10.0, 100.0 * KMH, None, methods)


def six_speed_fixed(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.4.2.2: gears, 36 to 140 km/h in 30 s."""
    return _accelerate("six-speed-fixed", _gearbox(car), 10.0, 140.0 * KMH, 30.0, methods)


def six_speed_limit(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """B.2.5.3: as six-speed-free with two thirds of the engine speeds allowed; costate jumps, and the same by penalty.

    In a gear the limit is one on the state, which the extremal of six-speed-free violates. The principle with state
    limits: lambda jumps where the limit ends a gear, by what keeps H; notes carry the jumps. By penalty (row
    "indirect-penalty"): J with the penalty is a bound from below, which rises to the constrained J with the weight; the
    limit is then exceeded by `overshoot_percent`.
    """
    model = _gearbox(car)
    low, high = model.engine_speed
    limited = replace(model, engine_speed=(low, high * 2.0 / 3.0))
    found = []
    for solution in _accelerate("six-speed-limit", limited, 10.0, 100.0 * KMH, None, methods):
        if solution.method != "indirect":
            found.append(solution)
            continue
        at = np.flatnonzero(np.diff(solution.time) == 0.0)
        jumps = solution.costate[at + 1, 0] - solution.costate[at, 0]
        notes = {f"costate_jump_{k}": float(jump) for k, jump in enumerate(jumps, start=1)}
        found.append(replace(solution, notes=notes))
        soft = replace(model, soft_limit=high * 2.0 / 3.0, penalty=1e8)
        priced = acceleration.shoot(soft, 10.0, 100.0 * KMH, None, dt=0.01, case="six-speed-limit")
        over = max((s.engine_speed for s in priced.shifts), default=0.0) / soft.soft_limit - 1.0
        found.append(replace(priced, method="indirect-penalty", notes={"overshoot_percent": 100.0 * max(over, 0.0)}))
    return found


def _distance(case: str, model: ControllerModel, methods: tuple[str, ...]) -> list[Solution]:
    length, found = 5000.0, []
    start = distance.corner(model).speed
    for method in methods:
        if method == "indirect":
            found.append(distance.corner_solution(model, length, case=case))
        elif method == "dp":
            found.append(distance.bellman(model, length, start, case=case, step=20.0, nodes=300))
        else:
            answer = distance.direct_solution(model, length, start, case=case)
            found.append(answer or failed(case, "direct", "IPOPT found no answer"))
    least = min((s.cost for s in found if s.certificate.refused is None), default=np.nan)
    return [_beaten(s, least) if s.method == "direct" else s for s in found]


def _beaten(solution: Solution, least: float) -> Solution:
    """A local optimum, as IPOPT may return one, is refused when another method does better by more than 1 %."""
    if solution.certificate.refused is None and solution.cost > 1.01 * least:
        excess = solution.cost / least - 1.0
        return solution.refuse(f"a local optimum: another method's answer is {excess:.1%} cheaper")
    return solution


def cvt_distance(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.5.1: CVT, 5 km, free time and final speed; the thesis' corner is refused, dp gives the infimum.

    Row "pulse-and-glide" is a drive that can be driven, in six pulses; its note says what the corner costs more. Row
    "dp-steady" is the best drive with pulse and glide forbidden, as the route planner does.
    """
    model = _stepless(car)
    found = _distance("cvt-distance", model, methods)
    if "dp" in methods:
        start = distance.corner(model).speed
        found.append(
            distance.bellman(
                model, 5000.0, start, case="cvt-distance", step=20.0, nodes=300, relaxed=False, method="dp-steady"
            )
        )
    if "indirect" in methods and found[methods.index("indirect")].certificate.refused is not None:
        corner = found[methods.index("indirect")]
        pulsed = pulse_and_glide(model, corner.distance, corner.notes["speed"], 6)
        excess = 100.0 * (corner.cost / pulsed.cost - 1.0)
        found.append(replace(pulsed, notes={**pulsed.notes, "corner_excess_percent": excess}))
    return found


def cvt_corner(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.5.1 with the floor at 2000 rpm and 30 N m, where the corner of least power is optimal."""
    model = _stepless(car)
    scale = model.torque[1] / THESIS_CVT.torque[1]
    return _distance("cvt-corner", distance.with_floor(model, 2000.0 * RPM, 30.0 * scale), methods)


def limited(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """B.2.5.3: 36 to 50 km/h over 1.5 km of level road, limit 70 km/h; six gears, a convex engine, a second at 30 kW.

    The boundary arc by the constrained principle (notes: lambda_x, eta, the share of time on the limit), by IPOPT with
    the limit as a constraint and, row "direct-penalty", as a price, and by dynamic programming.
    """
    road = speed_limit.LimitedRoad() if car is None else speed_limit.car_road(car)
    shot = speed_limit.indirect(road)
    driven = shot.gear[np.append(True, np.diff(shot.gear) != 0)]
    sequence = tuple(int(g) for g in driven) + (int(driven[-1]),) * max(3 - len(driven), 0)
    found = []
    for method in methods:
        if method == "indirect":
            found.append(shot)
        elif method == "dp":
            found.append(speed_limit.dynamic_programming(road))
        else:
            for name, penalty in (("direct", None), ("direct-penalty", 1e7)):
                answer = speed_limit.direct(road, sequence, penalty=penalty)
                found.append(answer or failed("speed-limit", name, "IPOPT found no answer"))
    return found


def soft_vs_pontryagin(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """4.4.3: the soft driver against Pontryagin to 90 km/h, as printed and fairly. Methods do not apply."""
    return compare(_gearbox(car))


def route(methods: tuple[str, ...], car: Car | None) -> list[Solution]:
    """Hills between two fixed speeds at a price on time, one gear, smooth engine."""
    problem = hill_road.HillRoad()
    if car is not None:
        problem = replace(
            problem,
            ratio=car.gear_ratios[-1] / car.wheel_radius,
            mass=car.mass,
            accelerated_mass=car.accelerated_mass,
            engine_inertia=car.engine.inertia,
            rolling_resistance=car.rolling_resistance,
            drag_area=car.drag_area,
        )
    solvers: dict[str, Callable[..., Solution]] = {
        "indirect": hill_road.indirect,
        "direct": hill_road.direct,
        "dp": hill_road.dynamic_programming,
    }
    return [solvers[m](problem) for m in methods]


CASES: dict[str, Callable[[tuple[str, ...], Car | None], list[Solution]]] = {
    "cvt-free": cvt_free,
    "cvt-fixed": cvt_fixed,
    "cvt-distance": cvt_distance,
    "cvt-corner": cvt_corner,
    "six-speed-free": six_speed_free,
    "six-speed-fixed": six_speed_fixed,
    "six-speed-limit": six_speed_limit,
    "speed-limit": limited,
    "soft-vs-pontryagin": soft_vs_pontryagin,
    "ball-and-wheel": reference_cases.ball_and_wheel_case,
    "route": route,
    "vector-cost": vector_cost.trades,
    "lqr": reference_cases.lqr,
}
"""Name -> solver; the first line of its docstring is what `solve --list` shows."""
ACCELERATIONS = ("cvt-free", "cvt-fixed", "six-speed-free", "six-speed-fixed", "six-speed-limit")
