"""The plant's step: one compiled function over flat vectors. `reference.py` says the same in readable Python.

A step of the plant is an exact energy balance. Speeds change linearly over it and every force works at the mean
speed of the step, so that fuel energy = work + losses + change of stored energy holds to rounding.

Vectors: `p` parameters (`plant_parameters` fills it), `x` state, rows of `record` the channels that the step knows.
Everything a kernel needs stands in this file, constants included: numba's cache does not see edits elsewhere.
"""

import math

import numpy as np
from numba import njit

TABLE = 96
"""Nodes of each table over engine speed."""
MAX_GEARS = 12

# --- parameters: index of each in `p` ------------------------------------------------------------------------
(
    P_MASS,  # kg, car and load
    P_GRAVITY,  # m/s2
    P_RADIUS,  # m, rolling radius at rest
    P_RADIUS_GROWTH,  # s2/m2, relative growth of the radius with speed squared
    P_DRIVEN_INERTIA,  # kg m2, driven wheels
    P_FREE_INERTIA,  # kg m2, free wheels
    P_FREE_RADIUS,  # m, constant
    P_DRAG,  # kg/m, rho Cd A / 2
    P_YAW_DRAG,  # 1/rad2, growth of Cd with the flow angle squared
    P_WIND,  # m/s
    P_WIND_FROM,  # rad, heading from which it blows
    P_GUST,  # relative amplitude
    P_GUST_RATE,  # rad/s
    P_CROSS,  # m/s
    P_CROSS_FROM,  # rad
    P_ROLLING,  # Crr at the reference speed and warm tyre
    P_ROLLING_BASE,  # share of Crr at standstill
    P_ROLLING_SPEED,  # s2/m2, growth with speed squared
    P_TYRE_COLD,  # relative extra of the cold tyre
    P_TYRE_FAST_SHARE,
    P_TYRE_RATE,  # 1/s
    P_TYRE_FAST_RATE,  # 1/s
    P_CORNERING,  # N s4/m2: cornering resistance = this x (v^2 S_j)^2
    P_BRAKE_DRAG,  # N
    P_BRAKE_DRAG_HOT,  # N, after braking
    P_BRAKE_COOLING,  # 1/s
    P_BRAKE_LIMIT,  # N
    P_TRACTION,  # N, what the driven wheels hold
    P_SLIP_COMPLIANCE,  # 1/N, wheel slip per tyre force
    P_SLIP_RELAXATION,  # 1/s
    P_GEARS,  # number of gears
    P_CVT,  # 1: the variator chooses its ratio between those of the first and the last gear
    P_CVT_RATE,  # 1/s, largest relative change of the ratio
    P_GEAR_DRAG,  # N m at the axle
    P_GEAR_DRAG_SPEED,  # N m s at the axle
    P_GEAR_OIL_COLD,  # relative extra of that drag with cold oil
    P_GEAR_OIL_RATE,  # 1/m
    P_SHIFT_TIME,  # s
    P_CLUTCH_CAPACITY,  # N m
    P_LAUNCH_SPEED,  # rad/s at full demand
    P_LAUNCH_FORCE,  # N, full demand
    P_INERTIA,  # kg m2, engine side
    P_IDLE,  # rad/s
    P_REDLINE,  # rad/s
    P_TORQUE_PER_PRESSURE,  # m3/rad: displacement / 4 pi
    P_CYCLE_EFFICIENCY,  # indicated efficiency before the losses below
    P_PRESSURE_GAIN,  # indicated mean pressure per manifold pressure
    P_AMBIENT_PRESSURE,  # Pa
    P_PUMPING_FLOOR,  # Pa
    P_THROTTLING,  # share of the throttle's pumping that the valve timing leaves
    P_SCHEDULE_SPEED,  # rad/s, the cycle's driver shifts up only to above it
    P_SCHEDULE_RESERVE,  # m/s2, acceleration that he keeps in reserve
    P_CLOSED_PRESSURE,  # Pa, manifold with closed throttle
    P_DILUTION,  # efficiency lost to residual gas at low load
    P_KNOCK,  # efficiency lost per square of relative pressure above the knock limit
    P_KNOCK_LIMIT,  # relative manifold pressure at zero speed
    P_KNOCK_SLOPE,  # s/rad
    P_ENRICHMENT,
    P_ENRICHMENT_LOAD,
    P_DRIFT,  # relative fuel at the centre of the drifted place
    P_DRIFT_SPEED,  # rad/s
    P_DRIFT_TORQUE,  # N m
    P_DRIFT_SPEED_WIDTH,  # rad/s
    P_DRIFT_TORQUE_WIDTH,  # N m
    P_FUEL_ENERGY,  # true / declared heating value
    P_BOOST_ONSET,  # share of the full load that comes without lag
    P_BOOST_TIME,  # s
    P_CUT_SHARE,  # share of the fuel that overrun cuts
    P_CUT_RESUME,  # rad/s
    P_CUT_BAND,  # rad/s
    P_TARGET_TEMPERATURE,  # K
    P_START_TEMPERATURE,  # K
    P_FRICTION_EXPONENT,
    P_OIL_SHARE,  # weight of the slow temperature in the friction
    P_WARM_UP_ENERGY,  # J, coolant
    P_WARM_UP_OIL_ENERGY,  # J, oil
    P_COLD_ENRICHMENT,  # relative fuel per (1 - T / T_target)
    P_CRANK_ENERGY,  # J
    P_CRANK_IDLE,  # rad/s
    P_CRANK_RETARD,  # relative fuel
    P_CRANK_TIME,  # s
    P_ELECTRICAL,  # W at the alternator's terminals
    P_ALTERNATOR,  # electrical over shaft power
    P_ACCESSORY_NOMINAL,  # W at the shaft, contained in the full-load curve
    P_AC_POWER,  # W at the shaft while on
    P_AC_RATE,  # 1/s, cycles per second
    P_AC_DUTY,
    P_IDLE_FUEL,  # factor on the fuel at standstill
    P_STOP_AFTER,  # s of standstill after which the engine stops
    P_TABLE_RATE,  # nodes per rad/s
) = range(90)
P_RATIO = 92
"""p[P_RATIO + gear]: engine speed / wheel speed; neutral is 0."""
P_LOSS = P_RATIO + MAX_GEARS + 1
"""p[P_LOSS + gear]: share of the torque that the gear loses."""
P_FULL_LOAD = np.int64(P_LOSS + MAX_GEARS + 1)  # no int: `_table` would be compiled for each literal
"""Tables over engine speed: full-load torque (N m), friction torque of the warm engine (N m), relative indicated
efficiency, exhaust back pressure (Pa, gauge)."""
P_FRICTION = P_FULL_LOAD + TABLE
P_SPEED_EFFICIENCY = P_FRICTION + TABLE
P_BACK_PRESSURE = P_SPEED_EFFICIENCY + TABLE
PARAMETERS = int(P_BACK_PRESSURE + TABLE)
"""Length of `p`."""

