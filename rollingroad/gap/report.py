"""The diagnosis as one self-contained page: the answer first, then the pictures an engineer wants."""

import base64
import html
import io
import json
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from jinja2 import Environment

from rollingroad.gap.channels import CHANNELS
from rollingroad.gap.design import FUEL
from rollingroad.gap.evidence import stack, whiten
from rollingroad.gap.low_rank import low_rank
from rollingroad.gap.result import as_json
from rollingroad.gap.where import hypotheses

matplotlib.use("Agg")
from matplotlib import pyplot as plt

if TYPE_CHECKING:
    from rollingroad.gap.diagnose import Diagnosis

PAGE = "report.html.j2"


def write_report(d: "Diagnosis", out: Path) -> Path:
    """Write `out`/report.html (aside, then renamed) and return its path."""
    result = as_json(d)
    s = result["shrinkage"]
    whitened = [whiten(t, d.layout, d.calibration.noise) for t in d.logs]
    rank = low_rank(d.logs, whitened, d.layout, d.calibration)
    recovered = "nothing to recover" if s["recovered"] is None else f"{100 * s['recovered']:.0f} % of the gap recovered"
    if s["ci95"]:
        recovered += f" (95 %: {100 * s['ci95'][0]:.0f} to {100 * s['ci95'][1]:.0f} %)"
    template = resources.files("rollingroad.gap").joinpath(PAGE).read_text()
    page = Environment(autoescape=True).from_string(template).render(
        car=d.car.name, result=result, trips=result["trips"], lead=lead(result), ranking=_ranking(result),
        plane=_plane(d),
        course=_course(d), bars=_bars(result), singular=", ".join(f"{v:.2f}" for v in rank.values),
        shrinkage=f"{recovered}; {s['channel']}, 30 s means: {s['before']:.4g} before, {s['after']:.4g} after, "
        f"floor {s['floor']:.4g}.",
        everything=json.dumps(result, indent=1),
    )  # fmt: skip
    out.mkdir(parents=True, exist_ok=True)
    path = out / "report.html"
    aside = path.with_name("report.html.part")
    aside.write_text(page)
    aside.replace(path)
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
        return f"One of {members}; these trips do not separate them. {separators}.{at}"
    return f"{named} (probability {first['probability']:.2f}).{at}"


def _picture(figure: Any) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, bbox_inches="tight")
    plt.close(figure)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _ranking(result: dict[str, Any]) -> str:
    rows = [c for c in result["causes"] if c["probability"] > 0.005][:10][::-1]
    figure, axes = plt.subplots(figsize=(8, 0.4 * len(rows) + 0.8))
    axes.barh(
        [html.unescape(" + ".join(c["effects"])) for c in rows], [c["probability"] for c in rows], color="#2f6f9f"
    )
    axes.set_xlim(0, 1)
    axes.set_xlabel("probability")
    return _picture(figure)


def _residuals(d: "Diagnosis", number: int) -> tuple[Any, Any, Any]:
    """Block times, residual before and after the most probable cause, of one trip's shrinkage channel."""
    trip = d.logs[number]
    rows = stack(trip, d.layout)
    c, n = len(d.layout.calibration), d.layout.nuisance
    mask = trip.p.layout.channel == CHANNELS.index(d.shrinkage.channel)
    before = rows[mask, -1] - rows[mask, :c] @ d.calibration.mean
    after = before.copy()
    causes = sorted(hypotheses(d.posterior, d.library, d.layout), key=lambda h: -h[0])
    if causes and d.posterior.none < 0.5:
        for probability, _, index, value in causes:
            if probability >= causes[0][0] - 1e-12:
                after = after - rows[mask][:, n + index] @ value
    return trip.p.layout.time[mask], before, after


def _course(d: "Diagnosis") -> str:
    figure, axes = plt.subplots(figsize=(9, 3))
    t, before, after = _residuals(d, 0)
    axes.plot(t, before, ".", ms=3, color="#c0392b", label="before")
    axes.plot(t, after, ".", ms=3, color="#2f6f9f", label="after")
    axes.axhline(0.0, color="k", lw=0.5)
    axes.set_xlabel("time of the first trip, s")
    axes.set_ylabel(f"{d.shrinkage.channel}: measured - simulated")
    axes.legend(loc="upper right")
    return _picture(figure)


def _plane(d: "Diagnosis") -> str:
    """Relative fuel residual over engine speed and torque (speed and acceleration where no engine speed is known)."""
    figure, axes = plt.subplots(figsize=(7, 4))
    xs, ys, zs = [], [], []
    for trip in d.logs:
        layout = trip.p.layout
        if "fuel_power" not in layout.parts:
            continue
        rows = stack(trip, d.layout)
        mask = layout.channel == FUEL
        index, number, count = layout.parts["fuel_power"]
        m = trip.p.samples.motion
        left = rows[mask, -1] - rows[mask, : len(d.layout.calibration)] @ d.calibration.mean
        burnt = np.bincount(number, np.nan_to_num(trip.p.samples.fuel)[index]) / count
        ok = burnt > 3000.0
        x, y = (m.speed, m.acceleration) if d.coarse else (m.engine_speed * 9.549, m.force)
        xs.append((np.bincount(number, x[index]) / count)[ok])
        ys.append((np.bincount(number, y[index]) / count)[ok])
        zs.append(100.0 * left[ok] / burnt[ok])
    if xs:
        z = np.concatenate(zs)
        limit = max(float(np.percentile(np.abs(z), 95)), 1.0) if len(z) else 1.0
        dots = axes.scatter(np.concatenate(xs), np.concatenate(ys), c=z, s=9, cmap="RdBu_r", vmin=-limit, vmax=limit)
        figure.colorbar(dots, label="fuel: measured - simulated, %")
    axes.set_xlabel("speed, m/s" if d.coarse else "engine speed, rpm")
    axes.set_ylabel("acceleration, m/s2" if d.coarse else "specific force, m/s2")
    return _picture(figure)


def _bars(result: dict[str, Any]) -> str:
    s = result["shrinkage"]
    names = ["before", "after", "wrong_effect", "generic", "floor"]
    rows = [(n.replace("_", " "), s[n]) for n in names if s[n] is not None]
    figure, axes = plt.subplots(figsize=(7, 2.6))
    axes.bar(
        [n for n, _ in rows], [v for _, v in rows], color=["#c0392b", "#2f6f9f", "#999", "#999", "#ddd"][: len(rows)]
    )
    axes.set_ylabel(f"{s['channel']}, {s['metric']}")
    return _picture(figure)
