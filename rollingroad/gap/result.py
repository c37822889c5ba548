"""From what was found to the object of `diagnose --json` (CLI.md)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from rollingroad.gap.fits import Fit
from rollingroad.gap.identify import class_of, separators
from rollingroad.gap.signature_form import Variant

if TYPE_CHECKING:
    from rollingroad.gap.diagnose import Diagnosis

LISTED = 12
"""Causes with a row of their own; the rest is left out and the probabilities are scaled to 1."""


def parameters(variant: Variant, fit: Fit, first: int = 0) -> dict[str, dict[str, Any]]:
    """The effect's parameters: value, deviation, unit, neutral. Columns of one parameter (`~1`, ...) add up."""
    out: dict[str, dict[str, Any]] = {}
    groups: dict[str, list[int]] = {}
    for i, column in enumerate(variant.columns):
        groups.setdefault(column.parameter.split("~")[0], []).append(first + i)
    for name, index in groups.items():
        column = next(c for c in variant.columns if c.parameter == name)
        if variant.effect == "ac_cycling":
            index = index[:1]
        total = float(fit.value[index].sum())
        sd = float(np.sqrt(fit.covariance[np.ix_(index, index)].sum()))
        out[f"{variant.effect}.{name}"] = {
            "value": column.neutral + total,
            "sd": sd,
            "unit": column.unit,
            "neutral": column.neutral,
        }
    if variant.effect == "head_wind":
        north, east = fit.value[first], fit.value[first + 1]
        speed = float(np.hypot(north, east))
        direction = np.array([north, east]) / max(speed, 1e-9)
        block = fit.covariance[first : first + 2, first : first + 2]
        sd = float(np.sqrt(direction @ block @ direction))
        across = float(np.sqrt(max(block.trace() - sd**2, 0.0))) / max(speed, 1e-3)
        out = {
            "head_wind.speed": {"value": speed, "sd": sd, "unit": "m/s", "neutral": 0.0},
            "head_wind.from": {
                "value": float(np.arctan2(east, north)),
                "sd": min(across, np.pi),
                "unit": "rad",
                "neutral": 0.0,
            },
        }
    for name, value in variant.shape.items():
        out.setdefault(name, {"value": value, "sd": None, "unit": "", "neutral": None})
    return out


def as_json(d: "Diagnosis") -> dict[str, Any]:
    """The JSON object."""
    post = d.posterior
    rows: list[dict[str, Any]] = [
        {"effects": ["none"], "probability": post.none, "class": [], "separated_by": [], "parameters": {}},
        {
            "effects": ["outside_catalogue"],
            "probability": post.outside,
            "class": [],
            "separated_by": [],
            "parameters": _outside(d),
        },
    ]
    keep: list[tuple[float, tuple[str, ...]]] = [(p, (e,)) for e, p in post.singles.items()] + [
        (p, e) for e, p in post.pairs.items()
    ]
    for probability, effects in sorted(keep, reverse=True)[:LISTED]:
        if len(effects) == 1:
            variant, fit = post.fits[effects[0]]
            members = class_of(effects[0], post, d.reduced, d.lexicon) if probability > 0.01 else [effects[0]]
            found = parameters(variant, fit)
        else:
            first, second, fit = post.pair_fits[effects]  # type: ignore[index]
            members = list(effects)
            found = parameters(first, fit) | parameters(second, fit, len(first.columns))
        alone = len(effects) == 2 or len(members) == 1
        rows.append({
            "effects": list(effects), "probability": probability, "class": members,
            "separated_by": [] if alone else separators(members), "parameters": found,
        })  # fmt: skip
    total = sum(row["probability"] for row in rows)
    for row in rows:
        row["probability"] = float(row["probability"] / total)
    rows.sort(key=lambda row: -row["probability"])
    s = d.shrinkage
    early = bool(d.where) and d.where[0].regime == "first_600_s"
    return {
        "verdict": verdict(d),
        "trips": {"diagnosed": len(d.logs), "held_out": len(d.logs) if s.held_out else 0,
        "reference": len(d.reference)},
        "where": [vars(place) for place in d.where],
        "causes": rows,
        "shrinkage": {
            "channel": s.channel, "metric": "nrmse_30s", "before": s.before, "after": s.after, "floor": s.floor,
            "recovered": s.recovered, "ci95": list(s.ci95) if s.ci95 else None, "window_s": [0, 600] if early else None,
            "held_out": s.held_out, "wrong_effect": s.wrong_effect, "generic": s.generic,
            "trip_fuel_error_before_percent": s.fuel_before, "trip_fuel_error_after_percent": s.fuel_after,
        },
        "not_testable": [{"effect": effect, "because": why} for effect, why in d.not_testable],
        "advice": dict(zip(("fuel_regret_before_percent", "fuel_regret_after_percent"), d.advice_regret, strict=True)),
        "notes": list(d.notes),
        "restarts": [
            {"trip": r.name, "rest_s": r.rest_s, "effect": r.effect, "probability": r.probability, "scale": r.scale,
             "scale_sd": r.scale_sd} for r in d.restarts if r is not None
        ],
    }  # fmt: skip


def verdict(d: "Diagnosis") -> str:
    """no_gap, named, class or outside_catalogue."""
    post = d.posterior
    known = sum(post.singles.values()) + sum(post.pairs.values())
    if post.none >= max(known, post.outside):
        return "no_gap"
    if post.outside >= known:
        return "outside_catalogue"
    top = max(post.singles, key=lambda e: post.singles[e], default="")
    if sum(post.pairs.values()) > sum(post.singles.values()):
        return "named"
    return "class" if len(class_of(top, post, d.reduced, d.lexicon)) > 1 else "named"


def _outside(d: "Diagnosis") -> dict[str, dict[str, Any]]:
    """The regressors that carry what the catalogue does not hold, as a hypothesis in words."""
    if d.posterior.regressors is None:
        return {}
    found, fit = d.posterior.regressors
    return {
        g.sentence: {"value": float(v), "sd": float(np.sqrt(fit.covariance[i, i])), "unit": g.unit, "neutral": 0.0}
        for i, (g, v) in enumerate(zip(found, fit.value, strict=True))
    }
