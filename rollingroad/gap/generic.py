"""Physical regressors for what the catalogue does not hold: forces, powers, fuel shares and sensor errors, with
units."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.channels import block_means
from rollingroad.gap.replay import replay_vector
from rollingroad.gap.signature_form import Context
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Regressor:
    """One column of the lexicon: how it reads, in which unit its coefficient is, its prior deviation, its subsystem."""

    name: str
    sentence: str
    unit: str
    sd: float
    subsystem: str
    family: str = ""
    """Columns of one family are one thing (a phase, a direction): they are also tried together."""


def lexicon(car: Car) -> list[Regressor]:
    """The regressors, in the order of `columns`' matrix. Deviations: about 3 % of the fuel of mixed driving."""
    weight = 0.03 * car.mass * car.gravity * 0.1
    rows: list[tuple[str, str, str, float, str] | tuple[str, str, str, float, str, str]] = [
        ("force_1", "a constant force", "N", weight, "road_load"),
        ("force_v", "a force growing with speed", "N s/m", weight / 15, "road_load"),
        ("force_v2", "a force growing with speed squared", "N s2/m2", weight / 250, "road_load"),
        ("force_v3", "a force growing with speed cubed", "N s3/m3", weight / 5000, "road_load"),
        ("force_side", "a force growing with lateral acceleration", "N s2/m", weight, "road_load"),
        ("force_side2", "a force growing with lateral acceleration squared", "N s4/m2", weight, "road_load"),
        ("force_time", "a force growing with time", "N/s", weight / 600, "road_load"),
        ("force_v_time", "a force growing with speed and time", "N/m", weight / 15 / 600, "road_load"),
        ("force_v2_time", "a force growing with speed squared and time", "N s/m2", weight / 250 / 600, "road_load"),
        ("force_fade", "a force that fades within minutes", "N", weight, "road_load"),
        ("force_fade_d", "a force that fades within kilometres", "N", weight, "road_load"),
        ("force_a", "a force growing with acceleration", "kg", 0.06 * car.mass, "road_load"),
        ("force_climb", "a force growing with the grade", "kg m/s2", 0.06 * car.mass * car.gravity, "road_load"),
        ("force_brake", "a force that remains after braking", "N", weight, "road_load"),
        ("power_1", "a constant power at the crankshaft", "W", 500.0, "accessory"),
        ("power_w", "a power growing with engine speed", "W s", 2.5, "accessory"),
        ("power_slow", "a power below 30 km/h only", "W", 500.0, "accessory"),
        ("power_fast", "a power above 70 km/h only", "W", 700.0, "accessory"),
        ("power_time", "a power growing with time", "W/s", 1.0, "accessory"),
        ("power_still", "a power at standstill only", "W", 500.0, "accessory"),
        ("power_moving", "a power while moving only", "W", 500.0, "accessory"),
        ("fuel_1", "fuel in proportion", "", 0.04, "engine_fuel"),
        ("fuel_w", "fuel in proportion to engine speed", "W s", 6.0, "engine_fuel"),
        ("fuel_w2", "fuel in proportion to engine speed squared", "W s2", 0.03, "engine_fuel"),
        ("fuel_load", "fuel growing with load", "", 0.08, "engine_fuel"),
        ("fuel_load2", "fuel growing with load squared", "", 0.10, "engine_fuel"),
        ("fuel_high", "fuel above half load, in proportion to time", "1/s", 0.08 / 600, "engine_fuel"),
        ("fuel_time", "fuel growing with time", "1/s", 0.05 / 600, "engine_fuel"),
        ("fuel_flow", "fuel growing with the flow squared", "1/W", 1.2e-6, "injector"),
        ("fuel_rise", "fuel when torque rises", "J/(N m)", 60.0, "engine_fuel"),
        ("fuel_fade", "fuel that fades within minutes", "W", 4000.0, "engine_fuel"),
        *(
            (f"fuel_above{share}", f"fuel above {share} % of full load, in proportion", "", 0.08, "engine_fuel")
            for share in (60, 70, 80, 90)
        ),
        ("power_w_fade", "fuel growing with engine speed that fades within minutes", "W s", 8.0, "engine_fuel"),
        ("power_w_fade_slow", "fuel growing with engine speed that fades slowly", "W s", 8.0, "engine_fuel"),
        ("fuel_start", "fuel in the first minute", "W", 4000.0, "engine_fuel"),
        ("fuel_overrun", "fuel during overrun", "W", 4000.0, "engine_fuel"),
        ("loss_share", "a share of the power lost", "", 0.04, "driveline"),
        ("gnss_1", "a constant receiver speed error", "m/s", 0.1, "gps"),
        ("gnss_v2", "a receiver speed error growing with speed squared", "s/m", 1e-3, "wheel"),
        ("gnss_time", "wheel speed drifting with time", "1/s", 0.01 / 600, "wheel"),
        ("gnss_turn", "wheel speed off in bends", "m", 3.0, "wheel"),
        ("height_time", "an altitude drifting with time", "m/s", 0.02, "gps"),
    ]
    for i in range(8):
        degrees = int(i * 45)
        rows.append((f"force_v2_{degrees}", f"a force growing with speed squared, on heading {degrees} degrees only",
                     "N s2/m2", weight / 150, "road_load"))  # fmt: skip
    for i in range(6):
        rows.append((f"force_v2_part{i}",
            f"a force growing with speed squared, in the {i + 1}. of six stretches of each trip only",
                     "N s2/m2", weight / 150, "road_load"))  # fmt: skip
    for period in (120.0, 200.0, 300.0, 400.0):
        for phase in ("cos", "sin"):
            rows.append((f"force_v2_{phase}{period:g}",
                f"a force growing with speed squared that comes and goes every {period:g} s",
                         "N s2/m2", weight / 150, "road_load", f"wet{period:g}"))  # fmt: skip
    for period in _cycles():
        for phase in ("cos", "sin"):
            rows.append((f"power_{phase}{period:.2f}", f"a power that comes and goes every {period:.1f} s",
                         "W", 500.0, "accessory", f"cycle{period:.2f}"))  # fmt: skip
    for name, degrees in (("north", 0), ("east", 90)):
        rows.append((f"force_v_{name}", f"a force growing with speed, turning with the heading from {degrees} degrees",
                     "N s/m", weight / 8, "road_load", "wind"))  # fmt: skip
    return [Regressor(*row) for row in rows]


