"""What the observer believes about a trip."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STATES = (
    "distance",  # x_i, m
    "speed",  # v_i, m/s
    "thrust",  # F_thrust, N (with brakes: the model does not tell them apart)
    "heading",  # psi, rad
    "pitch",  # theta, rad
    "north",  # N, m
    "east",  # E, m
    "down",  # D, m
    "straightness",  # S_j, rad/m
    "vertical_straightness",  # S_k, rad/m
    "fuel_energy",  # E_in, J
    "fuel_power",  # P_in, W
    "engine_angle",  # theta_e, rad
    "engine_speed",  # omega_e, rad/s
    "bias_x",  # b_i, m/s2
    "bias_y",  # b_j, m/s2
    "bias_z",  # b_k, m/s2
)
"""The 17 states in the order of equation 1.15."""


@dataclass(frozen=True)
class Estimate:
    """States at 10 Hz and one record per measurement. Shapes: (n,), (n, 17), (m,)."""

    time: NDArray[np.float64]
    """s on the logger's clock, 10 Hz grid."""
    state: NDArray[np.float64]
    """Causal filter, (n, 17)."""
    variance: NDArray[np.float64]
    """Diagonal of the filter's covariance, (n, 17)."""
    smoothed: NDArray[np.float64]
    """Fixed-interval smoother, (n, 17)."""
    smoothed_variance: NDArray[np.float64]
    records: NDArray
    """Structured, one row per scalar measurement: t, kind, value, innovation, variance, nis, fused (bool), reason."""
    origin: tuple[float, float, float]
    """Latitude, longitude (deg), altitude (m) of north = east = 0."""
    learnt: dict[str, float]
    """What the next trip may start from: biases and their variances."""

    def column(self, name: str, *, smoothed: bool = False) -> NDArray[np.float64]:
        """The time series of the state `name` (of STATES)."""
        return (self.smoothed if smoothed else self.state)[:, STATES.index(name)]
