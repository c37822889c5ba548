"""The car's CAN bus (seed 004, appendix D): table D.4 as a DBC file, frames of a trip, and logs of frames.

cantools encodes and decodes, python-can reads and writes the logs. The table gives the bytes' places and rates; scales
are ours (see the DBC's comment). Where the Vss line is dead, the bus is the odometer (2.3.3).
"""

from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
from numpy.typing import NDArray

from sensors.log import STREAMS, SensorLog
from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator
from vehicle_model.car.trip import Trip

RPM = 30.0 / np.pi
RATES = {"WheelSpeed": 0.02, "Speed": 0.02, "Steering": 0.01, "Gearbox": 0.02, "Engine": 0.02, "EngineSpeed": 0.02,
         "Motor": 0.01}  # fmt: skip
"""s between frames (table D.4)."""
WHEELS = ("FrontRight", "FrontLeft", "RearRight", "RearLeft")
JITTER = 1e-3
"""s: frames wait for the bus."""
WHEELBASE, STEERING_RATIO = 2.36, 18.0


def database(path: str | Path = "") -> cantools.database.Database:
    """Return the DBC file `path`, or the shipped one. Raises BadInput."""
    try:
        if path:
            return cantools.database.load_file(str(path), database_format="dbc")  # type: ignore[return-value]
        text = files("sensors.layouts").joinpath("smart.dbc").read_text()
        return cantools.database.load_string(text, database_format="dbc")  # type: ignore[return-value]
    except (OSError, cantools.Error, UnicodeDecodeError) as error:
        raise BadInput(path, "", f"a DBC file ({str(error).splitlines()[0]})") from error


def frames(trip: Trip, car: Car, seed: int = 0) -> Iterator[can.Message]:
    """Yield the frames of `trip` in order of time (stamps in trip time, s)."""
    table = database()
    rng = generator(seed, "sensors.can")
    parts: list[tuple[NDArray[np.float64], str]] = []
    for name, period in RATES.items():
        t = np.arange(trip.time[0] + rng.uniform(0.0, period), trip.time[-1], period)
        parts.append((t + JITTER * rng.exponential(1.0, t.size), name))
    times = np.concatenate([t for t, _ in parts])
    names = np.repeat([name for _, name in parts], [t.size for t, _ in parts])
    order = np.argsort(times, kind="stable")
    times, names = times[order], names[order]
    wanted = ["speed", "engine_speed", "fuel_power", "throttle", "gear", "coolant_temperature", "straightness"]
    wanted += ["brake_force"]
    at = {key: np.interp(times, trip.time, trip.channels[key]) for key in wanted if key in trip.channels}
    driven = np.interp(times, trip.time, np.gradient(trip.wheel_angle, trip.time)) * car.wheel_radius
    volume = at["fuel_power"] / (car.fuel.density * car.fuel.heating_value) * 3.6e6
    gear, throttle = at.get("gear", np.zeros(times.size)), at.get("throttle", np.zeros(times.size))
    warm = at.get("coolant_temperature", np.full(times.size, 360.0)) - 273.15
    brake = (at.get("brake_force", np.zeros(times.size)) > 1.0) * 1.0
    messages = {name: table.get_message_by_name(name) for name in RATES}
    for i in range(times.size):
        name = str(names[i])
        v, w, rpm = at["speed"][i] * 3.6, max(driven[i], 0.0) * 3.6, at["engine_speed"][i] * RPM
        signals: dict[str, float] = {
            "WheelSpeed": {"FrontRight": v, "FrontLeft": v, "RearRight": w, "RearLeft": w},
            "Speed": {"BrakePedal": brake[i], "CarSpeed": v},
            "Steering": {
                "SteeringAngle": np.degrees(np.arctan(WHEELBASE * at["straightness"][i])) * STEERING_RATIO,
                "SteeringMoment": 0.0,
            },
            "Gearbox": {"Gear": gear[i], "EngineSpeedCoarse": min(rpm, 8160.0), "WaterTemperature": warm[i]},
            "Engine": {"OilTemperature": warm[i], "NoGas": 64.0 * (throttle[i] <= 0.0)},
            "EngineSpeed": {"EngineSpeedFine": rpm, "GearFine": gear[i]},
            "Motor": {
                "FuelConsumption": min(volume[i], 25.5), "EngineSpeedLow": min(rpm, 8160.0),
                "GasPedalFiltered": 43.0 * throttle[i], "GasPedal": 253.0 * throttle[i],
                "Brake": brake[i], "Turbo": 0.0,
            },
        }[name]  # fmt: skip
        data = messages[name].encode({key: float(value) for key, value in signals.items()}, strict=False)
        yield can.Message(
            timestamp=float(times[i]), arbitration_id=messages[name].frame_id, data=data, is_extended_id=False
        )


