"""What a run's report shows: from a `Run` to `Chart`s. Human units (km, km/h, rpm, kN, MJ) begin here."""

import numpy as np
from numpy.typing import NDArray

from observer.efficiency_map import EfficiencyMap
from observer.estimate import STATES, Estimate
from rollingroad.run import Run
from rollingroad.viz import charts
from rollingroad.viz.accounts import PARTS, energy_account
from rollingroad.viz.charts import Band, Bars, Chart, Heat, Line, Mark, Panel, Span
from vehicle_model.car.route import CANYON, TUNNEL, Route
from vehicle_model.car.trip import Trip

KMH, RPM = 3.6, 30.0 / np.pi
_POINTS = 1500
"""Points of a line: more than a screen has columns."""
_PART_COLOURS = dict(
    zip(
        PARTS, (charts.GREY, charts.PURPLE, charts.SKY_BLUE, charts.GREEN, charts.VERMILION, charts.YELLOW), strict=True
    )
)


def run_charts(run: Run) -> list[Chart]:
    """All charts of a run's report, in reading order."""
    return [
        speed_chart(run),
        fuel_chart(run),
        account_chart(run),
        map_chart(run.efficiency_map, run.true_efficiency),
        thrust_chart(run.baseline, run.estimate),
        consistency_chart(run.estimate),
    ]


def speed_chart(run: Run) -> Chart:
    """Speed, gear and altitude over distance: baseline, advised, advice, limit."""
    base, adv, advice = _thinned(run.baseline), _thinned(run.advised), run.advice
    spans = sky_spans(run.route)
    speed: tuple[Mark, ...] = (
        *spans,
        Line(_km(run.route.s), run.route.speed_limit * KMH, "limit", charts.LIMIT, dash="dot", step=True),
        Line(_km(advice.s), advice.speed * KMH, "advice", charts.ADVICE, dash="dash"),
        Line(_km(base["distance"]), base["speed"] * KMH, "baseline", charts.BASELINE),
        Line(_km(adv["distance"]), adv["speed"] * KMH, "advised", charts.ADVISED),
    )
    gear = (
        Line(_km(advice.s), advice.gear.astype(float), gear_name(run), charts.ADVICE, dash="dash", step=True),
        Line(_km(base["distance"]), base["gear"], "baseline", charts.BASELINE, width=1.2, step=True),
        Line(_km(adv["distance"]), adv["gear"], "advised", charts.ADVISED, width=1.2, step=True),
    )
    height = (Line(_km(run.route.s), run.route.altitude, "altitude", charts.BLACK),)
    return Chart(
        "speed",
        "Speed, gear and altitude along the road",
        "Both drivers meet the same traffic up to the first advice. Shaded: where the sky is hidden from GPS.",
        (
            Panel("speed (km/h)", speed, weight=3.0),
            Panel("gear", gear, weight=1.2),
            Panel("altitude (m)", height, x_label="distance (km)", weight=1.2),
        ),
        height=560,
    )


def gear_name(run: Run) -> str:
    """What the gears of the plan are called: advice, or the plan's own where the driver is left to shift by himself."""
    return "advice" if run.gears_told else "planned, not told"


def fuel_chart(run: Run) -> Chart:
    """Fuel burnt and time taken over distance: where the difference arises."""
    s = np.linspace(0.0, min(run.baseline.distance[-1], run.advised.distance[-1]), _POINTS)
    base_fuel, adv_fuel = (np.interp(s, t.distance, t.fuel_energy) / 1e6 for t in (run.baseline, run.advised))
    base_time, adv_time = (np.interp(s, t.distance, t.time) for t in (run.baseline, run.advised))
    zero = Line(np.array([0.0, s[-1] / 1e3]), np.zeros(2), "baseline", charts.BASELINE, width=1.0)
    return Chart(
        "fuel",
        "Where the difference arises",
        "Advised minus baseline up to each place: below zero the advised driver has burnt less, or is ahead in time. "
        "Only where both curves are read together does a saving mean something.",
        (
            Panel("fuel (MJ)", (zero, Line(s / 1e3, adv_fuel - base_fuel, "advised - baseline", charts.ADVISED))),
            Panel(
                "time (s)",
                (zero, Line(s / 1e3, adv_time - base_time, "advised - baseline", charts.ADVISED)),
                x_label="distance (km)",
            ),
        ),
        height=380,
    )


def account_chart(run: Run) -> Chart:
    """Bars of where the fuel of each drive went."""
    names = ("baseline", "advised")
    accounts = [energy_account(trip, run.car) for trip in (run.baseline, run.advised)]
    bars = tuple(
        Bars(names, np.array([max(account.parts[part], 0.0) for account in accounts]) / 1e6, part, _PART_COLOURS[part])
        for part in PARTS
    )
    standing = " and ".join(f"{a.standing / 1e6:.2f} MJ ({n})" for n, a in zip(names, accounts, strict=True))
    return Chart(
        "account",
        "Where the fuel went",
        "The heating value of the fuel burnt, by what became of it: read off the simulated truth, hence without error. "
        f"Of it, {standing} burnt while standing.",
        (Panel("", bars, x_label="energy (MJ)"),),
        height=230,
    )


