"""What a log holds and how its sensors behave: rates, gaps, damage; lags, scales, offsets with their uncertainty.

Every figure stands with `sd`, its standard deviation, and `ci95`, its 95 % interval, both from a moving-block bootstrap
(errors of a sensor are correlated in time), so that what a short log cannot tell is seen.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.accelerometer import rotation
from sensors.log import SensorLog
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator

RESAMPLES = 400
BLOCK_SECONDS = 2.0
LAGS = np.arange(-0.6, 3.0, 0.02)
"""s: the receiver lags that are tried."""
GRAVITY = 9.80665
LONGEST = 86_400.0
"""s of a log that are looked at for the accelerometer's offset: stamps at random span weeks."""


def inspect(log: SensorLog, car: Car | None = None) -> dict[str, Any]:
    """Return what `log` shows of itself, ready for JSON.

    `streams`: count, start and end (s), rate (Hz), longest gap (s), gaps beyond five steps (at least 1 s);
    `damage`; `speed`: GPS against wheel: lag (s), scale, offset (m/s), residual (m/s); for wheel pulses the scale is
    the metres per tick. `accelerometer`: forward offset and scatter (m/s2), with the car file's mounting if `car` is
    given. `clock`: rate against GPS time. A figure that the log cannot give is None, with the reason in `not_found`.
    """
    report: dict[str, Any] = {
        "name": log.name,
        "streams": {name: _stream(rows["t"]) for name, rows in log.streams.items() if len(rows)},
        "damage": dict(log.damage),
        "receivers": {},
        "accelerometer": None,
        "clock": None,
        "not_found": {},
    }
    reference = reference_speed(log)
    for name in ("gps", "gps_second"):
        fixes = log[name]
        if not len(fixes):
            continue
        if reference is None:
            report["not_found"][name] = "no wheel pulses and no speed to compare with"
            continue
        usable = (fixes["quality"] > 0) & np.isfinite(fixes["speed"])
        found = None
        if usable.sum() >= 12:
            found = lag_and_scale(fixes["t"][usable], fixes["speed"][usable], *reference)
        if found is None:
            report["not_found"][name] = "fewer than 12 fixes with a speed while the reference moves"
            continue
        report["receivers"][name] = found | _receiver(fixes)
    if reference is not None and len(log["accelerometer"]) > 100:
        report["accelerometer"] = accelerometer_offset(log, car, reference)
    report["clock"] = _clock(log)
    return report


def _stream(t: NDArray[np.float64]) -> dict[str, Any]:
    step = np.diff(np.sort(t))
    median = float(np.median(step)) if step.size else 0.0
    return {
        "count": int(t.size),
        "start_s": float(t.min()),
        "end_s": float(t.max()),
        "rate_hz": float((t.size - 1) / (t.max() - t.min())) if t.size > 1 and t.max() > t.min() else 0.0,
        "longest_gap_s": float(step.max()) if step.size else 0.0,
        "gaps": int((step > max(5.0 * median, 1.0)).sum()),
        "interval_percentiles_s": [float(x) for x in np.quantile(step, (0.01, 0.5, 0.99))] if step.size else [],
        "backward_stamps": int((np.diff(t) < 0).sum()),
    }


def _receiver(fixes: NDArray) -> dict[str, Any]:
    good = fixes["quality"] > 0
    same = (np.diff(fixes["latitude"]) == 0) & (np.diff(fixes["longitude"]) == 0) & good[1:] & good[:-1]
    moving = np.nan_to_num(fixes["speed"][1:]) > 2.0
    return {"without_fix": int((~good).sum()), "repeated_while_moving": int((same & moving).sum())}


def reference_speed(log: SensorLog) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return (t, speed) to judge receivers by: the log's speed in m/s, or the wheel in ticks/s; None without either."""
    speed = log["speed"]
    if speed.size > 20:
        return speed["t"], speed["speed"]
    t = log["wheel"]["t"]
    if t.size < 50:
        return None
    # Ticks over about half a second, where the pulses run without a pause.
    t = np.sort(t)
    near = 8
    middle = 0.5 * (t[near:] + t[:-near])
    rate = near / np.maximum(t[near:] - t[:-near], 1e-3)
    return middle, np.where(
        np.max(np.lib.stride_tricks.sliding_window_view(np.diff(t), near), axis=1) < 1.0, rate, np.nan
    )


