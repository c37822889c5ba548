"""The motion along which the simulator is replayed, and what the accelerometer is off by."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from rollingroad.gap.reconstruct import Trace
from rollingroad.gap.replay import Motion
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]

LAG = 0.2
"""s, of the default receiver."""
MEAN_GRADE = 0.01
"""Deviation of a whole trip's grade where nothing tells it."""
SQUAT = np.radians(1.0)
"""rad per g of acceleration: the default box's (CLI.md)."""


def motion_of(trace: Trace, car: Car, idle_speed: float) -> tuple[Motion, Array, float, float]:
    """The trip's motion; the integrated height; the bias and its deviation."""
    t = trace.time - trace.time[0]
    v, a = trace.speed, trace.acceleration
    s = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * trace.step)])
    g = car.gravity
    if np.isfinite(trace.force).mean() > 0.9:
        raw = np.interp(t, t[np.isfinite(trace.force)], trace.force[np.isfinite(trace.force)]) - SQUAT * a
        height = np.concatenate([[0.0], np.cumsum((v * (raw - a))[1:] * trace.step)]) / g
        bias, bias_sd = _bias(trace, s, height, g)
        force = raw - bias
    else:
        height = np.zeros(len(t))
        bias, bias_sd = 0.0, 0.0 if grade_known(trace) else MEAN_GRADE * g
        force = a + g * _map_grade(trace, s)
    omega = trace.engine_speed.copy()
    gear = trace.gear
    if not np.isfinite(omega).any():
        omega, gear = _assumed_gears(v, a, car)
    ratio = np.asarray(car.gear_ratios)[np.maximum(gear, 1) - 1] / car.wheel_radius
    omega = np.where(np.isfinite(omega), omega, np.where(gear > 0, v * ratio, idle_speed))
    burnt = np.cumsum(np.nan_to_num(trace.fuel)) * trace.step
    braking = (a < -0.8).astype(float)
    heat = lfilter([0.5 * trace.step], [1.0, -(1.0 - trace.step / 60.0)], braking)
    width = max(1, round(1.0 / trace.step))
    smooth = uniform_filter1d(force, width)
    motion = Motion(
        t, s, v, uniform_filter1d(a, width), smooth, np.maximum(omega, 0.5 * idle_speed), gear, trace.heading,
        uniform_filter1d(trace.curvature, width), burnt, np.minimum(heat, 1.0),
    )  # fmt: skip
    return motion, height, bias, bias_sd


def _bias(trace: Trace, s: Array, height: Array, g: float) -> tuple[float, float]:
    """Bias by generalised least squares of the receiver's altitude (else the map's) on c - b s / g."""
    if trace.gps and np.isfinite(trace.gps["altitude"]).sum() > 100:
        t = trace.gps["t"] - LAG
        y_all, noise, tau, white = trace.gps["altitude"], 3.5, 200.0, 0.3
    elif np.isfinite(trace.map_altitude).sum() > 100:
        t, y_all, noise, tau, white = trace.time, trace.map_altitude, 1.0, 5.0, 0.3
    else:
        return float(np.nanmedian(trace.force - trace.acceleration)), 0.1
    edges = np.arange(t[0], t[-1], 10.0)
    which = np.digitize(t, edges) - 1
    good = np.isfinite(y_all)
    count = np.bincount(which[good], minlength=len(edges))
    keep = count > 5
    middle = (edges + 5.0)[keep]
    y = (np.bincount(which[good], y_all[good], minlength=len(edges)) / np.maximum(count, 1))[keep]
    y = y - np.interp(middle, trace.time, height)
    x = np.stack([np.ones(len(middle)), -np.interp(middle, trace.time, s) / g], axis=1)
    gap = np.abs(middle[:, None] - middle[None, :])
    walk = 0.05**2 * np.minimum.outer(middle - middle[0], middle - middle[0])
    cov = noise**2 * np.exp(-gap / tau) + white**2 * np.eye(len(middle)) + walk
    solve = np.linalg.solve(cov, np.column_stack([x, y]))
    normal = x.T @ solve[:, :2] + np.diag([1e-6, 1.0 / 0.5**2])
    value = np.linalg.solve(normal, x.T @ solve[:, 2])
    return float(value[1]), float(np.sqrt(np.linalg.inv(normal)[1, 1]))


def grade_known(trace: Trace) -> bool:
    """Whether an accelerometer or a road map tells how steep the road is."""
    return bool(np.isfinite(trace.force).mean() > 0.9 or np.isfinite(trace.map_altitude).sum() >= 50)


def _map_grade(trace: Trace, s: Array) -> Array:
    """Grade from an altitude over distance, smoothed over some 300 m; zero where none is known."""
    h = trace.map_altitude
    good = np.isfinite(h)
    if good.sum() < 50:
        return np.zeros(len(s))
    at = np.arange(0.0, s[-1], 10.0)
    if len(at) < 40:
        return np.zeros(len(s))
    level = uniform_filter1d(uniform_filter1d(np.interp(at, s[good], h[good]), 15), 15)
    return np.interp(s, at, np.gradient(level, 10.0))


def _assumed_gears(v: Array, a: Array, car: Car) -> tuple[Array, NDArray[np.int64]]:
    """Engine speed and gear of a driver who keeps the engine a little above 1,500 rpm, more when he accelerates."""
    ratios = np.asarray(car.gear_ratios) / car.wheel_radius
    wish = 150.0 + 60.0 * np.clip(a, 0.0, 2.0)
    gear = np.ones(len(v), int)
    for number in range(2, len(ratios) + 1):
        gear = np.where(v * ratios[number - 1] > wish, number, gear)
    omega = np.maximum(v * ratios[gear - 1], car.engine.idle_speed)
    return omega, np.where(v > 2.0, gear, 0)
