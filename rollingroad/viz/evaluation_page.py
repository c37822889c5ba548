"""evaluation.html: what each advisor saved, how surely, and where the rest of what could be saved went."""

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from rollingroad.viz import charts
from rollingroad.viz.charts import Bars, Chart, Panel, Span, Whiskers
from rollingroad.viz.page import write_page
from rollingroad.viz.report import NONE, interval, number, scaled

Row = Mapping[str, Any]
_ADVISORS = (charts.VERMILION, charts.BLUE, charts.GREEN, charts.ORANGE, charts.PURPLE, charts.SKY_BLUE)
_LOSSES = {
    "estimation": charts.ORANGE,
    "fit": charts.YELLOW,
    "optimiser": charts.GREEN,
    "driver": charts.BLUE,
    "traffic": charts.GREY,
}


def write_evaluation(found: Mapping[str, Any], path: Path) -> None:
    """Write the page of `found` (the object of `evaluate --json`) to `path`: one self-contained file."""
    rows = found["rows"]
    made = [_savings(rows), *_losses(rows)] if rows else []
    facts = {
        "answer": _answer(rows),
        "tiles": _tiles(rows),
        "savings": [_saving(row) for row in rows],
        "safety": [_safety(row) for row in rows],
        "losses": [_loss(row) for row in rows if row["regret"] is not None],
        "failed": [_failure(entry) for entry in found["failed"]],
        "notes": _notes(rows),
        "version": version("rollingroad"),
    }
    write_page("evaluation.html.j2", made, facts, path)


def _name(row: Row) -> str:
    return f"{row['scenario']}, {row['car']}, {row['baseline']}"


def _fair(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row["fair_saving_percent"] is not None]


def _answer(rows: Sequence[Row]) -> str:
    fair = _fair(rows)
    if not fair:
        return "No row has a saving at equal mean trip time: the reasons stand below."
    said = []
    for advisor in dict.fromkeys(row["advisor"] for row in fair):
        mine = [row for row in fair if row["advisor"] == advisor]
        values = [row["fair_saving_percent"] for row in mine]
        sure = sum(row["ci95"] is not None and row["ci95"][0] > 0.0 for row in mine)
        span = f"{number(min(values), 1, '')} to {number(max(values), 1, '%')}" if len(values) > 1 else ""
        told = f"a median of {number(float(np.median(values)), 1, '%')} ({span})" if span else number(values[0], 1, "%")
        of = f"{sure} of {len(mine)} {'rows' if len(mine) > 1 else 'row'}"
        said.append(f"{advisor} saves {told} of the fuel at equal mean trip time; above nought with 95 % in {of}")
    return ". ".join(said) + "."


def _tiles(rows: Sequence[Row]) -> list[dict[str, str]]:
    fair = _fair(rows)
    worst = max((abs(row["time_difference_percent"]) for row in fair), default=None)
    seeds = [row["seeds"] for row in rows]
    beyond = sum(row["limit_violations"] or 0 for row in rows)
    closest = min((row["min_time_to_collision_s"] for row in rows if row["min_time_to_collision_s"] is not None),
                  default=None)  # fmt: skip
    return [
        {"name": "rows with a fair saving", "value": f"{len(fair)} of {len(rows)}", "note": "exact"},
        {"name": "seeds a row", "value": " to ".join(map(str, sorted({min(seeds, default=0), max(seeds, default=0)}))),
         "note": "paired: the same traffic with and without advice"},
        {"name": "mean trip times differ by", "value": number(worst, 2, "%"), "note": "at most; 1 % is asked"},
        {"name": "beyond the limit", "value": number(beyond, 0, ""), "note": "times more than the baseline drivers"},
        {"name": "least time to collision", "value": number(closest, 1, "s"), "note": "of all advised drives"},
    ]  # fmt: skip


def _savings(rows: Sequence[Row]) -> Chart:
    """One line a row, one colour an advisor, with the interval over seeds."""
    names = tuple(f"{_name(row)}: {row['advisor']}" for row in rows)
    marks = []
    advisors = dict.fromkeys(row["advisor"] for row in rows)
    for i, advisor in enumerate(advisors):
        mine = [row["advisor"] == advisor for row in rows]
        column = [_known(row["fair_saving_percent"]) if of else np.nan for row, of in zip(rows, mine, strict=True)]
        ends = [row["ci95"] or (np.nan, np.nan) for row in rows]
        low, high = np.array(ends, float).T
        colour = _ADVISORS[i % len(_ADVISORS)]
        marks.append(Whiskers(names, np.array(column, float), low, high, advisor, colour))
    return Chart(
        "savings",
        "Saved at equal mean trip time",
        "Share of the baseline driver's fuel; bars: 95 % intervals of the mean over paired seeds (Student). Rows "
        "without a point have no fair figure.",
        (Panel("", (Span(-0.05, 0.05, ""), *marks), x_label="saved (%)"),),
        height=130 + 34 * len(names),
    )


def _losses(rows: Sequence[Row]) -> list[Chart]:
    """What lies between advised and oracle; nothing where no row has it."""
    known = [row for row in rows if row["regret"] is not None and row["advisor"] != "oracle"]
    if not known:
        return []
    names = tuple(f"{_name(row)}: {row['advisor']}" for row in known)
    bars = tuple(
        Bars(names, np.array([row["regret"][part] for row in known], float), part, colour)
        for part, colour in _LOSSES.items()
    )
    return [
        Chart(
            "losses",
            "Lost to the oracle",
            "Advised minus oracle, in per cent of the baseline's fuel, by what it comes from: map samples "
            "(estimation), smooth form (fit), planner (optimiser), a driver who follows imperfectly, and "
            "traffic, which is what is left and may be a gain.",
            (Panel("", bars, x_label="lost (% of the baseline's fuel)"),),
            height=150 + 34 * len(names),
        )
    ]


def _known(value: float | None) -> float:
    return float("nan") if value is None else value


def _saving(row: Row) -> list[str]:
    return [
        _name(row),
        row["advisor"],
        str(row["seeds"]),
        number(row["fair_saving_percent"], 2, "%", sign=True),
        interval(row["ci95"], 2, "%"),
        number(row["naive_saving_percent"], 2, "%", sign=True),
        number(row["oracle_saving_percent"], 2, "%", sign=True),
        number(scaled(row["oracle_fraction"], 100.0), 0, "%"),
        number(row["time_difference_percent"], 2, "%", sign=True),
    ]


def _safety(row: Row) -> list[str]:
    more = row.get("safety") or {}
    return [
        _name(row),
        row["advisor"],
        number(row["limit_violations"], 0, ""),
        number(row["min_time_to_collision_s"], 1, "s"),
        number(more.get("baseline_min_time_to_collision_s"), 1, "s"),
        *(number(more.get(key), 0, "") for key in ("harsh_braking", "collisions", "red_lights_run")),
    ]


def _loss(row: Row) -> list[str]:
    parts = [row["regret"][name] for name in _LOSSES]
    return [_name(row), row["advisor"], *(number(part, 2, "%", sign=True) for part in (*parts, sum(parts)))]


def _failure(entry: Mapping[str, Any]) -> str:
    where = ", ".join(f"{key} {value}" for key, value in entry.items() if key not in ("error", "log"))
    return f"{where}: {entry.get('error', NONE)}"


def _notes(rows: Sequence[Row]) -> list[str]:
    return [
        f"{_name(row)}, {row['advisor']}: the baseline's own time lies beyond all drives of seeds "
        f"{', '.join(map(str, row['seeds_not_bracketed']))}; they count in the means"
        for row in rows
        if row.get("seeds_not_bracketed")
    ]
