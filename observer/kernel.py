"""The compiled observer: asynchronous CD-EKF over logged events, and the backward pass of its smoother.

One file on purpose (numba's cache misses edits in callees of other modules), flat arrays in and out. The readable
reference of the model is `observer.model`; tests hold the two together. The filter is the continuous-discrete EKF of
A.3.1.3 with two departures: the covariance moves by the second-order transition at the interval's midpoint (RK4 is
`observer.runge_kutta`, tests compare them), and simultaneous measurements enter one after another as scalars.

The state is the model's 17 plus three slow errors of the satellite receiver (north, east, altitude; first-order
Gauss-Markov): white noise alone cannot describe fixes five times a second that err together for two minutes. Two
constants say how the odometer counts: dx/dt = v (1 + scale + slip F). A tyre under thrust turns faster than
the car moves, and a step of thrust would otherwise look like a jolt of the car.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

NX = 22
"""17 states of the model; the receiver's slow errors north, east and altitude; slip (1/N) and scale of the odometer."""
BIAS_X, BIAS_Y, BIAS_Z, SLIP, SCALE = 14, 15, 16, 20, 21
COLUMNS = 10
"""Columns of an event: time, code, values."""
# codes of events
ACCELEROMETER, WHEEL, INJECTOR, GPS, SKEW, GYROSCOPE, COMPASS_EVENT, SPEED_EVENT, FUEL, MAP, GRID, STEP = range(12)

# Constants that are passed as arguments are numpy integers: numba would compile a function again for every literal.
# states, of which some are set anew
X, V, HEADING, PITCH_ANGLE, NORTH, EAST, DOWN, ENERGY, POWER, ANGLE, OMEGA = np.array(
    [0, 1, 3, 4, 5, 6, 7, 10, 11, 12, 13]
)
# kinds of scalar measurements: those of observer.model
(
    DISTANCE,
    ACCELERATION_X,
    ACCELERATION_Y,
    ACCELERATION_Z,
    GPS_NORTH,
    GPS_EAST,
    GPS_ALTITUDE,
    GPS_SPEED,
    GPS_COURSE,
    MAP_HEADING,
    MAP_ALTITUDE,
    MAP_STRAIGHTNESS,
    PITCH,
    INJECTED_ENERGY,
    ENGINE_ANGLE,
    FUEL_POWER,
    SPEED,
    YAW_RATE,
    PITCH_RATE,
    COMPASS,
    ACCELERATION_X_THESIS,
    PULSE_POWER,
    SILENT_WHEELS,
    CUT_OFF,
    OPEN_CLUTCH,
) = np.arange(25)
KIND_CODES = 25

# why a measurement was not simply fused
FUSED, GATED, NOT_FINITE, REOPENED, STUCK, ANCHORED, POOR = np.arange(7)

# places in the memory between events
(
    M_TIME,
    M_TICK_TIME,
    M_TICK_ZERO,
    M_TICK_COUNT,
    M_TICK_ANCHORED,
    M_TICK_BAD,
    M_SILENT,
    M_STANDSTILL,
    M_PULSE_TIME,
    M_PULSE_ENERGY,
    M_PULSE_SATURATED,
    M_ANGLE_ZERO,
    M_ANGLE_COUNT,
    M_ANGLE_ANCHORED,
    M_ENERGY_ZERO,
    M_ENERGY_SUM,
    M_ENERGY_ANCHORED,
    M_CUT,
    M_RESERVOIR,
    M_PULSE_POWER,
    M_CLOCK,
    M_GAINED,
    M_CLOCK_SET,
    M_LATITUDE,
    M_LONGITUDE,
    M_ALTITUDE,
    M_NORTH_SCALE,
    M_EAST_SCALE,
    M_ORIGIN_SET,
    M_HEADING_SET,
    M_FIX_NORTH,
    M_FIX_EAST,
    M_ACC_X,
    M_ACC_Y,
    M_ACC_Z,
    M_ACC_SAME,
    M_FIX_LATITUDE,
    M_FIX_LONGITUDE,
    M_FIX_SAME,
    M_REPAIRS,
    M_EVENTS,
    M_FIX_TICKS,
    M_TICKS,
    M_HINDSIGHT,
    M_PULSE_GAP,
    M_TOLD_SPEED,
    M_SURPRISE,
    M_LATE,
    M_LATE_LEAST,
    M_RATTLE,
    _M_RATTLE_Y,
    _M_RATTLE_Z,
    M_DRIVEN_RATIO,
    M_DRIVEN_ENERGY,
    M_LOW_TIME,
    M_OPEN_SUM,
    M_OPEN_COUNT,
    M_OPEN_NOISE,
) = range(58)
"""M_TOLD_SPEED: the speed as the receiver's own filter sees it. M_SURPRISE: how far off the forward acceleration was
last, where that was a surprise, m/s2. M_LATE: fixes in a row that were far later than the earliest ever. M_RATTLE and
the two that follow: by how much the variance of the accelerometer's noise, x, y, z, exceeds the believed one, as a
share of it. M_DRIVEN_RATIO, M_DRIVEN_ENERGY: engine speed over car's (rad/m) and energy (J) of the last injector pulse
that was not less than half of the one before; M_LOW_TIME: of the first that was. M_OPEN_SUM, _COUNT, _NOISE: forward
readings (m/s2) of a clutch that may be open, how many, and the variance of one."""
M_SINCE = 58
"""Since when each kind is being rejected (NaN: it is not)."""
MEMORY = M_SINCE + KIND_CODES

# places in the array of the car's and the box's constants
(
    P_MASS,
    P_ACCELERATED,
    P_GRAVITY,
    P_DRAG,
    P_ROLLING,
    P_TICK,
    P_PULSE_POWER,
    P_PULSE_LAG,
    P_PULSE_ANGLE,
    P_ROTATION,
) = range(10)
P_SQUAT = P_ROTATION + 9
P_OPEN, P_OPEN_SPEED = P_SQUAT + 1, P_SQUAT + 2
"""N and N per m/s: what the gears drag with the clutch open."""
PARAMETERS = P_OPEN_SPEED + 1

# places in the array of settings: the order of observer.settings.ObserverSettings
(
    S_ACC,
    S_ACC_SLOPE,
    S_ACC_Z,
    S_ACC_Z_SLOPE,
    S_TOOTH,
    S_TICK_CLOCK,
    S_TICK_SILENCE,
    S_SILENT_SPEED,
    S_PULSE_CLOCK,
    S_PULSE,
    S_PULSE_POWER,
    S_CUT_GAP,
    S_GPS,
    S_GPS_Z,
    S_DRIFT,
    S_DRIFT_TIME,
    S_DRIFT_Z,
    S_DRIFT_Z_TIME,
    S_GPS_LAG,
    S_GPS_ARRIVAL,
    S_GPS_SPEED,
    S_GPS_COURSE,
    S_SPEED,
    S_FUEL,
    S_GYRO,
    S_COMPASS,
    S_Q_DISTANCE,
    S_Q_SPEED,
    S_Q_THRUST,
    S_Q_THRUST_CUT,
    S_THRUST_GAIN,
    S_THRUST_SETTLING,
    S_Q_HEADING,
    S_Q_PITCH,
    S_Q_POSITION,
    S_Q_DOWN,
    S_Q_STRAIGHT,
    S_Q_VERTICAL,
    S_Q_ENERGY,
    S_Q_POWER,
    S_Q_ANGLE,
    S_Q_OMEGA,
    S_Q_OMEGA_CUT,
    S_Q_BIAS,
    S_BIAS,
    S_PITCH,
    S_GATE,
    S_REOPEN,
    S_SKEW_LIMIT,
    S_THRUST_GAIN_HINDSIGHT,
    S_Q_THRUST_HINDSIGHT,
    S_Q_POWER_HINDSIGHT,
    S_SLIP_MEAN,
    S_SLIP,
    S_SCALE,
    S_Q_SLIP,
    S_Q_SCALE,
    S_MAP_HEADING,
    S_MAP_STRAIGHT,
    S_STANDSTILL,
    S_OPEN_CLUTCH,
) = range(61)

# places in Filter.counts
RECORDS, GRID_LINES, TAPE_LINES, RECORDING, TAPING, TAPE_GRID = range(6)

