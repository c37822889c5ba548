"""What may move the residuals without being a gap: the engine's own map, tolerances, each trip's weather and biases.

Columns over all blocks of all trips. `calibration` columns are fitted to the reference trips and then frozen (their
posterior stays as uncertainty); `tolerance` columns are the nominal parameters inside their declared limits, free again
in every diagnosis; `trip` columns are what differs from one trip to the next. A limit d is taken as a uniform law, so
its deviation is d / sqrt(3).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.blocks import CHANNELS, REGIMES, Prepared
from rollingroad.gap.channels import Correction, block_means, values
from rollingroad.gap.replay import Motion, Replay, replay_vector, vector_of
from vehicle_model.car.parameters import Car
from vehicle_model.plant import kernel as k

Array = NDArray[np.float64]
FUEL, COAST, GNSS, RATIO, IDLE, LAUNCH, SHIFT, HEIGHT_GPS, HEIGHT_MAP, CLOCK, SECOND = range(len(CHANNELS))


@dataclass(frozen=True)
class Columns:
    """Named columns (m, k) over the blocks of one trip or of all, with prior means zero and deviations `sd` (k,)."""

    names: tuple[str, ...]
    matrix: Array
    sd: Array

    @staticmethod
    def of(rows: Sequence[tuple[str, Array, float]], blocks: int) -> "Columns":
        """From (name, column, deviation) rows."""
        if not rows:
            return Columns((), np.zeros((blocks, 0)), np.zeros(0))
        names, columns, sd = zip(*rows, strict=True)
        return Columns(tuple(names), np.stack(columns, axis=1), np.array(sd, float))


POLYNOMIAL = (
    (0, 0, 1.5), (1, 0, 1.0), (2, 0, 0.6), (0, 1, 6.0), (1, 1, 3.0), (2, 1, 2.0), (0, 2, 4.0), (1, 2, 2.0), (0, 3, 3.0),
)  # fmt: skip
"""Powers of engine speed and torque, and the prior deviation in bar of mean pressure."""
BUMPS = tuple((gx, gy, 0.5 + 1.0 * gy) for gx in (-0.5, 0.0, 0.5) for gy in (0.1, 0.3, 0.5, 0.75, 1.0))


def _map_terms(car: Car, engine_speed: Array, torque: Array) -> list[tuple[str, Array, float]]:
    """The map's correction: (name, W per unit coefficient at each sample, deviation)."""
    x = engine_speed / 250.0 - 1.0
    y = np.clip(torque / car.engine.max_torque, -0.2, 1.3)
    bar = car.engine.displacement / (4.0 * np.pi) * 1e5 * engine_speed
    rows = [(f"map.poly{i}", bar * x**px * y**py, sd) for i, (px, py, sd) in enumerate(POLYNOMIAL)]
    for gx, gy, sd in BUMPS:
        bump = np.exp(-0.5 * ((x - gx) / 0.3) ** 2 - 0.5 * ((y - gy) / 0.18) ** 2)
        rows.append((f"map.bump{gx:g},{gy:g}", bar * bump, sd))
    return rows


def _driving(regime: NDArray[np.int64], torque: Array, speed: Array) -> NDArray[np.bool_]:
    return (regime == REGIMES.index("drive")) | ((regime == REGIMES.index("all")) & (torque > 0) & (speed > 0.5))


SLOPE = 2.7
"""W of fuel per W at the wheel, of columns that only need its order of magnitude."""
FORCES = (("constant", 0, 1.0, 15.0), ("speed", 1, 10.0, 8.0), ("speed2", 2, 20.0, 15.0))
"""Resistances that this car may have beyond the plant's: name, power of (speed / unit), unit in m/s, deviation in N."""


KNOCK = 1.2
"""Deviation of the coefficient by which knock retards ignition: the plant's own is 1.2, an engine may know none."""


