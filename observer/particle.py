"""A bootstrap particle filter on the longitudinal part of the model: speed, thrust, pitch, vertical straightness, bias.

Five states are what a few thousand particles can cover; the rest of the 17 is nearly linear and gains nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer import model
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]
REDUCED = (model.V, model.F, model.THETA, model.SK, model.BX)
"""The states kept, as indices of the full model."""


@dataclass
class Particles:
    """States (n, 5) and log-weights (n,), normalised."""

    states: Array
    log_weights: Array

    @property
    def weights(self) -> Array:
        """(n,), summing to 1."""
        return np.exp(self.log_weights)

    def mean(self) -> Array:
        """(5,)."""
        return self.weights @ self.states

    def covariance(self) -> Array:
        """(5, 5)."""
        d = self.states - self.mean()
        return d.T @ (self.weights[:, None] * d)


def draw(mean: Array, covariance: Array, count: int, rng: np.random.Generator) -> Particles:
    """Return `count` particles from a Gaussian."""
    return Particles(rng.multivariate_normal(mean, covariance, count), np.full(count, -np.log(count)))


def _widen(states: Array) -> Array:
    full = np.zeros((17, len(states)))
    full[list(REDUCED)] = states.T
    return full


def predict(particles: Particles, car: Car, noise: Array, dt: float, rng: np.random.Generator) -> None:
    """Move all particles over `dt` (s), midpoint rule, and shake them by densities `noise` (5,). In place."""

    def rate(states: Array) -> Array:
        full = model.dynamics(_widen(states), car, np)  # type: ignore[arg-type]
        return np.stack([np.broadcast_to(full[i], len(states)) for i in REDUCED], axis=1)

    middle = particles.states + 0.5 * dt * rate(particles.states)
    shaken = np.sqrt(noise * dt) * rng.standard_normal(particles.states.shape)
    particles.states = particles.states + dt * rate(middle) + shaken


def correct(
    particles: Particles, expected: Callable[[Array], Array], value: float, deviation: float, rng: np.random.Generator
) -> None:
    """Weigh by a Gaussian likelihood of `value`; resample (systematically) below half the effective number. In place.

    `expected` maps full states (17, n) to the measurement (n,).
    """
    nu = (value - expected(_widen(particles.states))) / deviation
    log_weights = particles.log_weights - 0.5 * nu * nu
    log_weights = log_weights - np.max(log_weights)
    log_weights = log_weights - np.log(np.sum(np.exp(log_weights)))
    particles.log_weights = log_weights
    weights = np.exp(log_weights)
    count = len(weights)
    if 1.0 / np.sum(weights**2) < 0.5 * count:
        places = (rng.random() + np.arange(count)) / count
        chosen = np.minimum(np.searchsorted(np.cumsum(weights), places), count - 1)
        particles.states = particles.states[chosen]
        particles.log_weights = np.full(count, -np.log(count))
