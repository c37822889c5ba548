"""From a log, a car file and a road map to the estimate: the asynchronous CD-EKF forwards, its smoother backwards."""

import logging
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from observer import kernel
from observer.estimate import Estimate
from observer.events import fuel_steps, prepare, with_grid
from observer.model import KINDS, OMEGA, open_thrust
from observer.settings import DEFAULT, ObserverSettings
from sensors.log import SensorLog
from sensors.matching import observations
from sensors.roadmap import RoadMap
from vehicle_model.car.parameters import Car, Mounting

RECORD = np.dtype(
    [
        ("t", "f8"),
        ("kind", "U21"),
        ("value", "f8"),
        ("innovation", "f8"),
        ("variance", "f8"),
        ("nis", "f8"),
        ("fused", "?"),
        ("reason", "U10"),
    ]
)
"""One row per scalar measurement: SI units of `observer.model.KINDS`; `reason` is empty where it was simply fused."""
REASONS = np.array(["", "gate", "not_finite", "reopened", "stuck", "anchor", "poor"])
"""By code of `observer.kernel`: beyond the gate; not a number; fused after a gate had been shut for too long; the
sensor repeats itself; the first pulse after a silence, which only sets the zero; said by the sensor to be poor."""
LOGGER = logging.getLogger("observer")
"""Told of what a healthy run never does."""
LEARNT = {
    "bias_x": kernel.BIAS_X,
    "bias_y": kernel.BIAS_Y,
    "bias_z": kernel.BIAS_Z,
    "odometer_slip": kernel.SLIP,
    "odometer_scale": kernel.SCALE,
}
"""What a trip leaves to the next (`Estimate.learnt`, with `..._variance`), and its place in the kernel's state."""
_UNKNOWN = (
    kernel.M_TICK_TIME,
    kernel.M_PULSE_TIME,
    kernel.M_FIX_NORTH,
    kernel.M_FIX_EAST,
    kernel.M_ACC_X,
    kernel.M_FIX_LATITUDE,
    kernel.M_STANDSTILL,
)
"""Places of the memory that start as unknown."""
SEGMENT = 8192
"""Events per segment of the backward pass: its tape then stays in the processor's cache and memory does not grow."""
SPIKE = 1.5
"""m/s2: ten usual deviations of a difference at low speed, five at 130 km/h."""
SPIKE_DEVIATIONS, SPIKE_WINDOW = 5.0, 201
"""Where the accelerometer is noisier than that: in deviations of a reading, as the median over so many shows it."""
_ROWS_PER_EVENT = np.array([3, 2, 5, 6, 0, 2, 1, 1, 1, 3, 1, 1])
"""Most scalar measurements that an event of each code can give."""
_LINES_PER_EVENT = 16
"""Most lines of tape that an event can give."""


def pulse_angle(car: Car) -> float:
    """Return the engine's rotation from one injector pulse to the next, rad (seed 004, 2.3.4.1).

    sequential: 4 pi (one injector is tapped); grouped:N: 4 pi / N; simultaneous: 4 pi / cylinders.
    """
    pattern = car.injector.pattern
    if pattern.startswith("simultaneous"):
        return 4.0 * math.pi / car.engine.cylinders
    if pattern.startswith("grouped"):
        return 4.0 * math.pi / int(pattern.split(":")[1])
    return 4.0 * math.pi


