"""The diagnosis as one self-contained page: the answer first, then the pictures an engineer wants."""

import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rollingroad.gap.blocks import CHANNELS
from rollingroad.gap.design import FUEL
from rollingroad.gap.low_rank import low_rank
from rollingroad.gap.result import as_json
from rollingroad.gap.trips import stack, whiten
from rollingroad.gap.where import hypotheses
from rollingroad.viz import charts
from rollingroad.viz.charts import Bars, Chart, Heat, Line, Panel
from rollingroad.viz.page import write_page
from rollingroad.viz.report import NONE, number, scaled

if TYPE_CHECKING:
    from rollingroad.gap.diagnose import Diagnosis

_UNITS = {"fuel_power": ("kW", 1e-3), "coast_force": ("N", 1.0), "gnss_speed": ("m/s", 1.0), "height_gps": ("m", 1.0),
          "height_map": ("m", 1.0)}  # fmt: skip
"""Of a residual channel, with the factor from SI; others stand in SI."""
_BINS = (36, 28)


def write_report(d: "Diagnosis", out: Path) -> Path:
    """Write `out`/report.html (aside, then renamed) and return its path."""
    result = as_json(d)
    whitened = [whiten(t, d.layout, d.calibration.noise) for t in d.logs]
    rank = low_rank(d.logs, whitened, d.layout, d.calibration)
    made = [_ranking(result), *_plane(d), _course(d), _shrinkage(result)]
    facts = {
        "car": d.car.name,
        "lead": lead(result),
        "tiles": _tiles(result),
        "trips": result["trips"],
        "held_out": result["shrinkage"]["held_out"],
        "causes": [_cause(row) for row in result["causes"] if row["probability"] > 0.005],
        "where": [
            [w["subsystem"], w["channel"], w["regime"], number(w["share"], 2, ""), f"{w['p_value']:.2g}"]
            for w in result["where"][:10]
        ],
        "singular": ", ".join(f"{value:.2f}" for value in rank.values),
        "not_testable": result["not_testable"],
        "notes": result["notes"],
        "everything": json.dumps(result, indent=1),
        "version": version("rollingroad"),
    }
    out.mkdir(parents=True, exist_ok=True)
    path = out / "report.html"
    write_page("diagnosis.html.j2", made, facts, path)
    return path


def lead(result: dict[str, Any]) -> str:
    """The answer in one sentence."""
    first = next((c for c in result["causes"] if c["effects"] != ["none"]), None)
    verdict = result["verdict"]
    if verdict == "no_gap":
        none = next(c["probability"] for c in result["causes"] if c["effects"] == ["none"])
        return f"No gap beyond the declared tolerances (probability {none:.2f})."
    place = result["where"][0] if result["where"] else None
    at = f" It lies in {place['subsystem']}, {place['channel']}, {place['regime']}." if place else ""
    if verdict == "outside_catalogue":
        row = next(c for c in result["causes"] if c["effects"] == ["outside_catalogue"])
        words = " and ".join(row["parameters"]) or "no regressor carries it"
        chance = f"(probability {row['probability']:.2f})"
        return f"Something that the catalogue does not hold {chance}. Hypothesis: {words}.{at}"
    assert first is not None
    named = " and ".join(first["effects"])
    if verdict == "class":
        members, separators = ", ".join(first["class"]), "; ".join(first["separated_by"])
        would = f" What would: {separators}." if separators else ""
        return f"One of {members}; these trips do not separate them.{would}{at}"
    return f"{named} (probability {first['probability']:.2f}).{at}"


def _tiles(result: Mapping[str, Any]) -> list[dict[str, str]]:
    first, s = result["causes"][0], result["shrinkage"]
    ends = s["ci95"]
    interval = f"95 %: {100 * ends[0]:.0f} to {100 * ends[1]:.0f} %" if ends else "no interval: one trip alone"
    place = result["where"][0] if result["where"] else None
    return [
        {"name": "most probable", "value": number(first["probability"], 2, ""), "note": " and ".join(first["effects"])},
        {"name": "gap recovered", "value": number(scaled(s["recovered"], 100.0), 0, "%"),
         "note": f"of what the noise floor leaves; {interval}" if s["recovered"] is not None else "nothing to recover"},
        {"name": "largest share of the gap", "value": number(place["share"] if place else None, 2, ""),
         "note": f"{place['channel']}, {place['regime']}" if place else NONE},
    ]  # fmt: skip


def _cause(row: Mapping[str, Any]) -> list[str]:
    sizes = (
        f"{name} = {p['value']:.4g} ± {p['sd']:.2g} {p['unit']}".strip()
        for name, p in row["parameters"].items()
        if p["sd"] is not None
    )
    others = [member for member in row["class"] if member not in row["effects"]]
    return [
        " and ".join(row["effects"]),
        number(row["probability"], 3, ""),
        "; ".join(sizes) or NONE,
        ", ".join(others) or NONE,
        "; ".join(row["separated_by"]) or NONE,
    ]


def _ranking(result: Mapping[str, Any]) -> Chart:
    rows = [row for row in result["causes"] if row["probability"] > 0.005][:10]
    names = tuple(" + ".join(row["effects"]) for row in rows)
    bars = Bars(names, np.array([row["probability"] for row in rows]), "probability", charts.BLUE)
    return Chart(
        "causes",
        "Which effect",
        "Probability of each cause, of none, and of something outside the catalogue; they sum to 1.",
        (Panel("", (bars,), x_label="probability (1)", x_range=(0.0, 1.0)),),
        height=110 + 30 * len(rows),
    )