def map_correction(car: Car, coefficients: Mapping[str, float]) -> Correction:
    """The calibrated correction as a function of the replay: what `channels.values` adds to the simulator's fuel.

    All calibrated terms that depend on the torque or the fuel belong to it, or the corrected simulator would burn the
    right amount and have the wrong slope: an effect moves the fuel along that slope. (A car that is not enriched, as
    ours is, at full load: a slope of 5 to 8 W of fuel per W where it is 3, in the blocks that weigh most.)
    """
    nominal = vector_of(car)
    rich, rich_from = float(nominal[k.P_ENRICHMENT]), float(nominal[k.P_ENRICHMENT_LOAD])

    def correct(r: Replay, m: Motion, regime: NDArray[np.int64]) -> Array:
        total = np.zeros(len(m.time))
        for name, term, _ in _map_terms(car, m.engine_speed, r.engine_torque):
            total += coefficients.get(name, 0.0) * term
        work = SLOPE * np.maximum(r.road_force, 0.0) * m.speed
        share = np.full(len(total), coefficients.get("state.loss_share", 0.0))
        share += coefficients.get("plant.driveline_loss.share", 0.0)
        drag = np.zeros(len(total))
        for gear in range(1, len(car.gear_ratios) + 1):
            share[m.gear == gear] += coefficients.get(f"map.gear{gear}", 0.0)
            drag[m.gear == gear] += coefficients.get(f"map.drag{gear}", 0.0)
        for name, power, unit, _ in FORCES:
            drag += coefficients.get(f"force.{name}", 0.0) * (m.speed / unit) ** power
        total += share * work + SLOPE * drag * m.speed
        load = np.clip(r.load, 0.0, 1.2)
        part = coefficients.get("state.fuel_1", 0.0) + coefficients.get("state.fuel_load", 0.0) * load
        part += coefficients.get("state.fuel_load2", 0.0) * load**2 + coefficients.get("state.fuel_flow", 0.0) * r.fuel
        excess = np.clip((r.load - rich_from) / (1.0 - rich_from), 0.0, 1.0)
        part += coefficients.get("plant.enrichment.amount", 0.0) * excess / (1.0 + rich * excess)
        part += coefficients.get("map.knock", 0.0) * r.knock
        return (total + part * r.fuel) * _driving(regime, r.engine_torque, m.speed)

    return correct


