"""What each effect of the catalogue does to the residual channels: the simulator is run with the setting.

A plant's effect: replay at neutral less replay with the setting. A sensor's effect: the trip's channels as that sensor
would have told them. One effect has one or more *variants* (a time constant, a place on the map), of which the evidence
is averaged; a variant has one or more columns, whose coefficients are the effect's parameters less their neutral
values.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.observe import pulse_angle
from rollingroad.gap.blocks import Prepared
from rollingroad.gap.channels import Correction, block_means, resensed, values
from rollingroad.gap.design import CLOCK, RATIO
from rollingroad.gap.replay import replay_vector, vector_of
from vehicle_model.car.parameters import Car

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """One column: the parameter it moves, its unit and neutral value, the prior deviation of its coefficient."""

    parameter: str
    unit: str
    neutral: float
    sd: float
    sign: int = 0
    """+1 or -1 where the coefficients of this parameter's columns, added up, can only have that sign, physically."""


@dataclass(frozen=True)
class Variant:
    """One shape of an effect."""

    effect: str
    columns: tuple[Column, ...]
    shape: Mapping[str, float]
    """Parameters of shape, as settings."""
    make: Callable[["Context"], Array]
    """(m, number of columns)."""
    settings: Callable[[Array], list[dict[str, float]]] | None = None
    """Settings of the simulator, at given coefficients, whose signals add up to the effect's; None for a sensor's."""
    swings: bool = False
    """The first column is the mean of what comes and goes by the two others: without a swing it is another effect."""

    def at(self, c: "Context", value: Array) -> Array:
        """(m,): the signal re-simulated at coefficients `value`. Raises BadInput where the simulator refuses them."""
        assert self.settings is not None
        return sum((c.neutral - c.residual(one) for one in self.settings(value)), np.zeros(len(c.base)))


@dataclass(frozen=True)
class Context:
    """A trip and the nominal car that it is compared with."""

    p: Prepared
    car: Car
    vector: Array
    base: Array
    fuel: Array
    """(m,) W, what the calibrated simulator says that each fuel block burns. (The measured fuel as a regressor of
    itself
    would explain its own noise.)"""
    correction: Correction | None = None

    def residual(self, settings: Mapping[str, float]) -> Array:
        """(m,): measured less calibrated replay under `settings` ("effect.parameter": value)."""
        return values(self.p, self.car, vector_of(self.car, settings), self.correction)

    @cached_property
    def neutral(self) -> Array:
        """(m,): the same with nothing set."""
        return values(self.p, self.car, self.vector, self.correction)

    @cached_property
    def compressor(self) -> Array:
        """(m,) per W at the crankshaft."""
        return (self.neutral - self.residual({"accessory_load.power": 400.0})) / 400.0 * 0.536


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


def _sensor(effect: str, columns: tuple[Column, ...], make: Callable[[Context], list[Array]]) -> Variant:
    return Variant(effect, columns, {}, lambda c: np.stack(make(c), axis=1))


def _moved(c: Context, **channels: Any) -> Array:
    """Change of the residuals if the trace's `channels` were these."""
    return (
        values(resensed(c.p, replace(c.p.trace, **channels), c.car, c.vector), c.car, c.vector, c.correction)
        - c.neutral
    )


def _speed_scaled(c: Context, share: Array) -> Array:
    """Change per unit if the wheels told (1 + share) times the speed."""
    step = 0.01
    t = c.p.trace
    v = t.speed * (1.0 + step * share)
    return _moved(c, speed=v, acceleration=t.acceleration * (1.0 + step * share)) / step


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


def _wheel_slip(c: Context) -> list[Array]:
    force = replay_vector(c.vector, c.p.samples.motion).road_force
    compliance = 1.0 / (30.0 * 0.55 * c.car.mass * c.car.gravity)
    return [_speed_scaled(c, np.clip(force, -4000, 6000) * compliance)]


def _wheel_radius(c: Context) -> list[Array]:
    v = c.p.trace.speed
    return [-_speed_scaled(c, np.ones_like(v)), -_speed_scaled(c, (v / 27.78) ** 2)]


def _tyre_radius(c: Context) -> list[Array]:
    """As `_wheel_radius`, of the tyre itself and not of the sensor's scale: the engine turns with the wheel."""
    return [np.where(c.p.layout.channel == RATIO, 0.0, column) for column in _wheel_radius(c)]


def _mount(c: Context) -> list[Array]:
    t = c.p.trace
    time = t.time - t.time[0]
    g = c.car.gravity
    known = np.where(np.isfinite(t.force), t.force, 0.0)
    return [
        _moved(c, force=t.force - 0.01 * g) / 0.01,  # the box's nose up by more than the file says: it reads less
        _moved(c, force=t.force + 0.02 * known) / 0.02,
        _moved(c, force=t.force + 0.1 * time / 3600.0) / 0.1,
    ]