def _residuals(d: "Diagnosis", number: int) -> tuple[Any, Any, Any]:
    """Block times, residual before and after the most probable cause, of one trip's shrinkage channel."""
    trip = d.logs[number]
    rows = stack(trip, d.layout)
    c, n = len(d.layout.calibration), d.layout.nuisance
    mask = trip.p.layout.channel == CHANNELS.index(d.shrinkage.channel)
    before = rows[mask, -1] - rows[mask, :c] @ d.calibration.mean
    after = before.copy()
    causes = sorted(hypotheses(d.posterior, d.lexicon, d.layout), key=lambda h: -h[0])
    if causes and d.posterior.none < 0.5:
        for probability, _, index, value in causes:
            if probability >= causes[0][0] - 1e-12:
                after = after - rows[mask][:, n + index] @ value
    return trip.p.layout.time[mask], before, after


def _course(d: "Diagnosis") -> Chart:
    t, before, after = _residuals(d, 0)
    channel = d.shrinkage.channel
    unit, factor = _UNITS.get(channel, ("SI", 1.0))
    ends = np.array([t.min(), t.max()]) if len(t) else np.zeros(2)
    marks = (
        Line(ends, np.zeros(2), "no gap", charts.GREY, width=1.0),
        Line(t, factor * before, "before", charts.VERMILION, dots=True, size=4.0),
        Line(t, factor * after, "after", charts.BLUE, dots=True, size=4.0),
    )
    name = channel.replace("_", " ")
    return Chart(
        "course",
        "Measured minus simulated, over the first trip",
        f"Channel {name}: as the calibrated nominal simulator has it, and with the most probable cause.",
        (Panel(f"{name} ({unit})", marks, x_label="time (s)"),),
        height=320,
    )


def _plane(d: "Diagnosis") -> list[Chart]:
    """Relative fuel residual over engine speed and force (speed and acceleration where no engine speed is known)."""
    xs, ys, zs = [], [], []
    for trip in d.logs:
        layout = trip.p.layout
        if "fuel_power" not in layout.parts:
            continue
        rows = stack(trip, d.layout)
        mask = layout.channel == FUEL
        index, part, count = layout.parts["fuel_power"]
        m = trip.p.samples.motion
        left = rows[mask, -1] - rows[mask, : len(d.layout.calibration)] @ d.calibration.mean
        burnt = np.bincount(part, np.nan_to_num(trip.p.samples.fuel)[index]) / count
        ok = burnt > 3000.0
        x, y = (m.speed, m.acceleration) if d.coarse else (m.engine_speed * 30.0 / np.pi, m.force)
        xs.append((np.bincount(part, x[index]) / count)[ok])
        ys.append((np.bincount(part, y[index]) / count)[ok])
        zs.append(100.0 * left[ok] / burnt[ok])
    if not xs or not sum(map(len, xs)):
        return []
    x, y, z = np.concatenate(xs), np.concatenate(ys), np.concatenate(zs)
    finite = np.isfinite(x) & np.isfinite(y) & np.isfinite(z)
    if finite.sum() < 2:
        return []
    count, x_edges, y_edges = np.histogram2d(x[finite], y[finite], _BINS)
    total = np.histogram2d(x[finite], y[finite], (x_edges, y_edges), weights=z[finite])[0]
    mean = np.full(_BINS, np.nan)
    np.divide(total, count, out=mean, where=count > 0)
    limit = max(float(np.percentile(np.abs(z[finite]), 95)), 1.0)
    centres = [0.5 * (edges[1:] + edges[:-1]) for edges in (x_edges, y_edges)]
    units = ("m/s", "m/s²") if d.coarse else ("rpm", "m/s²")
    heat = Heat(centres[0], centres[1], mean, "measured - simulated (%)", "PuOr", -limit, limit, units=units)
    across, up = ("speed (m/s)", "acceleration (m/s²)") if d.coarse else ("engine speed (rpm)", "specific force (m/s²)")
    return [
        Chart(
            "plane",
            "Where the fuel differs",
            "Fuel measured minus simulated, in per cent of what was burnt, means over stretches of one regime. Orange: "
            "less than simulated, purple: more.",
            (Panel(up, (heat,), "", across),),
            beside=True,
            height=400,
        )
    ]


def _shrinkage(result: Mapping[str, Any]) -> Chart:
    s = result["shrinkage"]
    said = {"before": "before", "after": "with the cause", "wrong_effect": "best wrong effect",
            "generic": "generic correction", "floor": "noise floor"}  # fmt: skip
    rows = [(name, s[key]) for key, name in said.items() if s[key] is not None]
    values = ", ".join(f"{name} {value:.4g}" for name, value in rows)
    on = "on trips left out of the fit" if s["held_out"] else "in-sample: one trip leaves none out"
    bars = Bars(tuple(name for name, _ in rows), np.array([value for _, value in rows]), "gap", charts.BLUE)
    return Chart(
        "shrinkage",
        "How far it shrinks",
        f"{s['channel']}, 30 s means, rms in units of the channel's own, {on}: {values}.",
        (Panel("", (bars,), x_label="gap (1)"),),
        height=110 + 30 * len(rows),
    )
