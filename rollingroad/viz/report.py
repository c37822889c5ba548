"""report.html: one run on one page; the first screen answers the question."""

import math
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rollingroad.run import Run
from rollingroad.viz.intervals import Interval, RunIntervals, run_intervals
from rollingroad.viz.page import write_page
from rollingroad.viz.views import run_charts

NONE, EXACT, ONCE = "—", "exact", "measured once"


def write_report(run: Run, path: Path) -> None:
    """Write the report of `run` to `path`: one self-contained file, written aside and renamed."""
    r = run.results
    intervals = run_intervals(run, int(r["seed"] or 0))
    facts = {
        "r": r,
        "answer": _answer(run),
        "tiles": _tiles(r, intervals),
        "comparison": _comparison(run),
        "figures_table": _figures(r, intervals),
        "settings": ", ".join(f"{key} = {value:g}" for key, value in (r.get("settings") or {}).items()),
        "notes": list(r.get("notes") or []),
        "fits": [(fit.name, number(fit.r2, 3, "")) for fit in sorted(run.fits.values(), key=lambda fit: fit.name)],
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


def _tiles(r: Mapping[str, Any], intervals: RunIntervals) -> list[dict[str, str]]:
    share = number(scaled(r["map"]["fuel_share"], 100), 0, "%")
    error = interval(_times(intervals.map_rmse, 100), 2, "")
    alone = "no drives bracket its time" if r["saving_percent"] is None else "one pair of drives: no interval"
    return [
        {"name": "saved at equal time", "value": number(r["saving_percent"], 1, "%", sign=True),
         "note": interval(r["saving_ci95"], 1, "%", alone)},
        {"name": "oracle", "value": number(r["oracle_saving_percent"], 1, "%", sign=True),
         "note": "plan on the true map, followed perfectly"},
        {"name": "naive figure, not a saving", "value": number(r["naive_saving_percent"], 1, "%", sign=True),
         "note": "trip time ignored"},
        {"name": "error of the map found", "value": number(scaled(r["map"]["rmse"], 100), 2, "points"),
         "note": f"rms over cells with {share} of the fuel; {error}"},
    ]  # fmt: skip


def _comparison(run: Run) -> list[tuple[str, str, str, str]]:
    r = run.results
    base, adv = r["baseline"], r["advised"]
    litre = run.car.fuel.density * run.car.fuel.heating_value / 1e3
    per_distance = 1e5 / litre / r["distance_m"]

    def row(name: str, a: float | None, b: float | None, digits: int) -> tuple[str, str, str, str]:
        difference = None if a is None or b is None else b - a
        return name, number(a, digits, ""), number(b, digits, ""), number(difference, digits, "", sign=True)

    return [
        row("fuel (MJ)", scaled(base["fuel_J"], 1e-6), scaled(adv["fuel_J"], 1e-6), 2),
        row("fuel (l/100 km)", scaled(base["fuel_J"], per_distance), scaled(adv["fuel_J"], per_distance), 2),
        row("trip time (s)", base["time_s"], adv["time_s"], 1),
    ]


def _figures(r: Mapping[str, Any], intervals: RunIntervals) -> list[dict[str, str]]:
    o, m, w = r["observer"], r["map"], r["wall_s"]
    points = _times(intervals.map_rmse, 100)
    fit = interval(_times(intervals.fit_rmse, 100), 2, "points")

    def row(name: str, value: str, of: str = NONE) -> dict[str, str]:
        return {"name": name, "value": value, "interval": of}

    def thrust(key: str) -> str:
        share = scaled(o[key], 100 / o["thrust_rms_N"]) if o["thrust_rms_N"] else None
        return f"{number(o[key], 1, 'N')} ({number(share, 1, '%')} of rms)"

    return [
        row("thrust error, filter", thrust("thrust_rmse_N"), interval(intervals.thrust, 1, "N")),
        row("thrust error, smoother", thrust("thrust_rmse_smoothed_N"), interval(intervals.thrust_smoothed, 1, "N")),
        row("momentary efficiency error, filter", number(scaled(o["efficiency_rmse"], 100), 2, "points")),
        row("mean NIS per degree of freedom", number(o["nis_mean_per_dof"], 2, ""), interval(intervals.nis, 2, "")),
        row("map error over valid cells", number(scaled(m["rmse"], 100), 2, "points"), interval(points, 2, "points")),
        row("fuel burnt in valid cells", number(scaled(m["fuel_share"], 100), 0, "%"), EXACT),
        row("valid cells", number(m["cells"], 0, ""), EXACT),
        row(f"fit {m['fit'] or NONE}: R²", number(m["r2"], 3, "")),
        row(f"fit {m['fit'] or NONE}: error against truth", number(scaled(m["fit_rmse"], 100), 2, "points"), fit),
        row(
            "value at the found peak, found - true", number(scaled(m["peak_value_error"], 100), 2, "points", sign=True)
        ),
        row("GPS outage", number(o["gps_outage_s"], 0, "s"), EXACT),
        row("measurements", number(o["events"], 0, ""), EXACT),
        *(
            row(f"rejected: {name}", number(count, 0, ""), EXACT)
            for name, count in sorted((o["rejected"] or {}).items())
        ),
        row("vehicles in the network", number(r["vehicles"], 0, ""), EXACT),
        row("one measurement takes", number(o["microseconds_per_event"], 2, "µs"), ONCE),
        *(row(f"computing: {stage}", number(seconds, 1, "s"), ONCE) for stage, seconds in w.items()),
        row("simulated over computing time", number(r["real_time_factor"], 0, "×"), ONCE),
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


def _times(ends: Interval, factor: float) -> Interval:
    return None if ends is None else (ends[0] * factor, ends[1] * factor)


def scaled(value: float | None, factor: float) -> float | None:
    """`value` times `factor`; None stays None."""
    return None if value is None else value * factor


def number(value: float | None, digits: int, unit: str, *, sign: bool = False) -> str:
    """A number with its unit, a dash for None and NaN."""
    if value is None or not math.isfinite(value):
        return NONE
    return f"{value:{'+' if sign else ''},.{digits}f} {unit}".strip().replace("-", "−")


def interval(ends: Sequence[float] | None, digits: int, unit: str, otherwise: str = NONE) -> str:
    """A 95 % interval, or `otherwise` where there is none."""
    if ends is None:
        return otherwise
    return f"95 %: {number(ends[0], digits, '')} to {number(ends[1], digits, unit)}"
