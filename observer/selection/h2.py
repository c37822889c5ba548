"""A linear system with candidate sensors, and the H2 norm of the best observer that a set of them allows."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solve_continuous_are, solve_continuous_lyapunov

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinearSystem:
    """dx/dt = A x + F w, y = C x + H v, z = W (x - x_hat); w, v white of unit density (seed 003, equation 1).

    Each sensor is a group of rows of C; rows of no sensor are always there. `deviation` is the diagonal of H.
    """

    a: Array
    """A, (n, n)."""
    noise: Array
    """F, (n, p)."""
    c: Array
    """C, (m, n)."""
    deviation: Array
    """Diagonal of H, (m,), > 0: square roots of noise densities."""
    weight: Array
    """W, (k, n)."""
    sensors: tuple[tuple[int, ...], ...]
    """Rows of each candidate sensor."""
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.sensors) != len(self.names):
            raise ValueError(f"expected one name per sensor, found {len(self.names)} for {len(self.sensors)}")
        if not np.all(self.deviation > 0.0):
            raise ValueError("expected every sensor to have noise: deviations > 0")

    @staticmethod
    def one_row_each(
        a: Array, noise: Array, c: Array, deviation: Array, weight: Array, names: Sequence[str] | None = None
    ) -> "LinearSystem":
        """A system whose sensors have one row each."""
        m = len(c)
        return LinearSystem(
            a,
            noise,
            c,
            np.asarray(deviation, float),
            weight,
            tuple((i,) for i in range(m)),
            tuple(names) if names else tuple(f"sensor {i + 1}" for i in range(m)),
        )

    def rows(self, chosen: Iterable[int]) -> list[int]:
        """Rows of C that the `chosen` sensors and the fixed rows give."""
        optional = {row for group in self.sensors for row in group}
        kept = {row for sensor in chosen for row in self.sensors[sensor]}
        return [row for row in range(len(self.c)) if row in kept or row not in optional]

    def scaled(self, states: Array) -> "LinearSystem":
        """The same in states x / `states` (n,) and outputs of unit noise: H2 norms stay as they are."""
        return LinearSystem(
            self.a * states / states[:, None],
            self.noise / states[:, None],
            self.c * states / self.deviation[:, None],
            np.ones(len(self.c)),
            self.weight * states,
            self.sensors,
            self.names,
        )


def kalman_h2(system: LinearSystem, chosen: Iterable[int]) -> tuple[float, Array]:
    """Return (H2 norm of z, gain L (n, rows)) of the steady-state Kalman filter with the `chosen` sensors.

    The norm is infinite where no observer with them is stable. Columns of L are in the order of `system.rows(chosen)`.
    """
    rows = system.rows(chosen)
    n = len(system.a)
    density = system.noise @ system.noise.T
    if not rows:
        if np.linalg.eigvals(system.a).real.max() >= 0.0:
            return np.inf, np.zeros((n, 0))
        x = solve_continuous_lyapunov(system.a, -density)
        return float(np.sqrt(np.trace(system.weight @ x @ system.weight.T))), np.zeros((n, 0))
    # outputs of unit noise: the Riccati solver then sees one scale less
    c = system.c[rows] / system.deviation[rows, None]
    try:
        x = solve_continuous_are(system.a.T, c.T, density, np.eye(len(rows)))
    except LinAlgError:
        return np.inf, np.zeros((n, len(rows)))
    gain = x @ c.T / system.deviation[rows]
    if np.linalg.eigvals(system.a - gain @ system.c[rows]).real.max() >= 0.0:
        return np.inf, gain
    return float(np.sqrt(max(np.trace(system.weight @ x @ system.weight.T), 0.0))), gain