# --- state: index of each in `x` -----------------------------------------------------------------------------
(
    X_TIME,
    X_DISTANCE,
    X_SPEED,
    X_ACCELERATION,
    X_WHEEL_SPEED,  # rad/s, driven wheels
    X_SLIP,  # kappa
    X_TYRE_FORCE,  # N, driven wheels on the road
    X_GEAR,
    X_TARGET_GEAR,
    X_RATIO,  # present ratio
    X_SHIFT,  # s left of the shift
    X_CLUTCH,  # 0 open, 1 slipping, 2 locked
    X_ENGINE_SPEED,
    X_BOOST,  # N m
    X_CUT,  # 1 while overrun cuts the fuel
    X_ENGINE_ON,
    X_STANDSTILL,  # s
    X_COOLANT,  # K
    X_OIL,  # K
    X_TYRE,  # coldness of the tyre, slow part
    X_TYRE_FAST,
    X_BRAKE_HEAT,
    X_FUEL_ENERGY,
    X_ENGINE_ANGLE,
    X_WHEEL_ANGLE,
    X_INTEGRAL,  # N, of the cycle's driver
    X_SINCE_SHIFT,  # s, of the cycle's driver
    # energies since the start, J
    E_EXHAUST,  # exhaust and coolant: fuel that became no indicated work
    E_BLEND,  # metered at the declared heating value, but not in the fuel
    E_FRICTION,
    E_PUMPING,
    E_ACCESSORIES,
    E_AIR_CONDITIONING,
    E_STARTER,  # out of the battery
    E_CLUTCH,
    E_GEARBOX,
    E_THRUST,  # work of the thrust at the driven wheels
    E_WHEEL_SLIP,
    E_DRAG,
    E_ROLLING,
    E_CORNERING,
    E_BRAKE_DRAG,
    E_BRAKES,
    E_CLIMB,
    # what the last step found
    Y_THRUST,
    Y_BRAKE,
    Y_ROAD_LOAD,
    Y_ENGINE_TORQUE,
    Y_FUEL_POWER,
    Y_THROTTLE,
    Y_VOLTAGE,
) = range(51)
STATES = 51

# --- record: the columns that a row holds, in the order of `RECORD` ------------------------------------------
RECORD = (
    "time",
    "distance",
    "speed",
    "acceleration",
    "thrust",
    "brake_force",
    "road_load",
    "gear",
    "clutch",
    "engine_speed",
    "engine_torque",
    "fuel_power",
    "fuel_energy",
    "engine_angle",
    "wheel_angle",
    "throttle",
    "coolant_temperature",
    "battery_voltage",
)
COLUMNS = 18

# What compiles fast matters: the first run waits for it. INNER has no way in from Python, where calling it would crash.
ENTRY = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
INNER = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True}

OPEN, SLIPPING, LOCKED = 0.0, 1.0, 2.0
TWO_PI = 2.0 * math.pi


@njit(**INNER)
def _table(p, base, place):
    """Linear interpolation in the table at `base`; `place` in nodes, clamped."""
    place = min(max(place, 0.0), TABLE - 1.0)
    i = min(int(place), TABLE - 2)
    share = place - i
    return p[base + i] + share * (p[base + i + 1] - p[base + i])


@njit(**ENTRY)
def indicated_torque(p, speed, shaft):
    """Indicated torque and pumping torque (N m): what carries `shaft` (brake + friction + accessories) and the pumping.

    The throttle leaves as much manifold pressure as the indicated work needs, so pumping falls as load rises, down to a
    floor (valves, or turbine against compressor).
    """
    per_pressure = p[P_TORQUE_PER_PRESSURE]
    exhaust = p[P_AMBIENT_PRESSURE] + _table(p, P_BACK_PRESSURE, speed * p[P_TABLE_RATE])
    gain = p[P_PRESSURE_GAIN]
    part = p[P_THROTTLING]
    throttled = (shaft + part * per_pressure * exhaust) * gain / (gain + part)
    wide_open = shaft + per_pressure * p[P_PUMPING_FLOOR]
    indicated = max(throttled, wide_open, 0.0)
    return indicated, indicated - shaft


@njit(**INNER)
def indicated_efficiency(p, speed, indicated):
    """Indicated work over fuel heat: compression, heat loss and burning over speed, residual gas, knock retard."""
    pressure = indicated / (p[P_TORQUE_PER_PRESSURE] * p[P_PRESSURE_GAIN] * p[P_AMBIENT_PRESSURE])
    diluted = max(0.0, 1.0 - pressure / 0.6)
    knocking = max(0.0, pressure - p[P_KNOCK_LIMIT] - p[P_KNOCK_SLOPE] * speed)
    retard = max(0.6, 1.0 - p[P_KNOCK] * knocking * knocking)
    return (
        p[P_CYCLE_EFFICIENCY]
        * _table(p, P_SPEED_EFFICIENCY, speed * p[P_TABLE_RATE])
        * (1.0 - p[P_DILUTION] * diluted * diluted)
        * retard
    )


