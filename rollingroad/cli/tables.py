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


def map_table(found: Mapping[str, Any]) -> None:
    """Print what a map is worth."""
    out = console()
    share = f"{found['fuel_share']:.0%} of the fuel"
    out.print(f"{found['cells']} valid cells hold {share}; fit {found['fit']}, R2 {found['r2']:.4f}")
    if found["rmse"] is not None:
        out.print(
            f"off by {100 * found['rmse']:.2f} points rms, the fit by {100 * found['fit_rmse']:.2f}, "
            f"its peak by {100 * found['peak_value_error']:+.2f}"
        )


def cycle_table(account: Mapping[str, Any]) -> None:
    """Print a drive cycle's fuel and energy account."""
    out = console()
    table = Table(title=f"{account['cycle']} · {account['car']}", show_header=True)
    table.add_column("where the fuel went")
    table.add_column("MJ", justify="right")
    table.add_column("share", justify="right")
    for name, joules in sorted(account["account_J"].items(), key=lambda item: -abs(item[1])):
        table.add_row(name.replace("_", " "), f"{joules / 1e6:.3f}", f"{joules / account['fuel_J']:+.1%}")
    table.add_section()
    table.add_row("fuel", f"{account['fuel_J'] / 1e6:.3f}", f"{account['fuel_l_per_100km']:.2f} l/100 km")
    out.print(table)
    out.print(
        f"{account['distance_m'] / 1000:.2f} km in {_minutes(account['time_s'])}; the account closes to "
        f"{abs(account['account_error']):.0e} of the fuel"
    )


def dyno_table(found: Mapping[str, Any]) -> None:
    """Print the dynamometer's map: efficiency in percent, every 500 rpm."""
    out = console()
    table = Table(title=f"{found['car']} on the dynamometer, gear {found['gear']}: efficiency, fuel to wheel, %")
    table.add_column("rpm", justify="right")
    # Every second torque and every fifth speed: what fits a terminal. The whole table is in --json.
    for torque in found["torque_N_m"][::2]:
        table.add_column(f"{torque:.0f} Nm", justify="right")
    for rpm, row in list(zip(found["rpm"], found["efficiency"], strict=True))[::5]:
        table.add_row(f"{rpm:.0f}", *("" if value is None else f"{100 * value:.1f}" for value in row[::2]))
    out.print(table)
    peak = found["peak"]
    out.print(f"best: {100 * peak['efficiency']:.1f} % at {peak['rpm']:.0f} rpm and {peak['torque_N_m']:.0f} Nm")


def solve_table(result: Mapping[str, Any]) -> None:
    """Print the answers to a case of optimal control."""
    out = console()
    table = Table(title=result["case"])
    for name in ("method", "fuel, kJ", "time, s", "shifts at, rpm", "drift of H", "gap", "took", ""):
        table.add_column(name, no_wrap=name in ("method", "took"))
    for row in result["solutions"]:
        proof = row["certificate"]
        table.add_row(
            row["method"],
            "–" if row["J"] is None else f"{row['J'] / 1e3:.2f}",
            "–" if row["time_s"] is None else f"{row['time_s']:.3f}",
            " ".join(f"{shift['engine_speed'] * 30 / 3.14159265:.0f}" for shift in row["shifts"]),
            "–" if proof.get("hamiltonian_drift") is None else f"{proof['hamiltonian_drift']:.1e}",
            "–" if proof.get("maximum_gap") is None else f"{proof['maximum_gap']:.0e}",
            f"{1e3 * row['wall_s']:.1f} ms",
            "" if proof["refused"] is None else f"refused: {proof['refused']}",
        )
    out.print(table)
    for row in result["solutions"]:
        if row.get("notes"):
            notes = ", ".join(f"{name.replace('_', ' ')} {_flat(value)}" for name, value in row["notes"].items())
            out.print(f"{row['method']}: {notes}", soft_wrap=True)


def scenario_table(found: Mapping[str, Any]) -> None:
    """Print what there is to drive."""
    out = console()
    table = Table(show_header=False)
    for name, title in found["scenarios"].items():
        table.add_row(name, title)
    table.add_section()
    for name, where in found["cities"].items():
        table.add_row(name, where)
    table.add_section()
    table.add_row("cars", ", ".join(found["cars"]))
    out.print(table)


def inspect_table(reports: Mapping[str, Any]) -> None:
    """Print what each log holds."""
    out = console()
    for report in reports["logs"]:
        table = Table(title=report["name"] or "log")
        for name in ("stream", "count", "rate, Hz", "longest gap, s", "gaps"):
            table.add_column(name, justify="left" if name == "stream" else "right")
        for name, stream in report["streams"].items():
            table.add_row(
                name, *(f"{stream[key]:.4g}" for key in ("count", "rate", "longest_gap", "gaps") if key in stream)
            )
        out.print(table)
        for part in ("receivers", "accelerometer", "clock", "damage", "not_found"):
            if report[part]:
                out.print(f"{part.replace('_', ' ')}: {_flat(report[part])}", soft_wrap=True)


def _flat(value: Any) -> str:
    if isinstance(value, Mapping):
        if set(value) >= {"value", "sd"}:
            return f"{value['value']:.4g} ± {value['sd']:.2g}"
        return ", ".join(f"{key.replace('_', ' ')} {_flat(item)}" for key, item in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def diagnosis_table(result: Mapping[str, Any]) -> None:
    """Print a diagnosis: the verdict, where, which, how far."""
    out = console()
    trips = result["trips"]
    out.print(
        f"verdict: {result['verdict'].replace('_', ' ')}  ({trips['diagnosed']} trips, {trips['reference']} reference)"
    )
    where = Table(title="where")
    for name in ("subsystem", "channel", "regime", "share", "p"):
        where.add_column(name)
    for place in result["where"][:6]:
        words = (place["subsystem"], place["channel"], place["regime"])
        where.add_row(*(str(word) for word in words), f"{place['share']:.0%}", f"{place['p_value']:.1g}")
    causes = Table(title="which")
    for name in ("cause", "probability", "cannot be told from", "separated by"):
        causes.add_column(name)
    for cause in result["causes"][:6]:
        causes.add_row(
            " + ".join(cause["effects"]),
            f"{cause['probability']:.1%}",
            ", ".join(effect for effect in cause["class"] if effect not in cause["effects"]),
            "; ".join(cause["separated_by"]),
        )
    for table in (where, causes):
        if table.row_count:
            out.print(table)
    shrinkage = result["shrinkage"]
    if shrinkage["recovered"] is not None:
        interval = shrinkage["ci95"]
        told = f" (95 %: {interval[0]:.0%} to {interval[1]:.0%})" if interval else " (in sample)"
        out.print(f"how far: {shrinkage['recovered']:.0%} of the gap in {shrinkage['channel']} recovered{told}")
    for missing in result["not_testable"]:
        out.print(f"not testable: {missing['effect']}, {missing['because']}", soft_wrap=True)


def score_table(scores: Mapping[str, Any]) -> None:
    """Print a blind set's scores with their intervals."""
    table = Table()
    for name in ("score", "value", "95 %"):
        table.add_column(name)
    for name, entry in scores.items():
        if isinstance(entry, Mapping) and "value" in entry and entry["value"] is not None:
            ends = entry.get("ci95")
            told = f"{ends[0]:.3f} to {ends[1]:.3f}" if ends and None not in ends else "–"
            table.add_row(name.replace("_", " "), f"{entry['value']:.3f}", told)
    console().print(table)
