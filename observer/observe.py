"""From a log, a car file and a road map to the estimate: the asynchronous CD-EKF forwards, its smoother backwards."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from observer import kernel
from observer.estimate import STATES, Estimate
from observer.events import prepare, with_grid
from observer.model import KINDS
from observer.settings import DEFAULT, ObserverSettings
from sensors.log import SensorLog
from vehicle_model.car.parameters import Car, Mounting

if TYPE_CHECKING:
    from sensors.roadmap import RoadMap

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
sensor repeats itself; the first pulse after a silence, which only sets the zero; said by the sensor itself to be poor."""
_SEGMENT = 8192
"""Events per segment of the backward pass: its tape then stays in the processor's cache and memory does not grow."""
_ROWS_PER_EVENT = np.array([3, 1, 3, 5, 0, 2, 1, 1, 1, 3, 1])
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


def constants(car: Car) -> NDArray[np.float64]:
    """Return the car's and the box's constants in the order in which the kernel reads them."""
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
    return np.concatenate([head, rotation(car.mounting).ravel()])


def start(
    settings: ObserverSettings, learnt: Mapping[str, float] | None, time: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return state (NX,), covariance (NX, NX) and memory before the first event, at `time` (s)."""
    vector = settings.vector()
    x = np.zeros(kernel.NX)
    P = np.diag([kernel.initial_variance(i, vector) for i in range(kernel.NX)])
    x[13] = 90.0
    for name in ("bias_x", "bias_y", "bias_z"):
        if learnt and name in learnt:
            place = STATES.index(name)
            x[place] = learnt[name]
            P[place, place] = min(learnt.get(f"{name}_variance", P[place, place]) + 1e-6, P[place, place])
    memory = np.zeros(kernel.MEMORY)
    memory[kernel.M_SINCE :] = math.nan
    memory[
        [
            kernel.M_TICK_TIME,
            kernel.M_PULSE_TIME,
            kernel.M_FIX_NORTH,
            kernel.M_FIX_EAST,
            kernel.M_ACC_X,
            kernel.M_FIX_LATITUDE,
        ]
    ] = math.nan
    memory[kernel.M_TIME] = time
    return x, P, memory


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
    road_map: "RoadMap | None" = None,
    learnt: Mapping[str, float] | None = None,
    settings: ObserverSettings = DEFAULT,
) -> Estimate:
    """Return the estimate of the trip that `log` holds: causal filter and smoother at 10 Hz, one record per measurement.

    `learnt` is what an earlier trip's `Estimate.learnt` says (biases in m/s2 and their variances). The filter is the
    CD-EKF of A.3.1.3, the smoother the modified Bryson-Frazier form of the fixed-interval smoother.
    """
    packets, _ = prepare(log)
    events = with_grid(packets)
    x, P, memory = start(settings, learnt, float(events[0, 0]) if len(events) else 0.0)
    parameters, vector = constants(car), settings.vector()
    codes = events[:, 1].astype(np.intp)
    on_grid = codes == kernel.GRID
    count = int(np.count_nonzero(on_grid))
    rec = np.empty((int(_ROWS_PER_EVENT[codes].sum()), 7))
    grid_x, grid_P = np.empty((count, kernel.NX)), np.empty((count, kernel.NX))
    starts = range(0, len(events), _SEGMENT)
    checkpoints = []
    out = np.array([0, 0, 0, 1, 0, 0])
    blank = np.empty((1, kernel.TAPE_ROW)), np.zeros((2, 10), np.int64), np.empty((1, kernel.NX, kernel.NX))
    work = np.empty(64)
    for first in starts:
        checkpoints.append((x.copy(), P.copy(), memory.copy(), int(out[1])))
        last = min(first + _SEGMENT, len(events))
        kernel.advance(
            events, first, last, x, P, memory, parameters, vector, rec, grid_x, grid_P, out, *blank, work
        )
    smooth_x, smooth_P = _smooth(events, checkpoints, parameters, vector, grid_x, grid_P)
    biases = {name: STATES.index(name) for name in ("bias_x", "bias_y", "bias_z")}
    found = {name: float(x[place]) for name, place in biases.items()}
    found |= {f"{name}_variance": float(P[place, place]) for name, place in biases.items()}
    return Estimate(
        time=events[on_grid, 0],
        state=grid_x[:, :17].copy(),
        variance=grid_P[:, :17].copy(),
        smoothed=smooth_x[:, :17].copy(),
        smoothed_variance=smooth_P[:, :17].copy(),
        records=records_from(rec[: out[0]]),
        origin=(
            float(memory[kernel.M_LATITUDE]),
            float(memory[kernel.M_LONGITUDE]),
            float(memory[kernel.M_ALTITUDE]),
        ),
        learnt=found,
    )


def _smooth(
    events: NDArray[np.float64],
    checkpoints: list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], int]],
    parameters: NDArray[np.float64],
    settings: NDArray[np.float64],
    grid_x: NDArray[np.float64],
    grid_P: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Smooth backwards, segment by segment: each is filtered again from its checkpoint, with the tape running."""
    lines = _LINES_PER_EVENT * min(_SEGMENT, len(events)) + 1
    tape = np.empty((lines, kernel.TAPE_ROW))
    index = np.zeros((lines + 1, 10), np.int64)
    in_segment = max(
        (int(np.count_nonzero(events[i : i + _SEGMENT, 1] == kernel.GRID)) for i in range(0, len(events), _SEGMENT)),
        default=0,
    )
    tape_P = np.empty((in_segment, kernel.NX, kernel.NX))
    smooth_x, smooth_P = grid_x.copy(), grid_P.copy()
    lam, information = np.zeros(kernel.NX), np.zeros((kernel.NX, kernel.NX))
    nothing, work = np.empty((0, 7)), np.empty(64)
    for number in range(len(checkpoints) - 1, -1, -1):
        x, P, memory, line = (item.copy() if isinstance(item, np.ndarray) else item for item in checkpoints[number])
        out = np.array([0, line, 0, 0, 1, 0])
        first = number * _SEGMENT
        last = min(first + _SEGMENT, len(events))
        kernel.advance(
            events, first, last, x, P, memory, parameters, settings, nothing, grid_x, grid_P, out, tape, index, tape_P, work
        )
        kernel.retreat(tape, index, tape_P, out[2], lam, information, parameters, settings, smooth_x, smooth_P)
    return smooth_x, smooth_P