@njit(**INNER)
def mixture(p, speed, brake, full_load):
    """Fuel over what the indicated work needs: enrichment near full load, and the drifted place of the map."""
    excess = (brake / full_load - p[P_ENRICHMENT_LOAD]) / (1.0 - p[P_ENRICHMENT_LOAD])
    rich = 1.0 + p[P_ENRICHMENT] * min(max(excess, 0.0), 1.0)
    a = (speed - p[P_DRIFT_SPEED]) / p[P_DRIFT_SPEED_WIDTH]
    b = (brake - p[P_DRIFT_TORQUE]) / p[P_DRIFT_TORQUE_WIDTH]
    bump = 1.0 / (1.0 + 0.5 * (a * a + b * b))
    return rich * (1.0 + p[P_DRIFT] * bump * bump * bump)


def initial_state(p, x, speed, gear):
    """Fill `x` for a car at `speed` (m/s) in `gear`, engine running, thermostat at its start temperature."""
    x[:] = 0.0
    radius = p[P_RADIUS] * (1.0 + p[P_RADIUS_GROWTH] * speed * speed)
    x[X_SPEED] = speed
    x[X_WHEEL_SPEED] = speed / radius
    x[X_GEAR] = gear
    x[X_TARGET_GEAR] = gear
    ratio = p[P_RATIO + int(gear)]
    locked = ratio * x[X_WHEEL_SPEED]
    if p[P_CVT] > 0.0 and gear > 0.0:
        # the variator stands where it brings the engine a little above idle
        highest, lowest = p[P_RATIO + 1], p[P_RATIO + int(p[P_GEARS])]
        wanted = 1.5 * p[P_IDLE] / max(x[X_WHEEL_SPEED], 1e-6)
        ratio = min(max(wanted, lowest), highest)
        locked = ratio * x[X_WHEEL_SPEED]
    x[X_RATIO] = ratio
    if locked > 0.9 * p[P_IDLE]:
        x[X_CLUTCH] = LOCKED
        x[X_ENGINE_SPEED] = locked
    else:
        x[X_CLUTCH] = OPEN
        x[X_ENGINE_SPEED] = p[P_IDLE] + p[P_CRANK_IDLE]
    x[X_ENGINE_ON] = 1.0
    x[X_COOLANT] = p[P_START_TEMPERATURE]
    x[X_OIL] = p[P_START_TEMPERATURE]
    x[X_TYRE] = 1.0
    x[X_TYRE_FAST] = 1.0
    x[X_SINCE_SHIFT] = 10.0
    x[Y_VOLTAGE] = 14.1


