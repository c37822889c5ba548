"""Figures 3.4 to 3.21: momentary efficiency with and without sensors, the map, and the smooth forms fitted to it."""

import dataclasses

import numpy as np

from controller.controller_model import THESIS
from observer.efficiency_map import EfficiencyMap
from observer.envelope import declared_torque
from observer.estimate import Estimate
from observer.observe import observe
from observer.operating_points import operating_points
from rollingroad.run import Run
from rollingroad.viz import charts
from rollingroad.viz.charts import Chart, Heat, Line, Panel
from rollingroad.viz.views import RPM

_FITS = (
    *(("3.9", "eta total 2"), ("3.10", "eta total 3"), ("3.11", "eta total 4")),
    *(("3.13", "phi total 2"), ("3.14", "phi total 3"), ("3.15", "phi printed 4")),
    *(("3.16", "P_in total 2"), ("3.17", "P_in total 3"), ("3.18", "P_in printed 4")),
)
"""Numbers of the thesis and names of `observer.fits`."""
_WINDOW = 60.0
"""s of each excerpt."""


def efficiency_charts(run: Run) -> list[Chart]:
    """The figures on the engine's efficiency, in the thesis' order; a fit that the data cannot carry is left out."""
    cases = _cases(run)
    found, fits = run.efficiency_map, run.fits
    used = np.flatnonzero(np.any(found.count > 0, axis=0))
    rows = slice(0, int(1.2 * used[-1]) + 2 if len(used) else None)
    x, y = found.engine_speed * RPM, found.torque[rows]
    made = [
        _excerpt(run, cases, "figure-3.4", "3.4 Highway", run.baseline.speed_limit > 30.0),
        _excerpt(run, cases, "figure-3.5", "3.5 In town", run.baseline.speed_limit < 15.0),
        _excerpt(run, cases, "figure-3.6", "3.6 Maximum acceleration", run.baseline.throttle > 0.9),
    ]
    raw = np.where(found.valid, 100 * found.mean, np.nan)[:, rows]
    caption = f"Valid cells only, nothing smoothed: {_coverage(found)}."
    made.append(_map("figure-3.7", "3.7 Efficiency map as found", caption, x, y, raw))
    made.append(_sample())
    if run.true_efficiency is not None:
        truth = 100 * run.true_efficiency[:, rows]
        made.append(
            _map("figure-3.19", "3.19 Efficiency map from the dynamometer", "The plant's own, steady.", x, y, truth)
        )
    made += [_bounded(run)] if run.results["map"]["fit"] in fits else []
    omega, torque = np.meshgrid(found.engine_speed, y, indexing="ij")
    for number, name in _FITS:
        if name in fits:
            smooth = 100 * np.clip(fits[name].efficiency(omega, torque), 0.0, 0.45)
            caption = f"{name}: R² = {fits[name].r2:.3f} of what it fits."
            made.append(_map(f"figure-{number}", f"{number} Fitted form", caption, x, y, smooth))
    return made


def other_car_charts(run: Run) -> list[Chart]:
    """Figures 3.20 and 3.21: the same of another car, nothing tuned to it."""
    found = run.efficiency_map
    used = np.flatnonzero(np.any(found.count > 0, axis=0))
    rows = slice(0, int(1.2 * used[-1]) + 2 if len(used) else None)
    x, y = found.engine_speed * RPM, found.torque[rows]
    raw = np.where(found.valid, 100 * found.mean, np.nan)[:, rows]
    name = f"Efficiency map, {run.car.name}"
    told = f"The same chain with another car, nothing tuned to it: {_coverage(found)}."
    made = [_map("figure-3.20", f"3.20 {name}", told, x, y, raw)]
    if fit := run.fits.get("P_in printed 4"):
        smooth = 100 * np.clip(fit.efficiency(*np.meshgrid(found.engine_speed, y, indexing="ij")), 0.0, 0.45)
        caption = f"{fit.name}: R² = {fit.r2:.3f} of fuel power. Far from the cells of 3.20 it is extrapolation."
        made.append(_map("figure-3.21", f"3.21 {name}, fourth order", caption, x, y, smooth))
    return made


def _coverage(found: EfficiencyMap) -> str:
    return f"{int(found.valid.sum())} cells that hold {100 * found.fuel_share:.0f} % of the fuel burnt"


def _sample() -> Chart:
    """3.8: the thesis shows an engine of the literature; here its own controller's engine."""
    w, torque = np.linspace(*THESIS.engine_speed, 104), np.linspace(*THESIS.torque, 96)
    percent = 100.0 / THESIS.inverse_efficiency(w[:, None], torque[None, :])
    caption = "For comparison: the polynomial of table 4.1, with which the cases of chapter 4 are solved."
    return _map("figure-3.8", "3.8 Sample efficiency map", caption, w * RPM, torque, percent)


