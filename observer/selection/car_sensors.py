"""The car's candidate sensors: the 17-state model linearised at operating points, with what each sensor would tell.

The injector's pulses are always there. Sampled sensors of variance r at rate f become white noise of density r / f.
Two slow errors (the altitudes of GPS and barometer) are states of their own, beyond the 17, since white noise of their
size would forbid what they tell well: changes. A small leak keeps states that a set cannot see (place, heading without
GPS) from growing for ever: the norm is that over a trip of `HORIZON`.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer import model
from observer.selection.h2 import LinearSystem
from observer.settings import DEFAULT, ObserverSettings
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]
HORIZON = 1000.0
"""s."""
THRUST_UNIT, PITCH_UNIT, EFFICIENCY_UNIT = 40.0, 0.002, 0.02
"""N, rad, fraction: errors that count as 1 in the norm (5 % of a usual thrust; what that thrust's weight is on a slope;
two points of efficiency)."""
PRICES = {
    "gps": 12.0,
    "accelerometer_x": 1.5,
    "accelerometer_y": 1.5,
    "accelerometer_z": 1.5,
    "wheel": 5.0,
    "road_map": 8.0,
    "gyroscope": 4.0,
    "compass": 2.5,
    "barometer": 3.0,
}
"""EUR apiece, our assumption: order of magnitude of parts with their wiring (GNSS module; a three-axis
accelerometer by axis; Hall sensor; memory and licence of a map; two-axis rate gyroscope; magnetometer; pressure)."""
SENSORS = tuple(PRICES)
GPS_DRIFT, BAROMETER_DRIFT = 17, 18
STATES = 19


@dataclass(frozen=True)
class OperatingPoint:
    """Steady driving: speed (m/s), grade (rad), gear's overall ratio place, curvature (rad/m), efficiency."""

    speed: float
    pitch: float = 0.0
    gear: int = 5
    straightness: float = 0.0
    acceleration: float = 0.0
    efficiency: float = 0.25


POINTS = (
    OperatingPoint(14.0, gear=4, straightness=0.005),
    OperatingPoint(16.0, pitch=0.04, gear=4, straightness=0.002),
    OperatingPoint(25.0, gear=6, straightness=0.001),
)
"""Town, a hill, a country road."""


@dataclass(frozen=True)
class _Row:
    sensor: str
    gradient: Array
    density: float


def _state(car: Car, point: OperatingPoint) -> Array:
    x = np.zeros(17)
    x[model.V], x[model.THETA], x[model.SJ], x[model.PSI] = point.speed, point.pitch, point.straightness, 0.5
    x[model.F] = car.accelerated_mass * (point.acceleration - model.acceleration(x, car))
    gear = min(point.gear, len(car.gear_ratios))
    x[model.OMEGA] = car.gear_ratios[gear - 1] * point.speed / car.wheel_radius
    x[model.PIN] = x[model.F] * point.speed / point.efficiency
    return x


def _dynamics(x: Array, car: Car, s: ObserverSettings) -> tuple[Array, Array]:
    """A (19, 19) and the densities (19,) of the process noise."""
    a = np.zeros((STATES, STATES))
    a[:17, :17] = model.dynamics_jacobian(x, car)
    v, power = x[model.V], x[model.PIN]
    q = np.zeros(STATES)
    q[[model.X, model.V, model.F, model.PSI, model.THETA]] = (
        s.distance_noise, s.speed_noise, s.thrust_noise, s.heading_noise, s.pitch_noise,
    )  # fmt: skip
    # thrust follows the fuel: a change of power of usual size, once a second, foretold only in part
    q[model.F] += (0.3 * s.thrust_gain * 0.2 * power / v) ** 2
    q[[model.N, model.E, model.D]] = s.position_noise, s.position_noise, s.down_noise
    q[model.SJ], q[model.SK] = s.straightness_noise * v, s.vertical_straightness_noise * v
    q[[model.EIN, model.PIN, model.ANGLE, model.OMEGA]] = (
        s.energy_noise, s.power_noise, s.angle_noise, s.engine_speed_noise,
    )  # fmt: skip
    # biases as learnt from earlier trips: 0.02 m/s2, slowly changing
    q[[model.BX, model.BY, model.BZ]] = 2.0 * 0.02**2 / HORIZON
    a -= np.eye(STATES) / HORIZON
    # bends and crests end after a hundred metres
    for curved in (model.SJ, model.SK):
        a[curved, curved] -= v / 100.0
    for drift, size, time in (
        (GPS_DRIFT, s.gps_vertical_drift, s.gps_vertical_drift_time),
        (BAROMETER_DRIFT, 3.0, 600.0),
    ):
        a[drift, drift] = -1.0 / time
        q[drift] = 2.0 * size**2 / time
    return a, q


