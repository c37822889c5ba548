"""The plant's step once more, to be read: one function per piece of physics, slow, with names instead of indices.

It says what `kernel.step` computes and is held to it by a test (1e-12). Quantities in SI units; a force at the wheels
is positive forwards; torque losses are positive numbers.

The order within a step of length dt: what the road asks (`road_load`) - which gear and clutch (`select_gear`) - what
the engine must carry (`carry`) - what the driver's force means at the crankshaft - what the engine gives -
the brakes - the motion, linear in the new speed (`move`) - the fuel - the energies.

Signs of an exact balance: speeds are linear over the step, each force works at the mean speed, so that with the free
mass m = M + J_free / r^2, the driven wheels' inertia J_w and the engine's J_e

    locked   [m + (J_w/r^2) g + lever k J_e i s] v'
                 = m v + (J_w/r^2) u + lever k (T dt + J_e w) - (drag + R + B) dt
    slipping [m + (J_w/r^2) g] v' = m v + (J_w/r^2) u + (X - R - B) dt,   J_e w' = J_e w + (T - T_c) dt

where i is the ratio, s = (1 + slip)/r the driven wheels' speed per car's speed, g = s r, u = r x wheel speed, lever =
i/r, k = 1 -+ loss of the gear, T the engine's torque, T_c the clutch's, X the thrust, R the road load and B the brakes.
"""

from dataclasses import dataclass
from math import cos, exp, floor, sin
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vehicle_model.plant import kernel as k

OPEN, SLIPPING, LOCKED = 0.0, 1.0, 2.0
Array = NDArray[np.float64]


def parameters_by_name(p: Array) -> SimpleNamespace:
    """Return the vector `p` as attributes in lower case ("mass", "radius" ...), tables as arrays over engine speed."""
    named: dict[str, Any] = {
        name[2:].lower(): float(p[index]) for name, index in vars(k).items() if name[:2] == "P_" and index < k.P_RATIO
    }
    nodes = np.arange(k.TABLE) / p[k.P_TABLE_RATE]
    for name in ("full_load", "friction", "speed_efficiency", "back_pressure"):
        base = getattr(k, f"P_{name.upper()}")
        values = p[base : base + k.TABLE]
        named[f"{name}_at"] = lambda w, values=values: float(np.interp(w, nodes, values))
    ratios = p[k.P_RATIO : k.P_RATIO + k.MAX_GEARS + 1]
    losses = p[k.P_LOSS : k.P_LOSS + k.MAX_GEARS + 1]
    return SimpleNamespace(**named, ratios=ratios, losses=losses)


@dataclass
class State:
    """The state by name: every `X_`, `E_` and `Y_` of the kernel, in lower case, `X_` without its letter."""

    values: dict[str, float]

    @staticmethod
    def of(x: Array) -> "State":
        """From the kernel's vector."""
        return State({_state_name(name): float(x[index]) for name, index in _indices()})

    def vector(self) -> Array:
        """Back to the kernel's vector."""
        x = np.zeros(k.STATES)
        for name, index in _indices():
            x[index] = self.values[_state_name(name)]
        return x

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def __setitem__(self, name: str, value: float) -> None:
        self.values[name] = float(value)


def _indices() -> list[tuple[str, int]]:
    return [(name, index) for name, index in vars(k).items() if name[:2] in ("X_", "E_", "Y_")]


def _state_name(name: str) -> str:
    return name[2:].lower() if name.startswith("X_") else name.lower()


@dataclass
class RoadLoad:
    """N each; `total` is the channel `road_load`."""

    drag: float
    rolling: float
    cornering: float
    brake_drag: float
    climb: float

    @property
    def total(self) -> float:
        return self.drag + self.rolling + self.cornering + self.brake_drag + self.climb


