"""The nominal simulator driven along a measured trip: what force, engine torque and fuel it needs for that motion.

The plant runs forward: a driver asks, the car moves. A logged trip is the other way round: the motion is known, so each
sample of the plant's step is solved for the torque instead (inverse dynamics), with the plant's own parameter vector.
Every effect of the catalogue that the plant knows is thereby a setting here too. `tests/gap` drives the forward plant
and checks that its own trip, replayed, gives its own fuel back.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_model.car.parameters import Car
from vehicle_model.plant import kernel as k
from vehicle_model.plant.parameters import plant_parameters

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """What was measured, all (n,): the input of a replay."""

    time: Array
    """s since the trip began."""
    distance: Array
    speed: Array
    acceleration: Array
    force: Array
    """dv/dt + g sin(theta), m/s2, bias removed."""
    engine_speed: Array
    """rad/s; idle speed where unknown and the clutch is open."""
    gear: NDArray[np.int64]
    heading: Array
    curvature: Array
    burnt: Array
    """J measured since the trip began (drives the warm-up)."""
    brake_heat: Array
    """0 to 1, memory of braking."""


@dataclass(frozen=True)
class Replay:
    """What the simulator says, (n,)."""

    road_force: Array
    """N at the wheels that the motion needs: resistance, climb, inertia of the body and wheels."""
    engine_torque: Array
    """N m at the crankshaft that gives it, engine's inertia included."""
    overrun: Array
    """N m with the fuel cut."""
    overrun_force: Array
    """N at the wheels with the fuel cut."""
    fuel: Array
    """W if the engine fires; not below what the closed throttle burns."""
    cut: Array
    """0 to 1: how surely the engine's control would cut the fuel."""
    launch_speed: float
    shift_time: float
    idle_speed: Array
    load: Array
    """engine torque / full load."""
    knock: Array
    """Share of the fuel's work that is lost by ignition retarded against knock, per unit of the plant's coefficient."""


def replay(car: Car, motion: Motion, settings: Mapping[str, float] | None = None) -> Replay:
    """Return what `car` under `settings` ("effect.parameter": value) needs for `motion`."""
    return replay_vector(vector_of(car, settings), motion)


_car: list[Car] = []
_vectors: dict[tuple[tuple[str, float], ...], Array] = {}


def vector_of(car: Car, settings: Mapping[str, float] | None = None) -> Array:
    """Return the plant's parameter vector; every trip of a car asks for the same hundred, so they are kept."""
    if not _car or (_car[0] is not car and _car[0] != car):
        _car[:] = [car]
        _vectors.clear()
    key = tuple(sorted((settings or {}).items()))
    if key not in _vectors:
        _vectors[key] = plant_parameters(car, settings)
    return _vectors[key]


def _table(p: Array, base: int | np.signedinteger, speed: Array) -> Array:
    return np.interp(speed * p[k.P_TABLE_RATE], np.arange(k.TABLE), p[base : base + k.TABLE])


