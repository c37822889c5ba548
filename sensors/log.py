"""What the logger saw: one structured array per stream, in the order in which the packets stand on the card."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

STREAMS: dict[str, np.dtype] = {
    # `order` is the packet's place among all packets of the log; `t` is the logger's own clock, s.
    "accelerometer": np.dtype([("order", "i8"), ("t", "f8"), ("x", "f8"), ("y", "f8"), ("z", "f8")]),
    # specific force in the *sensor's* axes, m/s2
    "wheel": np.dtype([("order", "i8"), ("t", "f8")]),
    "injector": np.dtype([("order", "i8"), ("t", "f8"), ("width", "f8"), ("saturated", "?")]),
    # t: rising edge; width: electrical, s
    "gps": np.dtype(
        [
            ("order", "i8"),
            ("t", "f8"),
            ("utc", "f8"),
            ("latitude", "f8"),
            ("longitude", "f8"),
            ("altitude", "f8"),
            ("hdop", "f8"),
            ("quality", "i4"),
            ("satellites", "i4"),
            ("speed", "f8"),
            ("course", "f8"),
        ]
    ),
    # t: logger time of the newest stamped packet before the sentence was complete (a lower bound of its arrival);
    # utc: s since 1970 of the epoch named in the sentence; deg, m above sea level; speed m/s and course rad, or NaN
    "skew": np.dtype([("order", "i8"), ("t", "f8"), ("gained", "f8")]),
    # s that the logger's clock gained on GPS time since the last skew packet
    "gyroscope": np.dtype([("order", "i8"), ("t", "f8"), ("x", "f8"), ("y", "f8"), ("z", "f8")]),
    "compass": np.dtype([("order", "i8"), ("t", "f8"), ("heading", "f8")]),
    "speed": np.dtype([("order", "i8"), ("t", "f8"), ("speed", "f8")]),
    # from real logs that carry a speed instead of wheel pulses, m/s
    "fuel": np.dtype([("order", "i8"), ("t", "f8"), ("power", "f8")]),
    # from real logs that carry a fuel flow instead of injector pulses, W
    "engine_speed": np.dtype([("order", "i8"), ("t", "f8"), ("speed", "f8")]),
    # from real logs that carry the engine's speed, rad/s
}
STREAMS["gps_second"] = STREAMS["gps"]
# a second receiver, as in comma2k19
"""The streams that a log may hold, and their columns."""


@dataclass(frozen=True)
class SensorLog:
    """A trip as it was logged. A stream that was not recorded is an empty array, never absent."""

    streams: dict[str, NDArray]
    damage: dict[str, int] = field(default_factory=dict)
    """What was lost, counted by kind ("bad_check", "unknown_type", "bytes_skipped", "bad_sentence", ...)."""
    name: str = ""
    """File name of the trip."""

    def __getitem__(self, stream: str) -> NDArray:
        return self.streams.get(stream, np.empty(0, STREAMS[stream]))
