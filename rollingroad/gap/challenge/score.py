"""Open the key, check that it is the one that was sealed, and score every answer.

A cause is right at class level (`effects.CLASSES`): what ordinary trips leave unseparated counts as one. Intervals are
bootstraps over cases. Which cases each score is over: GAP.md.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rollingroad.gap.challenge.effects import BY_ID, same_class
from vehicle_model.car.errors import BadInput

Row = dict[str, Any]
"""One case: its key and its result."""


def score(folder: Path) -> dict[str, Any]:
    """Return the object of `challenge score --json`. Raises BadInput for a missing, broken or unanswered set."""
    rows = _read(folder)
    free = [r for r in rows if r["kind"] == "gap_free"]
    known = [r for r in rows if r["kind"] in ("single", "sensor") and r["parts"][0]["strength"] == 2.0]
    hidden = [r for r in rows if r["hidden"] and r["parts"][0]["strength"] >= 2.0]
    out: dict[str, Any] = {
        "false_alarm_rate": _mean(free, _detected),
        "detection_rate": _mean(known, _detected),
        "component_accuracy": _mean(known, _component),
        "regime_tv": _mean(known, _regime_tv),
        "top1": _mean(known, lambda r: _top(r, 1)),
        "top2": _mean(known, lambda r: _top(r, 2)),
        "mean_probability": _macro(known, probability_of_truth),
        "outside_catalogue_rate": _mean(hidden, lambda r: r["result"]["verdict"] == "outside_catalogue"),
        "auroc_known_unknown": _auroc(known, hidden),
        "recovered_fraction": _ratio(known, _recovered),
        "size_error": _median(known, _size_error),
        "coverage90": _mean(known, _covered),
        "brier": _mean(known + free, _brier),
        "ece": _ece(known + free),
        "detection_delay_km": _median(known, _delay),
    }
    out["confusion"] = _confusion(rows)
    out["curves"] = _curves(rows)
    pairs = [r for r in rows if r["kind"] == "pair" and len(r["parts"]) == 2]
    other = [r for r in rows if r["kind"] == "other_way" and r["parts"][0]["strength"] >= 2.0]
    traffic = [r for r in rows if r["kind"] == "traffic"]
    out["more"] = {
        "pairs_both_named": _mean(pairs, _both_named),
        "other_implementation_top1": _mean(other, lambda r: _top(r, 1)),
        "traffic_booked_to_the_car": _mean(traffic, _detected),
        "hidden_component_accuracy": _mean(hidden, _component),
        "hidden_recovered_by_generic": _ratio(hidden, _generic_recovered),
        "exact_top1": _mean(known, lambda r: _ranked(r)[0] == [r["parts"][0]["effect"]]),
    }
    out["controls"] = _controls(known)
    out["cases"] = {
        "all": len(rows),
        "gap_free": len(free),
        "known_at_2": len(known),
        "hidden_at_2_or_more": len(hidden),
    }
    return out


def opened_key(folder: Path) -> list[dict[str, Any]]:
    """The key of each case. Raises BadInput where it is not the one that the manifest committed to."""
    try:
        manifest = json.loads((folder / "manifest.json").read_text())
        body = (folder / "key" / "key.json").read_text()
        salt = (folder / "key" / "salt").read_text()
        keys = json.loads(body)
    except (OSError, ValueError) as error:
        raise BadInput(folder, "manifest.json, key/key.json, key/salt", "a set made by `challenge make`") from error
    if hashlib.sha256((salt + body).encode()).hexdigest() != manifest["key_sha256"]:
        raise BadInput(folder / "key" / "key.json", "", "the key whose hash the manifest committed to")
    return keys


def _read(folder: Path) -> list[Row]:
    rows = []
    for key in opened_key(folder):
        path = folder / key["case"] / "result.json"
        if not path.exists():
            raise BadInput(path, "", "an answer; `challenge run` first")
        rows.append(key | {"result": json.loads(path.read_text())})
    return rows


# --- one case ---


def _truth(r: Row) -> str:
    return r["parts"][0]["effect"]


def _detected(r: Row) -> float:
    return float(r["result"]["verdict"] != "no_gap")


def _component(r: Row) -> float:
    """Subsystem of the largest cell; of a class any member's."""
    if r["result"]["verdict"] == "no_gap" or not r["result"]["where"]:
        return 0.0
    right = {BY_ID[e].subsystem for e in BY_ID if same_class(e, _truth(r))}
    return float(r["result"]["where"][0]["subsystem"] in right)


def _ranked(r: Row) -> list[list[str]]:
    return [c["effects"] for c in r["result"]["causes"]]


def _top(r: Row, count: int) -> float:
    """Whether one of the first `count` classes (not causes) holds the truth."""
    seen: list[str] = []
    for effects in _ranked(r):
        name = "+".join(effects)
        if len(effects) == 1 and any(same_class(name, s) for s in seen):
            continue
        seen.append(name)
        if len(effects) == 1 and same_class(name, _truth(r)):
            return 1.0
        if len(seen) >= count:
            break
    return 0.0


