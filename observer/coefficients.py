"""The Willans coefficients learnt directly, sample by sample, in a Kalman filter (seed 004, 3.4.1.4), without a map.

P_in / omega = a(omega) + b(omega) T + c(omega) T^2 is linear in the coefficients, so the extended Kalman filter that
the thesis considers is a plain one here, with the torque's own error as measurement noise through the slope. It needs
no grid and no memory of samples; what it cannot hold is what the form cannot hold (the thesis' reason against it).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer.efficiency_map import Limits
from observer.estimate import Estimate
from observer.fit_form import Cells
from observer.fit_willans import WillansFit, fit_willans, willans_rows
from observer.operating_points import operating_points
from vehicle_model.car.parameters import Car

BLOCK = 0.5
"""s of contiguous driving that make one measurement: the errors of the estimate stay alike over it."""
START = 0.25
"""Relative standard deviation of the coefficients at first, about an ordinary engine's."""
MODEL_ERROR = 0.015
"""Relative, of one measurement, beyond the observer's covariance."""
GATE = 4.0


def learn_coefficients(estimates: Sequence[Estimate], car: Car, *, smoothed: bool = False) -> WillansFit:
    """Return the Willans form whose coefficients a Kalman filter has learnt over the trips, in the order of time.

    Takes the causal filter's states unless `smoothed`. Starts from the prior that `fit_willans` has without any cell.
    """
    none = np.empty(0)
    form = fit_willans(Cells(none, none, none, none), car, Limits())
    value = form.coefficients.copy()
    size = np.maximum(np.abs(value), 0.1 * form.torque_scale)
    covariance = np.diag((START * size) ** 2)
    for estimate in estimates:
        points = operating_points(estimate, car, smoothed=smoothed)
        side = max(1, round(BLOCK / points.step))
        index = np.flatnonzero(points.mapped)
        for piece in np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(index) else []:
            for start in range(0, len(piece), side):
                block = piece[start : start + side]
                omega, torque = points.engine_speed[block], points.torque[block]
                row = willans_rows(form, omega, torque).mean(axis=0)
                fuel = points.fuel_power[block] / omega
                above, below = (willans_rows(form, omega, torque + d).mean(axis=0) for d in (0.5, -0.5))
                slope = float((above - below) @ value)
                noise = slope**2 * float(np.mean(points.variance[block] * fuel**2)) + (MODEL_ERROR * fuel.mean()) ** 2
                innovation = float(fuel.mean() - row @ value)
                column = covariance @ row
                expected = float(row @ column) + noise
                if innovation**2 > GATE**2 * expected:
                    continue
                value = value + column * (innovation / expected)
                covariance = covariance - np.outer(column, column) / expected
    return replace(form, name="P_in willans, learnt online", coefficients=value)
