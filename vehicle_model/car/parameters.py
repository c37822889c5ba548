"""The nominal car: what a car file declares and what every room may believe of it."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Engine:
    """Declared engine data (C.1.2 `engine`)."""

    displacement: float
    """m3."""
    cylinders: int
    compression: float
    max_power: float
    """W."""
    max_power_speed: float
    """rad/s."""
    max_torque: float
    """N m."""
    max_torque_speed: float
    """rad/s."""
    idle_speed: float
    """rad/s."""
    redline_speed: float
    """rad/s."""
    inertia: float
    """J_e, kg m2: all of the drivetrain but the wheels, lumped at the engine."""
    turbocharged: bool
    friction: float = 1.0
    """Rubbing and auxiliaries relative to a textbook engine of this size (plant only)."""
    throttling: float = 1.0
    """Share of the throttle's pumping that the valve timing leaves; late-closing (Atkinson) intake 0.6 (plant only)."""
    kind: str = ""
    """Free text of the file's `type`."""


@dataclass(frozen=True)
class Injector:
    """Declared injector data (C.1.2 `inj`)."""

    flow: float
    """m3/s of fuel, all injectors open (`fuelPerSecond`)."""
    lag: float
    """s; opening = electrical width + lag (negative)."""
    pattern: str
    """sequential, grouped:N or simultaneous: which rotation a pulse stands for (seed 004, 2.3.4.1)."""


@dataclass(frozen=True)
class Fuel:
    """Petrol unless the file says otherwise."""

    density: float = 745.0
    """kg/m3."""
    heating_value: float = 43.0e6
    """J/kg, lower."""


@dataclass(frozen=True)
class Mounting:
    """Accelerometer calibration: body = scale Rz(yaw) Ry(pitch) Rx(roll) raw, rad (CLI.md, "At the door")."""

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True)
class Tolerances:
    """How far the real car may lie from its file before that counts as a gap (limits; relative but for wind, m/s)."""

    mass: float = 0.02
    rolling_resistance: float = 0.03
    drag_area: float = 0.02
    fuel: float = 0.005
    air_density: float = 0.005
    wheel_radius: float = 0.001
    wind: float = 0.4


@dataclass(frozen=True)
class Driveline:
    """What C.1.2 does not say of the driveline and the rest; own element of the car file, with defaults."""

    loss: float = 0.04
    """Share of the torque that each gear loses; the direct one less."""
    drag_torque: float = 6.0
    """N m at the axle, lost at any load."""
    shift_time: float = 0.35
    """s without torque."""
    launch_speed: float = 0.0
    """rad/s of the engine when it launches at full demand; 0: from the engine's own data."""
    continuously_variable: bool = False
    """The first and last gear are the ends of a variator's range."""
    boost_time: float = -1.0
    """s, lag of the torque that the charger gives; negative: 0.5 with a turbocharger, 0.05 without."""
    schedule_speed: float = 0.0
    """rad/s: on a drive cycle the driver (or the automatic) shifts up only to above it; 0: 2.2 x idle."""
    schedule_reserve: float = 0.9
    """m/s2 of acceleration that he keeps in reserve when he shifts up."""
    electrical_power: float = 350.0
    """W, mean electrical load."""


@dataclass(frozen=True)
class Car:
    """A car as its file declares it. SI units."""

    name: str
    wet_mass: float
    """kg, all fluids, no driver."""
    drag_coefficient: float
    frontal_area: float
    """m2."""
    rolling_resistance: float
    """C_rr."""
    wheel_radius: float
    """r_w, m."""
    wheel_inertia: float
    """kg m2, one wheel with its tyre."""
    gear_ratios: tuple[float, ...]
    """Engine speed / wheel speed, first gear first."""
    metres_per_tick: float
    engine: Engine
    injector: Injector
    fuel: Fuel = field(default_factory=Fuel)
    mounting: Mounting = field(default_factory=Mounting)
    tolerances: Tolerances = field(default_factory=Tolerances)
    driver_mass: float = 76.0
    air_density: float = 1.2
    """kg/m3, table 3.1."""
    gravity: float = 9.805
    """m/s2, table 3.1."""
    driveline: Driveline = field(default_factory=Driveline)
    labels: dict[str, str] = field(default_factory=dict)
    """Texts of the file that describe and do not compute: owner, make, model, year, colour, tyre ..."""
    logs: tuple[str, ...] = ()
    """Names of the log files that the car file lists (C.1.2 `file`)."""

    @property
    def mass(self) -> float:
        """M, kg: wet mass plus driver."""
        return self.wet_mass + self.driver_mass

    @property
    def accelerated_mass(self) -> float:
        """M_a = M + 4 J_w / r_w^2, kg: the wheels' inertia, not the engine's (seed 004, 1.2.1.3)."""
        return self.mass + 4.0 * self.wheel_inertia / self.wheel_radius**2

    @property
    def drag_area(self) -> float:
        """C_d A, m2."""
        return self.drag_coefficient * self.frontal_area

    @property
    def injector_power(self) -> float:
        """W of fuel with all injectors open: the energy of a pulse is this times its opening."""
        return self.injector.flow * self.fuel.density * self.fuel.heating_value