@njit(**ENTRY)
def step(p, x, force, gear_wanted, pitch, straightness, vertical, heading, dt):
    """Advance `x` by `dt` seconds with `force` (N at the wheels) and `gear_wanted` (0 neutral ...) commanded.

    `pitch` (rad), `straightness` and `vertical` (rad/m), `heading` (rad): the road under the car.
    """
    force = min(force, p[P_TRACTION])
    v0 = x[X_SPEED]
    time = x[X_TIME]
    mass = p[P_MASS]

    # --- road load -------------------------------------------------------------------------------------------
    wind = p[P_WIND] * (1.0 + p[P_GUST] * math.sin(p[P_GUST_RATE] * time))
    air = v0 + wind * math.cos(heading - p[P_WIND_FROM])
    across = p[P_CROSS] * math.sin(heading - p[P_CROSS_FROM])
    flow_angle2 = min(across * across / max(air * air, 1.0), 0.12)
    drag = p[P_DRAG] * air * abs(air) * (1.0 + p[P_YAW_DRAG] * flow_angle2)
    load = max(mass * (p[P_GRAVITY] * math.cos(pitch) + vertical * v0 * v0), 0.0)
    cold_tyre = p[P_TYRE_COLD] * (p[P_TYRE_FAST_SHARE] * x[X_TYRE_FAST] + (1.0 - p[P_TYRE_FAST_SHARE]) * x[X_TYRE])
    rolling = p[P_ROLLING] * load * (p[P_ROLLING_BASE] + p[P_ROLLING_SPEED] * v0 * v0) * (1.0 + cold_tyre)
    lateral = v0 * v0 * straightness
    cornering = p[P_CORNERING] * lateral * lateral
    dragging = p[P_BRAKE_DRAG] + p[P_BRAKE_DRAG_HOT] * x[X_BRAKE_HEAT]
    climb = mass * p[P_GRAVITY] * math.sin(pitch)
    resistance = drag + rolling + cornering + dragging + climb

    # --- wheels ----------------------------------------------------------------------------------------------
    radius = p[P_RADIUS] * (1.0 + p[P_RADIUS_GROWTH] * v0 * v0)
    wheel0 = x[X_WHEEL_SPEED]
    slip0 = x[X_SLIP]
    slip = slip0 + min(p[P_SLIP_RELAXATION] * dt, 1.0) * (x[X_TYRE_FORCE] * p[P_SLIP_COMPLIANCE] - slip0)
    stretch = (1.0 + slip) / radius  # driven wheel's speed per car's speed

    # --- gear, shift, clutch ---------------------------------------------------------------------------------
    gear = x[X_GEAR]
    clutch = x[X_CLUTCH]
    shift = x[X_SHIFT]
    target = x[X_TARGET_GEAR]
    engine0 = x[X_ENGINE_SPEED]
    if shift <= 0.0 and gear_wanted != gear:
        target = gear_wanted
        clutch = OPEN
        shift = p[P_SHIFT_TIME] if v0 > 0.3 else dt
    elif shift > 0.0:
        target = gear_wanted
    if shift > 0.0:
        shift -= dt
        if shift <= 1e-9:
            shift = 0.0
            gear = target
            clutch = SLIPPING if gear > 0.0 else OPEN
    shifting = shift > 0.0
    ahead = target if shifting else gear
    ratio0 = x[X_RATIO]
    ratio = p[P_RATIO + int(ahead)]
    idle = p[P_IDLE] + p[P_CRANK_IDLE] * max(0.0, 1.0 - time / p[P_CRANK_TIME])
    full_load_hot = _table(p, P_FULL_LOAD, engine0 * p[P_TABLE_RATE])
    if p[P_CVT] > 0.0 and ahead > 0.0:
        # variator: engine speed follows the power that is wanted
        most = p[P_RATIO + 1]
        least = p[P_RATIO + int(p[P_GEARS])]
        power = max(force, 0.0) * v0
        wanted = min(max(1.35 * idle, power / (0.72 * full_load_hot)), 0.95 * p[P_REDLINE])
        ratio = min(max(wanted / max(wheel0, 1e-6), least), most)
        if ratio0 > 0.0:
            swing = p[P_CVT_RATE] * dt
            ratio = min(max(ratio, ratio0 * (1.0 - swing)), ratio0 * (1.0 + swing))
    if ratio0 <= 0.0 or p[P_CVT] <= 0.0:
        ratio0 = ratio
    middle_ratio = 0.5 * (ratio0 + ratio)
    synchronous = ratio0 * wheel0
    if clutch == LOCKED and synchronous < 0.9 * p[P_IDLE]:
        clutch = SLIPPING if force > 0.0 else OPEN
    elif clutch == OPEN and not shifting and gear > 0.0 and (force > 0.0 or synchronous > 1.15 * p[P_IDLE]):
        clutch = SLIPPING
    elif clutch == SLIPPING and force <= 0.0 and synchronous < 0.9 * p[P_IDLE]:
        clutch = OPEN
    loss = p[P_LOSS + int(ahead)]
    lever = middle_ratio / radius
    oil_cold = 1.0 + p[P_GEAR_OIL_COLD] * math.exp(-p[P_GEAR_OIL_RATE] * x[X_DISTANCE])
    turning = wheel0 / (wheel0 + 0.5)
    gear_drag = (p[P_GEAR_DRAG] + p[P_GEAR_DRAG_SPEED] * wheel0) * oil_cold * turning / radius

    # --- what the engine has to carry ------------------------------------------------------------------------
    warm = 1.0
    coldness = 0.0
    if x[X_COOLANT] < p[P_TARGET_TEMPERATURE] or x[X_OIL] < p[P_TARGET_TEMPERATURE]:
        coolant_share = (x[X_COOLANT] / p[P_TARGET_TEMPERATURE]) ** (-p[P_FRICTION_EXPONENT])
        oil_share = (x[X_OIL] / p[P_TARGET_TEMPERATURE]) ** (-p[P_FRICTION_EXPONENT])
        warm = (1.0 - p[P_OIL_SHARE]) * coolant_share + p[P_OIL_SHARE] * oil_share
        coldness = 1.0 - x[X_COOLANT] / p[P_TARGET_TEMPERATURE]
    place = engine0 * p[P_TABLE_RATE]
    friction_hot = _table(p, P_FRICTION, place)
    friction = friction_hot * warm
    turn = max(engine0, 0.4 * p[P_IDLE])
    phase = time * p[P_AC_RATE]
    ac_on = 1.0 if phase - math.floor(phase) < p[P_AC_DUTY] else 0.0
    alternator = p[P_ELECTRICAL] / p[P_ALTERNATOR] / turn
    compressor = p[P_AC_POWER] * ac_on / turn
    carried = friction + alternator + compressor
    full_load = max(
        full_load_hot - (friction - friction_hot) - (alternator + compressor - p[P_ACCESSORY_NOMINAL] / turn), 1.0
    )
    if engine0 > p[P_REDLINE]:
        full_load = max(full_load * (1.0 - (engine0 - p[P_REDLINE]) / (0.03 * p[P_REDLINE])), 1.0)
    per_pressure = p[P_TORQUE_PER_PRESSURE]
    exhaust = p[P_AMBIENT_PRESSURE] + _table(p, P_BACK_PRESSURE, place)
    closed_pumping = p[P_THROTTLING] * per_pressure * (exhaust - p[P_CLOSED_PRESSURE])
    closed_indicated = per_pressure * p[P_PRESSURE_GAIN] * p[P_CLOSED_PRESSURE]
    lowest = closed_indicated - closed_pumping - carried
    overrun = (1.0 - p[P_CUT_SHARE]) * closed_indicated - closed_pumping - carried

    # --- what is asked of it ---------------------------------------------------------------------------------
    wanted_clutch = 0.0
    if lever > 0.0:
        net = force + gear_drag
        wanted_clutch = net / (lever * (1.0 - loss)) if net > 0.0 else net / (lever * (1.0 + loss))
    inertia = p[P_INERTIA]
    difference = engine0 - synchronous
    launching = clutch == SLIPPING and synchronous < 1.15 * p[P_IDLE]
    held = idle
    if clutch == LOCKED:
        asked = wanted_clutch + inertia * ratio * stretch * x[X_ACCELERATION]
    elif launching:
        demand = min(max(force / p[P_LAUNCH_FORCE], 0.0), 1.0)
        held = idle + (p[P_LAUNCH_SPEED] - p[P_IDLE]) * demand
        asked = max(wanted_clutch, 0.0) + inertia * (max(held, synchronous) - engine0) / 0.15
    elif clutch == SLIPPING:
        asked = wanted_clutch + inertia * (synchronous - engine0) / 0.1
    elif shifting and ahead > 0.0:
        asked = inertia * (max(idle, ratio * wheel0) - engine0) / 0.08
    else:
        asked = inertia * (idle - engine0) / 0.25

    # --- what it gives ---------------------------------------------------------------------------------------
    standstill = x[X_STANDSTILL] + dt if v0 <= 0.0 and force <= 0.0 else 0.0
    on = x[X_ENGINE_ON]
    if on > 0.0 and standstill > p[P_STOP_AFTER]:
        on = 0.0
    elif on == 0.0 and force > 0.0:
        on = 0.5  # the starter turns it
    if on == 0.5 and engine0 > 0.7 * p[P_IDLE]:
        on = 1.0
    at_once = p[P_BOOST_ONSET] * full_load
    lagging = min(max(asked - at_once, 0.0), full_load - at_once)
    boost = x[X_BOOST] + (lagging - x[X_BOOST]) * min(dt / p[P_BOOST_TIME], 1.0)
    ceiling = at_once + boost
    span = lowest - overrun
    cut = x[X_CUT]
    if cut > 0.0:
        if engine0 < p[P_CUT_RESUME] or asked > overrun + 0.65 * span:
            cut = 0.0
    elif engine0 > p[P_CUT_RESUME] + p[P_CUT_BAND] and asked < overrun + 0.35 * span:
        cut = 1.0
    starter = 0.0
    if on < 1.0:
        indicated = 0.0
        pumping = closed_pumping * min(1.0, engine0 / p[P_IDLE])
        if engine0 <= 0.0:
            carried = 0.0
            friction = 0.0
            alternator = 0.0
            compressor = 0.0
            pumping = 0.0
        if on == 0.5:
            starter = carried + pumping + inertia * (p[P_IDLE] / 0.35)
        brake = starter - carried - pumping
    elif cut > 0.0:
        indicated = (1.0 - p[P_CUT_SHARE]) * closed_indicated
        pumping = closed_pumping
        brake = overrun
    else:
        brake = min(max(asked, lowest), ceiling)
        indicated, pumping = indicated_torque(p, engine0, brake + carried)
    throttle = min(max((asked - overrun) / (full_load - overrun), 0.0), 1.0)

    # --- brakes: what the overrun leaves ---------------------------------------------------------------------
    if clutch == LOCKED:
        through = brake - inertia * ratio * stretch * x[X_ACCELERATION]
    elif clutch == SLIPPING:
        capacity = p[P_CLUTCH_CAPACITY]
        if launching:
            bite = min(max((engine0 - 0.5 * p[P_IDLE]) / (0.4 * p[P_IDLE]), 0.0), 1.0)
            spared = min(max(inertia * (held - engine0) / 0.15, 0.0), 0.6 * ceiling)  # for the engine to rev up
            through = min(max(wanted_clutch, 0.0), ceiling - spared, capacity) * bite
            if difference < 0.0:
                through = -0.1 * through
        else:
            side = 1.0 if difference >= 0.0 else -1.0
            # beyond what is wanted the foot lets it in gently: a seventh of what it can carry, else the car would jump
            pull = max(min(inertia * abs(difference) / 0.06, 0.15 * capacity), side * wanted_clutch)
            through = side * min(max(pull, 0.0), capacity)
    else:
        through = 0.0
    thrust = lever * (through - loss * abs(through)) - gear_drag
    braking = 0.0
    if force < 0.0:
        braking = min(max(thrust - force, 0.0), p[P_BRAKE_LIMIT])

    # --- motion ----------------------------------------------------------------------------------------------
    driven = p[P_DRIVEN_INERTIA] / (radius * radius)
    free = mass + p[P_FREE_INERTIA] / (p[P_FREE_RADIUS] * p[P_FREE_RADIUS])
    surface0 = wheel0 * radius
    grip = stretch * radius
    moving = dt
    if clutch == LOCKED:
        # the gear's loss takes from the engine's torque or adds to the overrun's: the sign of the result decides
        kept = 1.0 - loss if through >= 0.0 else 1.0 + loss
        for _ in range(2):
            carry = lever * kept
            denominator = free + driven * grip + carry * inertia * ratio * stretch
            numerator = (
                free * v0
                + driven * surface0
                + carry * (brake * dt + inertia * engine0)
                - (gear_drag + resistance + braking) * dt
            )
            v1 = numerator / denominator
            through = brake - inertia * (ratio * stretch * v1 - engine0) / dt
            thrust = lever * kept * through - gear_drag
            if (through >= 0.0) == (kept < 1.0):
                break
            kept = 1.0 - loss if through >= 0.0 else 1.0 + loss
        if abs(through) > p[P_CLUTCH_CAPACITY]:
            clutch = SLIPPING
            through = p[P_CLUTCH_CAPACITY] if through > 0.0 else -p[P_CLUTCH_CAPACITY]
            thrust = lever * (through - loss * abs(through)) - gear_drag
    if clutch != LOCKED:
        v1 = (free * v0 + driven * surface0 + (thrust - resistance - braking) * dt) / (free + driven * grip)
    holding = v0 <= 0.0 and (force == 0.0 or (force < 0.0 and force <= climb))
    if v1 <= 0.0 or holding:
        # it stops within the step, and the brake holds it
        momentum = free * v0 + driven * surface0
        moving = dt * momentum / max(momentum - (free + driven * grip) * v1, 1e-12) if momentum > 0.0 else 0.0
        v1 = 0.0
        if clutch == LOCKED:
            clutch = OPEN
    wheel1 = stretch * v1
    engine1 = ratio * wheel1 if clutch == LOCKED else engine0 + dt * (brake - through) / inertia
    mean_speed = 0.5 * (v0 + v1)
    mean_wheel = 0.5 * (wheel0 + wheel1)
    if engine1 < 0.0:
        turned = 0.5 * engine0 * dt * engine0 / (engine0 - engine1)
        engine1 = 0.0
    else:
        turned = 0.5 * (engine0 + engine1) * dt
    travelled = mean_speed * moving
    rolled = mean_wheel * moving
    tyre_force = thrust - driven * (radius * wheel1 - surface0) / moving if moving > 0.0 else 0.0

    # --- fuel ------------------------------------------------------------------------------------------------
    if engine1 <= 0.0 and engine0 <= 0.0:
        heat = 0.0
    elif indicated > 0.0:
        need = 1.0 + p[P_COLD_ENRICHMENT] * coldness
        need *= mixture(p, engine0, brake, full_load)
        need *= 1.0 + p[P_CRANK_RETARD] * max(0.0, 1.0 - time / p[P_CRANK_TIME])
        if v0 <= 0.0:
            need *= p[P_IDLE_FUEL]
        heat = indicated * turned / indicated_efficiency(p, engine0, indicated) * need
    else:
        heat = 0.0
    if time < 1.0:
        heat += p[P_CRANK_ENERGY] * dt
    metered = heat / p[P_FUEL_ENERGY]

    # --- energies --------------------------------------------------------------------------------------------
    x[E_EXHAUST] += heat - indicated * turned
    x[E_BLEND] += metered - heat
    x[E_FRICTION] += friction * turned
    x[E_PUMPING] += pumping * turned
    x[E_ACCESSORIES] += alternator * turned
    x[E_AIR_CONDITIONING] += compressor * turned
    x[E_STARTER] += starter * turned
    x[E_GEARBOX] += (loss * abs(through) * middle_ratio + gear_drag * radius) * rolled
    if clutch == LOCKED:
        x[E_GEARBOX] += through * (turned - middle_ratio * rolled)  # of a variator that moves; else nothing
    else:
        x[E_CLUTCH] += through * (turned - middle_ratio * rolled)
    x[E_THRUST] += thrust * radius * rolled
    x[E_WHEEL_SLIP] += tyre_force * (radius * rolled - travelled)
    x[E_DRAG] += drag * travelled
    x[E_ROLLING] += rolling * travelled
    x[E_CORNERING] += cornering * travelled
    x[E_BRAKE_DRAG] += dragging * travelled
    x[E_BRAKES] += braking * travelled
    x[E_CLIMB] += climb * travelled

    # --- the clutch closes -----------------------------------------------------------------------------------
    if clutch == SLIPPING:
        after = engine1 - ratio * wheel1
        if v1 > 0.0 and (abs(after) < 0.5 or difference * after < 0.0) and abs(through) < p[P_CLUTCH_CAPACITY]:
            # an inelastic joint: what kinetic energy it takes is the clutch's
            gear_in = ratio * stretch
            car_before = free * v1 * v1 + p[P_DRIVEN_INERTIA] * wheel1 * wheel1
            engine_before = inertia * engine1 * engine1
            joint = (free + driven * grip * grip) * v1 + inertia * gear_in * engine1
            v1 = joint / (free + driven * grip * grip + inertia * gear_in * gear_in)
            wheel1 = stretch * v1
            engine1 = ratio * wheel1
            gained = free * v1 * v1 + p[P_DRIVEN_INERTIA] * wheel1 * wheel1 - car_before
            x[E_THRUST] += 0.5 * gained
            x[E_CLUTCH] += 0.5 * (engine_before - inertia * engine1 * engine1 - gained)
            clutch = LOCKED

    # --- slow states -----------------------------------------------------------------------------------------
    warming = p[P_TARGET_TEMPERATURE] - x[X_COOLANT]
    x[X_COOLANT] += warming * min(metered / p[P_WARM_UP_ENERGY], 1.0)
    warming = p[P_TARGET_TEMPERATURE] - x[X_OIL]
    x[X_OIL] += warming * min(metered / p[P_WARM_UP_OIL_ENERGY], 1.0)
    x[X_TYRE] -= x[X_TYRE] * p[P_TYRE_RATE] * dt
    x[X_TYRE_FAST] -= x[X_TYRE_FAST] * p[P_TYRE_FAST_RATE] * dt
    if braking > 0.0 and v0 > 0.5:
        x[X_BRAKE_HEAT] += (1.0 - x[X_BRAKE_HEAT]) * 0.5 * dt
    else:
        x[X_BRAKE_HEAT] -= x[X_BRAKE_HEAT] * p[P_BRAKE_COOLING] * dt

    # --- state -----------------------------------------------------------------------------------------------
    x[X_TIME] = time + dt
    x[X_DISTANCE] += travelled
    x[X_ACCELERATION] = (v1 - v0) / dt
    x[X_SPEED] = v1
    x[X_WHEEL_SPEED] = wheel1
    x[X_SLIP] = slip
    x[X_TYRE_FORCE] = tyre_force
    x[X_GEAR] = gear
    x[X_TARGET_GEAR] = target
    x[X_RATIO] = ratio
    x[X_SHIFT] = shift
    x[X_CLUTCH] = clutch
    x[X_ENGINE_SPEED] = engine1
    x[X_BOOST] = boost
    x[X_CUT] = cut
    x[X_ENGINE_ON] = on
    x[X_STANDSTILL] = standstill
    x[X_FUEL_ENERGY] += metered
    x[X_ENGINE_ANGLE] += turned
    x[X_WHEEL_ANGLE] += rolled
    x[Y_THRUST] = thrust
    x[Y_BRAKE] = braking if v1 > 0.0 else max(braking, thrust - climb)
    x[Y_ROAD_LOAD] = resistance
    x[Y_ENGINE_TORQUE] = brake
    x[Y_FUEL_POWER] = metered / dt
    x[Y_THROTTLE] = throttle
    if on == 1.0:
        x[Y_VOLTAGE] = 14.2 - 0.0004 * p[P_ELECTRICAL]
    elif on == 0.5:
        x[Y_VOLTAGE] = 9.5
    else:
        x[Y_VOLTAGE] = 12.3


