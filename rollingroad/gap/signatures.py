"""What each effect of the catalogue does to the residual channels: the simulator is run with the setting.

A plant's effect: replay at neutral less replay with the setting. A sensor's effect: the trip's channels as that sensor
would have told them. One effect has one or more *variants* (a time constant, a place on the map), of which the evidence
is averaged; a variant has one or more columns, whose coefficients are the effect's parameters less their neutral
values.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rollingroad.gap.sensor_signatures import (
    clock,
    dead_time,
    gps_lag,
    grade_map,
    mount,
    sensor,
    tyre_radius,
    wheel_radius,
    wheel_slip,
)
from rollingroad.gap.signature_form import COHERENT, PERIODS, Column, Context, Variant
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]


def _plant(
    effect: str, steps: Mapping[str, tuple[float, float, str, float, int]], shape: Mapping[str, float]
) -> Variant:
    """Variant of a plant's effect: `steps` parameter -> (neutral, step, unit, prior deviation, sign)."""
    columns = tuple(Column(name, unit, neutral, sd, sign) for name, (neutral, _, unit, sd, sign) in steps.items())

    def make(c: Context) -> Array:
        out = []
        for name, (neutral, step, *_) in steps.items():
            settings = {f"{effect}.{name}": neutral + step, **shape}
            out.append((c.neutral - c.residual(settings)) / step)
        return np.stack(out, axis=1)

    def settings(value: Array) -> list[dict[str, float]]:
        moved = {f"{effect}.{name}": row[0] + float(x) for (name, row), x in zip(steps.items(), value, strict=True)}
        return [{**moved, **shape}]

    return Variant(effect, columns, shape, make, settings)


def _wind() -> Variant:
    columns = (Column("speed", "m/s", 0.0, 2.5), Column("speed_east", "m/s", 0.0, 2.5))

    def make(c: Context) -> Array:
        out = []
        for bearing in (0.0, np.pi / 2):
            both = [c.residual({"head_wind.speed": s, "head_wind.from": bearing}) for s in (2.0, -2.0)]
            out.append((both[1] - both[0]) / 4.0)
        return np.stack(out, axis=1)

    def settings(value: Array) -> list[dict[str, float]]:
        return [{"head_wind.speed": float(np.hypot(*value)), "head_wind.from": float(np.arctan2(value[1], value[0]))}]

    return Variant("head_wind", columns, {}, make, settings)


def _warm(
    amount: str,
    unit: str,
    neutral: float,
    step: float,
    sd: float,
    effect: str,
    shapes: list[dict[str, float]],
    sign: int,
) -> Variant:
    """An effect that fades: shapes of different time constants side by side, so that any mixture of them is spanned."""
    columns = tuple(Column(amount if i == 0 else f"{amount}~{i}", unit, neutral, sd, sign) for i in range(len(shapes)))

    def make(c: Context) -> Array:
        out = []
        for shape in shapes:
            settings = {f"{effect}.{amount}": neutral + step, **shape}
            out.append((c.neutral - c.residual(settings)) / step)
        return np.stack(out, axis=1)

    def settings(value: Array) -> list[dict[str, float]]:
        parts = zip(shapes, value, strict=True)
        return [{f"{effect}.{amount}": neutral + float(x), **shape} for shape, x in parts]

    return Variant(effect, columns, shapes[0], make, settings)


