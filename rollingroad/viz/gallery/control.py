"""Figures 4.1, 4.3, 4.5, 4.6, 4.8 to 4.10 and G.2: optimal control, from our own solutions of the thesis' cases."""

import numpy as np
from scipy.integrate import solve_ivp

from controller import distance
from controller.acceleration import shoot
from controller.ball_and_wheel import switching_locus, time_optimal
from controller.controller_model import RPM, THESIS, THESIS_CVT, ControllerModel
from controller.soft_driving import compare
from controller.solution import Solution
from rollingroad.viz import charts
from rollingroad.viz.charts import Chart, Heat, Line, Panel

_MODEL = "The thesis' controller model (tables 3.1 and 4.1; 850 to 6000 rpm, 5 to 100 N m)."
_GEARS = (charts.PURPLE, charts.BLUE, charts.SKY_BLUE, charts.GREEN, charts.ORANGE, charts.VERMILION)
KMH = 3.6


def control_charts() -> list[Chart]:
    """The figures of chapter 4 and appendix G, in the thesis' order; they need no run."""
    to_100_kmh = shoot(THESIS, 10.0, 100.0 / KMH, None)
    fixed = shoot(THESIS, 10.0, 140.0 / KMH, 30.0)
    stepless = shoot(THESIS_CVT, 1.0, 180.0 / KMH, None)
    made = [_zones(stepless)]
    for number, title, model, solution in (
        ("4.3", "CVT, 1 m/s to 180 km/h, time free", THESIS_CVT, stepless),
        ("4.5", "Six gears, 36 to 100 km/h, time free", THESIS, to_100_kmh),
        ("4.6", "Six gears, 36 to 140 km/h in 30 s", THESIS, fixed),
    ):
        made += [_course(number, title, solution), _control_plane(number, title, model, solution)]
    optimal, soft, _ = compare(THESIS)
    printed, fair = soft.notes["printed_percent"], soft.notes["fair_percent"]
    made.append(_acceleration("4.8", "Slow acceleration", soft, "0.6 m/s², gears changed at 2500 rpm."))
    told = (
        f"To 90 km/h it burns {printed:.0f} % less than the slow driver, who is further down the road by then; at "
        f"equal speed and distance {fair:.1f} % less."
    )
    made.append(_acceleration("4.9", "Acceleration by Pontryagin's principle", optimal, told))
    return [*made, _corner(), _ball()]


def _plane(model: ControllerModel) -> tuple[charts.Array, charts.Array, Heat]:
    """Engine speeds, rpm, torques, N m, and the efficiency of table 4.1 over them, %."""
    w, t = np.linspace(*model.engine_speed, 104), np.linspace(*model.torque, 96)
    percent = 100.0 / model.inverse_efficiency(w[:, None], t[None, :])
    return w / RPM, t, Heat(w / RPM, t, percent, "efficiency (%)", "cividis", 0.0, 40.0)


def _zones(stepless: Solution) -> Chart:
    """4.1: where in the plane of engine speed and torque it pays to be."""
    rpm, torque, heat = _plane(THESIS)
    w = rpm * RPM
    power = np.linspace(2e3, 55e3, 54)
    t = np.minimum(power[:, None] / w[None, :], 1e9)
    allowed = (t >= THESIS.torque[0]) & (t <= THESIS.torque[1])
    best = np.argmin(np.where(allowed, THESIS.fuel_power(w[None, :], t), np.inf), axis=1)
    rows = np.arange(len(power))
    marks = (
        heat,
        Line(rpm[best], t[rows, best], "least fuel at each power", charts.BLACK),
        Line(stepless.control[:, 0] / RPM, stepless.control[:, 1], "least fuel to a speed (4.3)", charts.VERMILION),
    )
    return Chart(
        "figure-4.1",
        "4.1 Engine operation zones",
        f"{_MODEL} Where one power costs least fuel, and where the car is accelerated at least fuel. Of the emissions "
        "that the thesis sketches here, nothing is measured: none are drawn.",
        (Panel("torque (N m)", marks, "", "engine speed (rpm)", _range(torque), _range(rpm)),),
        True,
        420,
    )


def _range(values: charts.Array) -> tuple[float, float]:
    return float(values[0]), float(values[-1])


