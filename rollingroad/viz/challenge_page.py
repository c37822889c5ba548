"""scores.html: how well the diagnosis did on a blind set."""

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from rollingroad.viz import charts
from rollingroad.viz.charts import Chart, Line, Panel, Span, Whiskers
from rollingroad.viz.page import write_page
from rollingroad.viz.report import NONE, number

_SAID = {
    "false_alarm_rate": ("false alarms", "gap-free cases that were given a gap", "lower"),
    "detection_rate": ("detected", "cases at twice the detection limit", "higher"),
    "component_accuracy": ("right subsystem", "of the same cases", "higher"),
    "regime_tv": ("regimes: total variation", "between named and true regimes", "lower"),
    "top1": ("right effect first", "or its class", "higher"),
    "top2": ("right effect among two", "or its class", "higher"),
    "mean_probability": ("probability on the truth", "mean over effects", "higher"),
    "outside_catalogue_rate": ("called 'outside the catalogue'", "cases whose effect the catalogue lacks", "higher"),
    "auroc_known_unknown": ("known told from unknown", "area under the ROC curve, 0.5 is chance", "higher"),
    "recovered_fraction": ("gap recovered on held-out trips", "of what the true effect recovers", "higher"),
    "size_error": ("error of the size", "median, of the true size", "lower"),
    "coverage90": ("90 % intervals that hold the truth", "0.90 is right", "0.90"),
    "brier": ("Brier score", "", "lower"),
    "ece": ("calibration error", "expected, ten bins", "lower"),
    "detection_delay_km": ("detected after", "median distance", "lower"),
}
"""Names, what they are over, and which way is better, by the keys of `challenge score --json`."""
_KM = "detection_delay_km"
_BEYOND = ("brier", "size_error", _KM, "recovered_fraction")
"""Not shares of cases: not drawn on the axis from 0 to 1."""


def write_scores(scores: Mapping[str, Any], path: Path) -> None:
    """Write the page of `scores` (the object of `challenge score --json`) to `path`: one self-contained file."""
    known = [key for key in _SAID if isinstance(scores.get(key), Mapping)]
    made = [_shares(scores, known)]
    curves = scores.get("curves") or {}
    if curves.get("strength"):
        made.append(_curves(curves))
    cases = scores.get("cases") or {}
    facts = {
        "answer": _answer(scores),
        "tiles": [_tile(scores, key) for key in ("false_alarm_rate", "detection_rate", "top1", "recovered_fraction")],
        "scores": [[*_SAID[key], _value(scores[key], key), _ends(scores[key], key), _count(scores[key])]
                   for key in known],
        "more": [[_plain(key), _value(entry, key), _ends(entry, key), _count(entry)]
                 for part in ("more", "controls") for key, entry in (scores.get(part) or {}).items()],
        "cases": ", ".join(f"{count} {_plain(name)}" for name, count in cases.items() if name != "all"),
        "total": cases.get("all", NONE),
        "confusion": [_confused(truth, answers) for truth, answers in sorted(scores.get("confusion", {}).items())],
        "version": version("rollingroad"),
    }  # fmt: skip
    write_page("challenge.html.j2", made, facts, path)


def _plain(key: str) -> str:
    return key.replace("_", " ")


def _value(entry: Mapping[str, Any], key: str) -> str:
    return number(entry["value"], 2 if key != _KM else 1, "km" if key == _KM else "")


def _ends(entry: Mapping[str, Any], key: str) -> str:
    ends = entry.get("ci95")
    if not ends or None in ends:
        return NONE
    digits, unit = (1, "km") if key == _KM else (2, "")
    return f"{number(ends[0], digits, '')} to {number(ends[1], digits, unit)}"


def _count(entry: Mapping[str, Any]) -> str:
    return number(entry.get("n"), 0, "")


def _tile(scores: Mapping[str, Any], key: str) -> dict[str, str]:
    entry = scores[key]
    ends, count = _ends(entry, key), _count(entry)
    return {"name": _SAID[key][0], "value": _value(entry, key), "note": f"95 %: {ends}; {count} cases; {_SAID[key][1]}"}


def _answer(scores: Mapping[str, Any]) -> str:
    alarm, found, named = (scores[key] for key in ("false_alarm_rate", "detection_rate", "top1"))

    def share(entry: Mapping[str, Any]) -> str:
        value, count = entry["value"], entry.get("n")
        return NONE if value is None else f"{round(value * count)} of {count}" if count else f"{100 * value:.0f} %"

    return (
        f"A gap was seen in {share(alarm)} sets that had none. Of the effects at twice their detection limit "
        f"{share(found)} were detected and {share(named)} named first."
    )


def _shares(scores: Mapping[str, Any], known: list[str]) -> Chart:
    """The scores that are shares of cases, with their intervals; two colours for which way is better."""
    drawn = [key for key in known if key not in _BEYOND and scores[key]["value"] is not None]
    names = tuple(_SAID[key][0] for key in drawn)
    values = np.array([scores[key]["value"] for key in drawn], float)
    ends = [scores[key].get("ci95") or (np.nan, np.nan) for key in drawn]
    low, high = np.array([[np.nan if e is None else e for e in pair] for pair in ends], float).reshape(-1, 2).T
    marks = []
    for way, told, colour in (
        ("higher", "higher is better", charts.BLUE),
        ("lower", "lower is better", charts.VERMILION),
        ("0.90", "0.90 is right", charts.GREEN),
    ):
        mine = np.array([_SAID[key][2] == way for key in drawn], bool)
        if mine.any():
            marks.append(Whiskers(names, np.where(mine, values, np.nan), low, high, told, colour))
    return Chart(
        "scores",
        "The scores with their intervals",
        "95 % intervals over cases: Wilson's for shares, a bootstrap for the rest.",
        (Panel("", tuple(marks), x_label="score (1)", x_range=(-0.03, 1.03)),),
        height=150 + 30 * len(drawn),
    )


def _curves(curves: Mapping[str, Any]) -> Chart:
    strength = np.array(curves["strength"], float)
    marks = []
    for key, name, colour in (("detection", "detected", charts.BLUE), ("naming", "named first", charts.VERMILION)):
        share = 100.0 * np.array(curves[key], float)
        marks += [Line(strength, share, name, colour), Line(strength, share, name, colour, dots=True, size=8.0)]

    def reached(key: str) -> str:
        value = curves.get(key)
        return "never" if value is None else f"at {value:.2g} times its limit"

    return Chart(
        "curves",
        "Detection and naming over the strength of the effect",
        f"Half of the effects are detected {reached('detection_50')}; 80 % are named {reached('naming_80')}. "
        "Strength 1 is the detection limit: three Cramér-Rao deviations with the nominal model free inside its "
        "tolerances.",
        (
            Panel(
                "cases (%)",
                (Span(0.98, 1.02, "limit"), *marks),
                x_label="strength (detection limits)",
                y_range=(-3.0, 103.0),
            ),
        ),
        height=340,
    )


def _confused(truth: str, answers: Mapping[str, int]) -> list[str]:
    total = sum(answers.values())
    told = ", ".join(f"{_plain(name)} {count}" for name, count in sorted(answers.items(), key=lambda item: -item[1]))
    return [_plain(truth), str(total), told]