def calibration_columns(p: Prepared, car: Car, vector: Array) -> Columns:
    """The correction of the engine's map, overrun, idle and of the constant offsets of the sensors, for one trip."""
    m = p.samples.motion
    nominal = replay_vector(vector, m)
    x = m.engine_speed / 250.0 - 1.0
    bar = car.engine.displacement / (4.0 * np.pi) * 1e5 * m.engine_speed
    regime = p.samples.regime
    drive = _driving(regime, nominal.engine_torque, m.speed)
    idle = (regime == REGIMES.index("idle")) | ((regime == REGIMES.index("all")) & (m.speed <= 0.5))
    other = (regime == REGIMES.index("all")) & ~drive & ~idle
    rows: list[tuple[str, Array, float]] = []

    def fuel(name: str, sample: Array, sd: float) -> None:
        rows.append((f"map.{name}", block_means(p, "fuel_power", sample), sd))

    for name, term, sd in _map_terms(car, m.engine_speed, nominal.engine_torque):
        rows.append((name, block_means(p, "fuel_power", drive * term), sd))
    work = np.maximum(nominal.road_force, 0.0) * m.speed
    for gear in range(1, len(car.gear_ratios) + 1):
        fuel(f"gear{gear}", drive * (m.gear == gear) * work * SLOPE, 0.02)
        fuel(f"drag{gear}", drive * (m.gear == gear) * m.speed * SLOPE, 15.0)
    fuel("idle", idle.astype(float), 4000.0)
    fuel("inertia", drive * bar * m.acceleration, 0.4)
    for name in ("launch", "open", "overrun"):
        mask = regime == REGIMES.index(name)
        fuel(f"{name}", mask * bar, 4.0)
        fuel(f"{name}_torque", mask * bar * np.clip(m.acceleration, -2.0, 2.0), 4.0)
    fuel("coarse_overrun", other * bar, 2.0)
    # what our plant assumes of every car and this one may not have
    firing = drive | (regime == REGIMES.index("all"))
    for name, shape, sd in (
        ("side", (m.speed**2 * m.curvature) ** 2, 0.2 * car.mass / car.gravity),
        *((name, (m.speed / unit) ** power, sd) for name, power, unit, sd in FORCES),
    ):
        moving = shape * (m.speed > 0.3)
        column = block_means(p, "fuel_power", SLOPE * moving * m.speed * firing) - block_means(p, "coast_force", moving)
        rows.append((f"force.{name}", column, sd))
    base = values(p, car, vector)
    for key, neutral, step, sd in (
        ("enrichment.amount", 0.1, 0.1, 0.1), ("driveline_loss.share", 0.0, 0.01, 0.015),
        ("cornering_drag.factor", 1.0, -1.0, 1.0),
    ):  # fmt: skip
        moved = values(p, car, vector_of(car, {key: neutral + step}))
        rows.append((f"plant.{key}", (base - moved) / step, sd))
    fuel("knock", nominal.fuel * nominal.knock, KNOCK)
    lever = np.asarray(car.gear_ratios)[np.maximum(m.gear, 1) - 1] / car.wheel_radius
    for power in range(3):
        rows.append((f"overrun.{power}", block_means(p, "coast_force", lever * x**power), (6.0, 4.0, 2.0)[power]))
    rows.append(("overrun.speed", block_means(p, "coast_force", m.speed), 2.0))
    rows.append(("overrun.force", block_means(p, "coast_force", np.ones_like(x)), 25.0))
    ones = np.ones_like(x)
    rows.append(("ratio.offset", block_means(p, "gear_ratio", ones), 0.02))
    for gear in range(1, len(car.gear_ratios) + 1):
        rows.append((f"ratio.{gear}", block_means(p, "gear_ratio", (m.gear == gear).astype(float)), 0.004))
    rows.append(("ratio.force", block_means(p, "gear_ratio", nominal.road_force / 1000.0), 0.01))
    rows.append(("idle_speed.offset", block_means(p, "idle_speed", ones), 15.0))
    rows.append(("launch_speed.offset", block_means(p, "launch_speed", ones), 200.0))
    rows.append(("shift_time.offset", block_means(p, "shift_time", ones), 1.0))
    if p.trace.gps:
        at = p.trace.gps["t"] - p.trace.time[0]
        a, v, f = (np.interp(at - 0.2, m.time, c) for c in (m.acceleration, m.speed, nominal.road_force))
        rows.append(("gnss.lag", block_means(p, "gnss_speed", -a), 0.06))
        rows.append(("gnss.scale", block_means(p, "gnss_speed", v), 0.0012))
        rows.append(("gnss.offset", block_means(p, "gnss_speed", np.ones_like(v)), 0.03))
        rows.append(("gnss.slip", block_means(p, "gnss_speed", -f * v / 1000.0), 0.006))
        s = np.interp(at - 0.2, m.time, m.distance) / car.gravity
        lift = v**2 / 2.0 / car.gravity
        both = block_means(p, "height_gps", s) + block_means(p, "height_map", s)
        rows.append(("bias_x", both, 0.5))
        rows.append(("squat", block_means(p, "height_gps", lift) + block_means(p, "height_map", lift), 0.01))
    return Columns.of(rows, len(p.layout.time))


TOLERANCE_SETTINGS: Mapping[str, str] = {
    "mass": "mass.factor",
    "rolling_resistance": "rolling_resistance.factor",
    "drag_area": "drag_area.factor",
    "air_density": "air_density.factor",
}