def probability_of_truth(r: Row) -> float:
    """Probability on the true class; on "none" for a set without a gap."""
    if not r["parts"]:
        return _of(r, lambda e: e == ["none"])
    return _of(r, lambda e: len(e) == 1 and e[0] in BY_ID and same_class(e[0], _truth(r)))


def _of(r: Row, test: Callable[[list[str]], bool]) -> float:
    return float(sum(c["probability"] for c in r["result"]["causes"] if test(c["effects"])))


def _groups(r: Row) -> list[tuple[float, list[str]]]:
    """Probabilities pooled by class, largest first."""
    pools: list[tuple[float, list[str]]] = []
    for c in r["result"]["causes"]:
        for i, (p, members) in enumerate(pools):
            if len(c["effects"]) == 1 and len(members) == 1 and same_class(c["effects"][0], members[0]):
                pools[i] = (p + c["probability"], members)
                break
        else:
            pools.append((c["probability"], c["effects"]))
    return sorted(pools, key=lambda row: -row[0])


def _right(r: Row, effects: list[str]) -> bool:
    if not r["parts"]:
        return effects == ["none"]
    return len(effects) == 1 and effects[0] in BY_ID and same_class(effects[0], _truth(r))


def _brier(r: Row) -> float:
    return float(sum((p - _right(r, e)) ** 2 for p, e in _groups(r)))


def _found(r: Row) -> dict[str, Any] | None:
    """The estimate of the true parameter, where the true effect has a row of its own and ours is made alike."""
    part = r["parts"][0]
    parameter = BY_ID[part["effect"]].parameter
    if parameter is None:
        return None
    for c in r["result"]["causes"]:
        if c["effects"] == [part["effect"]] and parameter in c["parameters"] and c["probability"] > 0.05:
            return c["parameters"][parameter]
    return None


def _size_error(r: Row) -> float:
    found = _found(r)
    if found is None:
        return float("nan")
    return abs(found["value"] - found["neutral"] - r["parts"][0]["size"]) / abs(r["parts"][0]["size"])


def _covered(r: Row) -> float:
    found = _found(r)
    if found is None:
        return float("nan")
    return float(abs(found["value"] - found["neutral"] - r["parts"][0]["size"]) <= 1.645 * found["sd"])


def _delay(r: Row) -> float:
    value = r["result"].get("detected_after_km")
    return float("nan") if value is None else float(value)


def _recovered(r: Row) -> tuple[float, float]:
    """(before - after, before - oracle), in shares of before; the oracle is the true effect, refitted."""
    s = r["result"]["shrinkage"]
    oracle = r["result"]["after_by_effect"].get(_truth(r))
    if oracle is None or not s["before"]:
        return float("nan"), float("nan")
    return (s["before"] - s["after"]) / s["before"], (s["before"] - oracle) / s["before"]


def _generic_recovered(r: Row) -> tuple[float, float]:
    s = r["result"]["shrinkage"]
    if s["generic"] is None or not s["before"]:
        return float("nan"), float("nan")
    return (s["before"] - s["generic"]) / s["before"], (s["before"] - s["floor"]) / s["before"]


def _both_named(r: Row) -> float:
    first = next((e for e in _ranked(r) if e not in (["none"], ["outside_catalogue"])), [])
    want = [p["effect"] for p in r["parts"]]
    return float(len(first) == 2 and all(any(same_class(w, f) for f in first) for w in want))


def _regime_tv(r: Row) -> float:
    """Total variation between the regimes that the answer names and those where the effect is loud."""
    want = r.get("regimes")
    rows = r["result"]["where"]
    if not want or not rows or r["result"]["verdict"] == "no_gap":
        return float("nan")
    total = sum(w["share"] for w in rows)
    have: dict[str, float] = {}
    for w in rows:
        have[w["regime"]] = have.get(w["regime"], 0.0) + w["share"] / total
    if "first_600_s" in have:
        return abs(r["early"] - have["first_600_s"])
    return 0.5 * sum(abs(have.get(k, 0.0) - want.get(k, 0.0)) for k in {*have, *want})


# --- over cases ---


def _bootstrap(values: Any, statistic: Callable[[Any], float]) -> dict[str, Any]:
    n = len(values)
    if n == 0:
        return {"value": None, "ci95": None, "n": 0}
    rng = np.random.default_rng(0)
    draws = [statistic(values[rng.integers(n, size=n)]) for _ in range(1000)]
    low, high = np.nanpercentile(draws, [2.5, 97.5])
    return {"value": float(statistic(values)), "ci95": [float(low), float(high)], "n": n}


def _clean(rows: Sequence[Row], of: Callable[[Row], float]) -> Any:
    values = np.array([float(of(r)) for r in rows])
    return values[np.isfinite(values)]


def _mean(rows: Sequence[Row], of: Callable[[Row], float]) -> dict[str, Any]:
    values = _clean(rows, of)
    out = _bootstrap(values, lambda x: float(np.mean(x)))
    if len(values) and set(np.unique(values)) <= {0.0, 1.0}:
        out["ci95"] = _wilson(float(values.mean()), len(values))
    return out


