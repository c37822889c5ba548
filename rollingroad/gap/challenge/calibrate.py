"""Choose the thresholds on development sets: floors from the trips without a gap, then priors by the log score.

`rollingroad challenge calibrate DIR... --out thresholds.json`, sets diagnosed by `challenge run DIR --keep`. Two steps:

1. *Floors*: the deviation of what our own model's errors make of each effect, by maximum likelihood over the gap-free
   cases, all together (`floors.py`).
2. *Priors, barrier, temperature and misfit*: the least mean negative log probability of the truth (a proper score, so
   that it also calibrates), over gap-free cases, singles and sensors at twice the limit and more, hidden cases and
   pairs, each kind with its own weight whatever the number of its cases.

The search starts at the shipped thresholds. Nothing of a set that is scored later may be among these.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from rollingroad.gap.calibration import Reduced
from rollingroad.gap.challenge.effects import same_class
from rollingroad.gap.challenge.kept import read_evidence
from rollingroad.gap.challenge.score import opened_key
from rollingroad.gap.evidence import Hypotheses, Posterior, Thresholds, hypotheses, weighed
from rollingroad.gap.floors import floors
from rollingroad.gap.thresholds import load
from rollingroad.gap.trips import Layout, Lexicon
from vehicle_model.car.files import read_car

WEIGHTS: Mapping[str, float] = {"gap_free": 0.45, "known": 0.35, "hidden": 0.15, "pair": 0.05}
"""Of the kinds of case in the score that is minimised."""
WORST = 0.02
"""What a probability counts at least: a few hidden effects that look like a named one must not set all the rest."""
FREE = ("barrier", "misfit", "temperature", "prior_outside", "prior_pair")
"""Thresholds that step 2 moves, all positive."""


@dataclass(frozen=True)
class Case:
    """One diagnosed case of a development set, with its truth."""

    key: dict[str, Any]
    reduced: Reduced
    layout: Layout
    lexicon: Lexicon
    hide: tuple[str, ...]

    @property
    def kind(self) -> str | None:
        """Of WEIGHTS; None for cases that choose nothing (below twice the limit, for one)."""
        parts = self.key["parts"]
        if self.key["kind"] == "gap_free":
            return "gap_free"
        if not parts or min(p["strength"] for p in parts) < 2.0:
            return None
        if self.key["hidden"]:
            return "hidden"
        return "pair" if len(parts) == 2 else "known"


def read_cases(folders: Sequence[Path]) -> list[Case]:
    """The cases of `folders`. Raises BadInput where one has not been run with `--keep` by this version."""
    cases = []
    for folder in folders:
        for key in opened_key(folder):
            place = folder / key["case"]
            reduced, layout, hide = read_evidence(place)
            cases.append(Case(key, reduced, layout, Lexicon.of(read_car(place / "car.xml")), hide))
    return cases


def truth_probability(case: Case, p: Posterior) -> float:
    """Probability on the truth (its class) under `p`."""
    effects = [part["effect"] for part in case.key["parts"]]
    if case.kind == "gap_free":
        return p.none
    if case.kind == "hidden":
        return p.outside
    if case.kind == "pair":
        return sum(
            q for pair, q in p.pairs.items() if all(any(same_class(e, member) for member in pair) for e in effects)
        )
    return sum(q for effect, q in p.singles.items() if same_class(effect, effects[0]))


def log_score(cases: Sequence[tuple[Case, Hypotheses]], t: Thresholds) -> float:
    """Mean negative log probability of the truth over the kinds, weighted."""
    total, weight = 0.0, 0.0
    for kind, share in WEIGHTS.items():
        of = [-np.log(max(truth_probability(c, weighed(h, t)), WORST)) for c, h in cases if c.kind == kind]
        if of:
            total += share * float(np.mean(of))
            weight += share
    return total / weight


def calibrate(folders: Sequence[Path], start: Thresholds | None = None) -> dict[str, Any]:
    """Return the content of `thresholds.json`, chosen on the sets in `folders` from `start` (the shipped ones)."""
    cases = [case for case in read_cases(folders) if case.kind is not None]
    calm = [(case.reduced, case.lexicon) for case in cases if case.kind == "gap_free"]
    first = replace(start or load(), floor=floors(calm))
    ready = [(case, hypotheses(case.reduced, case.lexicon, case.layout, case.hide, first)) for case in cases]

    def at(x: Any) -> Thresholds:
        return replace(first, **dict(zip(FREE, np.exp(x).tolist(), strict=True)))

    begin = np.log([getattr(first, name) for name in FREE])
    best = minimize(
        lambda x: log_score(ready, at(x)) + 1e-3 * float(np.sum((x - begin) ** 2)), begin, method="Nelder-Mead",
        options={"maxfev": 400, "initial_simplex": np.vstack([begin, begin + 0.5 * np.eye(len(begin))])},
    )  # fmt: skip
    chosen = at(best.x)
    values = {
        name: value if isinstance(value, dict) else float(f"{value:.3g}") for name, value in asdict(chosen).items()
    }
    return {
        "development_seeds": [json.loads((folder / "manifest.json").read_text())["seed"] for folder in folders],
        "cases": len(cases),
        "log_score": {"before": round(log_score(ready, first), 4), "after": round(log_score(ready, chosen), 4)},
        "values": values,
    }
