"""Tables for people."""

from collections.abc import Mapping
from typing import Any

from rich.table import Table

from rollingroad.cli.output import console

LITRE = 745.0e-3 * 43.0e6
"""J in a litre of petrol (CLI.md, "Car file")."""


def _percent(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{value:+.{digits}f} %"


def _minutes(seconds: float) -> str:
    return f"{int(seconds // 60)} min {seconds % 60:04.1f} s"


def _consumption(fuel: float | None, distance: float) -> str:
    if fuel is None:
        return "no drives bracket the baseline's time"
    return f"{fuel / LITRE:.3f} l   ({fuel / LITRE / distance * 1e5:.2f} l/100 km)"


def run_table(results: Mapping[str, Any]) -> None:
    """Print what a run found: a table that needs no manual."""
    distance = results["distance_m"]
    observer, found = results["observer"], results["map"]
    out = console()
    table = Table(title=f"{results['scenario']} · {results['car']} · seed {results['seed']}", show_header=False)
    table.add_column(style="bold")
    table.add_column()
    table.add_row("distance", f"{distance / 1000:.2f} km, {results['vehicles']} vehicles around")
    table.add_row("time", _minutes(results["baseline"]["time_s"]) + " (baseline driver)")
    table.add_row("fuel, baseline driver", _consumption(results["baseline"]["fuel_J"], distance))
    table.add_row("fuel, advised driver", _consumption(results["advised"]["fuel_J"], distance) + " at the same time")
    table.add_section()
    table.add_row("saved at equal trip time", _percent(results["saving_percent"]))
    table.add_row("  naive figure, time ignored", _percent(results["naive_saving_percent"]))
    table.add_row("  oracle: true map, perfect driver", _percent(results["oracle_saving_percent"]))
    table.add_section()
    rms = observer["thrust_rms_N"]
    table.add_row(
        "thrust error",
        f"{observer['thrust_rmse_N'] / rms:.1%} of {rms:.0f} N rms live, "
        f"{observer['thrust_rmse_smoothed_N'] / rms:.1%} smoothed ({observer['gps_outage_s']:.0f} s without GPS)",
    )
    table.add_row(
        "efficiency map",
        f"off by {100 * found['rmse']:.2f} points over {found['cells']} cells that hold "
        f"{found['fuel_share']:.0%} of the fuel; fit {found['fit']}: {100 * found['fit_rmse']:.2f} points"
        if found["cells"] and found["rmse"] is not None
        else "no valid cell yet: drive longer",
    )
    table.add_section()
    wall = results["wall_s"]["total"]
    table.add_row("took", f"{wall:.0f} s, {results['real_time_factor']:.0f} times real time")
    for name, path in results["files"].items():
        table.add_row(name, str(path))
    out.print(table)