def map_chart(found: EfficiencyMap, truth: NDArray[np.float64] | None) -> Chart:
    """Efficiency as found, as it is, and the difference in points; cells that fail the validity rule are faint."""
    x, y = found.engine_speed * RPM, found.torque
    top = 40.0 if truth is None else float(np.ceil(np.nanmax(truth) * 20.0) * 5.0)
    heats = [("found", Heat(x, y, 100 * found.mean, "efficiency (%)", "cividis", 0.0, top, found.valid))]
    if truth is not None:
        heats.append(("true", Heat(x, y, 100 * truth, "efficiency (%)", "cividis", 0.0, top)))
        difference = 100 * (found.mean - truth)
        heats.append(("found - true", Heat(x, y, difference, "points", "PuOr", -3.0, 3.0, found.valid)))
    window = _window(x, np.any(found.count > 0, axis=1)), _window(y, np.any(found.count > 0, axis=0))
    panels = tuple(
        Panel("torque (N m)" if i == 0 else "", (heat,), name, "engine speed (rpm)", window[1], window[0])
        for i, (name, heat) in enumerate(heats)
    )
    return Chart(
        "map",
        "The efficiency map, found and true",
        "Cells of 50 rpm by 2 N m. Full colour: valid (at least 0.5 s in at least two visits, deviation at most 0.05). "
        "Faint: visited, not trusted. White: never visited.",
        panels,
        beside=True,
        height=380,
    )


def thrust_chart(trip: Trip, estimate: Estimate, length: float = 60.0) -> Chart:
    """The liveliest minute of the thrust: true, filtered with two standard deviations, smoothed."""
    start = _liveliest(trip.time, trip.thrust, length)
    inside = (estimate.time >= start) & (estimate.time <= start + length)
    t = estimate.time[inside]
    true_inside = (trip.time >= start) & (trip.time <= start + length)
    stride = max(int(0.05 / trip.step), 1)
    thrust = ((trip.thrust - trip.brake_force)[true_inside] / 1e3)[::stride]
    filtered = estimate.column("thrust")[inside] / 1e3
    deviation = 2.0 * _deviation(estimate.variance, "thrust")[inside] / 1e3
    smoothed = estimate.column("thrust", smoothed=True)[inside] / 1e3
    marks: tuple[Mark, ...] = (
        Band(t, filtered - deviation, filtered + deviation, "filter ± 2 sd", charts.FILTER),
        Line(trip.time[true_inside][::stride], thrust, "true", charts.TRUTH),
        Line(t, filtered, "filter", charts.FILTER),
        Line(t, smoothed, "smoothed", charts.FOUND, dash="dash"),
    )
    span = max(float(np.ptp(thrust)), 0.1)
    limits = float(thrust.min()) - 0.2 * span, float(thrust.max()) + 0.2 * span
    return Chart(
        "thrust",
        "What the observer saw of the thrust",
        f"The liveliest {length:.0f} s of the drive. Thrust less brakes, which the observer cannot tell apart.",
        (Panel("thrust (kN)", marks, x_label="time (s)", y_range=limits),),
        height=320,
    )


def consistency_chart(estimate: Estimate) -> Chart:
    """Mean normalised innovation squared and share of rejected measurements by kind of sensor."""
    records = estimate.records
    kinds = tuple(sorted({str(kind) for kind in records["kind"]}))
    of_kind = [records[records["kind"].astype(str) == kind] for kind in kinds]
    nis = np.array([rows["nis"][rows["fused"]].mean() if rows["fused"].any() else 0.0 for rows in of_kind])
    rejected = np.array([100.0 * (~rows["fused"]).mean() for rows in of_kind])
    return Chart(
        "consistency",
        "Does the observer know how wrong it is?",
        "Left: the mean normalised innovation squared per measurement; 1 where the stated uncertainty is right, less "
        "is cautious, more is overconfident. Right: measurements that the gate refused.",
        (
            Panel("", (Bars(kinds, nis, "mean NIS", charts.BLUE), Span(0.95, 1.05, "1")), x_label="mean NIS (1)"),
            Panel("", (Bars(kinds, rejected, "rejected", charts.VERMILION),), x_label="rejected (%)"),
        ),
        beside=True,
        height=120 + 26 * len(kinds),
    )


def sky_spans(route: Route) -> tuple[Span, ...]:
    """Stretches of tunnel and street canyon along the route, over kilometres."""
    edges = np.flatnonzero(np.diff(route.sky)) + 1
    starts, ends = np.concatenate([[0], edges]), np.concatenate([edges, [len(route.s) - 1]])
    names = {TUNNEL: "tunnel", CANYON: "canyon"}
    return tuple(
        Span(float(route.s[a]) / 1e3, float(route.s[b]) / 1e3, names[int(route.sky[a])])
        for a, b in zip(starts, ends, strict=True)
        if int(route.sky[a]) in names
    )


def _thinned(trip: Trip) -> dict[str, NDArray[np.float64]]:
    """Every k-th sample in time, so that stops keep their samples."""
    rows = slice(None, None, max(len(trip.time) // _POINTS, 1))
    return {name: trip.channels[name][rows] for name in ("distance", "speed", "gear")}


def _km(metres: NDArray[np.float64]) -> NDArray[np.float64]:
    return metres / 1e3


def _window(centres: NDArray[np.float64], used: NDArray[np.bool_]) -> tuple[float, float]:
    """From the first to the last cell in use, and half a cell more."""
    half = 0.5 * float(centres[1] - centres[0])
    inside = centres[used] if used.any() else centres
    return float(inside[0]) - half, float(inside[-1]) + half


def _liveliest(time: NDArray[np.float64], signal: NDArray[np.float64], length: float) -> float:
    """Start of the window of `length` seconds in which `signal` has the largest variance."""
    edges = np.arange(time[0], max(time[-1] - length, time[0] + 1e-9), length / 4.0)
    return float(max(edges, key=lambda start: signal[(time >= start) & (time <= start + length)].var()))


def _deviation(variance: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    return np.sqrt(variance[:, STATES.index(name)])