def write_can_log(trip: Trip, car: Car, path: Path, seed: int = 0) -> None:
    """Write the frames of `trip` as a log whose kind its suffix tells (.blf, .asc, .log, .csv, .trc), aside first."""
    aside = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        with can.Logger(str(aside)) as log:
            for frame in frames(trip, car, seed):
                log.on_message_received(frame)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def read_can_log(path: Path, dbc: str | Path = "") -> SensorLog:
    """Read a log of frames into the streams speed (mean of the wheels), engine_speed and fuel.

    Frames that the database does not know are counted as `unknown_frame`, those of another length as `bad_frame`;
    times start at the first frame. Raises BadInput for an unreadable log, or one without any frame that is known.
    """
    table = database(dbc)
    rows: dict[str, list[tuple[float, float]]] = {"speed": [], "engine_speed": [], "fuel": []}
    damage = {"unknown_frame": 0, "bad_frame": 0}
    per_litre_hour = 745.0 * 43.0e6 / 3.6e6
    first = None
    try:
        with can.LogReader(str(path)) as log:
            for frame in log:
                first = frame.timestamp if first is None else first
                t = frame.timestamp - first
                try:
                    found: Any = table.decode_message(frame.arbitration_id, bytes(frame.data), decode_choices=False)
                except KeyError:
                    damage["unknown_frame"] += 1
                    continue
                except (cantools.database.DecodeError, ValueError):
                    damage["bad_frame"] += 1
                    continue
                if all(name in found for name in WHEELS):
                    rows["speed"].append((t, sum(float(found[name]) for name in WHEELS) / 4.0 / 3.6))
                if "EngineSpeedFine" in found:
                    rows["engine_speed"].append((t, float(found["EngineSpeedFine"]) / RPM))
                if "FuelConsumption" in found:
                    rows["fuel"].append((t, float(found["FuelConsumption"]) * per_litre_hour))
    except Exception as error:  # python-can's readers let through whatever their parsers raise
        said = (str(error).splitlines() or [type(error).__name__])[0]
        raise BadInput(path, "", f"a log of CAN frames that python-can reads ({said})") from error
    if not any(rows.values()):
        raise BadInput(path, "", "at least one frame that the database knows")
    streams = {name: np.empty(0, dtype=dtype) for name, dtype in STREAMS.items()}
    times = np.concatenate([np.array(part).reshape(-1, 2)[:, 0] for part in rows.values()])
    place = np.empty(times.size, dtype=np.int64)
    place[np.argsort(times, kind="stable")] = np.arange(times.size)
    at = 0
    for name, part in rows.items():
        table_rows = np.array(part).reshape(-1, 2)
        out = np.zeros(len(part), dtype=STREAMS[name])
        out["t"], out["power" if name == "fuel" else "speed"] = table_rows[:, 0], table_rows[:, 1]
        out["order"] = place[at : at + len(part)]
        at += len(part)
        streams[name] = out
    return SensorLog(streams, {key: count for key, count in damage.items() if count}, path.name)