def _bounded(run: Run) -> Chart:
    """3.12: the planner's form, drawn only where the engine can be."""
    found, fit = run.efficiency_map, run.fits[str(run.results["map"]["fit"])]
    w, seen = found.engine_speed, found.limits.torque_max
    declared = 0.95 * declared_torque(w, run.car)
    top = np.where(np.isfinite(seen), seen, declared) if len(seen) == len(w) else declared
    inside = (w >= run.car.engine.idle_speed) & (w <= run.car.engine.redline_speed)
    torque = np.arange(1.0, 1.1 * float(top[inside].max()), 2.0)
    z = 100 * np.clip(fit.efficiency(*np.meshgrid(w, torque, indexing="ij")), 0.0, 0.45)
    z[(torque[None, :] > top[:, None]) | ~inside[:, None]] = np.nan
    marks = (
        Heat(w * RPM, torque, z, "efficiency (%)", "cividis", 0.0, 40.0),
        Line(w[inside] * RPM, declared[inside], "full load, from the car file", charts.BLACK, dash="dash"),
        Line(w * RPM, np.where(inside, seen, np.nan), "full load, seen in the log", charts.VERMILION, width=2.4),
    )
    return Chart(
        "figure-3.12",
        "3.12 Efficiency map with its bounds",
        f"{fit.name}, from idle to the red line and up to full load: as far as the log shows stretches at full "
        "throttle, from the car file elsewhere.",
        (Panel("torque (N m)", marks, "", "engine speed (rpm)", (0.0, float(torque[-1])), (800.0, 6500.0)),),
        True,
        420,
    )


def _cases(run: Run) -> dict[str, Estimate]:
    """The estimate with GPS and road map, with GPS alone, and with neither; biases carried from the first."""
    blind = dataclasses.replace(run.log, streams={k: v for k, v in run.log.streams.items() if k != "gps"})
    learnt = run.estimate.learnt
    return {
        "GPS and road map": run.estimate,
        "GPS only": observe(run.log, run.car, learnt=learnt),
        "neither": observe(blind, run.car, learnt=learnt),
    }


def _excerpt(run: Run, cases: dict[str, Estimate], key: str, title: str, wanted: np.ndarray) -> Chart:
    """The minute with most driving under `wanted` (n,) of the baseline's clock."""
    trip = run.baseline
    driven = wanted & (trip.thrust > 0.0) & (trip.clutch >= 1.0)
    starts = np.arange(0.0, max(trip.duration - _WINDOW, 1.0), _WINDOW / 4.0)
    begin = np.searchsorted(trip.time, starts)
    end = np.searchsorted(trip.time, starts + _WINDOW)
    total = np.concatenate([[0], np.cumsum(driven)])
    start = float(starts[np.argmax(total[np.minimum(end, len(driven))] - total[begin])])
    colours = (charts.BLUE, charts.ORANGE, charts.VERMILION)
    torque, speed, efficiency = [], [], []
    for (name, estimate), colour in zip(cases.items(), colours, strict=True):
        points = operating_points(estimate, run.car, smoothed=False)
        inside = (points.time >= start) & (points.time < start + _WINDOW)
        t, propelled = points.time[inside], points.mapped[inside]
        with np.errstate(divide="ignore", invalid="ignore"):
            momentary = np.where(propelled, 100 * points.power[inside] / points.fuel_power[inside], np.nan)
        torque.append(Line(t, np.where(propelled, points.torque[inside], np.nan), name, colour))
        speed.append(Line(t, points.engine_speed[inside] * RPM, name, colour))
        efficiency.append(Line(t, momentary, name, colour))
    return Chart(
        key,
        title,
        "The causal filter with all sensors, without road map, without GPS and road map (biases known from an earlier "
        "trip). Drawn only while the engine propels the car.",
        (
            Panel("engine (rpm)", tuple(speed)),
            Panel("torque (N m)", tuple(torque)),
            Panel("efficiency (%)", tuple(efficiency), x_label="time (s)", y_range=(0.0, 45.0)),
        ),
        height=480,
    )


def _map(key: str, title: str, caption: str, x: charts.Array, y: charts.Array, z: charts.Array) -> Chart:
    heat = Heat(x, y, z, "efficiency (%)", "cividis", 0.0, 40.0)
    window = (800.0, 6500.0), (0.0, float(y[-1]) if len(y) else 100.0)
    return Chart(
        key,
        title,
        caption,
        (Panel("torque (N m)", (heat,), "", "engine speed (rpm)", window[1], window[0]),),
        True,
        420,
    )