@njit(**ENTRY)
def write_row(x, row):
    """Copy the state into one row of the record (`RECORD`)."""
    row[0] = x[X_TIME]
    row[1] = x[X_DISTANCE]
    row[2] = x[X_SPEED]
    row[3] = x[X_ACCELERATION]
    row[4] = x[Y_THRUST]
    row[5] = x[Y_BRAKE]
    row[6] = x[Y_ROAD_LOAD]
    row[7] = x[X_GEAR]
    row[8] = 0.5 * x[X_CLUTCH]
    row[9] = x[X_ENGINE_SPEED]
    row[10] = x[Y_ENGINE_TORQUE]
    row[11] = x[Y_FUEL_POWER]
    row[12] = x[X_FUEL_ENERGY]
    row[13] = x[X_ENGINE_ANGLE]
    row[14] = x[X_WHEEL_ANGLE]
    row[15] = x[Y_THROTTLE]
    row[16] = x[X_COOLANT]
    row[17] = x[Y_VOLTAGE]


@njit(**ENTRY)
def advance(p, x, force, gear, road, start, nodes_per_metre, steps, dt, record, row):
    """Take `steps` steps of `dt` with a held command on `road` (n, 4: pitch, S_j, S_k, heading), rows from `row` on.

    `road` is even in distance, `nodes_per_metre` apart, from `start` (m); beyond its ends it holds its last value.
    """
    last = road.shape[0] - 1
    for k in range(steps):
        place = min(max((x[X_DISTANCE] - start) * nodes_per_metre, 0.0), float(last))
        i = min(int(place), last - 1)
        share = place - i
        step(
            p,
            x,
            force,
            gear,
            road[i, 0] + share * (road[i + 1, 0] - road[i, 0]),
            road[i, 1] + share * (road[i + 1, 1] - road[i, 1]),
            road[i, 2] + share * (road[i + 1, 2] - road[i, 2]),
            road[i, 3] + share * (road[i + 1, 3] - road[i, 3]),
            dt,
        )
        write_row(x, record[row + k])