def _engine(solution: Solution) -> tuple[charts.Array, charts.Array]:
    """Engine speed, rpm, and torque, N m."""
    if len(solution.control[0]) == 2:
        return solution.control[:, 0] / RPM, solution.control[:, 1]
    ratio = np.asarray(THESIS.ratios)[solution.gear - 1]
    return ratio * solution.state[:, 0] / RPM, solution.control[:, 0]


def _course(number: str, title: str, solution: Solution) -> Chart:
    """Speed, costate, gear, engine speed, torque and Hamiltonian over time: parts a to c."""
    t, costate = solution.time, solution.costate[:, 0]
    rpm, torque = _engine(solution)
    model = THESIS if len(solution.control[0]) == 1 else THESIS_CVT
    power = model.fuel_power(rpm * RPM, torque)
    hamiltonian = costate * model.acceleration(solution.state[:, 0], rpm * RPM, torque) - power
    start = 0.0 if abs(hamiltonian[0]) < 1.0 else float(hamiltonian[0])
    drift = (hamiltonian - start) / np.mean(power)
    panels = [
        Panel("speed (km/h)", (Line(t, KMH * solution.state[:, 0], "speed", charts.BLUE),)),
        Panel("costate (kJ s/m)", (Line(t, costate / 1e3, "costate", charts.GREEN),)),
        Panel("engine (rpm)", (Line(t, rpm, "engine speed", charts.ORANGE),)),
        Panel("torque (N m)", (Line(t, torque, "torque", charts.VERMILION),), y_range=(0.0, 105.0)),
    ]
    if len(solution.gear) and solution.gear.max() > 0:
        gear = Line(t, solution.gear.astype(float), "gear", charts.BLACK, step=True)
        panels.insert(2, Panel("gear", (gear,), y_range=(0.5, 6.5), weight=0.7))
    panels.append(Panel("(H - H0)/P", (Line(t, drift, "drift", charts.GREY),), x_label="time (s)", weight=0.7))
    at = "" if start == 0.0 else f" at {start / 1e3:.2f} kW"
    return Chart(
        f"figure-{number}",
        f"{number} {title}",
        f"{_MODEL} {solution.duration:.2f} s, {solution.cost / 1e3:.1f} kJ. Costate -dV/dv; the Hamiltonian stays{at} "
        "to the drift shown, a share of the mean fuel power.",
        tuple(panels),
        height=120 * len(panels),
    )


def _control_plane(number: str, title: str, model: ControllerModel, solution: Solution) -> Chart:
    """Part d: the control's way over the efficiency map."""
    axis, _, heat = _plane(model)
    rpm, torque = _engine(solution)
    marks: list[Heat | Line] = [heat]
    if model.cvt:
        marks.append(Line(rpm, torque, "control", charts.VERMILION))
    else:
        for gear in np.unique(solution.gear):
            of = solution.gear == gear
            marks.append(Line(rpm[of], torque[of], f"gear {gear}", _GEARS[gear - 1], width=2.6))
    return Chart(
        f"figure-{number}d",
        f"{number}d Control over efficiency",
        f"{title}: engine speed and torque on the efficiency of table 4.1.",
        (Panel("torque (N m)", tuple(marks), "", "engine speed (rpm)", (0.0, 105.0), _range(axis)),),
        True,
        420,
    )


def _acceleration(number: str, title: str, solution: Solution, told: str) -> Chart:
    """4.8, 4.9: one acceleration to 90 km/h, as computed in the thesis' model."""
    t = solution.time
    rpm, torque = _engine(solution)
    power = THESIS.fuel_power(rpm * RPM, torque)
    burnt = np.concatenate([[0.0], np.cumsum(np.diff(t) * 0.5 * (power[1:] + power[:-1]))])
    return Chart(
        f"figure-{number}",
        f"{number} {title}",
        f"Computed, not driven: the thesis' model in place of its road. {solution.cost / 1e3:.0f} kJ over "
        f"{solution.distance:.0f} m and {solution.duration:.1f} s. {told}",
        (
            Panel("speed (km/h)", (Line(t, KMH * solution.state[:, 0], "speed", charts.BLUE),)),
            Panel("engine (rpm)", (Line(t, rpm, "engine speed", charts.ORANGE),)),
            Panel("torque (N m)", (Line(t, torque, "torque", charts.VERMILION),), y_range=(0.0, 105.0)),
            Panel("fuel (kJ)", (Line(t, burnt / 1e3, "fuel", charts.BLACK),), x_label="time (s)"),
        ),
        height=480,
    )