def rotation(mounting: Mounting) -> NDArray[np.float64]:
    """Return the matrix (3, 3) from the sensor's axes to the body's: scale Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = math.cos(mounting.roll), math.sin(mounting.roll)
    cp, sp = math.cos(mounting.pitch), math.sin(mounting.pitch)
    cy, sy = math.cos(mounting.yaw), math.sin(mounting.yaw)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return mounting.scale * about_z @ about_y @ about_x


def constants(car: Car, squat: float = 0.0) -> NDArray[np.float64]:
    """Return the car's and the box's constants in the order in which the kernel reads them; `squat` in rad per g."""
    head = [
        car.mass,
        car.accelerated_mass,
        car.gravity,
        0.5 * car.air_density * car.drag_area,
        car.mass * car.rolling_resistance,
        car.metres_per_tick,
        car.injector_power,
        car.injector.lag,
        pulse_angle(car),
    ]
    still = -open_thrust(0.0, car)
    return np.concatenate([head, rotation(car.mounting).ravel(), [squat, still, -open_thrust(1.0, car) - still]])


def trip_change(settings: ObserverSettings) -> dict[str, float]:
    """Variance by which each of `LEARNT` changes from trip to trip: loads shift, tyres cool."""
    return dict.fromkeys(("bias_x", "bias_y", "bias_z"), settings.bias_trip_deviation**2) | {
        "odometer_slip": (0.1 * settings.slip_deviation) ** 2,
        "odometer_scale": settings.scale_trip_deviation**2,
    }


def start(car: Car, settings: ObserverSettings, learnt: Mapping[str, float] | None, time: float) -> kernel.Filter:
    """Return the filter before the first event, at `time` (s), with nothing recorded and no tape."""
    vector = settings.vector()
    x = np.zeros(kernel.NX)
    P = np.diag([kernel.initial_variance.py_func(i, vector) for i in range(kernel.NX)])
    x[OMEGA] = car.engine.idle_speed
    x[kernel.SLIP] = settings.slip
    change = trip_change(settings)
    for name, place in LEARNT.items():
        if learnt and name in learnt:
            x[place] = learnt[name]
            P[place, place] = min(learnt.get(f"{name}_variance", P[place, place]) + change[name], P[place, place])
    memory = np.zeros(kernel.MEMORY)
    memory[list(_UNKNOWN)] = math.nan
    memory[kernel.M_SINCE :] = math.nan
    memory[kernel.M_TIME] = time
    return kernel.Filter(
        x=x,
        P=P,
        memory=memory,
        car=constants(car, settings.body_squat),
        settings=vector,
        records=np.empty((0, 7)),
        grid_x=np.empty((0, kernel.NX)),
        grid_P=np.empty((0, kernel.NX)),
        counts=np.zeros(6, np.int64),
        tape=np.empty((1, kernel.TAPE_ROW)),
        tape_index=np.zeros((2, 10), np.int64),
        tape_P=np.empty((1, kernel.NX, kernel.NX)),
        work=np.empty(kernel.WORK),
    )


def tell_repairs(f: kernel.Filter, known: int) -> int:
    """Log the covariance's resets beyond the `known` ones; return how many there have been in all."""
    repairs = int(f.memory[kernel.M_REPAIRS])
    if repairs > known:
        LOGGER.warning(
            "covariance not positive up to %.1f s: states reset, %d times", f.memory[kernel.M_TIME], repairs - known
        )
    return repairs


def records_from(rows: NDArray[np.float64]) -> NDArray:
    """Return the kernel's record rows (m, 7) as the structured array of `Estimate.records`."""
    records = np.empty(len(rows), RECORD)
    reason = rows[:, 6].astype(np.intp)
    records["t"] = rows[:, 0]
    records["kind"] = np.array(KINDS)[rows[:, 1].astype(np.intp)]
    for place, name in enumerate(("value", "innovation", "variance", "nis"), start=2):
        records[name] = rows[:, place]
    records["fused"] = (reason == kernel.FUSED) | (reason == kernel.REOPENED)
    records["reason"] = REASONS[reason]
    return records


def observe(
    log: SensorLog,
    car: Car,
    road_map: RoadMap | None = None,
    learnt: Mapping[str, float] | None = None,
    settings: ObserverSettings = DEFAULT,
) -> Estimate:
    """Return the estimate of the trip that `log` holds: causal filter and smoother at 10 Hz, and its records.

    `learnt` is what an earlier trip's `Estimate.learnt` says (`LEARNT`: biases in m/s2, the odometer's slip and scale).
    The filter is the CD-EKF of A.3.1.3, the smoother the modified Bryson-Frazier form of the fixed-interval smoother.
    """
    passages = None if road_map is None else observations(log, road_map, car.metres_per_tick, settings.gps_lag)
    packets, _ = prepare(log, passages)
    events = with_grid(packets)
    begin = float(events[0, 0]) if len(events) else 0.0
    fresh = start(car, settings, learnt, begin)
    codes = events[:, 1].astype(np.intp)
    on_grid = codes == kernel.GRID
    lines = int(np.count_nonzero(on_grid))
    f = fresh._replace(
        records=np.empty((int(_ROWS_PER_EVENT[codes].sum()), 7)),
        grid_x=np.empty((lines, kernel.NX)),
        grid_P=np.empty((lines, kernel.NX)),
    )
    f.counts[kernel.RECORDING] = 1
    kernel.advance(events, 0, len(events), f)
    tell_repairs(f, 0)
    smooth_x, smooth_P = _smooth(packets, start(car, settings, learnt, begin))
    x, P, memory = f.x, f.P, f.memory
    found = {name: float(x[place]) for name, place in LEARNT.items()}
    found |= {f"{name}_variance": float(P[place, place]) for name, place in LEARNT.items()}
    return Estimate(
        time=events[on_grid, 0],
        state=f.grid_x[:, :17].copy(),
        variance=f.grid_P[:, :17].copy(),
        smoothed=smooth_x[:, :17].copy(),
        smoothed_variance=smooth_P[:, :17].copy(),
        records=records_from(f.records[: f.counts[kernel.RECORDS]]),
        origin=(
            float(memory[kernel.M_LATITUDE]),
            float(memory[kernel.M_LONGITUDE]),
            float(memory[kernel.M_ALTITUDE]),
        ),
        learnt=found,
    )


