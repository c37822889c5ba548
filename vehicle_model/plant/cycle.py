"""The plant on a drive cycle or along a measured trace, driver in the loop, and where its energy went.

`rollingroad cycle` prints what `run_cycle` returns; the diagnosis replays measured trips with `replay`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vehicle_model.car.errors import BadInput
from vehicle_model.car.parameters import Car
from vehicle_model.car.route import OPEN_SKY, Route
from vehicle_model.car.trip import Trip
from vehicle_model.plant import kernel as k
from vehicle_model.plant.parameters import plant_parameters
from vehicle_model.plant.session import build_trip

Array = NDArray[np.float64]
ALIASES = {"wltc": "wltc_3b", "wltp": "wltc_3b", "tsdc": "tsdc_42648"}


@dataclass(frozen=True)
class Cycle:
    """A speed trace: `time` (n,) s even and rising from 0, `speed` (n,) m/s, `grade` (n,) rise over run."""

    name: str
    time: Array
    speed: Array
    grade: Array


@dataclass(frozen=True)
class EnergyAccount:
    """Where the fuel went, J over the whole drive. `fuel` = sum of all other entries but `wheel_work`, to 1e-6.

    Stored energies are the change over the drive; what comes out of a store is negative.
    """

    fuel: float
    """Fuel burnt x declared heating value."""
    exhaust_and_cooling: float
    """Heat that became no indicated work."""
    fuel_blend: float
    """Metered at the declared heating value but not in the fuel (`fuel_energy`)."""
    friction: float
    pumping: float
    accessories: float
    """Alternator's and belt's shaft work."""
    air_conditioning: float
    starter: float
    """Given by the battery, hence negative."""
    clutch: float
    gearbox: float
    wheel_slip: float
    drag: float
    rolling: float
    cornering: float
    brake_drag: float
    brakes: float
    climb: float
    """Change of potential energy."""
    kinetic: float
    """Change of the car's and its wheels' kinetic energy."""
    engine_kinetic: float
    """Change of the engine's rotational energy."""
    wheel_work: float
    """Work of the axle at the driven wheels: what the drags, the brakes, slip and the car's stored energy add up to."""

    @property
    def imbalance(self) -> float:
        """(fuel - everything it went into) / fuel, or J where no fuel was burnt."""
        entries = [getattr(self, f.name) for f in fields(self) if f.name not in ("fuel", "wheel_work")]
        return (self.fuel - sum(entries)) / (self.fuel or 1.0)

    @property
    def wheel_imbalance(self) -> float:
        """(axle work - what the road took and the car stored) / fuel, or J where no fuel was burnt."""
        taken = self.wheel_slip + self.drag + self.rolling + self.cornering + self.brake_drag + self.brakes
        return (self.wheel_work - taken - self.climb - self.kinetic) / (self.fuel or 1.0)


def energy_account(parameters: Array, before: Array, after: Array) -> EnergyAccount:
    """Account between two states of the kernel."""
    difference = after - before

    def car_kinetic(x: Array) -> float:
        free = parameters[k.P_MASS] + parameters[k.P_FREE_INERTIA] / parameters[k.P_FREE_RADIUS] ** 2
        return 0.5 * (free * x[k.X_SPEED] ** 2 + parameters[k.P_DRIVEN_INERTIA] * x[k.X_WHEEL_SPEED] ** 2)

    def engine_kinetic(x: Array) -> float:
        return 0.5 * parameters[k.P_INERTIA] * x[k.X_ENGINE_SPEED] ** 2

    return EnergyAccount(
        fuel=float(difference[k.X_FUEL_ENERGY]),
        exhaust_and_cooling=float(difference[k.E_EXHAUST]),
        fuel_blend=float(difference[k.E_BLEND]),
        friction=float(difference[k.E_FRICTION]),
        pumping=float(difference[k.E_PUMPING]),
        accessories=float(difference[k.E_ACCESSORIES]),
        air_conditioning=float(difference[k.E_AIR_CONDITIONING]),
        starter=-float(difference[k.E_STARTER]),
        clutch=float(difference[k.E_CLUTCH]),
        gearbox=float(difference[k.E_GEARBOX]),
        wheel_slip=float(difference[k.E_WHEEL_SLIP]),
        drag=float(difference[k.E_DRAG]),
        rolling=float(difference[k.E_ROLLING]),
        cornering=float(difference[k.E_CORNERING]),
        brake_drag=float(difference[k.E_BRAKE_DRAG]),
        brakes=float(difference[k.E_BRAKES]),
        climb=float(difference[k.E_CLIMB]),
        kinetic=float(car_kinetic(after) - car_kinetic(before)),
        engine_kinetic=float(engine_kinetic(after) - engine_kinetic(before)),
        wheel_work=float(difference[k.E_THRUST]),
    )


