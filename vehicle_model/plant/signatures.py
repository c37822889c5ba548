"""What each effect changes, measured: the same speed trace and gears driven with the nominal car and with the effect.

`python -m vehicle_model.plant.signatures > docs/effects.md` writes the table of the documentation.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_model.car.effects import Effect
from vehicle_model.car.files import read_car
from vehicle_model.car.parameters import Car
from vehicle_model.plant import kernel as k
from vehicle_model.plant import steady
from vehicle_model.plant.cycle import read_cycle, replay
from vehicle_model.plant.effects import EFFECTS
from vehicle_model.plant.parameters import plant_parameters

Array = NDArray[np.float64]
Channels = dict[str, Array]


@dataclass(frozen=True)
class Signature:
    """Differences to the nominal drive. `fuel`, `map`, `wheel`: fractions; `thrust`, `road`, `driveline`: N, rms."""

    fuel: float
    """Of the whole drive's fuel."""
    thrust: float
    """Anywhere: what the car's speed history needs, and every gap and lag in it."""
    road: float
    """In `road_load` at the same speed and place."""
    driveline: float
    """In thrust beyond what crankshaft torque and nominal gearbox give, gear engaged."""
    map: float
    """In fuel beyond the nominal steady map at the same engine speed and torque, gear engaged; of the fuel there."""
    idle: float
    """In fuel power at standstill; of the nominal's."""
    engine_speed: float
    """rad/s rms at the same speed and gear, clutch closed."""
    wheel: float
    """In the driven wheels' turns per distance."""
    coolant: float
    """K, largest."""
    voltage: float
    """V, largest."""


def proving_ground() -> Channels:
    """A WLTC with slopes of 2 %, bends and all headings: something for every effect. Arrays over time, 1 Hz."""
    cycle = read_cycle("wltc")
    s = np.concatenate([[0.0], np.cumsum(0.5 * (cycle.speed[1:] + cycle.speed[:-1]))])
    # bends as sharp as 2 m/s2 of lateral acceleration allows, at most 1/50 m
    straightness = np.sin(2.0 * np.pi * s / 900.0) * np.minimum(0.02, 2.0 / np.maximum(cycle.speed, 3.0) ** 2)
    heading = np.concatenate([[0.0], np.cumsum(straightness[1:] * np.diff(s))]) + 2.0 * np.pi * s / 12_000.0
    return {
        "time": cycle.time,
        "speed": cycle.speed,
        "pitch": 0.02 * np.sin(2.0 * np.pi * s / 1500.0),
        "straightness": straightness,
        "heading": heading,
    }


def drive(car: Car, settings: Mapping[str, float], track: Channels, gear: Array | None = None) -> Channels:
    """Replay `track` with `car` under `settings`, in given gears or its own; 10 Hz."""
    p = plant_parameters(car, settings)
    t = track["time"]
    return replay(p, t, track["speed"], gear, track["pitch"], track["straightness"], track["heading"])


def signature(car: Car, settings: Mapping[str, float], track: Channels, nominal: Channels, gear: Array) -> Signature:
    """Return what `settings` change against `nominal`, the drive of the nominal car over `track` in `gear`."""
    p = plant_parameters(car)
    changed = drive(car, settings, track, gear)
    both = (nominal["clutch"] == 1.0) & (changed["clutch"] == 1.0) & (nominal["gear"] == changed["gear"])
    both &= nominal["gear"] > 0
    # a tenth of a second after a shift or a jump the averages below are still disturbed
    both &= np.convolve(both, np.ones(9), mode="same") > 8.5
    standing = (nominal["speed"] == 0.0) & (changed["speed"] == 0.0) & (nominal["time"] > 100.0)

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0

    def driveline_residual(run: Channels) -> Array:
        gears = run["gear"].astype(int)
        spin = p[k.P_INERTIA] * np.gradient(run["engine_speed"], run["time"])
        torque = run["engine_torque"] - spin
        lever = p[k.P_RATIO + gears] / p[k.P_RADIUS]
        wheel = run["speed"] / p[k.P_RADIUS]
        lost = (p[k.P_GEAR_DRAG] + p[k.P_GEAR_DRAG_SPEED] * wheel) / p[k.P_RADIUS]
        kept = 1.0 - p[k.P_LOSS + gears] * np.sign(torque)
        return run["thrust"] - lever * kept * torque + lost

    def map_residual(run: Channels, fired: NDArray[np.bool_]) -> float:
        expected = steady.engine_fuel_power(p, run["engine_speed"][fired], run["engine_torque"][fired])
        return float(np.sum(run["fuel_power"][fired] - expected) / np.sum(expected))

    def idle_power(run: Channels) -> float:
        return float(np.mean(run["fuel_power"][standing]))

    turns = {id(run): run["wheel_angle"][-1] / run["distance"][-1] for run in (nominal, changed)}
    coasting = both & (nominal["throttle"] < 0.05) & (changed["throttle"] < 0.05)
    driving = both & (nominal["fuel_power"] > 0.0) & (changed["fuel_power"] > 0.0) & ~coasting
    overrun_fuel = float(
        np.sum((changed["fuel_power"] - nominal["fuel_power"])[coasting]) / np.sum(nominal["fuel_power"])
    )
    return Signature(
        fuel=float(changed["fuel_energy"][-1] / nominal["fuel_energy"][-1] - 1.0),
        thrust=rms(changed["thrust"] - nominal["thrust"]),
        road=rms((changed["road_load"] - nominal["road_load"])[both]),
        driveline=rms((driveline_residual(changed) - driveline_residual(nominal))[driving]),
        map=map_residual(changed, driving) - map_residual(nominal, driving) + overrun_fuel,
        idle=idle_power(changed) / idle_power(nominal) - 1.0,
        engine_speed=rms((changed["engine_speed"] - nominal["engine_speed"])[both]),
        wheel=turns[id(changed)] / turns[id(nominal)] - 1.0,
        coolant=float(np.max(np.abs(changed["coolant_temperature"] - nominal["coolant_temperature"]))),
        voltage=float(np.max(np.abs(changed["battery_voltage"] - nominal["battery_voltage"]))),
    )