# the smoother's tape: one line per operation
OP_PREDICT, OP_ROW, OP_RESET, OP_GRID = range(4)
TAPE_ROW = NX + 10
WORK = 124 + 11 * NX + NX * NX
"""Scratch: one row's Jacobian and gain, then the transition, the midpoint, moved rows, noise, a Cholesky factor."""
READ = np.array([1, 2, 4, 9, 3, 8, 20, 21, 11, 13])
"""The states that others' motion depends on: the columns of `transition` and those of energy and engine angle."""
SIGN_BAND = 0.1
OVERDUE = 1.15
"""An injector pulse is overdue when the time since the last is so many times the interval before."""
REPEATED = 2e-3
"""s: an injector pulse that follows sooner is the last one told twice; no engine turns so fast."""
LATE, LATE_FIXES = 0.3, 25.0
"""s beyond the earliest arrival of a fix ever seen; so many in a row and the earliest was an error."""
HARDEST = 4.0
"""m/s2 by which a forward acceleration may be off and still be brakes; a spike is more."""
SURPRISE = 9.0
"""NIS of a forward acceleration beyond which, in hindsight, thrust is let free to follow it."""
SURPRISE_LIVE = 16.0
"""The same for the live filter, which has no second look."""
BRAKING = -400.0
"""N: less thrust than that is brakes, which may be released at once."""
SHIFTING, OPENING, FALLEN = 0.6, 0.08, 0.94
"""s from the first low pulse for which a shift may last, and until the clutch is open; share of the ratio of engine
speed to car's below which no gear that was in holds it."""
ROLLING = 2.5
"""m/s: slower, and the clutch slips by itself."""
STANDSTILL_AGAIN = 0.5
"""s after which it is told again that the car stands: sooner it would be the same word twice."""
BRAKED, DRIVEN = 4.0, 12.0
"""NIS of what is read between two gears beyond which a brake may have been on (too low a reading) or the clutch was not
open yet (too high)."""
RATTLE_MEMORY = 0.005
"""Share of one reading in the running estimate of the accelerometer's noise."""
RATTLE_USUAL = 0.5
"""Excess of the noise's variance that is not yet believed."""
RATTLE_MOST, RATTLE_STEP = 100.0, 50.0
"""Most excess that is believed, so that it is forgotten in time; m/s2 between readings that no noise makes."""
WRAP = 2.0 * math.pi
UNKNOWN_HEADING = 1.0
"""rad2: with more variance than this, a course is taken over instead of being fused."""


