"""Tunings as data: tables 3.2 and 3.3 of seed 004 as printed, the same normalised (3.1.4.4), and ours.

The print gives no units for the injector rows: read as J and rad they make a NIS in the thousands (ERRATA), so
`THESIS` states what it assumes. `state_noise` are diagonal densities per second, `measurement_noise` variances.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer import model
from observer.settings import DEFAULT, ObserverSettings


@dataclass(frozen=True)
class Tuning:
    """`state_noise` (17,), SI units squared per second; `measurement_noise` by kind, SI units squared."""

    state_noise: NDArray[np.float64]
    measurement_noise: Mapping[int, float]
    source: str
    vertical_per_speed: bool = False
    """Q(10, 10) is to be divided by v^2 (table 3.2), v bounded below at 1 m/s (ERRATA)."""
    dilution_squared: bool = False
    """GPS variances are to be multiplied by HDOP^2 (table 3.3)."""

    def noise_at(self, speed: float) -> NDArray[np.float64]:
        """Densities (17,) at `speed` (m/s)."""
        noise = self.state_noise.copy()
        if self.vertical_per_speed:
            noise[model.SK] /= max(abs(speed), 1.0) ** 2
        return noise


THESIS = Tuning(
    np.array(
        [0.1, 0.01, 9e4, 0.01, 1.5625e-8, 1e-4, 1e-4, 1e-5, 1e-6, 1e-9, 0.01, 5e4, 0.01, 500.0, 1e-17, 1e-17, 1e-17]
    ),
    {
        model.DISTANCE: 0.05,
        model.ACCELERATION_X: 1.0,
        model.ACCELERATION_Y: 4.0,
        model.ACCELERATION_Z: 50.0,
        model.MAP_HEADING: 0.03,
        model.PITCH: 0.03,
        model.GPS_NORTH: 100.0,
        model.GPS_EAST: 100.0,
        model.GPS_ALTITUDE: 1000.0,
        model.MAP_STRAIGHTNESS: 1e6,
        model.INJECTED_ENERGY: 1.0,
        model.ENGINE_ANGLE: 0.016,
        model.MAP_ALTITUDE: 1.0,
    },
    "seed 004, tables 3.2 and 3.3, as printed; E_in in J and theta_e in rad assumed",
    vertical_per_speed=True,
    dilution_squared=True,
)
"""As printed. R_Sj = 1e6 switches that row off."""

USUAL_STATE = np.array([1e2, 10, 1e3, 1, 0.1, 1e2, 1e2, 1e2, 0.01, 1e-3, 1e4, 1e4, 1e2, 1e2, 0.1, 0.1, 0.1])
"""A usual size of each state, SI: what 3.1.4.4 divides by."""


def normalised(tuning: Tuning) -> Tuning:
    """Return `tuning` in normalised units: states over `USUAL_STATE`, measurements over the usual size of theirs."""
    size = {
        model.DISTANCE: USUAL_STATE[model.X],
        model.ACCELERATION_X: 1.0,
        model.ACCELERATION_Y: 1.0,
        model.ACCELERATION_Z: 1.0,
        model.MAP_HEADING: USUAL_STATE[model.PSI],
        model.PITCH: USUAL_STATE[model.THETA],
        model.GPS_NORTH: USUAL_STATE[model.N],
        model.GPS_EAST: USUAL_STATE[model.E],
        model.GPS_ALTITUDE: USUAL_STATE[model.D],
        model.MAP_STRAIGHTNESS: USUAL_STATE[model.SJ],
        model.INJECTED_ENERGY: USUAL_STATE[model.EIN],
        model.ENGINE_ANGLE: USUAL_STATE[model.ANGLE],
        model.MAP_ALTITUDE: USUAL_STATE[model.D],
    }
    return Tuning(
        tuning.state_noise / USUAL_STATE**2,
        {kind: value / size[kind] ** 2 for kind, value in tuning.measurement_noise.items()},
        f"{tuning.source}; normalised (3.1.4.4)",
        tuning.vertical_per_speed,
        tuning.dilution_squared,
    )


def printed_in_our_filter() -> ObserverSettings:
    """Return the settings that make the default observer as noisy as tables 3.2 and 3.3 say, where it has such a place.

    Constant thrust noise, no help from the fuel, R as printed. Straightness noise is per second in the print and per
    metre here: taken at 15 m/s.
    """
    q, r = THESIS.state_noise, THESIS.measurement_noise
    speed = 15.0
    changes = {
        "distance_noise": q[model.X],
        "speed_noise": q[model.V],
        "thrust_noise": q[model.F],
        "thrust_noise_cut": 0.0,
        "thrust_gain": 0.0,
        "thrust_noise_hindsight": q[model.F],
        "thrust_gain_hindsight": 0.0,
        "heading_noise": q[model.PSI],
        "pitch_noise": q[model.THETA],
        "position_noise": q[model.N],
        "down_noise": q[model.D],
        "straightness_noise": q[model.SJ] / speed,
        "vertical_straightness_noise": q[model.SK] / speed**3,
        "energy_noise": q[model.EIN],
        "power_noise": q[model.PIN],
        "angle_noise": q[model.ANGLE],
        "engine_speed_noise": q[model.OMEGA],
        "bias_noise": q[model.BX],
        "accelerometer_floor": float(np.sqrt(r[model.ACCELERATION_X])),
        "accelerometer_slope": 0.0,
        "accelerometer_vertical_floor": float(np.sqrt(r[model.ACCELERATION_Z])),
        "accelerometer_vertical_slope": 0.0,
        "tooth_deviation": float(np.sqrt(r[model.DISTANCE])),
        "gps_white": float(np.sqrt(r[model.GPS_NORTH])),
        "gps_vertical_white": float(np.sqrt(r[model.GPS_ALTITUDE])),
        "gps_drift": 1e-3,
        "gps_vertical_drift": 1e-3,
        "slip": 0.0,
        "slip_deviation": 1e-12,
        "scale_deviation": 1e-9,
        "scale_noise": 0.0,
        "slip_noise": 0.0,
    }
    return ObserverSettings(**{name: float(value) for name, value in changes.items()})


OURS = DEFAULT
"""The tuning of the default observer: see `observer.settings`."""