def nominal_drive(car: Car, track: Channels) -> tuple[Channels, Array]:
    """The nominal car's drive over `track` and its gears at the track's times."""
    own = drive(car, {}, track)
    gear = own["gear"][np.clip(np.searchsorted(own["time"], track["time"] + 1e-9) - 1, 0, None)]
    return drive(car, {}, track, gear), gear


def settings_of(effect: Effect, parameter: str) -> dict[str, float]:
    """The effect with one parameter at the middle of its range, the others neutral."""
    part = next(part for part in effect.parameters if part.name == parameter)
    return {f"{effect.id}.{part.name}": part.middle}


def table(car: Car) -> str:
    """The table of the documentation, Markdown."""
    track = proving_ground()
    nominal, gear = nominal_drive(car, track)
    lines = [
        "<!-- Generated: python -m vehicle_model.plant.signatures > docs/effects.md -->",
        "# What each effect of the plant changes",
        "",
        f"The `{car.name}` over a WLTC 3b with slopes of 2 %, bends of up to 2 m/s2 and all headings; same speed trace",
        "and same gears with and without the effect; each primary parameter alone, at the middle of the longer side of",
        "its range. A dash is a difference below a thousandth of what the channel carries. *Fuel*: of the drive.",
        "*Thrust*: rms, whole drive. *Road*: `road_load` at the same speed and place, rms. *Driveline*: thrust beyond",
        "what the crankshaft's torque and the nominal gearbox give, rms. *Map*: fuel beyond the nominal",
        "steady map at the",
        "same engine speed and torque, overrun included. *Idle*: fuel power at standstill. *Engine speed*:",
        "rms at the same",
        "speed, clutch closed. *Wheel*: turns of the driven wheels per distance. Neutral is bit-identical to the",
        "nominal car (a test).",
        "",
        "| effect | parameter | unit | neutral | range | at | subsystem | fuel % | thrust N | road N | driveline N "
        "| map % | idle % | engine speed rad/s | wheel % | source of the range |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]

    def show(value: float, floor: float, digits: int, sign: bool = True) -> str:
        return f"{value:{'+' if sign else ''}.{digits}f}" if abs(value) > floor else "-"

    for effect in EFFECTS:
        for part in effect.parameters:
            span = f"{part.low:.4g} to {part.high:.4g}"
            head = f"| `{effect.id}` | `{part.name}` | {part.unit} | {part.neutral:.4g} | {span} "
            if not part.primary:
                lines.append(head + f"| | {effect.subsystem} | shape | | | | | | | | {part.source} |")
                continue
            found = signature(car, settings_of(effect, part.name), track, nominal, gear)
            lines.append(
                head + f"| {part.middle:.4g} | {effect.subsystem} "
                f"| {show(100 * found.fuel, 0.02, 2)} | {show(found.thrust, 1.0, 0, False)} "
                f"| {show(found.road, 0.4, 1, False)} | {show(found.driveline, 0.4, 1, False)} "
                f"| {show(100 * found.map, 0.02, 2)} | {show(100 * found.idle, 0.1, 1)} "
                f"| {show(found.engine_speed, 0.05, 2, False)} | {show(100 * found.wheel, 0.005, 2)} | {part.source} |"
            )
    lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(read_car("smart")))