inner = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Of a function that only others here call (from Python: its `py_func`): without wrappers it compiles faster."""


class Filter(NamedTuple):
    """All that the filter reads and writes, as one argument (numba compiles long argument lists slowly)."""

    x: NDArray[np.float64]
    """(NX,), state."""
    P: NDArray[np.float64]
    """(NX, NX), covariance."""
    memory: NDArray[np.float64]
    """(MEMORY,), what else is remembered between events."""
    car: NDArray[np.float64]
    """(PARAMETERS,)."""
    settings: NDArray[np.float64]
    records: NDArray[np.float64]
    """(m, 7): time, kind, value, innovation, its variance, NIS, reason."""
    grid_x: NDArray[np.float64]
    """(k, NX), estimate on the grid."""
    grid_P: NDArray[np.float64]
    """(k, NX), its variances."""
    counts: NDArray[np.int64]
    """(6,): RECORDS, GRID_LINES, TAPE_LINES and TAPE_GRID written; RECORDING, TAPING: on or off."""
    tape: NDArray[np.float64]
    """(l, TAPE_ROW)."""
    tape_index: NDArray[np.int64]
    """(l + 1, 10); the last line is scratch."""
    tape_P: NDArray[np.float64]
    """(g, NX, NX), covariance at the grid lines on tape."""
    work: NDArray[np.float64]
    """(WORK,), scratch."""


@inner
def acceleration(x, p, g):
    """dv/dt; fills g with its derivatives by v, F, theta, S_k."""
    v = x[1]
    ct, st = math.cos(x[4]), math.sin(x[4])
    root = math.sqrt(v * v + SIGN_BAND * SIGN_BAND)
    sign = v / root
    load = p[P_DRAG] * v * v + p[P_ROLLING] * (p[P_GRAVITY] * ct + x[9] * v * v)
    slope = SIGN_BAND * SIGN_BAND / (root * root * root)
    w = 1.0 / p[P_ACCELERATED]
    g[0] = -w * (slope * load + sign * 2.0 * v * (p[P_DRAG] + p[P_ROLLING] * x[9]))
    g[1] = w
    g[2] = w * (sign * p[P_ROLLING] * p[P_GRAVITY] * st - p[P_MASS] * p[P_GRAVITY] * ct)
    g[3] = -w * sign * p[P_ROLLING] * v * v
    return w * (x[2] - sign * load - p[P_MASS] * p[P_GRAVITY] * st)


@inner
def transition(x, dt, p, n, xm):
    """Fill n (7, 8) with the transition less the identity at the midpoint, xm with the state there.

    Rows: x, v, psi, theta, N, E, D; columns: v, F, theta, S_k, psi, S_j, slip, scale. Second order in dt.
    """
    g = xm[NX:]
    half = 0.5 * dt
    a = acceleration(x, p, g)
    v = x[1] + half * a
    for i in range(NX):
        xm[i] = x[i]
    xm[1] = v
    xm[3] = x[3] + half * x[8] * x[1]
    xm[4] = x[4] + half * x[9] * x[1]
    a = acceleration(xm, p, g)
    cp, sp, ct, st = math.cos(xm[3]), math.sin(xm[3]), math.cos(xm[4]), math.sin(xm[4])
    sj, sk = x[8], x[9]
    h2 = 0.5 * dt * dt
    n[:, :] = 0.0
    # distance: A = e_v
    turned = 1.0 + x[21] + x[20] * x[2]
    n[0, 0] = (dt + h2 * g[0]) * turned
    n[0, 1] = h2 * g[1] * turned + dt * v * x[20]
    n[0, 2] = h2 * g[2] * turned
    n[0, 3] = h2 * g[3] * turned
    n[0, 6] = dt * v * x[2]
    n[0, 7] = dt * v
    # speed
    n[1, 0] = dt * g[0] + h2 * (g[0] * g[0] + g[2] * sk)
    n[1, 1] = dt * g[1] + h2 * g[0] * g[1]
    n[1, 2] = dt * g[2] + h2 * g[0] * g[2]
    n[1, 3] = dt * g[3] + h2 * (g[0] * g[3] + g[2] * v)
    # heading and pitch
    n[2, 0] = dt * sj + h2 * sj * g[0]
    n[2, 1] = h2 * sj * g[1]
    n[2, 2] = h2 * sj * g[2]
    n[2, 3] = h2 * sj * g[3]
    n[2, 5] = dt * v
    n[3, 0] = dt * sk + h2 * sk * g[0]
    n[3, 1] = h2 * sk * g[1]
    n[3, 2] = h2 * sk * g[2]
    n[3, 3] = dt * v + h2 * sk * g[3]
    # north, east, down
    for r in range(3):
        if r == 0:
            bv, bp, bt = cp * ct, -v * sp * ct, -v * cp * st
        elif r == 1:
            bv, bp, bt = sp * ct, v * cp * ct, -v * sp * st
        else:
            bv, bp, bt = -st, 0.0, -v * ct
        n[4 + r, 0] = dt * bv + h2 * (bv * g[0] + bp * sj + bt * sk)
        n[4 + r, 1] = h2 * bv * g[1]
        n[4 + r, 2] = dt * bt + h2 * bv * g[2]
        n[4 + r, 3] = h2 * (bv * g[3] + bt * v)
        n[4 + r, 4] = dt * bp
        n[4 + r, 5] = h2 * bp * v
    # the state at the interval's end, in xm
    xm[0] = x[0] + dt * v * turned
    vm = v
    xm[1] = x[1] + dt * a
    xm[3] = x[3] + dt * sj * vm
    xm[4] = x[4] + dt * sk * vm
    xm[5] = x[5] + dt * vm * cp * ct
    xm[6] = x[6] + dt * vm * sp * ct
    xm[7] = x[7] - dt * vm * st
    xm[10] = x[10] + dt * x[11]
    xm[12] = x[12] + dt * x[13]


@inner
def predict(x, P, dt, p, s, q, n, xm, w):
    """Move x (NX) and P (NX, NX) by dt; q (NX) is the noise to add, already integrated over dt."""
    transition(x, dt, p, n, xm)
    for r in range(7):
        i = r if r < 2 else r + 1
        n0, n1, n2, n3 = n[r, 0], n[r, 1], n[r, 2], n[r, 3]
        if r == 2 or r == 4 or r == 5:
            n4, n5 = n[r, 4], n[r, 5]
            for j in range(NX):
                w[r, j] = (
                    P[i, j] + n0 * P[1, j] + n1 * P[2, j] + n2 * P[4, j] + n3 * P[9, j] + n4 * P[3, j] + n5 * P[8, j]
                )
        else:
            for j in range(NX):
                w[r, j] = P[i, j] + n0 * P[1, j] + n1 * P[2, j] + n2 * P[4, j] + n3 * P[9, j]
    n6, n7 = n[0, 6], n[0, 7]
    for j in range(NX):
        w[0, j] += n6 * P[20, j] + n7 * P[21, j]
        w[7, j] = P[10, j] + dt * P[11, j]
        w[8, j] = P[12, j] + dt * P[13, j]
    # columns: those that move depend on others, and one triangle is enough
    for r in range(9):
        i = r if r < 2 else (r + 1 if r < 7 else (10 if r == 7 else 12))
        v, thrust, pitch, vertical, heading, straight = w[r, 1], w[r, 2], w[r, 4], w[r, 9], w[r, 3], w[r, 8]
        for j in range(NX):
            P[i, j] = w[r, j]
        P[i, 0] += n6 * w[r, 20] + n7 * w[r, 21]
        P[i, 10] += dt * w[r, 11]
        P[i, 12] += dt * w[r, 13]
        for k in range(7):
            P[i, k if k < 2 else k + 1] += (
                n[k, 0] * v
                + n[k, 1] * thrust
                + n[k, 2] * pitch
                + n[k, 3] * vertical
                + n[k, 4] * heading
                + n[k, 5] * straight
            )
    for r in range(9):
        i = r if r < 2 else (r + 1 if r < 7 else (10 if r == 7 else 12))
        for j in range(NX):
            P[j, i] = P[i, j]
    decay = math.exp(-dt / s[S_DRIFT_TIME])
    decay_z = math.exp(-dt / s[S_DRIFT_Z_TIME])
    for j in range(NX):
        P[17, j] *= decay
        P[18, j] *= decay
        P[19, j] *= decay_z
    for i in range(NX):
        P[i, 17] *= decay
        P[i, 18] *= decay
        P[i, 19] *= decay_z
        P[i, i] += q[i]
    P[19, 17], P[19, 18] = P[17, 19], P[18, 19]
    for i in range(17):
        x[i] = xm[i]
    x[17] *= decay
    x[18] *= decay
    x[19] *= decay_z


@inner
def sparse_row(kind, x, p, aux, hi, hv, g):
    """Fill hi, hv with the places and values of the measurement's Jacobian; return its value and how many there are."""
    v = x[1]
    if kind in (ACCELERATION_X, ACCELERATION_X_THESIS):
        a = acceleration(x, p, g)
        share, lifted = p[P_GRAVITY], 1.0 + p[P_SQUAT]
        if kind == ACCELERATION_X_THESIS:
            share, lifted = share * p[P_MASS] / p[P_ACCELERATED], 1.0
        hi[0], hi[1], hi[2], hi[3], hi[4] = 1, 2, 4, 9, 14
        hv[0], hv[1], hv[3], hv[4] = lifted * g[0], lifted * g[1], lifted * g[3], 1.0
        hv[2] = lifted * g[2] + share * math.cos(x[4])
        return lifted * a + share * math.sin(x[4]) + x[14], 5
    if kind == OPEN_CLUTCH:
        a = acceleration(x, p, g) - (x[2] + p[P_OPEN] + p[P_OPEN_SPEED] * v) / p[P_ACCELERATED]
        lifted = 1.0 + p[P_SQUAT]
        hi[0], hi[1], hi[2], hi[3] = 1, 4, 9, 14
        hv[0], hv[2], hv[3] = lifted * (g[0] - p[P_OPEN_SPEED] / p[P_ACCELERATED]), lifted * g[3], 1.0
        hv[1] = lifted * g[2] + p[P_GRAVITY] * math.cos(x[4])
        return lifted * a + p[P_GRAVITY] * math.sin(x[4]) + x[14], 4
    if kind == ACCELERATION_Y:
        hi[0], hi[1], hi[2] = 1, 8, 15
        hv[0], hv[1], hv[2] = -2.0 * x[8] * v, -v * v, 1.0
        return -x[8] * v * v + x[15], 3
    if kind == ACCELERATION_Z:
        hi[0], hi[1], hi[2], hi[3] = 1, 4, 9, 16
        hv[0], hv[1], hv[2], hv[3] = 2.0 * x[9] * v, -p[P_GRAVITY] * math.sin(x[4]), v * v, 1.0
        return p[P_GRAVITY] * math.cos(x[4]) + x[9] * v * v + x[16], 4
    if kind in (GPS_NORTH, GPS_EAST, GPS_ALTITUDE, MAP_ALTITUDE):
        a = acceleration(x, p, g)
        way = aux * (v - 0.5 * aux * a)
        sv, sf, st, sk = (
            aux - 0.5 * aux * aux * g[0],
            -0.5 * aux * aux * g[1],
            -0.5 * aux * aux * g[2],
            -0.5 * aux * aux * g[3],
        )
        cos_t, sin_t = math.cos(x[4]), math.sin(x[4])
        hi[0], hi[1], hi[2], hi[3] = 1, 2, 4, 9
        if kind in (GPS_ALTITUDE, MAP_ALTITUDE):
            hv[0], hv[1], hv[2], hv[3] = -sv * sin_t, -sf * sin_t, -st * sin_t - way * cos_t, -sk * sin_t
            hi[4], hi[5] = 7, 19
            hv[4], hv[5] = -1.0, 1.0
            if kind == MAP_ALTITUDE:
                return -x[7] - way * sin_t, 5
            return -x[7] - way * sin_t + x[19], 6
        heading = x[3] - 0.5 * aux * x[8] * v
        along, across = math.cos(heading), math.sin(heading)
        place = 5
        if kind == GPS_EAST:
            along, across = across, -along
            place = 6
        turn = way * across * cos_t
        hv[0] = -sv * along * cos_t - 0.5 * aux * x[8] * turn
        hv[1] = -sf * along * cos_t
        hv[2] = -st * along * cos_t + way * along * sin_t
        hv[3] = -sk * along * cos_t
        hi[4], hi[5], hi[6], hi[7] = 3, 8, place, place + 12
        hv[4], hv[5], hv[6], hv[7] = turn, -0.5 * aux * v * turn, 1.0, 1.0
        return x[place] - way * along * cos_t + x[place + 12], 8
    if kind == GPS_SPEED:
        a = acceleration(x, p, g)
        hi[0], hi[1], hi[2], hi[3] = 1, 2, 4, 9
        hv[0], hv[1], hv[2], hv[3] = 1.0 - aux * g[0], -aux * g[1], -aux * g[2], -aux * g[3]
        return v - aux * a, 4
    if kind in (GPS_COURSE, MAP_HEADING):
        hi[0], hi[1], hi[2] = 3, 8, 1
        hv[0], hv[1], hv[2] = 1.0, -aux * v, -aux * x[8]
        return x[3] - aux * x[8] * v, 3
    if kind == PULSE_POWER:
        hi[0], hi[1] = 11, 13
        hv[0], hv[1] = 1.0, -aux
        return x[11] - aux * x[13], 2
    if kind == YAW_RATE:
        hi[0], hi[1] = 8, 1
        hv[0], hv[1] = -v, -x[8]
        return -x[8] * v, 2
    if kind == PITCH_RATE:
        hi[0], hi[1] = 9, 1
        hv[0], hv[1] = -v, -x[9]
        return -x[9] * v, 2
    hv[0] = 1.0
    if kind == DISTANCE:
        hi[0] = 0
    elif kind == COMPASS:
        hi[0] = 3
    elif kind == MAP_STRAIGHTNESS:
        hi[0] = 8
    elif kind == PITCH:
        hi[0] = 4
    elif kind == INJECTED_ENERGY:
        hi[0] = 10
    elif kind == ENGINE_ANGLE:
        hi[0] = 12
    elif kind in (FUEL_POWER, CUT_OFF):
        hi[0] = 11
    else:
        hi[0] = 1
    return hv[0] * x[hi[0]], 1