def _corner() -> Chart:
    """4.10: 5 km with the controls held at their lower limits, and what the maximum condition says to that."""
    model, length, start = THESIS_CVT, 5000.0, 72.0 / KMH
    refused = distance.corner_solution(model, length)
    w, t = model.engine_speed[0], model.torque[0]
    rolled = solve_ivp(
        lambda _, x: [x[1], model.acceleration(x[1], w, t)],
        (0.0, 2.0 * refused.duration),
        [0.0, start],
        events=_arrival(length),
        max_step=5.0,
        rtol=1e-8,
    )
    time, place, speed = rolled.t, rolled.y[0], KMH * rolled.y[1]
    answer = distance.corner(model)

    def rate(s: float, worth: charts.Array) -> charts.Array:
        """d lambda_v / ds in time to go s: (4.4) along the way driven."""
        v = np.interp(time[-1] - s, time, rolled.y[1])
        drag = model.air_density * model.drag_area * v
        return answer.costate_x - worth / model.accelerated_mass * (w * t / v**2 + drag)

    to_go = solve_ivp(rate, (0.0, time[-1]), [0.0], t_eval=time[-1] - time[::-1], rtol=1e-6, max_step=5.0)
    costate = to_go.y[0, ::-1]
    return Chart(
        "figure-4.10",
        "4.10 Two dimensions: CVT, 5 km, time free",
        f"Controls at their lower limits from {KMH * start:.0f} km/h: the car slows to {KMH * answer.speed:.1f} km/h "
        f"and burns {answer.power * time[-1] / 1e3:.0f} kJ. The thesis calls this optimal; here it is "
        f"{'refused: ' + refused.certificate.refused if refused.certificate.refused else 'confirmed'}.",
        (
            Panel("speed (km/h)", (Line(time, speed, "speed", charts.BLUE),)),
            Panel("distance (km)", (Line(time, place / 1e3, "distance", charts.BLACK),)),
            Panel("costate (kJ s/m)", (Line(time, costate / 1e3, "costate", charts.GREEN),), x_label="time (s)"),
        ),
    )


def _arrival(length: float):
    """Event of `solve_ivp`: the end of the road."""

    def arrived(_, x) -> float:
        return x[0] - length

    arrived.terminal = True  # type: ignore[attr-defined]
    return arrived


def _ball() -> Chart:
    """G.2: switching locus and the arcs that lead to it."""
    low, high = -1.0, 1.0
    rate = np.linspace(-1.6, 1.6, 161)
    marks = [Line(switching_locus(rate, low, high), rate, "switching locus", charts.BLACK, width=2.4)]
    for angle, speed in ((1.0, 0.0), (0.4, 1.0), (0.9, -0.8), (-1.0, 0.0), (-0.4, -1.0), (-0.9, 0.8)):
        plan = time_optimal(angle, speed, low, high)
        first, last = np.linspace(0.0, plan.switch, 60), np.linspace(0.0, plan.duration - plan.switch, 60)
        x, v = angle + speed * first + 0.5 * plan.first * first**2, speed + plan.first * first
        end_x, end_v = x[-1] + v[-1] * last + 0.5 * plan.last * last**2, v[-1] + plan.last * last
        for line_x, line_v, u in ((x, v, plan.first), (end_x, end_v, plan.last)):
            name, colour = ("lowest control", charts.VERMILION) if u < 0.0 else ("highest control", charts.BLUE)
            marks.append(Line(line_x, line_v, name, colour))
    return Chart(
        "figure-g.2",
        "G.2 Optimal control synthesis for ball and wheel",
        "Least time to the top, from six states: above the locus the lowest control until the locus is met, below it "
        "the highest. Controls scaled to ±1.",
        (Panel("rate", tuple(marks), x_label="angle", equal=True),),
        height=480,
    )