def replay_vector(p: Array, m: Motion) -> Replay:
    """The same from the plant's parameter vector."""
    v, w = m.speed, np.maximum(m.engine_speed, 0.4 * p[k.P_IDLE])
    moving = (v > 0.3).astype(float)
    wind = p[k.P_WIND] * (1.0 + p[k.P_GUST] * np.sin(p[k.P_GUST_RATE] * m.time))
    heading = np.nan_to_num(m.heading)
    air = v + wind * np.cos(heading - p[k.P_WIND_FROM])
    across = p[k.P_CROSS] * np.sin(heading - p[k.P_CROSS_FROM])
    angle2 = np.minimum(across**2 / np.maximum(air**2, 1.0), 0.12)
    drag = p[k.P_DRAG] * air * np.abs(air) * (1.0 + p[k.P_YAW_DRAG] * angle2)
    tyre = p[k.P_TYRE_COLD] * (
        p[k.P_TYRE_FAST_SHARE] * np.exp(-m.time * p[k.P_TYRE_FAST_RATE])
        + (1.0 - p[k.P_TYRE_FAST_SHARE]) * np.exp(-m.time * p[k.P_TYRE_RATE])
    )
    weight = p[k.P_MASS] * p[k.P_GRAVITY]
    rolling = p[k.P_ROLLING] * weight * (p[k.P_ROLLING_BASE] + p[k.P_ROLLING_SPEED] * v**2) * (1.0 + tyre)
    cornering = p[k.P_CORNERING] * (v**2 * m.curvature) ** 2
    dragging = p[k.P_BRAKE_DRAG] + p[k.P_BRAKE_DRAG_HOT] * m.brake_heat
    wheels = (p[k.P_DRIVEN_INERTIA] + p[k.P_FREE_INERTIA]) / p[k.P_FREE_RADIUS] ** 2
    force = drag * moving + (rolling + cornering + dragging) * moving + p[k.P_MASS] * m.force + wheels * m.acceleration

    gear = np.maximum(m.gear, 1)
    radius = p[k.P_RADIUS] * (1.0 + p[k.P_RADIUS_GROWTH] * v**2)
    lever = p[k.P_RATIO + gear] / radius
    loss = p[k.P_LOSS + gear]
    wheel = v / radius
    oil = 1.0 + p[k.P_GEAR_OIL_COLD] * np.exp(-p[k.P_GEAR_OIL_RATE] * m.distance)
    gear_drag = (p[k.P_GEAR_DRAG] + p[k.P_GEAR_DRAG_SPEED] * wheel) * oil * wheel / (wheel + 0.5) / radius
    net = force + gear_drag
    clutch = np.where(net > 0.0, net / (lever * (1.0 - loss)), net / (lever * (1.0 + loss)))
    locked = m.gear > 0
    torque = np.where(locked, clutch + p[k.P_INERTIA] * lever * m.acceleration, 0.0)
    launching = ~locked & (m.acceleration > 0.2) & (v > 0.3) & (v < 5.0)
    lever1 = p[k.P_RATIO + 1] / radius
    torque = np.where(launching, np.maximum(net, 0.0) / (lever1 * (1.0 - p[k.P_LOSS + 1])), torque)

    start = p[k.P_START_TEMPERATURE] / p[k.P_TARGET_TEMPERATURE]
    coolant = 1.0 - (1.0 - start) * np.exp(-m.burnt / p[k.P_WARM_UP_ENERGY])
    oil_t = 1.0 - (1.0 - start) * np.exp(-m.burnt / p[k.P_WARM_UP_OIL_ENERGY])
    power = -p[k.P_FRICTION_EXPONENT]
    warm = (1.0 - p[k.P_OIL_SHARE]) * coolant**power + p[k.P_OIL_SHARE] * oil_t**power
    hot = _table(p, k.P_FRICTION, w)
    phase = m.time * p[k.P_AC_RATE]
    compressor = p[k.P_AC_POWER] * (phase % 1.0 < p[k.P_AC_DUTY]) / w
    alternator = p[k.P_ELECTRICAL] / p[k.P_ALTERNATOR] / w
    carried = hot * warm + alternator + compressor
    full = _table(p, k.P_FULL_LOAD, w) - hot * (warm - 1.0) - alternator - compressor + p[k.P_ACCESSORY_NOMINAL] / w
    full = np.maximum(full, 1.0)
    per = p[k.P_TORQUE_PER_PRESSURE]
    exhaust = p[k.P_AMBIENT_PRESSURE] + _table(p, k.P_BACK_PRESSURE, w)
    pumping = per * (exhaust - p[k.P_CLOSED_PRESSURE])
    closed = per * p[k.P_PRESSURE_GAIN] * p[k.P_CLOSED_PRESSURE]
    lowest = closed - pumping - carried
    overrun = (1.0 - p[k.P_CUT_SHARE]) * closed - pumping - carried

    brake = np.maximum(np.where(locked | launching, torque, 0.0), lowest)
    heat, retard = _burn(p, w, brake, brake + carried, full, exhaust)
    heat = heat * (1.0 + p[k.P_COLD_ENRICHMENT] * (1.0 - coolant))
    heat = heat * (1.0 + p[k.P_CRANK_RETARD] * np.maximum(0.0, 1.0 - m.time / p[k.P_CRANK_TIME]))
    heat = heat * np.where(moving > 0.0, 1.0, p[k.P_IDLE_FUEL])
    heat = heat + p[k.P_CRANK_ENERGY] / 1.0 * (m.time < 1.0)
    span = np.maximum(lowest - overrun, 0.2 * np.abs(lowest) + 1.0)
    low = np.clip((0.5 - (torque - overrun) / span) / 0.3 + 0.5, 0.0, 1.0)
    fast = np.clip((w - p[k.P_CUT_RESUME] - 0.5 * p[k.P_CUT_BAND]) / p[k.P_CUT_BAND] + 0.5, 0.0, 1.0)
    cut = np.where(locked, low * fast, 0.0)
    closed_fuel, _ = _burn(p, w, lowest, lowest + carried, full, exhaust)
    cut_share = (1.0 - p[k.P_CUT_SHARE]) * closed_fuel
    fuel = ((1.0 - cut) * heat + cut * cut_share) / p[k.P_FUEL_ENERGY]
    overrun_force = lever * overrun * (1.0 + loss) - gear_drag - lever**2 * p[k.P_INERTIA] * m.acceleration
    idle = p[k.P_IDLE] + p[k.P_CRANK_IDLE] * np.maximum(0.0, 1.0 - m.time / p[k.P_CRANK_TIME])
    return Replay(
        force, torque, overrun, overrun_force, fuel, cut, float(p[k.P_LAUNCH_SPEED]), float(p[k.P_SHIFT_TIME]), idle,
        brake / full, (1.0 - retard) / p[k.P_KNOCK],
    )  # fmt: skip