@njit(**ENTRY)
def wheel_force_limits(p, x):
    """Steady wheel force (N) at full load and in overrun, in the present gear at the present speed; 0, 0 in neutral."""
    gear = int(x[X_GEAR])
    ratio = x[X_RATIO] if p[P_CVT] > 0.0 and x[X_RATIO] > 0.0 else p[P_RATIO + gear]
    if gear == 0 or ratio <= 0.0:
        return 0.0, 0.0
    speed = max(x[X_ENGINE_SPEED], p[P_IDLE])
    if x[X_CLUTCH] != LOCKED and ratio * x[X_WHEEL_SPEED] < p[P_LAUNCH_SPEED]:
        speed = p[P_LAUNCH_SPEED]  # it will launch there
    return wheel_force_at(p, gear, ratio, speed)


@njit(**INNER)
def wheel_force_at(p, gear, ratio, speed):
    """Steady wheel force (N) at full load and in overrun with the engine at `speed` (rad/s) in `gear` of `ratio`."""
    place = speed * p[P_TABLE_RATE]
    full = _table(p, P_FULL_LOAD, place)
    if speed > p[P_REDLINE]:
        full = max(full * (1.0 - (speed - p[P_REDLINE]) / (0.03 * p[P_REDLINE])), 0.0)
    carried = _table(p, P_FRICTION, place) + p[P_ELECTRICAL] / p[P_ALTERNATOR] / speed
    exhaust = p[P_AMBIENT_PRESSURE] + _table(p, P_BACK_PRESSURE, place)
    closed = p[P_THROTTLING] * p[P_TORQUE_PER_PRESSURE] * (exhaust - p[P_CLOSED_PRESSURE])
    fired = (1.0 - p[P_CUT_SHARE]) * p[P_TORQUE_PER_PRESSURE] * p[P_PRESSURE_GAIN] * p[P_CLOSED_PRESSURE]
    wheel = speed / ratio
    lost = (p[P_GEAR_DRAG] + p[P_GEAR_DRAG_SPEED] * wheel) / p[P_RADIUS]
    lever = ratio / p[P_RADIUS]
    loss = p[P_LOSS + gear]
    return lever * (1.0 - loss) * full - lost, lever * (1.0 + loss) * (fired - closed - carried) - lost


