"""Where on a known road the car is, without GPS: a particle filter on heading and slope (seed 000, chapter 6).

Seed 004, note 11: an odometer, a compass and an elevation map alone. The elevation map says the slope at each place;
the car's own is what its accelerometer feels beyond dv/dt, off by a bias that is a state too. Each particle is a place
along the road, an error of the odometer's scale, a bias of the slope and one of the compass.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.priors.bootstrap import systematic
from vehicle_model.car.randomness import generator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RoadShape:
    """What is known of the road: `s` (m,) increasing, m; `heading` (m,) unwrapped, rad; `pitch` (m,), rad."""

    s: Array
    heading: Array
    pitch: Array


@dataclass(frozen=True)
class Localiser:
    """Settings; deviations."""

    particles: int = 2000
    scale: float = 0.003
    """Of the odometer, relative: constant over a drive."""
    walk: float = 0.3
    """m per sqrt(step): what the odometer's scale does not explain."""
    pitch_noise: float = 0.012
    """rad, of a mean over one step: the accelerometer, the car's squat and the map's slope together."""
    pitch_bias: float = 0.03
    """rad: constant over a drive."""
    compass_noise: float = 0.04
    """rad, deviation of the compass and the map's heading together."""
    compass_bias: float = 0.03
    tail: float = 0.02
    """Share of the likelihood's peak that no reading falls below: outliers do not kill."""
    seed: int = 0

    def follow(
        self,
        road: RoadShape,
        moved: Array,
        pitch: Array | None,
        heading: Array | None,
        start: tuple[float, float] | None = None,
    ) -> tuple[Array, Array]:
        """Return place and its deviation (n,), m, after each step.

        `moved` (n,) m by the odometer over each step; `pitch` and `heading` (n,) rad seen over it, NaN or None where
        not; `start` place and deviation, m, None anywhere on the road.
        """
        rng = generator(self.seed, "localisation")
        count = self.particles
        if start is None:
            place = rng.uniform(road.s[0], road.s[-1], count)
        else:
            place = start[0] + start[1] * rng.standard_normal(count)
        scale = self.scale * rng.standard_normal(count)
        bias = self.pitch_bias * rng.standard_normal(count)
        turn = self.compass_bias * rng.standard_normal(count)
        log_weight = np.zeros(count)
        found, spread = np.empty(len(moved)), np.empty(len(moved))
        for k, distance in enumerate(moved):
            place = (
                place + distance * (1.0 + scale) + (self.walk if distance > 0.0 else 0.0) * rng.standard_normal(count)
            )
            outside = (place < road.s[0]) | (place > road.s[-1])
            log_weight = log_weight - 5.0 * outside
            if distance > 0.0:
                middle = place - 0.5 * distance
                if pitch is not None and np.isfinite(pitch[k]):
                    off = pitch[k] - bias - np.interp(middle, road.s, road.pitch)
                    log_weight = log_weight + _log_likelihood(off / self.pitch_noise, self.tail)
                if heading is not None and np.isfinite(heading[k]):
                    off = heading[k] - turn - np.interp(middle, road.s, road.heading)
                    off = (off + np.pi) % (2.0 * np.pi) - np.pi
                    log_weight = log_weight + _log_likelihood(off / self.compass_noise, self.tail)
            weight = np.exp(log_weight - log_weight.max())
            weight /= weight.sum()
            found[k] = weight @ place
            spread[k] = np.sqrt(weight @ (place - found[k]) ** 2)
            if 1.0 / np.sum(weight**2) < 0.5 * count:
                chosen = systematic(weight[None, :], rng)
                place, scale, bias, turn = place[chosen], scale[chosen], bias[chosen], turn[chosen]
                scale = scale + 0.02 * self.scale * rng.standard_normal(count)
                bias = bias + 0.02 * self.pitch_bias * rng.standard_normal(count)
                turn = turn + 0.02 * self.compass_bias * rng.standard_normal(count)
                log_weight = np.zeros(count)
            else:
                log_weight = np.log(np.maximum(weight, 1e-300))
        return found, spread


def _log_likelihood(z: Array, tail: float) -> Array:
    """Of a Gaussian with a flat tail; readings of one second are far from independent, hence the half."""
    return 0.5 * np.log(np.exp(-0.5 * z * z) + tail)