def road_load(
    p: SimpleNamespace, x: State, pitch: float, straightness: float, vertical: float, heading: float
) -> RoadLoad:
    """Air drag in the wind, rolling on the weight that the road's curvature leaves, cornering, brake drag, grade."""
    v = x["speed"]
    wind = p.wind * (1.0 + p.gust * sin(p.gust_rate * x["time"]))
    air = v + wind * cos(heading - p.wind_from)
    across = p.cross * sin(heading - p.cross_from)
    # (flow angle)^2, up to 20 degrees
    flow_angle2 = min(across**2 / max(air**2, 1.0), 0.12)
    drag = p.drag * air * abs(air) * (1.0 + p.yaw_drag * flow_angle2)

    weight = max(p.mass * (p.gravity * cos(pitch) + vertical * v**2), 0.0)
    cold_tyre = p.tyre_cold * (p.tyre_fast_share * x["tyre_fast"] + (1.0 - p.tyre_fast_share) * x["tyre"])
    rolling = p.rolling * weight * (p.rolling_base + p.rolling_speed * v**2) * (1.0 + cold_tyre)
    return RoadLoad(
        drag=drag,
        rolling=rolling,
        cornering=p.cornering * (v**2 * straightness) ** 2,
        brake_drag=p.brake_drag + p.brake_drag_hot * x["brake_heat"],
        climb=p.mass * p.gravity * sin(pitch),
    )


@dataclass
class Gearing:
    """What stands between engine and wheels in this step."""

    gear: float
    target: float
    ahead: int
    """The gear whose ratio counts: the target while a shift is under way."""
    shift: float
    clutch: float
    ratio_before: float
    ratio: float

    @property
    def shifting(self) -> bool:
        return self.shift > 0.0

    @property
    def middle_ratio(self) -> float:
        return 0.5 * (self.ratio_before + self.ratio)


def idle_speed(p: SimpleNamespace, time: float) -> float:
    """Idle speed, raised after the start."""
    return p.idle + p.crank_idle * max(0.0, 1.0 - time / p.crank_time)


def select_gear(p: SimpleNamespace, x: State, force: float, wanted_gear: float, dt: float) -> Gearing:
    """Run the shift's clock, move the variator, open and close the clutch."""
    g = Gearing(x["gear"], x["target_gear"], 0, x["shift"], x["clutch"], x["ratio"], 0.0)
    if g.shift <= 0.0 and wanted_gear != g.gear:
        g.target, g.clutch = wanted_gear, OPEN
        g.shift = p.shift_time if x["speed"] > 0.3 else dt
    elif g.shift > 0.0:
        g.target = wanted_gear
    if g.shift > 0.0:
        g.shift -= dt
        if g.shift <= 1e-9:
            g.shift, g.gear = 0.0, g.target
            g.clutch = SLIPPING if g.gear > 0.0 else OPEN
    g.ahead = int(g.target if g.shifting else g.gear)
    g.ratio = float(p.ratios[g.ahead])

    if p.cvt > 0.0 and g.ahead > 0:
        # the variator turns the engine so fast that the wanted power is some 70 % of what it could give
        power = max(force, 0.0) * x["speed"]
        wanted = min(
            max(1.35 * idle_speed(p, x["time"]), power / (0.72 * p.full_load_at(x["engine_speed"]))), 0.95 * p.redline
        )
        g.ratio = min(max(wanted / max(x["wheel_speed"], 1e-6), p.ratios[int(p.gears)]), p.ratios[1])
        if g.ratio_before > 0.0:
            swing = p.cvt_rate * dt
            g.ratio = min(max(g.ratio, g.ratio_before * (1.0 - swing)), g.ratio_before * (1.0 + swing))
    if g.ratio_before <= 0.0 or p.cvt <= 0.0:
        g.ratio_before = g.ratio

    synchronous = g.ratio_before * x["wheel_speed"]
    if g.clutch == LOCKED and synchronous < 0.9 * p.idle:
        g.clutch = SLIPPING if force > 0.0 else OPEN
    elif g.clutch == OPEN and not g.shifting and g.gear > 0.0 and (force > 0.0 or synchronous > 1.15 * p.idle):
        g.clutch = SLIPPING
    elif g.clutch == SLIPPING and force <= 0.0 and synchronous < 0.9 * p.idle:
        g.clutch = OPEN
    return g


