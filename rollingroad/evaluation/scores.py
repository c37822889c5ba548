"""How good the observer and the map were, against the truth of a simulated trip. What each figure means: DESIGN.md."""

import numpy as np
from numpy.typing import NDArray

from observer.estimate import Estimate
from vehicle_model.car.trip import Trip

SHIFT_MARGIN = 0.3
"""s on both sides of a change of gear or clutch that count as the shift."""


def at(trip: Trip, channel: str, time: NDArray[np.float64]) -> NDArray[np.float64]:
    """`channel` of the truth, linearly interpolated at `time` (n,), s."""
    return np.interp(time, trip.channels["time"], trip.channels[channel])


def driving(trip: Trip, time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """True where the engine drives with the clutch closed, outside shifts: the samples that thrust is judged on.

    `time` (n,), s on the trip's clock.
    """
    c = trip.channels
    closed = (c["clutch"] >= 1.0) & (c["gear"] >= 1.0)
    still = np.concatenate([[True], c["gear"][1:] == c["gear"][:-1]])
    quiet = _eroded(closed & still, round(SHIFT_MARGIN / trip.step))
    pushing = (c["thrust"] > 0.0) & (c["fuel_power"] > 0.0) & (c["brake_force"] <= 0.0) & (c["speed"] > 1.0)
    index = np.clip(np.round((time - c["time"][0]) / trip.step).astype(int), 0, len(c["time"]) - 1)
    return (quiet & pushing)[index]


def _eroded(mask: NDArray[np.bool_], radius: int) -> NDArray[np.bool_]:
    """`mask` shrunk by `radius` samples at each of its edges."""
    bad = np.cumsum(np.concatenate([[0], ~mask]))
    n = len(mask)
    low = np.clip(np.arange(n) - radius, 0, n)
    high = np.clip(np.arange(n) + radius + 1, 0, n)
    return bad[high] == bad[low]


def rms(values: NDArray[np.float64]) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


def observer_scores(estimate: Estimate, trip: Trip, *, clock_offset: float = 0.0) -> dict[str, float | None]:
    """Thrust and efficiency errors of the causal filter and of the smoother (`run --json`, "observer").

    `clock_offset` is the logger's clock minus the trip's, s. Thrust in N over `driving` samples; efficiency (fraction)
    of the causal filter where torque exceeds 10 Nm and engine speed 1,500 rpm, outside shifts.
    """
    time = estimate.time - clock_offset
    use = driving(trip, time)
    thrust = at(trip, "thrust", time)
    speed = at(trip, "speed", time)
    engine_speed = at(trip, "engine_speed", time)
    fuel = at(trip, "fuel_power", time)
    with np.errstate(divide="ignore", invalid="ignore"):
        torque = thrust * speed / engine_speed
        true = thrust * speed / fuel
        found = estimate.column("thrust") * estimate.column("speed") / estimate.column("fuel_power")
        # Where no fuel is believed to flow no efficiency is claimed: the whole of the true one is the error.
        error = np.where(estimate.column("fuel_power") > 0.0, found, 0.0) - true
    hard = use & (torque > 10.0) & (engine_speed > 1500.0 * 2.0 * np.pi / 60.0)
    smoothed = estimate.column("thrust", smoothed=True)
    return {
        "thrust_rmse_N": rms((estimate.column("thrust") - thrust)[use]),
        "thrust_rmse_smoothed_N": rms((smoothed - thrust)[use]),
        "thrust_rms_N": rms(thrust[use]),
        "efficiency_rmse": rms(error[hard]),
    }


def outage_seconds(trip: Trip, tunnel: int) -> float:
    """Time driven where satellites are hidden, s; `tunnel` is the value of `Trip.sky` there."""
    return float(np.count_nonzero(trip.channels["sky"] == tunnel) * trip.step)
