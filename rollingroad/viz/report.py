"""report.html: one run on one page; the first screen answers the question."""

import math
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rollingroad.run import Run
from rollingroad.viz.page import write_page
from rollingroad.viz.views import run_charts

NONE = "—"


def write_report(run: Run, path: Path) -> None:
    """Write the report of `run` to `path`: one self-contained file, written aside and renamed."""
    facts = {
        "r": run.results,
        "answer": _answer(run),
        "tiles": _tiles(run.results),
        "comparison": _comparison(run),
        "figures_table": _figures(run.results),
        "damage": _damage(run),
        "version": f" {version('rollingroad')}",
        "files": "run.rrd (rollingroad view), trip.kml, truth.parquet, estimate.parquet, map.parquet, advice.parquet",
    }
    write_page("run.html.j2", run_charts(run), facts, path)


def _answer(run: Run) -> str:
    r = run.results
    base, saving = r["baseline"], r["saving_percent"]
    drive = f"{r['distance_m'] / 1e3:.1f} km in {minutes(base['time_s'])}"
    start = f"{drive}. The baseline driver burnt {_fuel(run, base['fuel_J'])}"
    if saving is None:
        return (
            f"{start}. No drive with advice could be brought to the same trip time, so there is no fair saving to give."
        )
    verb = "saves" if saving >= 0 else "costs"
    advised = _fuel(run, r["advised"]["fuel_J"])
    return (
        f"{start}, the advised driver {advised}: at equal trip time the advice {verb} {abs(saving):.1f} % of the fuel."
    )


def _tiles(r: Mapping[str, Any]) -> list[dict[str, str]]:
    fair = number(r["saving_percent"], 1, "%", sign=True)
    return [
        {"name": "saved at equal time", "value": fair,
         "note": interval(r["saving_ci95"], 1, "%", "one pair of drives")},
        {"name": "oracle", "value": number(r["oracle_saving_percent"], 1, "%", sign=True),
         "note": "plan on the true map, followed perfectly"},
        {"name": "naive figure, not a saving", "value": number(r["naive_saving_percent"], 1, "%", sign=True),
         "note": "trip time ignored"},
        {"name": "error of the map found", "value": number(scaled(r["map"]["rmse"], 100), 2, "points"),
         "note": f"rms over cells with {number(scaled(r['map']['fuel_share'], 100), 0, '%')} of the fuel"},
    ]  # fmt: skip


def _comparison(run: Run) -> list[tuple[str, str, str, str]]:
    r = run.results
    base, adv = r["baseline"], r["advised"]
    km = r["distance_m"] / 1e3
    litre = run.car.fuel.density * run.car.fuel.heating_value / 1e3

    def row(name: str, a: float | None, b: float | None, digits: int) -> tuple[str, str, str, str]:
        difference = None if a is None or b is None else b - a
        return name, number(a, digits, ""), number(b, digits, ""), number(difference, digits, "", sign=True)

    fuels, times = (base["fuel_J"], adv["fuel_J"]), (base["time_s"], adv["time_s"])
    return [
        row("fuel (MJ)", *(scaled(fuel, 1e-6) for fuel in fuels), 2),
        row("fuel (l/100 km)", *(scaled(fuel, 100 / litre / km) for fuel in fuels), 2),
        row("trip time (s)", *times, 1),
    ]


def _figures(r: Mapping[str, Any]) -> list[dict[str, str]]:
    o, m, w = r["observer"], r["map"], r["wall_s"]
    share = scaled(o["thrust_rmse_N"], 100 / o["thrust_rms_N"]) if o["thrust_rms_N"] else None
    smooth = scaled(o["thrust_rmse_smoothed_N"], 100 / o["thrust_rms_N"]) if o["thrust_rms_N"] else None

    def row(name: str, value: str, interval: str = NONE) -> dict[str, str]:
        return {"name": name, "value": value, "interval": interval}

    return [
        row("thrust error, filter", f"{number(o['thrust_rmse_N'], 1, 'N')} ({number(share, 1, '%')} of rms)"),
        row(
            "thrust error, smoother", f"{number(o['thrust_rmse_smoothed_N'], 1, 'N')} ({number(smooth, 1, '%')} of rms)"
        ),
        row("momentary efficiency error, filter", number(scaled(o["efficiency_rmse"], 100), 2, "points")),
        row("mean NIS per degree of freedom", number(o["nis_mean_per_dof"], 2, "")),
        row("GPS outage", number(o["gps_outage_s"], 0, "s"), "exact"),
        row("measurements", number(o["events"], 0, ""), "exact"),
        row("one measurement takes", number(o["microseconds_per_event"], 2, "µs")),
        row("map error over valid cells", number(scaled(m["rmse"], 100), 2, "points")),
        row("fuel burnt in valid cells", number(scaled(m["fuel_share"], 100), 0, "%"), "exact"),
        row("valid cells", number(m["cells"], 0, ""), "exact"),
        row(f"fit {m['fit']}: R²", number(m["r2"], 3, "")),
        row(f"fit {m['fit']}: error against truth", number(scaled(m["fit_rmse"], 100), 2, "points")),
        row("value at the found peak", number(scaled(m["peak_value_error"], 100), 2, "points", sign=True)),
        row("vehicles in the network", number(r["vehicles"], 0, ""), "exact"),
        row(
            "computing: drive / observe / plan / all",
            " / ".join(number(w[k], 1, "s") for k in ("drive", "observe", "plan", "total")),
        ),
        row("simulated over computing time", number(r["real_time_factor"], 0, "×")),
    ]


def _damage(run: Run) -> str:
    lost = {kind: count for kind, count in run.log.damage.items() if count}
    if not lost:
        return "Nothing: every packet of log.dat passed its check."
    return (
        "Read around, and counted: "
        + ", ".join(f"{kind.replace('_', ' ')} {count:,}" for kind, count in sorted(lost.items()))
        + "."
    )


def _fuel(run: Run, joules: float | None) -> str:
    if joules is None:
        return NONE
    fuel = run.car.fuel
    litres = joules / (fuel.heating_value * fuel.density) * 1e3
    return f"{litres:.3f} l ({litres / run.results['distance_m'] * 1e5:.2f} l/100 km)"


def minutes(seconds: float) -> str:
    """ "14 min 32 s"."""
    whole = round(seconds)
    return f"{whole // 60} min {whole % 60:02d} s"


def scaled(value: float | None, factor: float) -> float | None:
    """`value` times `factor`; None stays None."""
    return None if value is None else value * factor


def number(value: float | None, digits: int, unit: str, *, sign: bool = False) -> str:
    """A number with its unit, a dash for None and NaN."""
    if value is None or not math.isfinite(value):
        return NONE
    return f"{value:{'+' if sign else ''},.{digits}f} {unit}".strip().replace("-", "−")


def interval(ends: tuple[float, float] | list[float] | None, digits: int, unit: str, otherwise: str) -> str:
    """A 95 % interval, or `otherwise` where there is none."""
    return otherwise if ends is None else f"95 %: {ends[0]:.{digits}f} to {ends[1]:.{digits}f} {unit}".replace("-", "−")