@dataclass
class Burden:
    """Torques (N m) of the engine at its present speed."""

    friction: float
    alternator: float
    compressor: float
    closed_pumping: float
    closed_indicated: float
    full_load: float
    coldness: float
    shut_share: float
    """Share of the fuel that overrun cuts."""

    @property
    def carried(self) -> float:
        return self.friction + self.alternator + self.compressor

    @property
    def lowest(self) -> float:
        """Brake torque of the closed throttle with fuel."""
        return self.closed_indicated - self.closed_pumping - self.carried

    @property
    def overrun(self) -> float:
        """Brake torque with the fuel cut."""
        return (1.0 - self.shut_share) * self.closed_indicated - self.closed_pumping - self.carried


def carry(p: SimpleNamespace, x: State) -> Burden:
    """Friction (thicker in cold oil), accessories, pumping at closed throttle, and the full load that is left."""
    w = x["engine_speed"]
    warm, coldness = 1.0, 0.0
    if x["coolant"] < p.target_temperature or x["oil"] < p.target_temperature:
        by_coolant = (x["coolant"] / p.target_temperature) ** -p.friction_exponent
        by_oil = (x["oil"] / p.target_temperature) ** -p.friction_exponent
        warm = (1.0 - p.oil_share) * by_coolant + p.oil_share * by_oil
        coldness = 1.0 - x["coolant"] / p.target_temperature
    friction_warm = p.friction_at(w)
    friction = friction_warm * warm
    turning = max(w, 0.4 * p.idle)
    phase = x["time"] * p.ac_rate
    compressor = (p.ac_power if phase - floor(phase) < p.ac_duty else 0.0) / turning
    alternator = p.electrical / p.alternator / turning
    extra = alternator + compressor - p.accessory_nominal / turning
    full_load = max(p.full_load_at(w) - (friction - friction_warm) - extra, 1.0)
    if w > p.redline:
        full_load = max(full_load * (1.0 - (w - p.redline) / (0.03 * p.redline)), 1.0)
    exhaust = p.ambient_pressure + p.back_pressure_at(w)
    return Burden(
        friction=friction,
        alternator=alternator,
        compressor=compressor,
        closed_pumping=p.throttling * p.torque_per_pressure * (exhaust - p.closed_pressure),
        closed_indicated=p.torque_per_pressure * p.pressure_gain * p.closed_pressure,
        full_load=full_load,
        coldness=coldness,
        shut_share=p.cut_share,
    )


def indicated_torque(p: SimpleNamespace, w: float, shaft: float) -> tuple[float, float]:
    """Indicated torque and pumping (N m): the throttle leaves the manifold the pressure that the work needs.

    T_i = shaft + c V (p_exhaust - p_manifold) with T_i = V gain p_manifold, but never less pumping than the floor's.
    """
    exhaust = p.ambient_pressure + p.back_pressure_at(w)
    pumped = p.throttling * p.torque_per_pressure * exhaust
    throttled = (shaft + pumped) * p.pressure_gain / (p.pressure_gain + p.throttling)
    wide_open = shaft + p.torque_per_pressure * p.pumping_floor
    indicated = max(throttled, wide_open, 0.0)
    return indicated, indicated - shaft


def indicated_efficiency(p: SimpleNamespace, w: float, indicated: float) -> float:
    """Indicated work over fuel heat."""
    manifold = indicated / (p.torque_per_pressure * p.pressure_gain * p.ambient_pressure)
    residual_gas = 1.0 - p.dilution * max(0.0, 1.0 - manifold / 0.6) ** 2
    knock_retard = max(0.6, 1.0 - p.knock * max(0.0, manifold - p.knock_limit - p.knock_slope * w) ** 2)
    return p.cycle_efficiency * p.speed_efficiency_at(w) * residual_gas * knock_retard


def mixture(p: SimpleNamespace, w: float, brake: float, full_load: float) -> float:
    """Fuel over what the work needs: rich near full load, and the drifted place of the map."""
    rich = (brake / full_load - p.enrichment_load) / (1.0 - p.enrichment_load)
    a = (w - p.drift_speed) / p.drift_speed_width
    b = (brake - p.drift_torque) / p.drift_torque_width
    bump = (1.0 + 0.5 * (a**2 + b**2)) ** -3
    return (1.0 + p.enrichment * min(max(rich, 0.0), 1.0)) * (1.0 + p.drift * bump)


