"""The 17-state model of seed 004, equations 1.16 to 1.18, in one place: f, h per measurement, and their Jacobians.

This is the readable reference. Every function is written once for numbers and for CasADi symbols alike (pass
`m=casadi`), so that the Jacobians written out here are held against automatic differentiation, and
`observer.kernel`, which repeats them sparse and compiled, is held against this module.

Conventions are those of `vehicle_model.car`. Where we depart from the print:

* accelerations are specific forces, `a_x = dv/dt + g sin(theta)`, `a_y = -S_j v^2`, `a_z = g cos(theta) + S_k v^2`
  (ERRATA on 1.5, 1.6, 1.9, 1.18); equation 1.18's own row stays available as `ACCELERATION_X_THESIS`;
* the air drag and the rolling resistance change sign with the speed over a narrow band, `v / sqrt(v^2 + e^2)`, so that
  the model has a Jacobian at standstill (1.16 has sign(v));
* a satellite fix is late: its rows say where the car was `lag` seconds ago, to second order in the lag.
"""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.estimate import STATES
from vehicle_model.car.parameters import Car

X, V, F, PSI, THETA, N, E, D, SJ, SK, EIN, PIN, ANGLE, OMEGA, BX, BY, BZ = range(17)
"""Indices of the states, in the order of `observer.estimate.STATES`."""

SIGN_BAND = 0.1
"""m/s: width of the band in which drag changes sign with the speed."""

DISTANCE, ACCELERATION_X, ACCELERATION_Y, ACCELERATION_Z = 0, 1, 2, 3
GPS_NORTH, GPS_EAST, GPS_ALTITUDE, GPS_SPEED, GPS_COURSE = 4, 5, 6, 7, 8
MAP_HEADING, MAP_ALTITUDE, MAP_STRAIGHTNESS, PITCH = 9, 10, 11, 12
INJECTED_ENERGY, ENGINE_ANGLE, FUEL_POWER, SPEED = 13, 14, 15, 16
YAW_RATE, PITCH_RATE, COMPASS, ACCELERATION_X_THESIS, PULSE_POWER = 17, 18, 19, 20, 21
SILENT_WHEELS, CUT_OFF, OPEN_CLUTCH = 22, 23, 24
KINDS = (
    "distance",
    "acceleration_x",
    "acceleration_y",
    "acceleration_z",
    "gps_north",
    "gps_east",
    "gps_altitude",
    "gps_speed",
    "gps_course",
    "map_heading",
    "map_altitude",
    "map_straightness",
    "pitch",
    "injected_energy",
    "engine_angle",
    "fuel_power",
    "speed",
    "yaw_rate",
    "pitch_rate",
    "compass",
    "acceleration_x_thesis",
    "pulse_power",
    "silent_wheels",
    "cut_off",
    "open_clutch",
)
"""Names of the scalar measurements, by code.

`distance` x_im (m); `acceleration_*` a_im, a_jm, a_km (m/s2); `gps_*` position (m), Doppler speed (m/s, note 4) and
course (rad); `map_*` DEM_psi (rad), DEM_alt (m), S_j (rad/m); `pitch` theta_m (rad); `injected_energy`
INJ_duration (J);
`engine_angle` INJ_time (rad); `pulse_power` the power that one injector pulse stands for (W), through its energy per
radian: P_in - (energy / angle) omega_e = 0; `fuel_power` (W) and `speed` (m/s) from logs that carry them;
`silent_wheels` a speed (m/s) and `cut_off` a fuel power (W), told by pulses that do not come;
`open_clutch` the forward specific force (m/s2) while the engine drives nothing, told by an engine that falls behind its
gear;
`yaw_rate` and `pitch_rate` about z (up) and y (left) in rad/s; `compass` (rad); `acceleration_x_thesis` equation 1.18.
"""
HEADINGS = (GPS_COURSE, MAP_HEADING, COMPASS)
"""Kinds whose innovation is an angle and is wrapped to [-pi, pi)."""

assert len(STATES) == 17


def acceleration(x: Any, car: Car, m: ModuleType = math) -> Any:
    """dv/dt in m/s2 (second line of 1.16). `x` is indexable by the state indices."""
    v, theta = x[V], x[THETA]
    sign = v / m.sqrt(v * v + SIGN_BAND * SIGN_BAND)
    drag = 0.5 * car.air_density * car.drag_area * v * v
    rolling = car.mass * car.rolling_resistance * (car.gravity * m.cos(theta) + x[SK] * v * v)
    return (x[F] - sign * (drag + rolling) - car.mass * car.gravity * m.sin(theta)) / car.accelerated_mass


