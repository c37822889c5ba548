"""The seven weighting functions of seed 000, 3.14 to 3.20: how far an estimate stays where it is, from a quotient q."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WEIGHTINGS = (
    "linear",
    "inverse",
    "inverse_quadratic",
    "negative_exponential",
    "tanh",
    "square_root",
    "hit_or_miss",
)
"""By name: equations 3.14 to 3.20."""


@dataclass(frozen=True)
class Weighting:
    """alpha = w(q, sigma), in [0, 1]: 1 keeps the estimate, 0 takes the measurement. Raises ValueError on bad values.

    `sigma` (> 0) is the shape; of `hit_or_miss`, which has none, it is the threshold c. `level` is that function's k.
    """

    name: str = "negative_exponential"
    sigma: float = 8.0
    level: float = 0.9

    def __post_init__(self) -> None:
        if self.name not in WEIGHTINGS:
            raise ValueError(f"weighting: expected one of {', '.join(WEIGHTINGS)}, found {self.name!r}")
        if not (self.sigma > 0.0 and math.isfinite(self.sigma)):
            raise ValueError(f"weighting: expected sigma > 0, found {self.sigma}")
        if not 0.0 < self.level < 1.0:
            raise ValueError(f"weighting: expected 0 < level < 1, found {self.level}")

    @staticmethod
    def matched(name: str, alpha: float, threshold: float = 2.0) -> "Weighting":
        """Return the function of `name` with w(1) = `alpha`, as chapter 4 sets sigma; `threshold` is c of 3.20."""
        if not 0.0 < alpha < 1.0:
            raise ValueError(f"weighting: expected 0 < alpha < 1, found {alpha}")
        sigma = {
            "linear": 1.0 / (1.0 - alpha),
            "inverse": 1.0 / alpha - 1.0,
            "inverse_quadratic": 1.0 / alpha - 1.0,
            "negative_exponential": -1.0 / math.log(alpha),
            "tanh": math.atanh(1.0 - alpha),
            "square_root": (1.0 - alpha) ** -2,
        }
        return Weighting(name, sigma.get(name, threshold), alpha)

    def __call__(self, q: Array) -> Array:
        """alpha of the quotients `q` (any shape, >= 0, may be infinite).

        3.14 and 3.19 leave [0, 1] beyond q = sigma and are clipped there (c = sigma of 3.14 makes it continuous).
        3.20 is listed as a weighting function but is a constant below c and nothing above: as printed.
        """
        s = self.sigma
        if self.name == "negative_exponential":
            return np.exp(q * (-1.0 / s))
        if self.name == "linear":
            return np.clip(1.0 - q / s, 0.0, 1.0)
        if self.name == "inverse":
            return 1.0 / (s * q + 1.0)
        if self.name == "inverse_quadratic":
            return 1.0 / (s * q * q + 1.0)
        if self.name == "tanh":
            return 1.0 - np.tanh(s * q)
        if self.name == "square_root":
            return np.clip(1.0 - np.sqrt(q / s), 0.0, 1.0)
        return np.where(q < s, self.level, 0.0)