def _burn(p: Array, w: Array, brake: Array, shaft: Array, full: Array, exhaust: Array) -> tuple[Array, Array]:
    """W of fuel for `shaft` torque at the piston side of pumping, and what retarded ignition leaves of its work (1:
    all): the plant's mean-value cycle, vectorised."""
    per, gain = p[k.P_TORQUE_PER_PRESSURE], p[k.P_PRESSURE_GAIN]
    indicated = np.maximum.reduce(
        [(shaft + per * exhaust) * gain / (gain + 1.0), shaft + per * p[k.P_PUMPING_FLOOR], np.zeros_like(w)]
    )
    pressure = indicated / (per * gain * p[k.P_AMBIENT_PRESSURE])
    diluted = np.maximum(0.0, 1.0 - pressure / 0.6)
    knocking = np.maximum(0.0, pressure - p[k.P_KNOCK_LIMIT] - p[k.P_KNOCK_SLOPE] * w)
    retard = np.maximum(0.6, 1.0 - p[k.P_KNOCK] * knocking**2)
    efficiency = (
        p[k.P_CYCLE_EFFICIENCY] * _table(p, k.P_SPEED_EFFICIENCY, w) * (1.0 - p[k.P_DILUTION] * diluted**2) * retard
    )
    excess = (brake / full - p[k.P_ENRICHMENT_LOAD]) / (1.0 - p[k.P_ENRICHMENT_LOAD])
    rich = 1.0 + p[k.P_ENRICHMENT] * np.clip(excess, 0.0, 1.0)
    a = (w - p[k.P_DRIFT_SPEED]) / p[k.P_DRIFT_SPEED_WIDTH]
    b = (brake - p[k.P_DRIFT_TORQUE]) / p[k.P_DRIFT_TORQUE_WIDTH]
    bump = 1.0 / (1.0 + 0.5 * (a * a + b * b))
    return indicated * w / efficiency * rich * (1.0 + p[k.P_DRIFT] * bump**3), retard