@inner
def fuse(kind, z, r, aux, f):
    """One scalar measurement: gate, update, record. Returns the reason code (FUSED or REOPENED: it entered)."""
    x = f.x
    P = f.P
    mem = f.memory
    p = f.car
    s = f.settings
    rec = f.records
    out = f.counts
    tape = f.tape
    tape_index = f.tape_index
    work = f.work
    hv, ph, g = work[0:8], work[16 : 16 + NX], work[40:44]
    index = tape_index[tape_index.shape[0] - 1]
    value, size = sparse_row(kind, x, p, aux, index, hv, g)
    nu = z - value
    if kind in (GPS_COURSE, MAP_HEADING, COMPASS):
        nu -= WRAP * math.floor(nu / WRAP + 0.5)
    reason = FUSED
    S = r
    nis = 0.0
    if not (math.isfinite(nu) and math.isfinite(r) and r > 0.0):
        reason = NOT_FINITE
    else:
        for i in range(NX):
            ph[i] = 0.0
        for k in range(size):
            c = hv[k]
            j = index[k]
            for i in range(NX):
                ph[i] += c * P[j, i]
        for k in range(size):
            S += hv[k] * ph[index[k]]
        nis = nu * nu / S
        surprising = False
        if kind == ACCELERATION_X:
            if mem[M_HINDSIGHT] > 0.0:
                surprising = nis > SURPRISE and abs(nu) < HARDEST
            else:
                # one reading may be a spike, two that agree are not
                surprising = nis > SURPRISE_LIVE and abs(nu) < HARDEST and mem[M_SURPRISE] * nu > 0.25 * nu * nu
                mem[M_SURPRISE] = nu if nis > SURPRISE_LIVE else 0.0
        if surprising and (nu < 0.0 or x[2] < BRAKING):
            # thrust changed and no pulse told: brakes put on or released, or fuel that was cut a moment ago
            more = (nu * nu - S) / (hv[1] * hv[1])
            P[2, 2] += more
            ph[2] += hv[1] * more
            S += hv[1] * hv[1] * more
            nis = 1.0
        gate = s[S_GATE]
        if kind == OPEN_CLUTCH:
            gate = BRAKED if nu < 0.0 else DRIVEN
        if nis > gate:
            since = mem[M_SINCE + kind]
            if math.isnan(since):
                mem[M_SINCE + kind] = mem[M_TIME]
                reason = GATED
            elif mem[M_TIME] - since < s[S_REOPEN] or kind in (SILENT_WHEELS, OPEN_CLUTCH):
                reason = GATED
            else:
                reason = REOPENED
                S = nu * nu / s[S_GATE]
        else:
            mem[M_SINCE + kind] = math.nan
    if reason in (FUSED, REOPENED):
        inverse = 1.0 / S
        gain = nu * inverse
        for i in range(NX):
            x[i] += ph[i] * gain
        mem[M_TOLD_SPEED] += ph[1] * gain
        # scaled first: both triangles then change by the same bits
        root = math.sqrt(inverse)
        for i in range(NX):
            ph[i] *= root
        for i in range(NX):
            c = ph[i]
            for j in range(NX):
                P[i, j] -= c * ph[j]
        if out[TAPING] > 0:
            m = out[TAPE_LINES]
            tape_index[m, 0] = OP_ROW
            tape_index[m, 1] = size
            for k in range(size):
                tape_index[m, 2 + k] = index[k]
                tape[m, NX + k] = hv[k]
            for i in range(NX):
                tape[m, i] = ph[i] * root
            tape[m, NX + 8] = nu
            tape[m, NX + 9] = inverse
            out[TAPE_LINES] = m + 1
    if out[RECORDING] > 0:
        m = out[RECORDS]
        rec[m, 0] = mem[M_TIME]
        rec[m, 1] = kind
        rec[m, 2] = z
        rec[m, 3] = nu
        rec[m, 4] = S
        rec[m, 5] = nis
        rec[m, 6] = reason
        out[RECORDS] = m + 1
    return reason


@inner
def reset(i, value, variance, f):
    """Forget the state i: set it to `value` with `variance`, uncorrelated with everything else."""
    x = f.x
    P = f.P
    out = f.counts
    tape_index = f.tape_index
    x[i] = value
    for j in range(NX):
        P[i, j] = 0.0
        P[j, i] = 0.0
    P[i, i] = variance
    if out[TAPING] > 0:
        m = out[TAPE_LINES]
        tape_index[m, 0] = OP_RESET
        tape_index[m, 1] = i
        out[TAPE_LINES] = m + 1


@inner
def note(kind, z, reason, f):
    """Record a measurement that never reached the filter."""
    mem = f.memory
    rec = f.records
    out = f.counts
    if out[RECORDING] > 0:
        m = out[RECORDS]
        rec[m, 0] = mem[M_TIME]
        rec[m, 1] = kind
        rec[m, 2] = z
        rec[m, 3] = math.nan
        rec[m, 4] = math.nan
        rec[m, 5] = math.nan
        rec[m, 6] = reason
        out[RECORDS] = m + 1


@inner
def initial_variance(i, s):
    """Variance of the state i before anything was measured."""
    if i == 1:
        return 100.0
    if i == 2:
        return 4e6
    if i == 3:
        return 10.0
    if i == 4:
        return s[S_PITCH] * s[S_PITCH]
    if 5 <= i <= 7:
        return 1e6
    if i == 8:
        return 1e-4
    if i == 9:
        return 1e-7
    if i == 11:
        return 1e8
    if i == 13:
        return 1e4
    if 14 <= i <= 16:
        return s[S_BIAS] * s[S_BIAS]
    if i == 17 or i == 18:
        return s[S_DRIFT] * s[S_DRIFT]
    if i == 19:
        return s[S_DRIFT_Z] * s[S_DRIFT_Z]
    if i == 20:
        return s[S_SLIP] * s[S_SLIP]
    if i == 21:
        return s[S_SCALE] * s[S_SCALE]
    return 1e-6