def open_thrust(v: Any, car: Car) -> Any:
    """Thrust (N) at the speed `v` (m/s) with the clutch open: the drag of the gears (`vehicle_model.car.nominal`)."""
    dragged = 0.5 * car.driveline.drag_torque / car.wheel_radius
    return -dragged * (1.0 + v / (60.0 * car.wheel_radius))


def dynamics(x: Any, car: Car, m: ModuleType = math) -> list[Any]:
    """f(x) of 1.16 and 1.17: the time derivatives of the 17 states, as a list."""
    v, psi, theta = x[V], x[PSI], x[THETA]
    rate: list[Any] = [0.0] * 17
    rate[X] = v
    rate[V] = acceleration(x, car, m)
    rate[PSI] = x[SJ] * v
    rate[THETA] = x[SK] * v
    rate[N] = v * m.cos(psi) * m.cos(theta)
    rate[E] = v * m.sin(psi) * m.cos(theta)
    rate[D] = -v * m.sin(theta)
    rate[EIN] = x[PIN]
    rate[ANGLE] = x[OMEGA]
    return rate


def acceleration_gradient(x: NDArray[np.float64], car: Car) -> NDArray[np.float64]:
    """d(dv/dt)/dx, shape (17,): row 2 of equation 3.4."""
    v, theta, sk = x[V], x[THETA], x[SK]
    root = math.sqrt(v * v + SIGN_BAND**2)
    sign, slope = v / root, SIGN_BAND**2 / root**3
    drag = 0.5 * car.air_density * car.drag_area
    rolling = car.mass * car.rolling_resistance
    load = drag * v * v + rolling * (car.gravity * math.cos(theta) + sk * v * v)
    row = np.zeros(17)
    row[V] = -(slope * load + sign * 2.0 * v * (drag + rolling * sk)) / car.accelerated_mass
    row[F] = 1.0 / car.accelerated_mass
    row[THETA] = (
        sign * rolling * car.gravity * math.sin(theta) - car.mass * car.gravity * math.cos(theta)
    ) / car.accelerated_mass
    row[SK] = -sign * rolling * v * v / car.accelerated_mass
    return row


def dynamics_jacobian(x: NDArray[np.float64], car: Car) -> NDArray[np.float64]:
    """A_c = df/dx, shape (17, 17): equation 3.4 (with A_{5,10} for the misprinted A_{4,10})."""
    v, psi, theta = x[V], x[PSI], x[THETA]
    a = np.zeros((17, 17))
    a[X, V] = 1.0
    a[V] = acceleration_gradient(x, car)
    a[PSI, V], a[PSI, SJ] = x[SJ], v
    a[THETA, V], a[THETA, SK] = x[SK], v
    cp, sp, ct, st = math.cos(psi), math.sin(psi), math.cos(theta), math.sin(theta)
    a[N, V], a[N, PSI], a[N, THETA] = cp * ct, -v * sp * ct, -v * cp * st
    a[E, V], a[E, PSI], a[E, THETA] = sp * ct, v * cp * ct, -v * sp * st
    a[D, V], a[D, THETA] = -st, -v * ct
    a[EIN, PIN] = 1.0
    a[ANGLE, OMEGA] = 1.0
    return a


def measurement(kind: int, x: Any, car: Car, aux: float = 0.0, m: ModuleType = math, squat: float = 0.0) -> Any:
    """h(x) of the scalar measurement `kind`, in the units of `KINDS`.

    `aux` is the lag in seconds of the `gps_*` kinds, of `map_heading` and `map_altitude` (the row is of the state at
    t - lag) and the energy per radian (J/rad) of `pulse_power`; otherwise it is not used. `squat` (rad per g) is how
    far the body on its springs turns nose-up, and the sensor with it: to first order it reads `squat` dv/dt more
    forwards (upwards a hundredth of that: left out).
    """
    v, psi, theta = x[V], x[PSI], x[THETA]
    if kind == DISTANCE:
        return x[X]
    if kind in (ACCELERATION_X, OPEN_CLUTCH):
        a = acceleration(x, car, m)
        if kind == OPEN_CLUTCH:
            a += (open_thrust(v, car) - x[F]) / car.accelerated_mass
        return (1.0 + squat) * a + car.gravity * m.sin(theta) + x[BX]
    if kind == ACCELERATION_X_THESIS:
        return acceleration(x, car, m) + car.mass / car.accelerated_mass * car.gravity * m.sin(theta) + x[BX]
    if kind == ACCELERATION_Y:
        return -x[SJ] * v * v + x[BY]
    if kind == ACCELERATION_Z:
        return car.gravity * m.cos(theta) + x[SK] * v * v + x[BZ]
    if kind in (GPS_NORTH, GPS_EAST, GPS_ALTITUDE, MAP_ALTITUDE):
        way = aux * (v - 0.5 * aux * acceleration(x, car, m))
        heading = psi - 0.5 * aux * x[SJ] * v
        if kind == GPS_NORTH:
            return x[N] - way * m.cos(heading) * m.cos(theta)
        if kind == GPS_EAST:
            return x[E] - way * m.sin(heading) * m.cos(theta)
        return -x[D] - way * m.sin(theta)
    if kind == GPS_SPEED:
        return v - aux * acceleration(x, car, m)
    if kind in (GPS_COURSE, MAP_HEADING):
        return psi - aux * x[SJ] * v
    if kind == COMPASS:
        return psi
    if kind == PULSE_POWER:
        return x[PIN] - aux * x[OMEGA]
    if kind == YAW_RATE:
        return -x[SJ] * v
    if kind == PITCH_RATE:
        return -x[SK] * v
    simple = {
        MAP_STRAIGHTNESS: SJ,
        PITCH: THETA,
        INJECTED_ENERGY: EIN,
        ENGINE_ANGLE: ANGLE,
        FUEL_POWER: PIN,
        CUT_OFF: PIN,
        SPEED: V,
        SILENT_WHEELS: V,
    }
    return x[simple[kind]]


