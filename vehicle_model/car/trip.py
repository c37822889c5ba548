"""What truly happened on a drive: time series on the plant's clock. Sensors read it; the observer never does."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

CHANNELS = {
    "time": "s, from the start of the drive",
    "distance": "m along the route, x_i",
    "speed": "m/s over ground, v_i",
    "acceleration": "m/s2, dv/dt",
    "north": "m",
    "east": "m",
    "altitude": "m above sea level",
    "heading": "rad, psi, unwrapped",
    "pitch": "rad, theta, of the road",
    "straightness": "rad/m, S_j",
    "vertical_straightness": "rad/m, S_k",
    "thrust": "N, axle torque / wheel radius, before wheel inertia, without brakes",
    "brake_force": "N at the wheels, positive slows the car",
    "road_load": "N, drag + rolling + grade",
    "gear": "0 neutral, 1 ...",
    "clutch": "1 locked, 0 open, between: slipping",
    "engine_speed": "rad/s",
    "engine_torque": "N m at the crankshaft, net of friction and accessories, before engine inertia",
    "fuel_power": "W, fuel burnt x lower heating value, P_in",
    "fuel_energy": "J since the start, E_in",
    "engine_angle": "rad since the start, theta_e",
    "wheel_angle": "rad of the driven wheels since the start",
    "throttle": "0 to 1, load demanded",
    "coolant_temperature": "K",
    "battery_voltage": "V",
    "speed_limit": "m/s",
    "sky": "OPEN_SKY, CANYON, TUNNEL of `route`",
}
"""Name and unit of every channel of a `Trip`."""


@dataclass(frozen=True)
class Trip:
    """A drive. `channels[name]` has shape (n,), float64, evenly spaced in time by `step` seconds."""

    channels: dict[str, NDArray[np.float64]]
    step: float
    origin: tuple[float, float, float]
    """Latitude, longitude (deg, WGS 84), altitude (m) of north = east = 0."""
    gps_epoch: float = 1_256_634_000.0
    """UTC (s since 1970) of time 0: the receiver's clock, apart from the logger's."""

    def __getattr__(self, name: str) -> NDArray[np.float64]:
        try:
            return self.__dict__["channels"][name]
        except KeyError:
            raise AttributeError(name) from None

    @property
    def duration(self) -> float:
        """Length of the drive, s."""
        return float(self.channels["time"][-1] - self.channels["time"][0])

    def write(self, path: Path) -> None:
        """Write as Parquet (`truth.parquet`), written aside and renamed."""
        table = pa.table(self.channels).replace_schema_metadata(
            {"step": repr(self.step), "origin": repr(list(self.origin)), "gps_epoch": repr(self.gps_epoch)}
        )
        aside = path.with_name(path.name + ".part")
        pq.write_table(table, aside, compression="zstd")
        aside.replace(path)

    @staticmethod
    def read(path: Path) -> "Trip":
        """Read what `write` wrote."""
        table = pq.read_table(path)
        meta = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}
        lat, lon, alt = (float(part) for part in meta["origin"].strip("[]").split(","))
        columns = {name: table[name].to_numpy() for name in table.column_names}
        return Trip(columns, float(meta["step"]), (lat, lon, alt), float(meta["gps_epoch"]))