def step(
    p: SimpleNamespace,
    x: State,
    force: float,
    gear_wanted: float,
    pitch: float,
    straightness: float,
    vertical: float,
    heading: float,
    dt: float,
) -> None:
    """Advance `x` by `dt`; arguments as `kernel.step`."""
    force = min(force, p.traction)
    v0, w0, wheel0, time = x["speed"], x["engine_speed"], x["wheel_speed"], x["time"]
    road = road_load(p, x, pitch, straightness, vertical, heading)
    g = select_gear(p, x, force, gear_wanted, dt)
    burden = carry(p, x)

    # tyre: slip follows the force that the road felt, over its relaxation length
    radius = p.radius * (1.0 + p.radius_growth * v0**2)
    settling = min(p.slip_relaxation * dt, 1.0)
    slip = x["slip"] + settling * (x["tyre_force"] * p.slip_compliance - x["slip"])
    stretch = (1.0 + slip) / radius
    grip = stretch * radius

    # driver's force at the crankshaft
    loss, lever = float(p.losses[g.ahead]), g.middle_ratio / radius
    cold_oil = 1.0 + p.gear_oil_cold * exp(-p.gear_oil_rate * x["distance"])
    gear_drag = (p.gear_drag + p.gear_drag_speed * wheel0) * cold_oil * (wheel0 / (wheel0 + 0.5)) / radius
    wanted_clutch = 0.0
    if lever > 0.0:
        net = force + gear_drag
        wanted_clutch = net / (lever * (1.0 - loss if net > 0.0 else 1.0 + loss))
    synchronous = g.ratio_before * wheel0
    launching = g.clutch == SLIPPING and synchronous < 1.15 * p.idle
    idle = idle_speed(p, time)
    speeding_up = p.inertia * g.ratio * stretch * x["acceleration"]
    held = idle
    if g.clutch == LOCKED:
        asked = wanted_clutch + speeding_up
    elif launching:
        held = idle + (p.launch_speed - p.idle) * min(max(force / p.launch_force, 0.0), 1.0)
        asked = max(wanted_clutch, 0.0) + p.inertia * (max(held, synchronous) - w0) / 0.15
    elif g.clutch == SLIPPING:
        asked = wanted_clutch + p.inertia * (synchronous - w0) / 0.1
    elif g.shifting and g.ahead > 0:
        asked = p.inertia * (max(idle, g.ratio * wheel0) - w0) / 0.08
    else:
        asked = p.inertia * (idle - w0) / 0.25

    # running, stopped at standstill, cranked by the starter (0.5)
    standstill = x["standstill"] + dt if v0 <= 0.0 and force <= 0.0 else 0.0
    running = x["engine_on"]
    if running > 0.0 and standstill > p.stop_after:
        running = 0.0
    elif running == 0.0 and force > 0.0:
        running = 0.5
    if running == 0.5 and w0 > 0.7 * p.idle:
        running = 1.0

    # what comes at once and what lags, overrun cut-off with its hysteresis
    at_once = p.boost_onset * burden.full_load
    lagging = min(max(asked - at_once, 0.0), burden.full_load - at_once)
    boost = x["boost"] + (lagging - x["boost"]) * min(dt / p.boost_time, 1.0)
    ceiling = at_once + boost
    span = burden.lowest - burden.overrun
    cut = x["cut"]
    if cut > 0.0:
        if w0 < p.cut_resume or asked > burden.overrun + 0.65 * span:
            cut = 0.0
    elif w0 > p.cut_resume + p.cut_band and asked < burden.overrun + 0.35 * span:
        cut = 1.0

    friction, alternator, compressor, starter = burden.friction, burden.alternator, burden.compressor, 0.0
    if running < 1.0:
        indicated, pumping = 0.0, burden.closed_pumping * min(1.0, w0 / p.idle)
        if w0 <= 0.0:
            friction = alternator = compressor = pumping = 0.0
        if running == 0.5:
            starter = friction + alternator + compressor + pumping + p.inertia * p.idle / 0.35
        brake = starter - (friction + alternator + compressor) - pumping
    elif cut > 0.0:
        indicated, pumping, brake = (1.0 - p.cut_share) * burden.closed_indicated, burden.closed_pumping, burden.overrun
    else:
        brake = min(max(asked, burden.lowest), ceiling)
        indicated, pumping = indicated_torque(p, w0, brake + burden.carried)

    # clutch torque that is known beforehand, and the brakes: what the overrun leaves of a negative force
    difference = w0 - synchronous
    through = 0.0
    if g.clutch == LOCKED:
        through = brake - speeding_up
    elif launching:
        spared = min(max(p.inertia * (held - w0) / 0.15, 0.0), 0.6 * ceiling)
        bite = min(max((w0 - 0.5 * p.idle) / (0.4 * p.idle), 0.0), 1.0)
        through = min(max(wanted_clutch, 0.0), ceiling - spared, p.clutch_capacity) * bite
        if difference < 0.0:
            through *= -0.1
    elif g.clutch == SLIPPING:
        side = 1.0 if difference >= 0.0 else -1.0
        pull = max(min(p.inertia * abs(difference) / 0.06, 0.15 * p.clutch_capacity), side * wanted_clutch)
        through = side * min(max(pull, 0.0), p.clutch_capacity)
    thrust = lever * (through - loss * abs(through)) - gear_drag
    braking = min(max(thrust - force, 0.0), p.brake_limit) if force < 0.0 else 0.0

    # motion
    driven = p.driven_inertia / radius**2
    free = p.mass + p.free_inertia / p.free_radius**2
    surface0 = wheel0 * radius
    clutch = g.clutch
    v1 = 0.0
    if clutch == LOCKED:
        # the loss takes from a driving torque and adds to a dragging one: try the sign of the last step, then the other
        first = 1.0 if through >= 0.0 else -1.0
        for sign in (first, -first):
            kept = 1.0 - sign * loss
            carrying = lever * kept
            v1 = (
                free * v0
                + driven * surface0
                + carrying * (brake * dt + p.inertia * w0)
                - (gear_drag + road.total + braking) * dt
            ) / (free + driven * grip + carrying * p.inertia * g.ratio * stretch)
            through = brake - p.inertia * (g.ratio * stretch * v1 - w0) / dt
            thrust = carrying * through - gear_drag
            if (through >= 0.0) == (kept < 1.0):
                break
        if abs(through) > p.clutch_capacity:
            clutch = SLIPPING
            through = float(np.copysign(p.clutch_capacity, through))
            thrust = lever * (through - loss * abs(through)) - gear_drag
    if clutch != LOCKED:
        v1 = (free * v0 + driven * surface0 + (thrust - road.total - braking) * dt) / (free + driven * grip)
    moving = dt
    held_by_brake = v0 <= 0.0 and (force == 0.0 or (force < 0.0 and force <= road.climb))
    if v1 <= 0.0 or held_by_brake:
        momentum = free * v0 + driven * surface0
        moving = dt * momentum / max(momentum - (free + driven * grip) * v1, 1e-12) if momentum > 0.0 else 0.0
        v1 = 0.0
        clutch = OPEN if clutch == LOCKED else clutch
    wheel1 = stretch * v1
    w1 = g.ratio * wheel1 if clutch == LOCKED else w0 + dt * (brake - through) / p.inertia
    if w1 < 0.0:
        turned, w1 = 0.5 * w0 * dt * w0 / (w0 - w1), 0.0
    else:
        turned = 0.5 * (w0 + w1) * dt
    travelled = 0.5 * (v0 + v1) * moving
    rolled = 0.5 * (wheel0 + wheel1) * moving
    tyre_force = thrust - driven * (radius * wheel1 - surface0) / moving if moving > 0.0 else 0.0

    # fuel
    heat = 0.0
    if indicated > 0.0 and not (w0 <= 0.0 and w1 <= 0.0):
        heat = indicated * turned / indicated_efficiency(p, w0, indicated)
        heat *= (1.0 + p.cold_enrichment * burden.coldness) * mixture(p, w0, brake, burden.full_load)
        heat *= 1.0 + p.crank_retard * max(0.0, 1.0 - time / p.crank_time)
        heat *= p.idle_fuel if v0 <= 0.0 else 1.0
    if time < 1.0:
        heat += p.crank_energy * dt
    metered = heat / p.fuel_energy

    # energies
    for name, energy in {
        "e_exhaust": heat - indicated * turned,
        "e_blend": metered - heat,
        "e_friction": friction * turned,
        "e_pumping": pumping * turned,
        "e_accessories": alternator * turned,
        "e_air_conditioning": compressor * turned,
        "e_starter": starter * turned,
        "e_clutch": 0.0 if clutch == LOCKED else through * (turned - g.middle_ratio * rolled),
        "e_gearbox": (loss * abs(through) * g.middle_ratio + gear_drag * radius) * rolled
        + (through * (turned - g.middle_ratio * rolled) if clutch == LOCKED else 0.0),
        "e_thrust": thrust * radius * rolled,
        "e_wheel_slip": tyre_force * (radius * rolled - travelled),
        "e_drag": road.drag * travelled,
        "e_rolling": road.rolling * travelled,
        "e_cornering": road.cornering * travelled,
        "e_brake_drag": road.brake_drag * travelled,
        "e_brakes": braking * travelled,
        "e_climb": road.climb * travelled,
        "fuel_energy": metered,
        "distance": travelled,
        "engine_angle": turned,
        "wheel_angle": rolled,
    }.items():
        x[name] += energy

    # the clutch closes: an inelastic joint of the engine with the car
    after = w1 - g.ratio * wheel1
    caught = abs(after) < 0.5 or difference * after < 0.0
    if clutch == SLIPPING and v1 > 0.0 and caught and abs(through) < p.clutch_capacity:
        car_mass, inward = free + driven * grip**2, g.ratio * stretch
        car_before, engine_before = car_mass * v1**2, p.inertia * w1**2
        v1 = (car_mass * v1 + p.inertia * inward * w1) / (car_mass + p.inertia * inward**2)
        wheel1, w1, clutch = stretch * v1, inward * v1, LOCKED
        gained = car_mass * v1**2 - car_before
        x["e_thrust"] += 0.5 * gained
        x["e_clutch"] += 0.5 * (engine_before - p.inertia * w1**2 - gained)

    # slow states
    x["coolant"] += (p.target_temperature - x["coolant"]) * min(metered / p.warm_up_energy, 1.0)
    x["oil"] += (p.target_temperature - x["oil"]) * min(metered / p.warm_up_oil_energy, 1.0)
    x["tyre"] *= 1.0 - p.tyre_rate * dt
    x["tyre_fast"] *= 1.0 - p.tyre_fast_rate * dt
    heating = braking > 0.0 and v0 > 0.5
    x["brake_heat"] += (1.0 - x["brake_heat"]) * 0.5 * dt if heating else -x["brake_heat"] * p.brake_cooling * dt

    for name, value in {
        "time": time + dt,
        "acceleration": (v1 - v0) / dt,
        "speed": v1,
        "wheel_speed": wheel1,
        "slip": slip,
        "tyre_force": tyre_force,
        "gear": g.gear,
        "target_gear": g.target,
        "ratio": g.ratio,
        "shift": g.shift,
        "clutch": clutch,
        "engine_speed": w1,
        "boost": boost,
        "cut": cut,
        "engine_on": running,
        "standstill": standstill,
        "y_thrust": thrust,
        "y_brake": braking if v1 > 0.0 else max(braking, thrust - road.climb),
        "y_road_load": road.total,
        "y_engine_torque": brake,
        "y_fuel_power": metered / dt,
        "y_throttle": min(max((asked - burden.overrun) / (burden.full_load - burden.overrun), 0.0), 1.0),
        "y_voltage": {1.0: 14.2 - 0.0004 * p.electrical, 0.5: 9.5}.get(running, 12.3),
    }.items():
        x[name] = value