def _wilson(p: float, n: int) -> list[float]:
    """95 % interval of a share; a bootstrap of a share of 0 or 1 would have no width."""
    z = 1.96
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return [float(max(0.0, middle - half)), float(min(1.0, middle + half))]


def _median(rows: Sequence[Row], of: Callable[[Row], float]) -> dict[str, Any]:
    return _bootstrap(_clean(rows, of), lambda x: float(np.median(x)))


def _macro(rows: Sequence[Row], of: Callable[[Row], float]) -> dict[str, Any]:
    """Mean over effects of the mean over each effect's cases."""
    names = np.array([_truth(r) for r in rows])
    values = np.array([float(of(r)) for r in rows])

    def statistic(index: Any) -> float:
        return float(np.mean([values[index][names[index] == n].mean() for n in np.unique(names[index])]))

    return _bootstrap(np.arange(len(rows)), statistic)


def _ratio(rows: Sequence[Row], of: Callable[[Row], tuple[float, float]]) -> dict[str, Any]:
    """Sum over sum: a case with next to nothing to recover weighs next to nothing."""
    values = np.array([of(r) for r in rows]).reshape(-1, 2)
    values = values[np.isfinite(values).all(axis=1)]
    return _bootstrap(values, lambda x: float(x[:, 0].sum() / max(x[:, 1].sum(), 1e-12)))


def _auroc(known: Sequence[Row], hidden: Sequence[Row]) -> dict[str, Any]:
    """How well the probability of "outside the catalogue" tells hidden cases from known ones."""
    p = np.array([_of(r, lambda e: e == ["outside_catalogue"]) for r in (*known, *hidden)])
    label = np.array([0] * len(known) + [1] * len(hidden))

    def statistic(index: Any) -> float:
        a, b = p[index][label[index] == 1], p[index][label[index] == 0]
        if not len(a) or not len(b):
            return float("nan")
        return float(np.mean((a[:, None] > b[None, :]) + 0.5 * (a[:, None] == b[None, :])))

    return _bootstrap(np.arange(len(p)), statistic)


def _ece(rows: Sequence[Row]) -> dict[str, Any]:
    """Expected calibration error of the first class' probability, ten bins."""
    first = [_groups(r)[0] for r in rows]
    p = np.array([q for q, _ in first])
    right = np.array([_right(r, e) for r, (_, e) in zip(rows, first, strict=True)], float)

    def statistic(index: Any) -> float:
        q, y = p[index], right[index]
        which = np.minimum((q * 10).astype(int), 9)
        return float(sum(abs(q[which == b].sum() - y[which == b].sum()) for b in range(10)) / len(q))

    return _bootstrap(np.arange(len(p)), statistic)


def _confusion(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """True effects (or kind) against the first answer."""
    table: dict[str, dict[str, int]] = {}
    for r in rows:
        truth = "+".join(sorted(p["effect"] for p in r["parts"])) or r["kind"]
        answer = "+".join(sorted(_ranked(r)[0])) if r["result"]["verdict"] != "no_gap" else "none"
        row = table.setdefault(truth, {})
        row[answer] = row.get(answer, 0) + 1
    return table


def _curves(rows: Sequence[Row]) -> dict[str, Any]:
    """Detection and naming over strength, and where they reach 50 and 80 %."""
    single = [r for r in rows if r["kind"] in ("single", "sensor")]
    strengths = sorted({r["parts"][0]["strength"] for r in single})
    detected, named = [], []
    for s in strengths:
        at = [r for r in single if r["parts"][0]["strength"] == s]
        detected.append(float(np.mean([_detected(r) for r in at])))
        named.append(float(np.mean([_top(r, 1) for r in at])))
    return {
        "strength": strengths, "detection": detected, "naming": named,
        "detection_50": _crossing(strengths, detected, 0.5), "naming_80": _crossing(strengths, named, 0.8),
    }  # fmt: skip


def _crossing(x: Sequence[float], y: Sequence[float], level: float) -> float | None:
    for i in range(len(x)):
        if y[i] >= level:
            if i == 0 or y[i] == y[i - 1]:
                return float(x[i])
            share = (level - y[i - 1]) / (y[i] - y[i - 1])
            return float(x[i - 1] + share * (x[i] - x[i - 1]))
    return None


def _controls(known: Sequence[Row]) -> dict[str, Any]:
    """What the scores would be if the answers had nothing to do with the truth."""
    if not known:
        return {}
    rng = np.random.default_rng(1)
    permuted = []
    for _ in range(20):
        order = rng.permutation(len(known))
        permuted += [r | {"parts": known[j]["parts"]} for r, j in zip(known, order, strict=True)]
    shuffled = [r["result"]["control"]["shuffled_none"] for r in known if "control" in r["result"]]
    foreign = [r["result"]["control"]["other_trip_explained"] for r in known if "control" in r["result"]]
    return {
        "permuted_key_top1": _mean(permuted, lambda r: _top(r, 1)),
        "permuted_key_probability": _mean(permuted, probability_of_truth),
        "shuffled_regressors_gain": _bootstrap(np.array(shuffled), lambda x: float(np.mean(x))),
        "other_trips_effect_gain": _bootstrap(np.array(foreign), lambda x: float(np.mean(x))),
    }