CYCLE, COHERENT = (15.0, 100.0), 1500.0
"""s: shortest and longest period of a power that comes and goes; twice the longest time over which two neighbouring
frequencies stay in step."""


def _cycles() -> Array:
    return 1.0 / np.arange(1.0 / CYCLE[1], 1.0 / CYCLE[0], 1.0 / COHERENT)


STATE = frozenset({
    "fuel_rise", "fuel_w", "fuel_w2", "fuel_load", "fuel_load2", "fuel_1", "fuel_flow", "fuel_overrun", "force_v",
    "force_v3",
    "force_side", "force_a", "force_climb", "force_brake", "power_slow", "power_fast", "power_still", "power_moving",
    "loss_share", "gnss_1", "gnss_v2", "gnss_turn",
})  # fmt: skip
"""Regressors that are functions of the present state alone: how the nominal simulator may differ from this car for
ever,
which reference trips show. (What depends on time, place or heading is no property of the car.)"""


def columns(c: Context) -> Array:
    """(m, k): the lexicon's columns over the blocks of one trip."""
    p, m = c.p, c.p.samples.motion
    r = replay_vector(c.vector, m)
    v, t, w = m.speed, m.time, m.engine_speed
    firing = 1.0 - r.cut
    drive = firing * (r.engine_torque > 0)
    slope = 2.7
    moving = (v > 0.3).astype(float)
    side = np.abs(v**2 * m.curvature)
    fuel = c.fuel
    at = p.layout.time
    load = block_means(p, "fuel_power", np.clip(r.load, 0.0, 1.2))
    climb = np.clip(m.force - m.acceleration, -1.2, 1.2) / c.car.gravity
    rise = np.maximum(np.gradient(r.engine_torque, t[1] - t[0]), 0.0) * drive
    heading = np.nan_to_num(m.heading)
    zero = np.zeros(len(c.base))

    def force(f: Array) -> Array:
        f = f * moving
        return block_means(p, "fuel_power", slope * f * v * drive) - block_means(p, "coast_force", f)

    def burn(x: Array) -> Array:
        return block_means(p, "fuel_power", x)

    def fix(x: Array) -> Array:
        if not p.trace.gps:
            return zero
        at = p.trace.gps["t"] - p.trace.time[0]
        return np.interp(at - 0.2, t, x)

    def gnss(x: Array) -> Array:
        return block_means(p, "gnss_speed", fix(x)) if p.trace.gps else zero

    one = np.ones_like(v)
    out = [
        force(one), force(v), force(v**2), force(v**3), force(side), force(side**2), force(t), force(v * t),
        force(v**2 * t), force(np.exp(-t / 300)), force(np.exp(-m.distance / 4000)), force(m.acceleration),
        force(climb),
        force(m.brake_heat), burn(slope * firing), burn(slope * firing * w), burn(slope * firing * (v < 8.3)),
        burn(slope * firing * (v > 19.4)), burn(slope * firing * t), burn(slope * firing * (v < 0.3)), burn(slope *
        firing * moving),
        fuel, burn(w * firing), burn(w**2 * firing), fuel * load,
        fuel * load**2, fuel * np.maximum(load - 0.4, 0.0) * at, fuel * at, fuel**2,
        burn(rise), burn(np.exp(-t / 150)), *(burn(r.fuel * (r.load > 0.01 * share)) for share in (60, 70, 80, 90)),
        burn(w * firing * np.exp(-t / 150)), burn(w * firing * np.exp(-t / 400)), burn((t < 60.0).astype(float)),
        burn(r.cut), burn(slope * np.maximum(r.road_force, 0) * v * drive),
        gnss(one), gnss(v**2), gnss(v * t), gnss(v * m.curvature), block_means(p, "height_gps",
            fix(t)) if p.trace.gps else zero,
    ]  # fmt: skip
    for i in range(8):
        out.append(force(v**2 * np.maximum(np.cos(heading - i * np.pi / 4), 0.0) ** 4))
    for i in range(6):
        part = (t >= t[-1] * i / 6) & (t < t[-1] * (i + 1) / 6)
        out.append(force(v**2 * part))
    for period in (120.0, 200.0, 300.0, 400.0):
        out.append(force(v**2 * np.cos(2 * np.pi * t / period)))
        out.append(force(v**2 * np.sin(2 * np.pi * t / period)))
    power, at = burn(slope * firing), p.layout.time
    for period in _cycles():
        out += [power * np.cos(2.0 * np.pi * at / period), power * np.sin(2.0 * np.pi * at / period)]
    out += [force(v * np.cos(heading)), force(v * np.sin(heading))]
    return np.stack(out, axis=1)
