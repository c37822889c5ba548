"""Tables of what was judged."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from rollingroad.cli.output import console
from rollingroad.evaluation.learning import Lesson
from rollingroad.evaluation.regress import Difference


def bench_table(found: Mapping[str, Any]) -> None:
    """Print each figure beside its reference."""
    table = Table(title="each beside its reference, measured in the same process")
    for name in ("benchmark", "value", "unit", "reference", "its value", "times faster"):
        table.add_column(name, justify="right" if name in ("value", "its value", "times faster") else "left")
    for row in found["benchmarks"]:
        table.add_row(
            row["name"].replace("_", " "),
            f"{row['value']:.4g}",
            row["unit"].replace("_", " "),
            row["reference"],
            f"{row['reference_value']:.4g}",
            "" if row["ratio"] is None else f"{row['ratio']:.3g}",
        )
    console().print(table)


def learning_table(lessons: Sequence[Lesson]) -> None:
    """Print what the map costs after each trip."""
    table = Table(title="lost to the map on the empty road, % of the fuel of the plan by the true map")
    for name in ("trips", "fuel mapped, %", "estimation", "fit", "both", "l/100 km as driven"):
        table.add_column(name, justify="right")
    for lesson in lessons:
        table.add_row(
            str(lesson.trips),
            f"{100.0 * lesson.fuel_share:.0f}",
            f"{lesson.estimation:+.2f}",
            f"{lesson.fit:+.2f}",
            f"{lesson.regret:+.2f}",
            f"{lesson.litres_per_100km:.2f}",
        )
    console().print(table)


def evaluate_table(found: Mapping[str, Any], page: Path) -> None:
    """Print what each advisor saved, where the rest of what could be saved went, and where the `page` is."""
    out = console()
    savings = Table(title="saved at equal mean trip time, % of the baseline's fuel")
    losses = Table(title="lost to the oracle, % of the baseline's fuel")
    for table in (savings, losses):
        for name in ("scenario", "car", "advisor", "baseline"):
            table.add_column(name)
    for name in ("seeds", "saved", "95 %", "naive", "oracle", "over limit", "TTC, s"):
        savings.add_column(name, justify="right")
    for name in ("fit", "estimation", "optimiser", "driver", "traffic", "sum"):
        losses.add_column(name, justify="right")
    for row in found["rows"]:
        span, regret, ttc = row["ci95"], row["regret"], row["min_time_to_collision_s"]
        which = [row[name] for name in ("scenario", "car", "advisor", "baseline")]
        savings.add_row(
            *which,
            str(row["seeds"]),
            _signed(row["fair_saving_percent"]),
            "" if span is None else f"{span[0]:+.1f} {span[1]:+.1f}",
            _signed(row["naive_saving_percent"]),
            _signed(row["oracle_saving_percent"]),
            "–" if row["limit_violations"] is None else str(row["limit_violations"]),
            "–" if ttc is None else f"{ttc:.1f}",
        )
        if regret is not None:
            losses.add_row(*which, *(_signed(value) for value in regret.values()), _signed(sum(regret.values())))
    out.print(savings)
    if losses.row_count:
        out.print(losses)
    for entry in found["failed"]:
        out.print("failed: " + ", ".join(f"{k} {v}" for k, v in entry.items() if k != "log"), soft_wrap=True)
    out.print(f"as a page: {page}", soft_wrap=True)


def _signed(value: float | None) -> str:
    return "–" if value is None else f"{value:+.2f}"


def regress_table(rows: Sequence[Difference], scenarios: int, kept: Path) -> None:
    """Print each metric that moved by more than a tenth of its tolerance, worst first, and where recordings are."""
    out = console()
    table = Table(title=f"{scenarios} scenarios against their baselines")
    for name in ("scenario", "metric", "was", "is", "moved", "tolerance", ""):
        table.add_column(name, justify="left" if name in ("scenario", "metric", "") else "right")
    shown = [row for row in rows if row.fell_short or _moved(row) > 0.1]
    for row in sorted(shown, key=lambda row: (not row.fell_short, -_moved(row))):
        table.add_row(
            row.scenario,
            row.metric,
            *("–" if value is None else f"{value:.4g}" for value in (row.was, row.now)),
            "–" if row.was is None or row.now is None else f"{row.now - row.was:+.2g}",
            "–" if row.tolerance is None else f"{row.tolerance:.2g}",
            "fell short" if row.fell_short else "",
        )
    if shown:
        out.print(table)
    short = sorted({row.scenario for row in rows if row.fell_short})
    out.print(
        f"{scenarios} scenarios, {len(rows)} metrics: "
        + (f"{len(short)} fell short; their runs are in {kept}" if short else "none fell short")
    )


def _moved(row: Difference) -> float:
    """How far a metric moved, in tolerances."""
    if row.was is None or row.now is None or row.was == row.now:
        return 0.0
    return abs(row.now - row.was) / row.tolerance if row.tolerance else float("inf")


def sweep_table(found: Mapping[str, Any], kept: Path) -> None:
    """Print each point with the numbers that its command gave at the top level."""
    out = console()
    rows = found["rows"]
    keys = list(rows[0]["settings"]) if rows else []
    figures = [k for k, v in rows[0]["output"].items() if isinstance(v, int | float) and k != "seed"] if rows else []
    table = Table(title=f"{found['command']}: {len(rows)} points")
    for name in (*keys, *figures):
        table.add_column(name, justify="right")
    for row in rows:
        values = [row["output"].get(name) for name in figures]
        table.add_row(
            *(str(row["settings"][key]) for key in keys),
            *(f"{value:.5g}" if isinstance(value, int | float) else "–" for value in values),
        )
    out.print(table)
    for entry in found["failed"]:
        out.print(f"failed at {entry['settings']}: {entry['error']}", soft_wrap=True)
    out.print(f"everything: {kept}")