def variants(car: Car) -> list[Variant]:
    """The lexicon, as Variants; effects without an observable signature are found out by their columns being zero."""
    out = [
        _wind(),
        _plant("rolling_resistance", {"factor": (1.0, 0.1, "", 0.15, 0)}, {}),
        _warm("amount", "", 0.0, 0.2, 0.12, "tyre_warm_up",
              [{"tyre_warm_up.time": 720.0}, {"tyre_warm_up.time": 300.0}, {"tyre_warm_up.time": 1500.0}], 1),
        _plant("mass", {"factor": (1.0, 0.05, "", 0.10, 0)}, {}),
        _plant("drag_area", {"factor": (1.0, 0.1, "", 0.12, 0)}, {}),
        _plant("air_density", {"factor": (1.0, 0.1, "", 0.08, 0)}, {}),
        _warm("temperature", "K", 363.15, -40.0, 40.0, "cold_start",
              [{}, {"cold_start.energy": 0.8e9, "cold_start.oil_share": 0.0},
               {"cold_start.energy": 5e9, "cold_start.oil_energy": 15e9, "cold_start.enrichment": 0.0}], -1),
        _plant("cranking_fuel", {"energy": (0.0, 2e4, "J", 3e4, 1), "idle_raise": (0.0, 20.0, "rad/s", 20.0, 1),
                                 "retard": (0.0, 0.2, "", 0.2, 1)}, {}),
        _warm("amount", "", 0.0, 1.0, 1.2, "gearbox_oil_cold",
              [{"gearbox_oil_cold.distance": 4000.0}, {"gearbox_oil_cold.distance": 2000.0},
              {"gearbox_oil_cold.distance": 8000.0}], 1),
        _plant("accessory_load", {"power": (0.0, 400.0, "W", 400.0, 0)}, {}),
        _plant("fuel_cutoff", {"share": (1.0, -0.5, "", 0.5, -1)}, {}),
        _plant("idle_fuel", {"factor": (1.0, 0.2, "", 0.2, 0)}, {}),
        sensor("fuel_energy", (Column("factor", "", 1.0, 0.03),), lambda c: [-c.fuel]),
        _plant("driveline_loss", {"share": (0.0, 0.02, "", 0.02, 0)}, {}),
        _plant("driveline_loss", {"drag": (1.0, 0.5, "", 0.8, 0)}, {}),
        _plant("clutch_slip", {"launch": (1.0, 0.2, "", 0.3, 0)}, {}),
        _plant("shift_loss", {"time": (0.0, 0.2, "s", 0.25, 0)}, {}),
        _plant("cornering_drag", {"factor": (1.0, 1.0, "", 1.2, 0)}, {}),
        _plant("brake_drag", {"force": (0.0, 20.0, "N", 25.0, 1)}, {}),
        _plant("brake_drag", {"after_braking": (0.0, 20.0, "N", 30.0, 1)}, {}),
        sensor("injector_dead_time", (Column("extra", "s", 0.0, 1.5e-4),), dead_time),
        sensor("injector_fouling", (Column("flow_lost", "", 0.0, 0.05),), lambda c: [c.fuel]),
        sensor("wheel_slip", (Column("factor", "", 1.0, 1.0),), wheel_slip),
        sensor("wheel_radius", (Column("change", "", 0.0, 0.012), Column("growth", "", 0.0, 0.004)), wheel_radius),
        sensor("wheel_radius", (Column("change", "", 0.0, 0.012), Column("growth", "", 0.0, 0.004)), tyre_radius),
        sensor("accelerometer_mount",
                (Column("pitch", "rad", 0.0, 0.03), Column("scale", "", 0.0, 0.03), Column("drift", "m/s2/h", 0.0,
                    0.15)), mount),
        sensor("gps_lag", (Column("seconds", "s", 0.2, 0.5), Column("seconds_of_second_receiver", "s", 0.2, 1.0)),
            gps_lag),
        sensor("clock_skew", (Column("rate", "", 0.0, 1.5e-4),), clock),
        sensor("grade_map_error", (Column("bias", "", 0.0, 0.003),), lambda c: grade_map(c)[:1]),
        sensor("grade_map_error", (Column("shift", "m", 0.0, 15.0),), lambda c: grade_map(c)[1:]),
    ]  # fmt: skip
    out.append(_cold_with_start())
    for bearing in (0.0, 0.79, 1.57, 2.36):
        out.append(_plant("cross_wind", {"speed": (0.0, 5.0, "m/s", 5.0, 1)}, {"cross_wind.from": bearing}))
    for load in (0.6, 0.7, 0.8, 0.9):
        # a threshold below the declared one moves fuel there too: the step holds amount and place together
        out.append(_plant("enrichment", {"amount": (0.10, 0.1, "", 0.08, 0)}, {"enrichment.load": load}))
    for speed in (0.2, 0.3, 0.4, 0.5, 0.65):
        for torque in (0.15, 0.3, 0.45, 0.65, 0.85, 1.05):
            out.append(_plant("map_drift", {"size": (0.0, 0.03, "", 0.04, 0)},
                              {"map_drift.speed": speed, "map_drift.torque": torque}))  # fmt: skip
    for frequency in np.arange(1.0 / PERIODS[1], 1.0 / PERIODS[0], 1.0 / COHERENT):
        out.append(_cycling(float(1.0 / frequency)))
    return out


def _cold_with_start() -> Variant:
    """A cold start as cars really make it: friction that fades over minutes, and the first half minute's rich mixture
    and heating of the catalyst."""
    friction = _warm("temperature", "K", 363.15, -40.0, 40.0, "cold_start",
                     [{}, {"cold_start.energy": 0.8e9, "cold_start.oil_share": 0.0}], -1)  # fmt: skip
    columns = (*friction.columns, Column("first_half_minute", "", 0.0, 0.4, 1))

    def make(c: Context) -> Array:
        start = {"cranking_fuel.retard": 0.2, "cranking_fuel.time": 30.0}
        early = (c.neutral - c.residual(start)) / 0.2
        return np.concatenate([friction.make(c), early[:, None]], axis=1)

    return Variant("cold_start", columns, {}, make)


def _cycling(period: float) -> Variant:
    """A compressor that cycles: its mean, and its swing in a phase that each trip has for itself."""
    columns = (
        Column("power", "W", 0.0, 1500.0, 1),
        Column("power~1", "W", 0.0, 800.0),
        Column("power~2", "W", 0.0, 800.0),
    )

    def make(c: Context) -> Array:
        mean = c.compressor
        t = c.p.layout.time
        phase = 2.0 * np.pi * t / period
        return np.stack([0.5 * mean, mean * np.cos(phase), mean * np.sin(phase)], axis=1)

    return Variant("ac_cycling", columns, {"ac_cycling.period": period}, make, swings=True)