def cycle_names() -> list[str]:
    """Names of the cycles that come with the package."""
    folder = resources.files("vehicle_model") / "cycles"
    return sorted(entry.name.removesuffix(".csv") for entry in folder.iterdir() if entry.name.endswith(".csv"))


def read_cycle(name_or_path: str | Path) -> Cycle:
    """Return the shipped cycle of that name (any case; WLTC is 3b) or that in a CSV file.

    Columns, by header: time `cycSecs` or `time_s` (s), speed `cycMps`, `mps` or `speed_mps` (m/s), and optionally grade
    `cycGrade` or `grade` (rise over run). Raises `BadInput` naming file, row or column, and what was expected.
    """
    name = str(name_or_path).lower()
    name = ALIASES.get(name, name)
    shipped = resources.files("vehicle_model") / "cycles" / f"{name}.csv"
    if Path(name).suffix == "" and shipped.is_file():
        text, source = shipped.read_text(encoding="utf-8-sig"), f"{name}.csv"
    else:
        source = str(name_or_path)
        try:
            text = Path(name_or_path).read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            known = ", ".join(cycle_names())
            raise BadInput(source, "", f"is neither a shipped cycle ({known}) nor a readable text file") from error
    rows = [line.split(",") for line in text.splitlines() if line.strip()]
    header = [word.strip() for word in rows[0]] if rows else []

    def column(*names: str) -> Array | None:
        for wanted in names:
            if wanted in header:
                at = header.index(wanted)
                values = []
                for number, row in enumerate(rows[1:], start=2):
                    try:
                        values.append(float(row[at]))
                    except (IndexError, ValueError):
                        raise BadInput(source, f"line {number}", f"a number in column {wanted}") from None
                return np.array(values)
        return None

    time = column("cycSecs", "time_s")
    speed = column("cycMps", "mps", "speed_mps")
    grade = column("cycGrade", "grade")
    if time is None or speed is None:
        raise BadInput(source, "line 1", f"columns cycSecs, cycMps (or time_s, mps), found {', '.join(header)[:80]!r}")
    if len(time) < 3 or not np.all(np.isfinite(time)) or not np.all(np.diff(time) > 0.0):
        raise BadInput(source, "time", "at least 3 rising times")
    if not np.all((speed >= 0.0) & (speed < 90.0)):
        bad = int(np.argmin((speed >= 0.0) & (speed < 90.0)))
        raise BadInput(source, f"line {bad + 2}", f"a speed of 0 to 90 m/s, found {speed[bad]:g}")
    if grade is None:
        grade = np.zeros_like(time)
    elif not np.all(np.abs(grade) <= 0.4):
        bad = int(np.argmax(~(np.abs(grade) <= 0.4)))
        raise BadInput(source, f"line {bad + 2}", f"a grade of -0.4 to 0.4, found {grade[bad]:g}")
    time = time - time[0]
    spacing = float(np.median(np.diff(time)))
    even = np.arange(round(time[-1] / spacing) + 1) * spacing
    return Cycle(Path(name).stem, even, np.interp(even, time, speed), np.interp(even, time, grade))


def run_cycle(
    car: Car, cycle: Cycle | str | Path, settings: Mapping[str, float] | None = None, step: float = 0.01
) -> tuple[Trip, EnergyAccount]:
    """Drive `car` over `cycle` under the effects' `settings`; return the trip (every `step` s) and its energy account.

    The trace's driver has no limit of nerves: where the car is too weak he keeps his foot down and catches up.
    """
    if not isinstance(cycle, Cycle):
        cycle = read_cycle(cycle)
    parameters = plant_parameters(car, settings)
    pitch = np.arctan(cycle.grade)
    zero = np.zeros_like(pitch)
    trace = np.column_stack([cycle.speed, zero, pitch, zero, zero, zero])
    start, end, record = _follow(parameters, trace, cycle.time[1], True, step, 1)
    route = _flat_route(record, np.interp(record[:, 0], cycle.time, pitch))
    return build_trip(record, step, route), energy_account(parameters, start, end)