@inner
def sound(P, work):
    """Tell whether P is finite and positive definite (Cholesky on a copy of its scaled form)."""
    for i in range(NX):
        d = P[i, i]
        if not (math.isfinite(d) and d > 0.0):
            return False
    for i in range(NX):
        for j in range(i + 1):
            total = P[i, j] / math.sqrt(P[i, i] * P[j, j])
            if i == j:
                total = 1.0 + 1e-12
            for k in range(j):
                total -= work[i, k] * work[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                work[i, i] = math.sqrt(total)
            else:
                if not math.isfinite(total):
                    return False
                work[i, j] = total / work[j, j]
    return True


@inner
def move(t, f):
    """Predict to the time `t`, with the process noise of the moment."""
    x, P, mem, s, out, tape, tape_index = f.x, f.P, f.memory, f.settings, f.counts, f.tape, f.tape_index
    dt = t - mem[M_TIME]
    if not dt > 0.0:
        return
    n, xm = f.work[64:120].reshape(7, 8), f.work[120 : 124 + NX]
    w = f.work[124 + NX : 124 + 10 * NX].reshape(9, NX)
    q = f.work[124 + 10 * NX : 124 + 11 * NX]
    speed = abs(x[1])
    cut = mem[M_CUT] > 0.0
    silent = mem[M_SILENT] > 0.0
    q[0] = s[S_Q_DISTANCE] * dt
    q[1] = s[S_Q_SPEED] * dt
    arriving = mem[M_RESERVOIR] * (1.0 - math.exp(-dt / s[S_THRUST_SETTLING]))
    mem[M_RESERVOIR] -= arriving
    hindsight = mem[M_HINDSIGHT] > 0.0
    q[2] = (s[S_Q_THRUST_HINDSIGHT] if hindsight else s[S_Q_THRUST]) * dt + arriving
    # a pulse that is overdue: fuel is being cut, and brakes may follow at once
    if cut or silent or t - mem[M_PULSE_TIME] > OVERDUE * mem[M_PULSE_GAP]:
        q[2] += s[S_Q_THRUST_CUT] * dt
    q[3] = s[S_Q_HEADING] * dt
    q[4] = s[S_Q_PITCH] * dt
    if silent:
        q[3] = 0.0
        q[4] = 0.0
    q[5] = s[S_Q_POSITION] * dt
    q[6] = q[5]
    q[7] = s[S_Q_DOWN] * dt
    q[8] = s[S_Q_STRAIGHT] * speed * dt
    q[9] = s[S_Q_VERTICAL] * speed * dt
    q[10] = s[S_Q_ENERGY] * dt
    q[11] = 0.0 if cut else (s[S_Q_POWER_HINDSIGHT] if hindsight else s[S_Q_POWER]) * dt
    q[12] = s[S_Q_ANGLE] * dt
    q[13] = (s[S_Q_OMEGA_CUT] if cut else s[S_Q_OMEGA]) * dt
    if P[13, 13] > 4e4:
        q[13] = 0.0
    q[14] = s[S_Q_BIAS] * dt
    q[15] = q[14]
    q[16] = q[14]
    q[17] = 2.0 * s[S_DRIFT] * s[S_DRIFT] / s[S_DRIFT_TIME] * dt
    q[18] = q[17]
    q[20] = s[S_Q_SLIP] * dt
    q[21] = s[S_Q_SCALE] * dt
    q[19] = 2.0 * s[S_DRIFT_Z] * s[S_DRIFT_Z] / s[S_DRIFT_Z_TIME] * dt
    if out[TAPING] > 0:
        m = out[TAPE_LINES]
        tape_index[m, 0] = OP_PREDICT
        for i in range(NX):
            tape[m, i] = x[i]
        tape[m, NX + 8] = dt
        out[TAPE_LINES] = m + 1
    before = x[1]
    predict(x, P, dt, f.car, s, q, n, xm, w)
    # an engine in gear follows the car (1.8, with N_spd = omega / v of the moment): an input, not a dependence
    if before > 3.0 and not cut:
        x[13] *= x[1] / before
    mem[M_TOLD_SPEED] += (x[1] - mem[M_TOLD_SPEED]) * (1.0 - math.exp(-dt / s[S_GPS_LAG]))
    mem[M_TIME] = t


@inner
def on_accelerometer(event, f):
    """Specific force in the sensor's axes, m/s2."""
    x = f.x
    mem = f.memory
    p = f.car
    s = f.settings
    ax, ay, az = event[2], event[3], event[4]
    if ax == mem[M_ACC_X] and ay == mem[M_ACC_Y] and az == mem[M_ACC_Z]:
        mem[M_ACC_SAME] += 1.0
    else:
        mem[M_ACC_SAME] = 0.0
    dx, dy, dz = ax - mem[M_ACC_X], ay - mem[M_ACC_Y], az - mem[M_ACC_Z]
    mem[M_ACC_X], mem[M_ACC_Y], mem[M_ACC_Z] = ax, ay, az
    r = P_ROTATION
    bx = p[r] * ax + p[r + 1] * ay + p[r + 2] * az
    by = p[r + 3] * ax + p[r + 4] * ay + p[r + 5] * az
    bz = p[r + 6] * ax + p[r + 7] * ay + p[r + 8] * az
    if mem[M_ACC_SAME] >= 20.0:
        note(ACCELERATION_X, bx, STUCK, f)
        note(ACCELERATION_Y, by, STUCK, f)
        note(ACCELERATION_Z, bz, STUCK, f)
        return
    speed = abs(x[1])
    plane = s[S_ACC] + s[S_ACC_SLOPE] * speed
    vertical = s[S_ACC_Z] + s[S_ACC_Z_SLOPE] * speed
    for axis in range(3):
        value = bx if axis == 0 else (by if axis == 1 else bz)
        deviation = plane if axis < 2 else vertical
        believed = deviation * deviation
        # what differs from reading to reading is noise: where there is much more of it than believed, it is believed
        step = p[r + 3 * axis] * dx + p[r + 3 * axis + 1] * dy + p[r + 3 * axis + 2] * dz
        excess = mem[M_RATTLE + axis]
        seen = min(0.5 * step * step / believed, 9.0 * (1.0 + excess)) - 1.0
        if math.isfinite(seen) and abs(step) < RATTLE_STEP:
            excess = min(excess + RATTLE_MEMORY * (seen - excess), RATTLE_MOST)
            mem[M_RATTLE + axis] = excess
        if excess > RATTLE_USUAL:
            believed *= 1.0 + excess - RATTLE_USUAL
        fuse(ACCELERATION_X + axis, value, believed, 0.0, f)
        if axis == 0 and mem[M_LOW_TIME] > 0.0 and mem[M_TIME] > mem[M_LOW_TIME] + OPENING:
            mem[M_OPEN_SUM] += value
            mem[M_OPEN_COUNT] += 1.0
            mem[M_OPEN_NOISE] = believed


@inner
def on_wheel(event, t, f):
    """One pulse of the wheel: a distance since the anchor, or a new anchor."""
    x = f.x
    P = f.P
    mem = f.memory
    p = f.car
    s = f.settings
    gap = t - mem[M_TICK_TIME]
    mem[M_TICKS] += 1.0
    clock = s[S_TICK_CLOCK] * x[1]
    r_tick = s[S_TOOTH] * s[S_TOOTH] + clock * clock / 12.0
    anchored = mem[M_TICK_ANCHORED] > 0.0 and gap <= s[S_TICK_SILENCE]
    if anchored:
        mem[M_TICK_COUNT] += 1.0
        z = mem[M_TICK_ZERO] + mem[M_TICK_COUNT] * p[P_TICK]
        mem[M_SINCE + DISTANCE] = math.nan
        reason = fuse(DISTANCE, z, r_tick, 0.0, f)
        if reason != FUSED:
            anchored = False
            mem[M_TICK_BAD] += 1.0
            if mem[M_TICK_BAD] >= 3.0 and gap > 0.0:
                # the pulses agree with each other and not with the filter: believe them
                told = p[P_TICK] / gap
                reset(V, told, (0.2 * told) ** 2 + 0.01, f)
                mem[M_TOLD_SPEED] = told
                P[2, 2] += 1e6
                mem[M_TICK_BAD] = 0.0
        else:
            mem[M_TICK_BAD] = 0.0
    else:
        note(DISTANCE, math.nan, ANCHORED, f)
        if mem[M_SILENT] > 0.0 or math.isnan(mem[M_TICK_TIME]):
            # pulses come again: the car is at least as fast as the pick-up can see
            v = s[S_SILENT_SPEED]
            if x[1] < v:
                fuse(SILENT_WHEELS, 1.1 * v, v * v / 12.0, 0.0, f)
    if not anchored:
        mem[M_TICK_ZERO] = x[0]
        mem[M_TICK_COUNT] = 0.0
        mem[M_TICK_ANCHORED] = 1.0
        reset(X, x[0], r_tick, f)
    mem[M_TICK_TIME] = t
    mem[M_SILENT] = 0.0


@inner
def on_injector(event, t, f):
    """One injector pulse: engine angle, fuel of the interval that ends, power of the one that begins."""
    x = f.x
    P = f.P
    mem = f.memory
    p = f.car
    s = f.settings
    gap = t - mem[M_PULSE_TIME]
    opening = event[2] + p[P_PULSE_LAG]
    saturated = event[3] > 0.0
    if not (opening > 0.0 and opening < 0.1):
        note(INJECTED_ENERGY, opening, POOR, f)
        return
    if gap < REPEATED:
        note(INJECTED_ENERGY, opening, STUCK, f)
        return
    energy = p[P_PULSE_POWER] * opening
    omega = max(abs(x[13]), 30.0)
    timing = s[S_PULSE_CLOCK] * s[S_PULSE_CLOCK] / 12.0
    r_angle = omega * omega * timing + 1e-5
    power = abs(x[11])
    r_energy = power * power * timing + 1.0
    resumed = not (gap <= s[S_CUT_GAP])
    anchored = mem[M_ANGLE_ANCHORED] > 0.0 and not resumed
    if resumed:
        note(ENGINE_ANGLE, math.nan, ANCHORED, f)
        # the engine's speed and fuel are unknown after silence
        reset(OMEGA, x[13], 1e4, f)
        if mem[M_HINDSIGHT] == 0.0:
            reset(POWER, energy / p[P_PULSE_ANGLE] * omega, 1e8, f)
        mem[M_ENERGY_ANCHORED] = 0.0
    else:
        if anchored:
            mem[M_ANGLE_COUNT] += 1.0
            z = mem[M_ANGLE_ZERO] + mem[M_ANGLE_COUNT] * p[P_PULSE_ANGLE]
            mem[M_SINCE + ENGINE_ANGLE] = math.nan
            surprise = (z - x[12]) ** 2
            if surprise > 4.0 * (P[12, 12] + r_angle):
                # a shift or a slipping clutch: the engine's speed has drifted all along the interval
                rate = 3.0 * surprise / max(gap, 0.005) ** 2
                P[12, 12] += rate * gap * gap / 3.0
                P[12, 13] += rate * gap / 2.0
                P[13, 12] = P[12, 13]
                P[13, 13] += rate
            reason = fuse(ENGINE_ANGLE, z, r_angle, 0.0, f)
            if reason != FUSED:
                anchored = False
                reset(OMEGA, p[P_PULSE_ANGLE] / max(gap, 0.01), 400.0, f)
                mem[M_ENERGY_ANCHORED] = 0.0
        if mem[M_ENERGY_ANCHORED] > 0.0 and mem[M_PULSE_SATURATED] == 0.0:
            # the fuel of the pulse before was burnt in the interval that ends now
            before = mem[M_PULSE_ENERGY]
            mem[M_ENERGY_SUM] += before
            P[10, 10] += (s[S_PULSE] * before) ** 2
            z = mem[M_ENERGY_ZERO] + mem[M_ENERGY_SUM]
            mem[M_SINCE + INJECTED_ENERGY] = math.nan
            reason = fuse(INJECTED_ENERGY, z, r_energy, 0.0, f)
            if reason != FUSED:
                mem[M_ENERGY_ANCHORED] = 0.0
        else:
            mem[M_ENERGY_ANCHORED] = 0.0
    if not anchored:
        mem[M_ANGLE_ZERO] = x[12]
        mem[M_ANGLE_COUNT] = 0.0
        mem[M_ANGLE_ANCHORED] = 1.0
        reset(ANGLE, x[12], r_angle, f)
    if mem[M_ENERGY_ANCHORED] == 0.0:
        mem[M_ENERGY_ZERO] = x[10]
        mem[M_ENERGY_SUM] = 0.0
        mem[M_ENERGY_ANCHORED] = 1.0
        reset(ENERGY, x[10], r_energy, f)
    # what this pulse foretells of the interval that it opens
    told = energy / p[P_PULSE_ANGLE] * max(x[13], 30.0)
    change = told - mem[M_PULSE_POWER]
    if resumed:
        change = told
    if not saturated and mem[M_HINDSIGHT] == 0.0:
        thrust = change / max(x[1], 3.0)
        mem[M_RESERVOIR] += (s[S_THRUST_GAIN] * thrust) ** 2
        r_power = (s[S_PULSE_POWER] * told) ** 2 + 1e4
        slope = energy / p[P_PULSE_ANGLE]
        expected = P[11, 11] - 2.0 * slope * P[11, 13] + slope * slope * P[13, 13] + r_power
        P[11, 11] += max((x[11] - slope * x[13]) ** 2 - expected, 0.0)
        fuse(PULSE_POWER, 0.0, r_power, slope, f)
        mem[M_PULSE_POWER] = told
    shift(energy, t, f)
    mem[M_PULSE_TIME] = t
    mem[M_PULSE_GAP] = min(gap, s[S_CUT_GAP])
    mem[M_PULSE_ENERGY] = energy
    mem[M_PULSE_SATURATED] = 1.0 if saturated else 0.0
    mem[M_CUT] = 0.0


@inner
def shift(energy, t, f):
    """Between two gears the engine drives nothing: what the accelerometer then reads tells its bias.

    Seen by a pulse (`energy`, J) at `t` that is less than half of those of a moment before while the engine's speed
    falls and the car's does not: an engine in gear cannot do that, and a foot is not on the brake yet. The readings
    since the clutch was open are fused as one, as those of a car with a known thrust: neither the thrust's estimate nor
    the odometer, whose tyres recover from the thrust just then, have a part in it.
    """
    x, P, mem, s = f.x, f.P, f.memory, f.settings
    ratio = x[13] / max(x[1], ROLLING)
    low = energy < 0.5 * mem[M_DRIVEN_ENERGY]
    if not low or (mem[M_LOW_TIME] > 0.0 and t - mem[M_LOW_TIME] > SHIFTING):
        mem[M_DRIVEN_RATIO], mem[M_DRIVEN_ENERGY], mem[M_LOW_TIME] = ratio, energy, 0.0
    elif mem[M_LOW_TIME] == 0.0:
        mem[M_LOW_TIME] = t
    elif mem[M_OPEN_COUNT] > 0.0 and x[1] > ROLLING and ratio < FALLEN * mem[M_DRIVEN_RATIO]:
        if P[13, 13] < (0.05 * x[13]) ** 2:
            count = mem[M_OPEN_COUNT]
            r = mem[M_OPEN_NOISE] / count + s[S_OPEN_CLUTCH] ** 2
            fuse(OPEN_CLUTCH, mem[M_OPEN_SUM] / count, r, 0.0, f)
        mem[M_OPEN_SUM], mem[M_OPEN_COUNT] = 0.0, 0.0
    if mem[M_LOW_TIME] == 0.0:
        mem[M_OPEN_SUM], mem[M_OPEN_COUNT] = 0.0, 0.0


@inner
def on_skew(event, f):
    """What the logger's clock gained on GPS time, s."""
    mem = f.memory
    gained = event[2]
    if abs(gained) < 1.0:
        mem[M_GAINED] += gained


@inner
def on_gps(event, t, f):
    """One satellite fix, late by its way to the logger and the receiver's own filter."""
    x = f.x
    P = f.P
    mem = f.memory
    s = f.settings
    utc, lat, lon, alt = event[2], event[3], event[4], event[5]
    hdop, quality, told_speed, course = event[6], event[7], event[8], event[9]
    usable = math.isfinite(lat) and math.isfinite(lon) and math.isfinite(utc) and quality > 0.0
    usable = usable and abs(lat) <= 90.0 and abs(lon) <= 180.0 and not (lat == 0.0 and lon == 0.0)
    if not usable:
        note(GPS_NORTH, lat, POOR, f)
        note(GPS_EAST, lon, POOR, f)
        return
    # the logger's time of UTC 0, from the earliest arrival seen
    clock = t - utc - mem[M_GAINED]
    if mem[M_CLOCK_SET] == 0.0 or clock < mem[M_CLOCK] or clock > mem[M_CLOCK] + 5.0:
        mem[M_CLOCK] = clock
        mem[M_CLOCK_SET] = 1.0
    # so late for so long: the logger's clock has been set anew
    if clock > mem[M_CLOCK] + LATE:
        mem[M_LATE_LEAST] = min(mem[M_LATE_LEAST], clock) if mem[M_LATE] > 0.0 else clock
        mem[M_LATE] += 1.0
        if mem[M_LATE] >= LATE_FIXES:
            mem[M_CLOCK] = mem[M_LATE_LEAST]
            mem[M_LATE] = 0.0
    else:
        mem[M_LATE] = 0.0
    lag = clock - mem[M_CLOCK] + s[S_GPS_ARRIVAL] + s[S_GPS_LAG]
    if mem[M_ORIGIN_SET] == 0.0:
        phi = math.radians(lat)
        axis, flattening = 6378137.0, 1.0 / 298.257223563
        e2 = flattening * (2.0 - flattening)
        root = math.sqrt(1.0 - e2 * math.sin(phi) ** 2)
        mem[M_LATITUDE], mem[M_LONGITUDE], mem[M_ALTITUDE] = lat, lon, alt
        mem[M_NORTH_SCALE] = math.radians(1.0) * axis * (1.0 - e2) / root**3
        mem[M_EAST_SCALE] = math.radians(1.0) * axis / root * math.cos(phi)
        mem[M_ORIGIN_SET] = 1.0
        reset(NORTH, 0.0, 25.0, f)
        reset(EAST, 0.0, 25.0, f)
        if math.isfinite(alt):
            reset(DOWN, -alt, 100.0, f)
    if lat == mem[M_FIX_LATITUDE] and lon == mem[M_FIX_LONGITUDE]:
        if mem[M_TICKS] - mem[M_FIX_TICKS] >= 2.0:
            mem[M_FIX_SAME] += 1.0
    else:
        mem[M_FIX_SAME] = 0.0
    mem[M_FIX_LATITUDE], mem[M_FIX_LONGITUDE], mem[M_FIX_TICKS] = lat, lon, mem[M_TICKS]
    north = (lat - mem[M_LATITUDE]) * mem[M_NORTH_SCALE]
    east = (lon - mem[M_LONGITUDE]) * mem[M_EAST_SCALE]
    if mem[M_FIX_SAME] >= 2.0:
        note(GPS_NORTH, north, STUCK, f)
        note(GPS_EAST, east, STUCK, f)
        return
    dilution = max(hdop, 1.0) if math.isfinite(hdop) else 2.0
    moving = x[1] > 2.0 and P[1, 1] < 1.0
    # a heading that nobody knows is taken over, from the course or from the way since an earlier fix
    if moving and mem[M_HEADING_SET] == 0.0:
        step_n, step_e = north - mem[M_FIX_NORTH], east - mem[M_FIX_EAST]
        way = math.hypot(step_n, step_e)
        if math.isfinite(course):
            reset(HEADING, course + lag * x[8] * x[1], (s[S_GPS_COURSE] / x[1]) ** 2 + 0.01, f)
            mem[M_HEADING_SET] = 1.0
        elif math.isnan(way):
            mem[M_FIX_NORTH], mem[M_FIX_EAST] = north, east
        elif way > 10.0:
            reset(HEADING, math.atan2(step_e, step_n), 0.04, f)
            mem[M_HEADING_SET] = 1.0
    r = (s[S_GPS] * dilution) ** 2
    if mem[M_HEADING_SET] > 0.0 or not moving:
        a1 = fuse(GPS_NORTH, north, r, lag, f)
        a2 = fuse(GPS_EAST, east, r, lag, f)
        if a1 == REOPENED or a2 == REOPENED:
            # the receiver may have jumped, or we are lost: let both move
            for k in (5, 6, 17, 18):
                P[k, k] += 100.0
    if math.isfinite(alt):
        r = (s[S_GPS_Z] * dilution) ** 2
        fuse(GPS_ALTITUDE, alt, r, lag, f)
    if math.isfinite(told_speed):
        # the receiver smooths: after a jolt, one linear in time says too little of what it has seen
        r = s[S_GPS_SPEED] ** 2
        late = (lag - s[S_GPS_LAG]) / max(s[S_GPS_LAG], 1e-3)
        smoothed = mem[M_TOLD_SPEED] - late * (x[1] - mem[M_TOLD_SPEED])
        straight = x[1] - lag * acceleration(x, f.car, f.work[40:44])
        fuse(GPS_SPEED, told_speed - smoothed + straight, r, lag, f)
        if moving and told_speed > 3.0 and mem[M_HEADING_SET] > 0.0 and math.isfinite(course):
            r = (s[S_GPS_COURSE] / told_speed) ** 2
            reason = fuse(GPS_COURSE, course, r, lag, f)
            if reason == REOPENED:
                reset(HEADING, course + lag * x[8] * x[1], r + 0.01, f)


@inner
def on_plain(event, code, f):
    """Sensors whose values are measurements as they stand: road map, gyroscope, compass, speed, fuel flow.

    MAP: heading, altitude, straightness of a node passed `event[8]` s ago, each with its deviation; NaN where unsaid.
    GYROSCOPE: body rates, rad/s. COMPASS_EVENT: rad. SPEED_EVENT: m/s. FUEL: W.
    """
    x, P, mem, s = f.x, f.P, f.memory, f.settings
    # up to three measurements: kind, value, deviation, lag (one call of `fuse` compiles faster than ten)
    told = f.work[48:60].reshape(3, 4)
    count = 1
    told[0, 1] = event[2]
    told[:, 3] = 0.0
    if code == MAP:
        count = 3
        told[0, 0], told[1, 0], told[2, 0] = MAP_HEADING, MAP_ALTITUDE, MAP_STRAIGHTNESS
        told[1, 1], told[2, 1] = event[4], event[6]
        told[0, 2], told[1, 2], told[2, 2] = s[S_MAP_HEADING] * event[3], event[5], s[S_MAP_STRAIGHT] * event[7]
        told[0, 3], told[1, 3] = event[8], event[8]
    elif code == GYROSCOPE:
        count = 2
        told[0, 0], told[0, 1], told[0, 2] = YAW_RATE, event[4], s[S_GYRO]
        told[1, 0], told[1, 1], told[1, 2] = PITCH_RATE, event[3], s[S_GYRO]
    elif code == COMPASS_EVENT:
        told[0, 0], told[0, 2] = COMPASS, s[S_COMPASS]
    elif code == SPEED_EVENT:
        told[0, 0], told[0, 2] = SPEED, s[S_SPEED]
        mem[M_TICKS] += 1.0 if event[2] > 1.0 else 0.0
    else:
        power = event[2]
        told[0, 0], told[0, 2] = FUEL_POWER, math.hypot(s[S_FUEL] * power, 100.0)
        if math.isfinite(power):
            thrust = s[S_THRUST_GAIN] * (power - x[11]) / max(x[1], 3.0)
            mem[M_RESERVOIR] += thrust * thrust
            P[11, 11] += (power - x[11]) ** 2
            mem[M_CUT] = 1.0 if power < 200.0 else 0.0
    for i in range(count):
        if code == MAP and (not math.isfinite(told[i, 1]) or (i == 0 and mem[M_HEADING_SET] == 0.0)):
            continue
        fuse(np.int64(told[i, 0]), told[i, 1], told[i, 2] ** 2, told[i, 3], f)


@inner
def on_step(event, f):
    """In hindsight only: here the fuel power changed by `event[2]` W; `event[3]`: it fell to 0."""
    change = event[2]
    f.P[11, 11] += change * change
    thrust = change / max(f.x[1], 3.0)
    f.P[2, 2] += (f.settings[S_THRUST_GAIN_HINDSIGHT] * thrust) ** 2
    if event[3] > 0.0:
        f.memory[M_PULSE_GAP] = 0.0
        fuse(CUT_OFF, 0.0, 1e4, 0.0, f)


@inner
def on_grid(t, f):
    """Every 0.1 s: what silence tells, whether all is sound, and the estimate."""
    x = f.x
    P = f.P
    mem = f.memory
    s = f.settings
    out = f.counts
    tape = f.tape
    tape_index = f.tape_index
    tape_P = f.tape_P
    grid_x = f.grid_x
    grid_P = f.grid_P
    # silence is information, once there has been a pulse
    if not math.isnan(mem[M_TICK_TIME]):
        quiet = t - mem[M_TICK_TIME]
        if quiet > s[S_TICK_SILENCE]:
            mem[M_SILENT] = 1.0
            mem[M_TICK_ANCHORED] = 0.0
            v = s[S_SILENT_SPEED]
            if quiet > 2.0:
                if not t - mem[M_STANDSTILL] < STANDSTILL_AGAIN - 0.01:
                    mem[M_STANDSTILL] = t
                    fuse(SILENT_WHEELS, 0.0, s[S_STANDSTILL] * s[S_STANDSTILL], 0.0, f)
            elif x[1] > 0.5 * v:
                # anywhere below the speed that is heard
                fuse(SILENT_WHEELS, 0.5 * v, v * v / 12.0, 0.0, f)
    quiet = t - mem[M_PULSE_TIME]
    if quiet > s[S_CUT_GAP] and mem[M_CUT] == 0.0:
        mem[M_CUT] = 1.0
        mem[M_ANGLE_ANCHORED] = 0.0
        mem[M_ENERGY_ANCHORED] = 0.0
        reset(POWER, 0.0, 1e4, f)
        mem[M_PULSE_POWER] = 0.0
    if not sound(P, f.work[124 + 11 * NX : 124 + 11 * NX + NX * NX].reshape(NX, NX)):
        mem[M_REPAIRS] += 1.0
        for i in range(NX):
            if not math.isfinite(x[i]):
                x[i] = 0.0
            reset(i, x[i], initial_variance(i, s), f)
        mem[M_TOLD_SPEED] = x[1]
    if abs(x[4]) > 0.5:
        reset(PITCH_ANGLE, 0.0, s[S_PITCH] * s[S_PITCH], f)
    m = out[GRID_LINES]
    if m < grid_x.shape[0]:
        for i in range(NX):
            grid_x[m, i] = x[i]
            grid_P[m, i] = P[i, i]
    if out[TAPING] > 0:
        k = out[TAPE_LINES]
        tape_index[k, 0] = OP_GRID
        tape_index[k, 1] = m
        for i in range(NX):
            tape[k, i] = x[i]
        j = out[TAPE_GRID]
        tape_index[k, 2] = j
        for i in range(NX):
            for c in range(NX):
                tape_P[j, i, c] = P[i, c]
        out[TAPE_GRID] = j + 1
        out[TAPE_LINES] = k + 1
    out[GRID_LINES] = m + 1


@njit(cache=True, error_model="numpy", no_cfunc_wrapper=True)
def advance(events, first, last, f):
    """Run the filter over events[first:last], (n, COLUMNS), sorted by time. All state lives in `f`."""
    for e in range(first, last):
        event = events[e]
        t, code = event[0], int(event[1])
        f.memory[M_EVENTS] += 1.0
        move(t, f)
        if code == ACCELEROMETER:
            on_accelerometer(event, f)
        elif code == WHEEL:
            on_wheel(event, t, f)
        elif code == INJECTOR:
            on_injector(event, t, f)
        elif code == SKEW:
            on_skew(event, f)
        elif code == GPS:
            on_gps(event, t, f)
        elif code == GRID:
            on_grid(t, f)
        elif code == STEP:
            on_step(event, f)
        else:
            on_plain(event, code, f)


@njit(cache=True, error_model="numpy", no_cfunc_wrapper=True)
def retreat(f, begin, end, only, lam, L, smooth_x, smooth_P):
    """The modified Bryson-Frazier smoother backwards over lines [begin, end) of the tape of `f` (Bierman 1973).

    `only`: the one grid line that is wanted; -1: all of them.

    lam (NX) and L (NX, NX) are the adjoint state and its information; they carry over from the tape that follows.
    smooth_x, smooth_P (k, NX) receive the smoothed states and variances at the grid's places.
    """
    tape, tape_index, tape_P, p, s = f.tape, f.tape_index, f.tape_P, f.car, f.settings
    n = np.empty((7, 8))
    xm = np.empty(NX + 4)
    b = np.empty(NX)
    w = np.empty((NX, NX))
    moved = np.empty((10, NX))
    for m in range(end - 1, begin - 1, -1):
        op = tape_index[m, 0]
        if op == OP_ROW:
            k_gain = tape[m, 0:NX]
            count = tape_index[m, 1]
            nu, inverse = tape[m, NX + 8], tape[m, NX + 9]
            # (I - K H)' lam - H' nu / S, and the same on both sides of L, plus H' H / S
            dot = 0.0
            for i in range(NX):
                dot += k_gain[i] * lam[i]
            for i in range(NX):
                total = 0.0
                for j in range(NX):
                    total += L[i, j] * k_gain[j]
                b[i] = total
            quad = 0.0
            for i in range(NX):
                quad += k_gain[i] * b[i]
            for c in range(count):
                i = tape_index[m, 2 + c]
                h = tape[m, NX + c]
                lam[i] -= h * (dot + nu * inverse)
                for j in range(NX):
                    L[i, j] -= h * b[j]
            for c in range(count):
                i = tape_index[m, 2 + c]
                h = tape[m, NX + c]
                for j in range(NX):
                    L[j, i] -= h * b[j]
            for c in range(count):
                i = tape_index[m, 2 + c]
                for d in range(count):
                    j = tape_index[m, 2 + d]
                    L[i, j] += tape[m, NX + c] * tape[m, NX + d] * (quad + inverse)
        elif op == OP_PREDICT:
            dt = tape[m, NX + 8]
            transition(tape[m], dt, p, n, xm)
            decay = math.exp(-dt / s[S_DRIFT_TIME])
            decay_z = math.exp(-dt / s[S_DRIFT_Z_TIME])
            transpose_apply(lam, n, dt, decay, decay_z)
            sandwich(L, n, dt, decay, decay_z, moved)
        elif op == OP_RESET:
            i = tape_index[m, 1]
            lam[i] = 0.0
            for j in range(NX):
                L[i, j] = 0.0
                L[j, i] = 0.0
        else:
            g = tape_index[m, 1]
            P = tape_P[tape_index[m, 2]]
            if g < smooth_x.shape[0] and (only < 0 or g == only):
                for i in range(NX):
                    total = 0.0
                    for j in range(NX):
                        total += P[i, j] * lam[j]
                    smooth_x[g, i] = tape[m, i] - total
                for i in range(NX):
                    for j in range(NX):
                        w[i, j] = 0.0
                    for k in range(NX):
                        c = P[i, k]
                        for j in range(NX):
                            w[i, j] += c * L[k, j]
                for i in range(NX):
                    total = 0.0
                    for j in range(NX):
                        total += w[i, j] * P[j, i]
                    smooth_P[g, i] = P[i, i] - total


@inner
def transpose_apply(lam, n, dt, decay, decay_z):
    """lam <- Phi' lam."""
    a0, a1, a2, a3, a4, a5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(7):
        c = lam[r if r < 2 else r + 1]
        a0 += c * n[r, 0]
        a1 += c * n[r, 1]
        a2 += c * n[r, 2]
        a3 += c * n[r, 3]
        a4 += c * n[r, 4]
        a5 += c * n[r, 5]
    lam[20] += n[0, 6] * lam[0]
    lam[21] += n[0, 7] * lam[0]
    lam[1] += a0
    lam[2] += a1
    lam[4] += a2
    lam[9] += a3
    lam[3] += a4
    lam[8] += a5
    lam[11] += dt * lam[10]
    lam[13] += dt * lam[12]
    lam[17] *= decay
    lam[18] *= decay
    lam[19] *= decay_z


@inner
def sandwich(L, n, dt, decay, decay_z, a):
    """L <- Phi' L Phi for a symmetric L (NX, NX); a (10, NX) is scratch.

    With Phi = I + N: L + N' L + L N + N' L N, of which only the rows and columns `READ` of N differ from zero.
    """
    for j in range(NX):
        L[17, j] *= decay
        L[18, j] *= decay
        L[19, j] *= decay_z
    for j in range(NX):
        L[j, 17] *= decay
        L[j, 18] *= decay
        L[j, 19] *= decay_z
    for c in range(6):
        for j in range(NX):
            a[c, j] = 0.0
        for r in range(7):
            h = n[r, c]
            if h != 0.0:
                i = r if r < 2 else r + 1
                for j in range(NX):
                    a[c, j] += h * L[i, j]
    n6, n7 = n[0, 6], n[0, 7]
    for j in range(NX):
        a[6, j] = n6 * L[0, j]
        a[7, j] = n7 * L[0, j]
        a[8, j] = dt * L[10, j]
        a[9, j] = dt * L[12, j]
    for c in range(10):
        i = READ[c]
        for j in range(NX):
            L[i, j] += a[c, j]
    for c in range(10):
        i = READ[c]
        a0, a1, a3, a4, a5, a6, a7 = a[c, 0], a[c, 1], a[c, 3], a[c, 4], a[c, 5], a[c, 6], a[c, 7]
        for d in range(6):
            L[i, READ[d]] += (
                n[0, d] * a0 + n[1, d] * a1 + n[2, d] * a3 + n[3, d] * a4 + n[4, d] * a5 + n[5, d] * a6 + n[6, d] * a7
            )
        L[i, 20] += n6 * a0
        L[i, 21] += n7 * a0
        L[i, 11] += dt * a[c, 10]
        L[i, 13] += dt * a[c, 12]
    for c in range(10):
        i = READ[c]
        for d in range(10):
            L[i, READ[d]] += a[d, i]
    for c in range(10):
        i = READ[c]
        for j in range(NX):
            L[j, i] = L[i, j]