class Hindsight(NamedTuple):
    """The filter run once more, knowing when the fuel changed; ready to be gone through backwards."""

    events: NDArray[np.float64]
    """(n, COLUMNS), with STEP and GRID rows."""
    filter: kernel.Filter
    checkpoints: list[tuple[NDArray, ...]]
    """x, P, memory and counts at the beginning of each segment of `SEGMENT` events."""

    def tape(self, number: int, beyond: float = 0.0) -> kernel.Filter:
        """Filter segment `number` again, with the tape running, and on for `beyond` seconds after its end."""
        first = number * SEGMENT
        last = min(first + SEGMENT, len(self.events))
        if beyond > 0.0:
            last = int(np.searchsorted(self.events[:, 0], self.events[last - 1, 0] + beyond, side="right"))
        lines = _LINES_PER_EVENT * (last - first) + 1
        on_grid = int(np.count_nonzero(self.events[first:last, 1] == kernel.GRID))
        x, P, memory, counts = (array.copy() for array in self.checkpoints[number])
        counts[[kernel.RECORDING, kernel.TAPING, kernel.TAPE_LINES, kernel.TAPE_GRID]] = 0, 1, 0, 0
        f = self.filter._replace(
            x=x,
            P=P,
            memory=memory,
            counts=counts,
            tape=np.empty((lines, kernel.TAPE_ROW)),
            tape_index=np.zeros((lines + 1, 10), np.int64),
            tape_P=np.empty((on_grid, kernel.NX, kernel.NX)),
        )
        kernel.advance(self.events, first, last, f)
        return f


def without_spikes(packets: NDArray[np.float64], forward: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `packets` (n, COLUMNS) with readings of the accelerometer that stand out alone made NaN.

    Alone: along `forward` (3,), the car's x in the sensor's axes, or in length, on the same side of both neighbours by
    `SPIKE`, or by `SPIKE_DEVIATIONS` of the readings around it if that is more. What moves a car lasts longer than one
    reading. The forward axis is looked at twice: of two spikes in a row the second stands alone once the first is gone,
    unless they are alike.
    """
    place = np.flatnonzero(packets[:, 1] == kernel.ACCELEROMETER)
    clean = packets.copy()
    with np.errstate(all="ignore"):
        readings = packets[place, 2:5]
        ahead, length = readings @ forward, np.sqrt(np.sum(readings * readings, axis=1))
        left = np.arange(len(place))
        for values in (ahead, length, ahead):
            alone = 1 + np.flatnonzero(_stands_out(values[left]))
            clean[place[left[alone]], 2:5] = math.nan
            left = np.delete(left, alone)
    return clean


def _stands_out(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each of `values` (n,), the ends left out, lies alone on one side of both its neighbours: (n - 2,)."""
    if len(values) < 3:
        return np.zeros(0, bool)
    step = np.diff(values)
    before, after = step[:-1], -step[1:]
    # white noise of deviation s makes the sum of both differences scatter by s times the root of 6
    usual = median_filter(np.nan_to_num(np.abs(before + after)), SPIKE_WINDOW, mode="nearest")
    least = np.maximum(SPIKE, SPIKE_DEVIATIONS * usual / (0.6745 * math.sqrt(6.0)))
    return (np.minimum(before, after) > least) | (np.maximum(before, after) < -least)


def hindsight(packets: NDArray[np.float64], fresh: kernel.Filter) -> Hindsight:
    """Filter the admitted `packets` once more from `fresh`, knowing when the fuel changed (`events.fuel_steps`).

    Thrust may then change there and only there; else this is the causal filter.
    """
    parameters, settings = fresh.car, fresh.settings
    packets = without_spikes(packets, parameters[kernel.P_ROTATION : kernel.P_ROTATION + 3])
    steps = fuel_steps(
        packets, parameters[kernel.P_PULSE_LAG], parameters[kernel.P_PULSE_POWER], settings[kernel.S_CUT_GAP]
    )
    events = with_grid(packets, steps)
    fresh.memory[kernel.M_HINDSIGHT] = 1.0
    lines = int(np.count_nonzero(events[:, 1] == kernel.GRID))
    f = fresh._replace(grid_x=np.empty((lines, kernel.NX)), grid_P=np.empty((lines, kernel.NX)))
    checkpoints = []
    for first in range(0, len(events), SEGMENT):
        checkpoints.append(tuple(array.copy() for array in (f.x, f.P, f.memory, f.counts)))
        kernel.advance(events, first, min(first + SEGMENT, len(events)), f)
    return Hindsight(events, f, checkpoints)


def _smooth(packets: NDArray[np.float64], fresh: kernel.Filter) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Smooth the admitted `packets` over the whole trip, backwards, segment by segment: memory does not grow."""
    back = hindsight(packets, fresh)
    smooth_x, smooth_P = back.filter.grid_x.copy(), back.filter.grid_P.copy()
    adjoint, information = np.zeros(kernel.NX), np.zeros((kernel.NX, kernel.NX))
    for number in range(len(back.checkpoints) - 1, -1, -1):
        f = back.tape(number)
        kernel.retreat(f, 0, f.counts[kernel.TAPE_LINES], -1, adjoint, information, smooth_x, smooth_P)
    return smooth_x, smooth_P