def measurement_jacobian(
    kind: int, x: NDArray[np.float64], car: Car, aux: float = 0.0, squat: float = 0.0
) -> NDArray[np.float64]:
    """H = dh/dx of the scalar measurement `kind`, shape (17,) (17 columns: ERRATA on the printed 18)."""
    v, psi, theta = x[V], x[PSI], x[THETA]
    h = np.zeros(17)
    if kind in (ACCELERATION_X, ACCELERATION_X_THESIS, OPEN_CLUTCH):
        as_printed = kind == ACCELERATION_X_THESIS
        h += (1.0 if as_printed else 1.0 + squat) * acceleration_gradient(x, car)
        share = car.mass / car.accelerated_mass if as_printed else 1.0
        h[THETA] += share * car.gravity * math.cos(theta)
        h[BX] = 1.0
        if kind == OPEN_CLUTCH:
            h[F] = 0.0
            h[V] += (1.0 + squat) * (open_thrust(1.0, car) - open_thrust(0.0, car)) / car.accelerated_mass
    elif kind == ACCELERATION_Y:
        h[V], h[SJ], h[BY] = -2.0 * x[SJ] * v, -v * v, 1.0
    elif kind == ACCELERATION_Z:
        h[V], h[THETA], h[SK], h[BZ] = 2.0 * x[SK] * v, -car.gravity * math.sin(theta), v * v, 1.0
    elif kind in (GPS_NORTH, GPS_EAST, GPS_ALTITUDE, MAP_ALTITUDE):
        way = aux * (v - 0.5 * aux * acceleration(x, car))
        slope = -0.5 * aux * aux * acceleration_gradient(x, car)
        slope[V] += aux
        if kind in (GPS_ALTITUDE, MAP_ALTITUDE):
            h -= slope * math.sin(theta)
            h[THETA] -= way * math.cos(theta)
            h[D] = -1.0
        else:
            heading = psi - 0.5 * aux * x[SJ] * v
            along, across = math.cos(heading), math.sin(heading)
            if kind == GPS_EAST:
                along, across = across, -along
            h -= slope * along * math.cos(theta)
            h[THETA] += way * along * math.sin(theta)
            turn = way * across * math.cos(theta)
            h[PSI] += turn
            h[SJ] -= 0.5 * aux * v * turn
            h[V] -= 0.5 * aux * x[SJ] * turn
            h[N if kind == GPS_NORTH else E] = 1.0
    elif kind == GPS_SPEED:
        h -= aux * acceleration_gradient(x, car)
        h[V] += 1.0
    elif kind in (GPS_COURSE, MAP_HEADING):
        h[PSI], h[SJ], h[V] = 1.0, -aux * v, -aux * x[SJ]
    elif kind == PULSE_POWER:
        h[PIN], h[OMEGA] = 1.0, -aux
    elif kind == YAW_RATE:
        h[SJ], h[V] = -v, -x[SJ]
    elif kind == PITCH_RATE:
        h[SK], h[V] = -v, -x[SK]
    else:
        simple = {
            DISTANCE: X,
            COMPASS: PSI,
            MAP_STRAIGHTNESS: SJ,
            PITCH: THETA,
            INJECTED_ENERGY: EIN,
            ENGINE_ANGLE: ANGLE,
            FUEL_POWER: PIN,
            CUT_OFF: PIN,
            SPEED: V,
            SILENT_WHEELS: V,
        }
        h[simple[kind]] = 1.0
    return h