@njit(**INNER)
def choose_gear(p, x, wanted, acceleration):
    """The cycle driver's gear (0 at standstill): low engine speed at low demand, more at high, never the wrong side.

    `wanted` (N): wheel force he is about to ask for; `acceleration` (m/s2): that of the trace ahead.
    """
    v = x[X_SPEED]
    gears = int(p[P_GEARS])
    gear = int(x[X_GEAR])
    if p[P_CVT] > 0.0:
        return 1 if v > 0.0 or wanted > 0.0 else 0
    if v < 0.3:
        return 1 if wanted > 0.0 or acceleration > 0.0 else 0
    wheel = v / p[P_RADIUS]
    if gear == 0:
        gear = 1
        while gear < gears and p[P_RATIO + gear] * wheel > 0.42 * p[P_REDLINE]:
            gear += 1
        return gear
    if x[X_SHIFT] > 0.0:
        return int(x[X_TARGET_GEAR])
    if x[X_CLUTCH] == SLIPPING and p[P_RATIO + gear] * wheel < 1.15 * p[P_IDLE]:
        return gear
    idle = p[P_IDLE]
    if gear < gears and p[P_RATIO + gear] * wheel > 0.97 * p[P_REDLINE]:
        return gear + 1
    if gear < gears and x[X_SINCE_SHIFT] > 1.2 and wanted > 0.0:
        after = p[P_RATIO + gear + 1] * wheel
        strongest, _ = wheel_force_at(p, gear + 1, p[P_RATIO + gear + 1], after)
        if after > p[P_SCHEDULE_SPEED] and wanted + p[P_SCHEDULE_RESERVE] * p[P_MASS] < strongest:
            return gear + 1
    if gear > 1:
        now = p[P_RATIO + gear] * wheel
        below = p[P_RATIO + gear - 1] * wheel
        strongest, _ = wheel_force_at(p, gear, p[P_RATIO + gear], max(now, idle))
        if now < 0.73 * p[P_SCHEDULE_SPEED]:
            return gear - 1
        if wanted > 0.95 * strongest and below < 0.92 * p[P_REDLINE] and x[X_SINCE_SHIFT] > 0.8:
            return gear - 1
    return gear


