"""Process noise from a model's residuals: seed 003, 3.2, with the corrections by skewness and kurtosis."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kurtosis, skew

Array = NDArray[np.float64]
SKEWED = 0.5
"""Skewness beyond which a distribution counts as asymmetric (the print says "large")."""
FLAT = -1.0
"""Excess kurtosis below which the correction is made (the number is lost in print)."""


def process_noise(residual: Array, skewed: float = SKEWED, flat: float = FLAT) -> Array:
    """Return the deviations sigma_i (n,), the diagonal of F, of `residual` (samples, n) = dx/dt - (A x + B u + D d).

    Small skewness: the deviation s. Large skewness: | s - |mean| | where skewness and mean have one sign (26), else
    s + |mean|. Excess kurtosis below `flat`: the lost equation 28 is taken as sqrt(1 + |k|) times that. States without
    residual (actuators and sensors, whose lags are exact) get 0.
    """
    mean, s = residual.mean(axis=0), residual.std(axis=0)
    with np.errstate(invalid="ignore"):
        third = np.nan_to_num(skew(residual, axis=0))
        fourth = np.nan_to_num(kurtosis(residual, axis=0))
    together = np.sign(third) == np.sign(mean)
    corrected = np.where(together, np.abs(s - np.abs(mean)), s + np.abs(mean))
    sigma = np.where(np.abs(third) > skewed, corrected, s)
    return np.where(fourth < flat, sigma * np.sqrt(1.0 + np.abs(fourth)), sigma)