def _dead_time(c: Context) -> list[Array]:
    m = c.p.samples.motion
    firing = ~c.p.trace.cut
    power = c.car.injector_power * m.engine_speed / pulse_angle(c.car) * firing
    return [block_means(c.p, "fuel_power", power)]


def _fixes(c: Context, sample: Array) -> Array:
    at = c.p.trace.gps["t"] - c.p.trace.time[0]
    return np.interp(at - 0.2, c.p.samples.motion.time, sample)


def _gps_lag(c: Context) -> list[Array]:
    if not c.p.trace.gps:
        return [np.zeros(len(c.base))] * 2
    first = block_means(c.p, "gnss_speed", -_fixes(c, c.p.samples.motion.acceleration))
    second = np.zeros(len(c.base))
    if c.p.trace.second:
        at = c.p.trace.second["t"] - c.p.trace.time[0]
        m = c.p.samples.motion
        second = block_means(c.p, "gnss_second", -np.interp(at - 0.2, m.time, m.acceleration))
    return [first, second]


def _clock(c: Context) -> list[Array]:
    return [(c.p.layout.channel == CLOCK).astype(float)]


def _grade_map(c: Context) -> list[Array]:
    if not c.p.trace.gps:
        return [np.zeros(len(c.base))] * 2
    m = c.p.samples.motion
    height = c.p.trace.gps["map_altitude"]
    good = np.isfinite(height)
    slope = np.zeros(len(height))
    if good.sum() > 50:
        s = _fixes(c, m.distance)
        at = np.arange(s[good][0], s[good][-1] + 1.0, 20.0)
        level = np.interp(at, np.maximum.accumulate(s[good]), height[good])
        level = np.convolve(np.pad(level, 3, mode="edge"), np.ones(7) / 7, mode="valid")
        slope = np.interp(s, at, np.gradient(level, 20.0)) if len(at) > 5 else slope
    return [block_means(c.p, "height_map", _fixes(c, m.distance)), block_means(c.p, "height_map", slope)]


def variants(car: Car) -> list[Variant]:
    """The library, as Variants; effects without an observable signature are found out by their columns being zero."""
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
        _sensor("fuel_energy", (Column("factor", "", 1.0, 0.03),), lambda c: [-c.fuel]),
        _plant("driveline_loss", {"share": (0.0, 0.02, "", 0.02, 0)}, {}),
        _plant("driveline_loss", {"drag": (1.0, 0.5, "", 0.8, 0)}, {}),
        _plant("clutch_slip", {"launch": (1.0, 0.2, "", 0.3, 0)}, {}),
        _plant("shift_loss", {"time": (0.0, 0.2, "s", 0.25, 0)}, {}),
        _plant("cornering_drag", {"factor": (1.0, 1.0, "", 1.2, 0)}, {}),
        _plant("brake_drag", {"force": (0.0, 20.0, "N", 25.0, 1)}, {}),
        _plant("brake_drag", {"after_braking": (0.0, 20.0, "N", 30.0, 1)}, {}),
        _sensor("injector_dead_time", (Column("extra", "s", 0.0, 1.5e-4),), _dead_time),
        _sensor("injector_fouling", (Column("flow_lost", "", 0.0, 0.05),), lambda c: [c.fuel]),
        _sensor("wheel_slip", (Column("factor", "", 1.0, 1.0),), _wheel_slip),
        _sensor("wheel_radius", (Column("change", "", 0.0, 0.012), Column("growth", "", 0.0, 0.004)), _wheel_radius),
        _sensor("wheel_radius", (Column("change", "", 0.0, 0.012), Column("growth", "", 0.0, 0.004)), _tyre_radius),
        _sensor("accelerometer_mount",
                (Column("pitch", "rad", 0.0, 0.03), Column("scale", "", 0.0, 0.03), Column("drift", "m/s2/h", 0.0,
                    0.15)), _mount),
        _sensor("gps_lag", (Column("seconds", "s", 0.2, 0.5), Column("seconds_of_second_receiver", "s", 0.2, 1.0)),
            _gps_lag),
        _sensor("clock_skew", (Column("rate", "", 0.0, 1.5e-4),), _clock),
        _sensor("grade_map_error", (Column("bias", "", 0.0, 0.003),), lambda c: _grade_map(c)[:1]),
        _sensor("grade_map_error", (Column("shift", "m", 0.0, 15.0),), lambda c: _grade_map(c)[1:]),
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


PERIODS, COHERENT = (17.0, 65.0), 1500.0
"""s: of a compressor; twice the longest time over which two neighbouring frequencies stay in step."""


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