def _blocks(count: int, length: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Weights (RESAMPLES, count): how often each sample is drawn when whole blocks of `length` are."""
    length = max(1, min(length, count // 4))
    draws = -(-count // length)
    begins = rng.integers(0, count - length + 1, (RESAMPLES, draws))
    marks = np.zeros((RESAMPLES, count + 1))
    np.add.at(marks, (np.arange(RESAMPLES)[:, None], begins), 1.0)
    np.add.at(marks, (np.arange(RESAMPLES)[:, None], begins + length), -1.0)
    return np.cumsum(marks, axis=1)[:, :count]


def _figure(value: float, samples: NDArray[np.float64]) -> dict[str, Any]:
    low, high = np.quantile(samples, (0.025, 0.975))
    return {"value": float(value), "sd": float(samples.std()), "ci95": [float(low), float(high)]}


def lag_and_scale(
    t: NDArray[np.float64], speed: NDArray[np.float64], t_reference: NDArray[np.float64], reference: NDArray[np.float64]
) -> dict[str, Any] | None:
    """Fit speed(t) = scale x reference(t - lag) + offset by least squares; None where there is nothing to fit.

    Arrays (n,) and (m,), s and m/s (or ticks/s for `reference`). The uncertainty resamples blocks of 2 s.
    """
    looks = t[:, None] - LAGS[None, :]
    shifted = np.interp(looks.ravel(), t_reference, reference).reshape(looks.shape)
    inside = (looks[:, -1] >= t_reference[0]) & (looks[:, 0] <= t_reference[-1]) & np.isfinite(shifted).all(axis=1)
    # In a long log only where it moves: standing still tells of neither lag nor scale.
    inside &= speed > 1.0
    if inside.sum() < 12:
        return None
    shifted, y = shifted[inside], speed[inside]
    if y.std() < 0.3:
        return None
    step = float(np.median(np.diff(t[inside])))
    rng = generator(0, "inspect.lag")
    draws = _blocks(y.size, round(BLOCK_SECONDS / max(step, 1e-3)) or 1, rng)
    weights = np.vstack((np.ones(y.size), draws))
    total = weights.sum(axis=1)[:, None]
    mean_w, mean_y = weights @ shifted / total, (weights @ y)[:, None] / total
    var_w = weights @ shifted**2 / total - mean_w**2
    cov = weights @ (shifted * y[:, None]) / total - mean_w * mean_y
    var_y = (weights @ y**2)[:, None] / total - mean_y**2
    error = var_y - cov**2 / np.maximum(var_w, 1e-12)
    best = np.argmin(error, axis=1)
    rows = np.arange(best.size)
    middle = np.clip(best, 1, LAGS.size - 2)
    left, here, right = (error[rows, middle + k] for k in (-1, 0, 1))
    bend = np.maximum(left - 2.0 * here + right, 1e-15)
    lag = LAGS[middle] + np.clip(0.5 * (left - right) / bend, -1.0, 1.0) * (LAGS[1] - LAGS[0])
    scale = cov[rows, best] / np.maximum(var_w[rows, best], 1e-12)
    offset = mean_y[rows, 0] - scale * mean_w[rows, best]
    return {
        "lag_s": _figure(lag[0], lag[1:]),
        "scale": _figure(scale[0], scale[1:]),
        "offset_mps": _figure(offset[0], offset[1:]),
        "residual_mps": float(np.sqrt(max(error[0, best[0]], 0.0))),
        "fixes": int(y.size),
    }


def accelerometer_offset(
    log: SensorLog, car: Car | None, reference: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> dict[str, Any]:
    """Forward offset of the accelerometer against the speed's rate of change, m/s2, and the scatter of each axis.

    Includes what the road's mean slope adds; the uncertainty holds both the bootstrap's and the slope's: the GPS
    altitude's climb over the distance where there is one, else 1.5 %.
    """
    rows = log["accelerometer"]
    raw = np.column_stack([rows[axis] for axis in "xyz"])
    if car is not None:
        m = car.mounting
        raw = raw @ (m.scale * rotation(m.roll, m.pitch, m.yaw)).T
    t = rows["t"]
    t_speed, speed = reference
    if not len(log["speed"]):
        found = lag_and_scale(log["gps"]["t"], np.nan_to_num(log["gps"]["speed"]), t_speed, speed)
        metres = car.metres_per_tick if car is not None else (found["scale"]["value"] if found else np.nan)
        speed = speed * metres
    good = np.isfinite(speed)
    t_speed, speed = t_speed[good], speed[good]
    # Whole seconds: the mean force against the change of speed over each.
    # Stamps may go back or stand still in a damaged log.
    raw, t = raw[np.argsort(t, kind="stable")], np.sort(t)
    order = np.argsort(t_speed, kind="stable")
    t_speed, speed = t_speed[order], speed[order]
    begin, end = (max(t[0], t_speed[0]), min(t[-1], t_speed[-1])) if t_speed.size else (0.0, 0.0)
    edges = np.arange(begin, min(end, begin + LONGEST), 1.0)
    if edges.size < 10:
        return {"offset_mps2": None, "scatter_mps2": _scatter(raw)}
    place = np.searchsorted(t, edges)
    count = np.diff(place)
    sums = np.diff(np.concatenate(([0.0], np.cumsum(raw[:, 0])))[place])
    at_edges = np.interp(edges, t_speed, speed)
    gap = np.diff(edges)
    whole = (count > 0) & (at_edges[1:] > 1.5) & (at_edges[:-1] > 1.5)
    if whole.sum() < 8:
        return {"offset_mps2": None, "scatter_mps2": _scatter(raw)}
    residual = sums[whole] / count[whole] - (np.diff(at_edges) / gap)[whole]
    draws = _blocks(residual.size, 5, generator(0, "inspect.accelerometer"))
    means = draws @ residual / draws.sum(axis=1)
    slope = _slope_doubt(log, at_edges, edges)
    sd = float(np.hypot(means.std(), GRAVITY * slope))
    value = float(residual.mean())
    return {
        "offset_mps2": {"value": value, "sd": sd, "ci95": [value - 1.96 * sd, value + 1.96 * sd]},
        "scatter_mps2": _scatter(raw),
        "mean_slope_doubt": slope,
    }


def _scatter(raw: NDArray[np.float64]) -> list[float]:
    """Deviation of each axis from sample to sample: noise and vibration, without the drive."""
    return [float(1.4826 * np.median(np.abs(np.diff(raw[:, axis]))) / np.sqrt(2.0)) for axis in range(3)]


def _slope_doubt(log: SensorLog, speed: NDArray[np.float64], t: NDArray[np.float64]) -> float:
    """How much mean slope (rad) the road may have had."""
    fixes = log["gps"]
    height = fixes["altitude"][(fixes["quality"] > 0) & np.isfinite(fixes["altitude"])]
    distance = float(np.trapezoid(speed, t))
    if height.size < 20 or distance < 100.0:
        return 0.015
    ends = max(5, height.size // 20)
    return float(np.hypot(height[-ends:].mean() - height[:ends].mean(), 5.0) / distance)


def _clock(log: SensorLog) -> dict[str, Any] | None:
    """The logger's rate against GPS time: from skew packets, else from the earliest arrivals of the fixes' epochs."""
    skew = log["skew"]
    span = float(skew["t"][-1] - skew["t"][0]) if len(skew) else 0.0
    if len(skew) >= 5 and span > 0.0:
        rate = float(skew["gained"][1:].sum() / span)
        doubt = 1e-3 * np.sqrt(2.0 / 12.0) / span
        source = "skew packets"
    else:
        fixes = log["gps"]
        good = np.isfinite(fixes["utc"]) & (fixes["quality"] > 0)
        if good.sum() < 50:
            return None
        t, utc = fixes["t"][good], fixes["utc"][good]
        delay = t - utc - (t[0] - utc[0])
        parts = np.array_split(np.arange(t.size), 8)
        lowest = np.array([part[np.argmin(delay[part])] for part in parts])
        if np.ptp(utc[lowest]) < 1.0:
            return None
        (rate, _), cov = np.polyfit(utc[lowest] - utc[lowest].mean(), delay[lowest], 1, cov=True)
        rate, doubt, source = float(rate), float(np.sqrt(cov[0, 0])), "arrival of fixes"
    figure = {"value": rate, "sd": float(doubt), "ci95": [rate - 1.96 * doubt, rate + 1.96 * doubt]}
    return {"rate": figure, "source": source}
