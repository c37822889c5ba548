"""The driver's and the traffic's rows of the catalogue of effects."""

from vehicle_model.car.effects import Effect, Parameter

EFFECTS = (
    Effect(
        "driver_lag",
        "driver",
        "Driver's reaction lag, advice missed or ignored",
        (
            Parameter("extra_delay", "s", 0.0, 0.0, 2.0, "tau 0.5 - 2 s, textbook (M)"),
            Parameter("gain", "", 1.0, 0.4, 1.0, "share of an advised change that is carried out, (M)"),
            Parameter("ignored", "", 0.0, 0.0, 1.0, "share of the time in which advice is ignored; Pavlovic"),
        ),
        ("speed", "thrust"),
        ("traffic_actuation",),
    ),
    Effect(
        "traffic_actuation",
        "traffic",
        "Speed set by the leader and not by the driver",
        (Parameter("density_factor", "", 1.0, 0.2, 4.0, "times the scenario's number of vehicles"),),
        ("speed",),
        ("driver_lag",),
    ),
)
"""Rows of EFFECTS 32 and 33."""