def _rows(x: Array, car: Car, s: ObserverSettings) -> list[_Row]:
    v, omega, power = x[model.V], x[model.OMEGA], x[model.PIN]

    def row(sensor: str, kind: int, variance: float, rate: float, drift: int | None = None) -> _Row:
        gradient = np.zeros(STATES)
        gradient[:17] = model.measurement_jacobian(kind, x, car)
        if drift is not None:
            gradient[drift] = 1.0
        return _Row(sensor, gradient, variance / rate)

    pulses = omega / (4.0 * np.pi)
    plane, vertical = s.accelerometer_floor + s.accelerometer_slope * v, s.accelerometer_vertical_floor
    vertical += s.accelerometer_vertical_slope * v
    nodes = v / 50.0
    horizontal = s.gps_white**2 / 5.0 + 2.0 * s.gps_drift**2 * s.gps_drift_time
    return [
        row("injector", model.FUEL_POWER, (s.pulse_deviation * power) ** 2, pulses),
        row("injector", model.ENGINE_ANGLE, (omega * s.pulse_clock) ** 2 / 12.0, pulses),
        row("gps", model.GPS_NORTH, horizontal, 1.0),
        row("gps", model.GPS_EAST, horizontal, 1.0),
        row("gps", model.GPS_ALTITUDE, s.gps_vertical_white**2, 5.0, GPS_DRIFT),
        row("gps", model.GPS_SPEED, s.gps_speed**2, 5.0),
        row("gps", model.GPS_COURSE, (s.gps_course / v) ** 2, 5.0),
        row("accelerometer_x", model.ACCELERATION_X, plane**2, 40.0),
        row("accelerometer_y", model.ACCELERATION_Y, plane**2, 40.0),
        row("accelerometer_z", model.ACCELERATION_Z, vertical**2, 40.0),
        row("wheel", model.DISTANCE, s.tooth_deviation**2 + (s.tick_clock * v) ** 2 / 12.0, v / car.metres_per_tick),
        row("road_map", model.MAP_HEADING, 0.02**2, nodes),
        row("road_map", model.MAP_ALTITUDE, 1.0, nodes),
        row("road_map", model.MAP_STRAIGHTNESS, 1e-3**2, nodes),
        row("gyroscope", model.YAW_RATE, s.gyroscope**2, 40.0),
        row("gyroscope", model.PITCH_RATE, s.gyroscope**2, 40.0),
        row("compass", model.COMPASS, s.compass**2, 10.0),
        row("barometer", model.GPS_ALTITUDE, 0.5**2, 10.0, BAROMETER_DRIFT),
    ]


def car_systems(
    car: Car, points: tuple[OperatingPoint, ...] = POINTS, settings: ObserverSettings = DEFAULT
) -> tuple[LinearSystem, ...]:
    """Return the linear systems of `car` at `points` with the candidates `SENSORS`, scaled states, z in our units."""
    systems = []
    for point in points:
        x = _state(car, point)
        a, q = _dynamics(x, car, settings)
        rows = _rows(x, car, settings)
        v, force, power = x[model.V], x[model.F], x[model.PIN]
        weight = np.zeros((3, STATES))
        weight[0, model.F] = 1.0 / THRUST_UNIT
        weight[1, model.THETA] = 1.0 / PITCH_UNIT
        # eta = F v / P_in
        weight[2, [model.F, model.V, model.PIN]] = v / power, force / power, -force * v / power**2
        weight[2] /= EFFICIENCY_UNIT
        scale = np.ones(STATES)
        scale[[model.F, model.PIN, model.EIN]] = 100.0, 1e3, 1e3
        scale[[model.PSI, model.THETA, model.SJ, model.SK]] = 0.01, 0.01, 1e-3, 1e-4
        scale[[model.BX, model.BY, model.BZ]] = 0.02
        system = LinearSystem(
            a,
            np.diag(np.sqrt(q)),
            np.array([r.gradient for r in rows]),
            np.sqrt([r.density for r in rows]),
            weight,
            tuple(tuple(i for i, r in enumerate(rows) if r.sensor == name) for name in SENSORS),
            SENSORS,
        )
        systems.append(system.scaled(scale))
    return tuple(systems)


def cost(names: tuple[str, ...], prices: Mapping[str, float] = PRICES) -> float:
    """Sum of the prices of the sensors `names`, EUR."""
    return float(sum(prices[name] for name in names))