def replay(
    parameters: Array,
    time: ArrayLike,
    speed: ArrayLike,
    gear: ArrayLike | None = None,
    pitch: ArrayLike | None = None,
    straightness: ArrayLike | None = None,
    heading: ArrayLike | None = None,
    vertical_straightness: ArrayLike | None = None,
    step: float = 0.01,
    every: int = 10,
) -> dict[str, Array]:
    """Drive the plant of `parameters` along a measured trace and return what it would have done.

    `time` (n,) s rising, `speed` (n,) m/s, `gear` (n,) held between samples (None: own shift schedule), road angles
    (n,) rad and straightness (n,) rad/m at the same times; absent ones are zero. Uneven times are resampled at their
    median spacing. Returns the channels of `kernel.RECORD` (m,), every `every`-th `step`, with `time` on the trace's
    clock. The trace's own gear while the clutch is open may be anything: the plant declutches at standstill by itself.
    """
    t = np.asarray(time, float)
    given = [speed, 0.0 if gear is None else gear, pitch, straightness, vertical_straightness, heading]
    columns = [np.broadcast_to(np.asarray(0.0 if part is None else part, float), t.shape) for part in given]
    spacing = float(np.median(np.diff(t)))
    even = np.arange(int((t[-1] - t[0]) / spacing + 1e-6) + 1) * spacing
    if len(even) == len(t) and np.allclose(even, t - t[0], atol=1e-6 * spacing):
        trace = np.column_stack(columns)
    else:
        trace = np.column_stack([np.interp(even, t - t[0], column) for column in columns])
        held = np.clip(np.searchsorted(t - t[0], even + 1e-9, side="right") - 1, 0, len(t) - 1)
        trace[:, 1] = columns[1][held]
    _, _, record = _follow(np.asarray(parameters), trace, spacing, gear is None, step, every)
    channels = {name: record[:, n].copy() for n, name in enumerate(k.RECORD)}
    channels["time"] += t[0]
    return channels


def _follow(
    parameters: Array, trace: Array, spacing: float, own_gears: bool, step: float, every: int
) -> tuple[Array, Array, Array]:
    """State before, state after, record with the start as its first row."""
    trace = np.ascontiguousarray(trace, dtype=np.float64)
    state = np.zeros(k.STATES)
    first = 0.0 if own_gears or trace[0, 0] < 0.3 else float(trace[0, 1])
    if own_gears and trace[0, 0] >= 0.3:
        ratios = parameters[k.P_RATIO + 1 : k.P_RATIO + 1 + int(parameters[k.P_GEARS])]
        wheel = trace[0, 0] / parameters[k.P_RADIUS]
        first = 1.0 + float(np.argmin(np.abs(np.log(ratios * wheel / (0.35 * parameters[k.P_REDLINE])))))
    k.initial_state(parameters, state, float(trace[0, 0]), first)
    start = state.copy()
    steps = round((len(trace) - 1) * spacing / step)
    record = np.empty((steps // every + 1, k.COLUMNS))
    k.write_row(state, record[0])
    rows = k.follow(parameters, state, trace, spacing, 1 if own_gears else 0, steps, step, every, record[1:])
    return start, state, record[: rows + 1]


def _flat_route(record: Array, pitch: Array) -> Route:
    """A straight road north with the pitch that the car met, for the trip's road channels."""
    distance = record[:, 1]
    s = np.linspace(0.0, max(float(distance[-1]), 1.0), max(int(distance[-1]) + 1, 2))
    at = np.interp(s, distance, pitch)
    climb = np.concatenate([[0.0], np.cumsum(0.5 * (np.sin(at[1:]) + np.sin(at[:-1])) * np.diff(s))])
    zero = np.zeros_like(s)
    return Route(
        s=s,
        north=s,
        east=zero,
        altitude=300.0 + climb,
        heading=zero,
        pitch=at,
        straightness=zero,
        vertical_straightness=np.gradient(at, s),
        speed_limit=np.full_like(s, 50.0),
        sky=np.full(s.shape, OPEN_SKY, dtype=np.int8),
        origin=(49.6, 6.1, 300.0),
    )