@njit(**ENTRY)
def follow(p, x, trace, trace_step, own_gears, steps, dt, every, record):
    """Drive `steps` steps of `dt` along `trace` (n, 6: speed, gear, pitch, S_j, S_k, heading; every `trace_step` s).

    The driver knows his car: he asks for the force that the trace's acceleration and the road need, and corrects the
    speed error. `own_gears` 1: he shifts by `choose_gear`, else the trace's gears hold. Every `every`-th step fills a
    row of `record`; returns the rows filled.
    """
    last = trace.shape[0] - 1
    rows = 0
    mass = (
        p[P_MASS]
        + p[P_DRIVEN_INERTIA] / (p[P_RADIUS] * p[P_RADIUS])
        + p[P_FREE_INERTIA] / (p[P_FREE_RADIUS] * p[P_FREE_RADIUS])
    )
    per_step = dt / trace_step
    for k in range(steps):
        place = min((k + 1) * per_step, float(last))
        i = min(int(place), last - 1)
        share = place - i
        speed = trace[i, 0] + share * (trace[i + 1, 0] - trace[i, 0])
        slope = (trace[i + 1, 0] - trace[i, 0]) / trace_step
        pitch = trace[i, 2] + share * (trace[i + 1, 2] - trace[i, 2])
        straightness = trace[i, 3] + share * (trace[i + 1, 3] - trace[i, 3])
        vertical = trace[i, 4] + share * (trace[i + 1, 4] - trace[i, 4])
        heading = trace[i, 5] + share * (trace[i + 1, 5] - trace[i, 5])
        error = speed - x[X_SPEED]
        wanted = mass * (slope + 2.5 * error) + x[Y_ROAD_LOAD]
        if x[X_SHIFT] <= 0.0 and x[X_CLUTCH] == LOCKED:
            x[X_INTEGRAL] = min(max(x[X_INTEGRAL] + mass * 0.8 * error * dt, -0.1 * mass), 0.1 * mass)
        wanted += x[X_INTEGRAL]
        if speed <= 0.02 and slope <= 0.0:
            x[X_INTEGRAL] = 0.0
            wanted = min(wanted, -0.05 * mass) if x[X_SPEED] > 0.0 else 0.0
        gear = choose_gear(p, x, wanted, slope) if own_gears > 0 else int(trace[i, 1] + 0.5)
        if gear != int(x[X_TARGET_GEAR]):
            x[X_SINCE_SHIFT] = 0.0
        x[X_SINCE_SHIFT] += dt
        step(p, x, wanted, float(gear), pitch, straightness, vertical, heading, dt)
        if (k + 1) % every == 0 and rows < record.shape[0]:
            write_row(x, record[rows])
            rows += 1
    return rows


@njit(**INNER)
def steady_fuel(p, speed, brake):
    """Fuel power (W, metered) of the warm engine at steady `speed` (rad/s) and brake torque (N m), cut-off aside."""
    place = speed * p[P_TABLE_RATE]
    carried = _table(p, P_FRICTION, place) + p[P_ELECTRICAL] / p[P_ALTERNATOR] / max(speed, 0.4 * p[P_IDLE])
    carried += p[P_AC_POWER] * p[P_AC_DUTY] / max(speed, 0.4 * p[P_IDLE])
    full = _table(p, P_FULL_LOAD, place)
    indicated, _ = indicated_torque(p, speed, brake + carried)
    if indicated <= 0.0:
        return 0.0
    return (
        indicated
        * speed
        / indicated_efficiency(p, speed, indicated)
        * mixture(p, speed, brake, full)
        / p[P_FUEL_ENERGY]
    )


@njit(**INNER)
def steady_brake_torque(p, gear, speed, torque):
    """Crankshaft torque (N m) that gives the wheel-level `torque` = thrust x car's speed / engine speed, steadily."""
    ratio = p[P_RATIO + gear]
    wheel = speed / ratio
    surface = wheel * p[P_RADIUS]
    v = surface
    thrust = torque * speed / surface
    for _ in range(8):  # growth and slip are per mille: a contraction by 1e-2 each time
        radius = p[P_RADIUS] * (1.0 + p[P_RADIUS_GROWTH] * v * v)
        v = wheel * radius / (1.0 + thrust * p[P_SLIP_COMPLIANCE])
        thrust = torque * speed / v
    lost = (p[P_GEAR_DRAG] + p[P_GEAR_DRAG_SPEED] * wheel) * (wheel / (wheel + 0.5)) / radius
    net = (thrust + lost) * radius / ratio
    return net / (1.0 - p[P_LOSS + gear]) if net > 0.0 else net / (1.0 + p[P_LOSS + gear])


@njit(**INNER)
def steady_wheel_torque(p, gear, speed, brake):
    """Wheel-level torque (thrust x car's speed / engine speed, N m) of a steady crankshaft torque `brake` (N m)."""
    ratio = p[P_RATIO + gear]
    wheel = speed / ratio
    v = wheel * p[P_RADIUS]
    thrust = 0.0
    for _ in range(8):
        radius = p[P_RADIUS] * (1.0 + p[P_RADIUS_GROWTH] * v * v)
        lost = (p[P_GEAR_DRAG] + p[P_GEAR_DRAG_SPEED] * wheel) * (wheel / (wheel + 0.5)) / radius
        kept = brake * (1.0 - p[P_LOSS + gear]) if brake > 0.0 else brake * (1.0 + p[P_LOSS + gear])
        thrust = kept * ratio / radius - lost
        v = wheel * radius / (1.0 + thrust * p[P_SLIP_COMPLIANCE])
    return thrust * v / speed


@njit(**INNER)
def steady_overrun(p, speed):
    """Crankshaft torque (N m, negative) in overrun with the fuel cut as far as the car cuts it."""
    place = speed * p[P_TABLE_RATE]
    carried = _table(p, P_FRICTION, place) + p[P_ELECTRICAL] / p[P_ALTERNATOR] / max(speed, 0.4 * p[P_IDLE])
    carried += p[P_AC_POWER] * p[P_AC_DUTY] / max(speed, 0.4 * p[P_IDLE])
    exhaust = p[P_AMBIENT_PRESSURE] + _table(p, P_BACK_PRESSURE, place)
    closed = p[P_THROTTLING] * p[P_TORQUE_PER_PRESSURE] * (exhaust - p[P_CLOSED_PRESSURE])
    fired = (1.0 - p[P_CUT_SHARE]) * p[P_TORQUE_PER_PRESSURE] * p[P_PRESSURE_GAIN] * p[P_CLOSED_PRESSURE]
    return fired - closed - carried


@njit(**ENTRY)
def steady_table(p, quantity, gear, speed, torque, out):
    """Fill `out` (n,) for the arguments (n,): 0 fuel at wheel level, 1 full load, 2 overrun, 3 fuel at the crank."""
    for n in range(out.shape[0]):
        w = speed[n]
        if quantity == 0:
            out[n] = steady_fuel(p, w, steady_brake_torque(p, gear[n], w, torque[n]))
        elif quantity == 1:
            full = _table(p, P_FULL_LOAD, w * p[P_TABLE_RATE])
            out[n] = steady_wheel_torque(p, gear[n], w, full)
        elif quantity == 2:
            out[n] = steady_wheel_torque(p, gear[n], w, steady_overrun(p, w))
        else:
            out[n] = steady_fuel(p, w, torque[n])