def tolerance_columns(p: Prepared, car: Car, vector: Array, fuel: Array, correction: Correction | None) -> Columns:
    """Nominal parameters inside their limits, for one trip; `fuel` (m,) W burnt in each fuel block."""
    base = values(p, car, vector, correction)
    t = car.tolerances
    root = np.sqrt(3.0)
    rows: list[tuple[str, Array, float]] = []
    for name, key in TOLERANCE_SETTINGS.items():
        step = 0.02
        moved = values(p, car, vector_of(car, {key: 1.0 + step}), correction)
        rows.append((f"tolerance.{name}", (base - moved) / step, getattr(t, name) / root))
    rows.append(("tolerance.fuel", fuel, t.fuel / root))
    v = block_means(p, "gnss_speed", _at_fixes(p, p.samples.motion.speed)) if p.trace.gps else np.zeros(len(base))
    rows.append(("tolerance.wheel_radius", v, t.wheel_radius / root))
    return Columns.of(rows, len(base))


def trip_columns(
    p: Prepared, car: Car, vector: Array, fuel: Array, coarse: bool, correction: Correction | None
) -> Columns:
    """What this trip alone may have: wind, density, accelerometer bias, a little fuel, clock alignment."""
    base = values(p, car, vector, correction)
    root = np.sqrt(3.0)
    rows: list[tuple[str, Array, float]] = []
    m = p.samples.motion
    if np.isfinite(m.heading).mean() > 0.5:
        for name, bearing in (("wind_n", 0.0), ("wind_e", np.pi / 2)):
            moved = values(p, car, vector_of(car, {"head_wind.speed": 2.0, "head_wind.from": bearing}), correction)
            rows.append((name, (base - moved) / 2.0, car.tolerances.wind / root))
    elif not coarse:
        moved = values(p, car, vector_of(car, {"head_wind.speed": 2.0}), correction)
        rows.append(("wind", (base - moved) / 2.0, car.tolerances.wind / root))
    if p.samples.bias_sd > 0.0:
        shifted = replace(p, samples=replace(p.samples, motion=replace(m, force=m.force + 0.02)))
        change = values(shifted, car, vector, correction) - base
        rows.append(("force_bias", change / 0.02, float(np.hypot(p.samples.bias_sd, 0.0015))))
        s = _at_fixes(p, m.distance) / car.gravity if p.trace.gps else np.zeros(0)
        if p.trace.gps:
            rows.append(("height_bias", block_means(p, "height_gps", s) + block_means(p, "height_map", s), 0.015))
    if p.trace.gps:
        ones = np.ones(len(p.trace.gps["t"]))
        rows.append(("height_gps", block_means(p, "height_gps", ones), 500.0))
        rows.append(("height_map", block_means(p, "height_map", ones), 500.0))
        # wheels alone, without an accelerometer, are a smoother and less punctual speed than the references' may be
        punctual = 0.005 if correction is None or np.isfinite(p.trace.force).mean() > 0.9 else 0.1
        rows.append(("fix_time", block_means(p, "gnss_speed", -_at_fixes(p, m.acceleration)), punctual))
    bar = car.engine.displacement / (4.0 * np.pi) * 1e5 * m.engine_speed
    for name, sd in (("launch", 4.0), ("open", 1.0)):  # how this driver uses the clutch
        mask = p.samples.regime == REGIMES.index(name)
        rows.append((f"{name}_fuel_habit", block_means(p, "fuel_power", mask * bar), sd))
    rise = np.maximum(np.gradient(replay_vector(vector, m).engine_torque, p.trace.step), 0.0)
    jerky = rise * (p.samples.regime == REGIMES.index("drive"))
    rows.append(("foot_habit", block_means(p, "fuel_power", jerky), 30.0))
    rows.append(("launch_habit", block_means(p, "launch_speed", np.ones(len(m.time))), 25.0))
    rows.append(("shift_habit", block_means(p, "shift_time", np.ones(len(m.time))), 0.06))
    rows.append(("trip_fuel", fuel, 0.025 / root * 1.5 if coarse else 0.0008))
    rows.append(("trip_load", block_means(p, "fuel_power", np.ones(len(m.time))), 100.0 if coarse else 15.0))
    return Columns.of(rows, len(base))


def _at_fixes(p: Prepared, sample: Array) -> Array:
    at = p.trace.gps["t"] - p.trace.time[0]
    return np.interp(at - 0.2, p.samples.motion.time, sample)
