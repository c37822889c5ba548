"""A mean-value model of a turbocharged SI engine with low-pressure EGR: what seed 003's observers are designed on.

The paper's 20-state model is in a supplement that nobody here has. This one follows Eriksson and Nielsen (2014), mean
value engine modelling: orifices (isentropic nozzle), the ellipse compressor, the k sqrt(1 - Pi^K) turbine,
speed-density cylinders, isothermal volumes, first-order actuators and sensors. Parameters were fixed before the first
selection: sizes of a two-litre engine, the fixed areas and the turbine such that boost there is 1.6 bar.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from observer.selection.h2 import LinearSystem

Array = NDArray[np.float64]
STATES = (
    "boost_pressure", "intake_pressure", "exhaust_pressure", "inlet_pressure", "tail_pressure", "cooler_pressure",
    "turbo_speed",
    "inlet_burnt", "boost_burnt", "intake_burnt", "exhaust_burnt", "tail_burnt",
    "exhaust_temperature",
    "throttle", "wastegate", "egr_valve",
    "maf_air", "maf_high", "maf", "egr_dp",
)  # fmt: skip
"""Pa; rad/s; mass fractions; K; actuators: rad, m, rad; sensors: kg/s and, for egr_dp, Pa. "inlet" is before the
compressor, where air and EGR meet; "tail" behind the turbine."""
SENSORS = ("EGR dp", "MAFa", "MAFh", "MAF")
INTAKE_BURNT = STATES.index("intake_burnt")


class Inputs(NamedTuple):
    """Commands and what is known of the engine: rad, m, rad, rad/s."""

    throttle: float
    wastegate: float
    egr_valve: float
    engine_speed: float


NOMINAL = Inputs(np.radians(60.0), 11.6e-3, np.radians(10.0), 3200.0 * 2.0 * np.pi / 60.0)
"""The paper's operating point: 3200 rpm, throttle 60 deg, waste-gate 11.6 mm, EGR valve 10 deg."""
AMBIENT, T_AMBIENT, R, CP, CP_EXHAUST = 101_325.0, 298.0, 287.0, 1005.0, 1150.0
T_BOOST, T_INTAKE, T_TAIL, T_COOLED = 318.0, 320.0, 850.0, 380.0
VOLUMES = (6e-3, 2.5e-3, 2.0e-3, 3e-3, 10e-3, 1.5e-3)
"""m3: boost, intake, exhaust, inlet, tail, cooler."""
DISPLACEMENT, VOLUMETRIC, STOICHIOMETRIC = 2.0e-3, 0.88, 14.7
FILTER, COOLER, TAIL = 1.0e-3, 2.2e-4, 1.3e-3
"""m2, effective."""
COMPRESSOR_RADIUS, HEAD, CHOKE = 0.026, 1.45, 0.15
"""m, -, kg/s at 15,000 rad/s."""
COMPRESSOR_EFFICIENCY, TURBINE_EFFICIENCY, TURBO_INERTIA = 0.72, 0.68, 2.5e-5
TURBINE_FLOW, TURBINE_EXPONENT = 2.8e-5, 1.3
"""kg sqrt(K) / (s Pa), -."""
HEATING = 880.0
"""K from intake to exhaust."""
TIMES = (0.05, 0.1, 0.1)
"""s: throttle, waste-gate, EGR valve."""
SENSOR_TIMES = (0.03, 0.1, 0.06, 0.02)
"""s: MAFa, MAFh, MAF, EGR dp; the one behind the compressor is slower than that before it, as in the paper."""
ACCURACY = {"EGR dp": 0.02, "MAFa": 0.03, "MAFh": 0.03, "MAF": 0.03}
"""Relative to the largest deviation from the operating point (3.3)."""
START = np.array([
    1.5e5, 1.4e5, 1.8e5, 0.99e5, 1.06e5, 1.055e5, 9000.0, 0.05, 0.05, 0.05, 0.99, 0.99, 1180.0,
    *NOMINAL[:3], 0.06, 0.06, 0.06, 5e3,
])  # fmt: skip


def butterfly(diameter: float, angle: float) -> float:
    """Open area of a butterfly valve, m2."""
    return 0.25 * np.pi * diameter**2 * (1.0 - np.cos(angle)) + 1e-7


def orifice(area: float, upstream: float, temperature: float, downstream: float) -> float:
    """Isentropic nozzle flow, kg/s (Eriksson and Nielsen, 7.10), backwards where pressures are."""
    if downstream > upstream:
        return -orifice(area, downstream, temperature, upstream)
    g = 1.4
    pr = max(downstream / upstream, (2.0 / (g + 1.0)) ** (g / (g - 1.0)))
    psi = np.sqrt(2.0 * g / (g - 1.0) * max(pr ** (2.0 / g) - pr ** ((g + 1.0) / g), 0.0))
    return area * upstream / np.sqrt(R * temperature) * psi


def dynamics(x: Array, u: Inputs) -> Array:
    """dx/dt (20,) of the states `STATES`."""
    boost, intake, exhaust, inlet, tail, cooler, turbo, f_inlet, f_boost, f_intake, f_ex, f_tail, t_ex = x[:13]
    throttle, wastegate, valve = x[13:16]
    air = orifice(FILTER, AMBIENT, T_AMBIENT, inlet)
    egr = orifice(butterfly(0.05, valve), cooler, T_COOLED, inlet)
    through_cooler = orifice(COOLER, tail, T_TAIL, cooler)
    tip = turbo * COMPRESSOR_RADIUS
    highest = (tip**2 * HEAD / (2.0 * CP * T_AMBIENT) + 1.0) ** 3.5
    ratio = boost / inlet
    compressor = CHOKE * turbo / 15_000.0 * np.sqrt(max(1.0 - (ratio / highest) ** 2, 1e-6))
    entering = orifice(butterfly(0.05, throttle), boost, T_BOOST, intake)
    charge = VOLUMETRIC * intake * DISPLACEMENT * u.engine_speed / (4.0 * np.pi) / (R * T_INTAKE)
    burnt = charge * (1.0 + (1.0 - f_intake) / STOICHIOMETRIC)
    expansion = tail / exhaust
    turbine = TURBINE_FLOW * exhaust / np.sqrt(t_ex) * np.sqrt(max(1.0 - expansion**TURBINE_EXPONENT, 1e-6))
    bypass = orifice(0.25 * np.pi * wastegate**2, exhaust, t_ex, tail)
    leaving = orifice(TAIL, tail, T_TAIL, AMBIENT)
    power = turbine * CP_EXHAUST * t_ex * TURBINE_EFFICIENCY * (1.0 - expansion**0.25)
    power -= compressor * CP * T_AMBIENT / COMPRESSOR_EFFICIENCY * (ratio ** (1.0 / 3.5) - 1.0)
    k = [R * t / v for t, v in zip((T_BOOST, T_INTAKE, t_ex, T_AMBIENT, T_TAIL, T_COOLED), VOLUMES, strict=True)]
    return np.array([
        k[0] * (compressor - entering),
        k[1] * (entering - charge),
        k[2] * (burnt - turbine - bypass),
        k[3] * (air + egr - compressor),
        k[4] * (turbine + bypass - leaving - through_cooler),
        k[5] * (through_cooler - egr),
        power / (TURBO_INERTIA * turbo),
        k[3] / inlet * (egr * (f_tail - f_inlet) - air * f_inlet),
        k[0] / boost * compressor * (f_inlet - f_boost),
        k[1] / intake * entering * (f_boost - f_intake),
        k[2] / exhaust * burnt * (1.0 - f_ex),
        k[4] / tail * (turbine + bypass) * (f_ex - f_tail),
        (T_INTAKE + HEATING - t_ex) / 0.3,
        *((command - now) / time for command, now, time in zip(u[:3], x[13:16], TIMES, strict=True)),
        (air - x[16]) / SENSOR_TIMES[0],
        (compressor - x[17]) / SENSOR_TIMES[1],
        (compressor - x[18]) / SENSOR_TIMES[2],
        (cooler - inlet - x[19]) / SENSOR_TIMES[3],
    ])  # fmt: skip


SCALE = np.array([1e4] * 6 + [500.0] + [0.01] * 5 + [50.0, 0.1, 1e-3, 0.02, 5e-3, 5e-3, 5e-3, 1e3])
"""Usual size of a deviation of each state."""


def equilibrium(u: Inputs = NOMINAL) -> Array:
    """States (20,) at rest under `u`. Raises ValueError where there are none."""
    run = solve_ivp(lambda _, x: dynamics(x, u), (0.0, 120.0), START, method="BDF", rtol=1e-6, atol=1e-8 * SCALE)
    found = least_squares(lambda z: dynamics(run.y[:, -1] + SCALE * z, u) / SCALE, np.zeros(20), xtol=1e-14, ftol=1e-14)
    if not run.success or np.abs(found.fun).max() > 1e-3:
        raise ValueError(f"engine: expected an equilibrium, found rates of {np.abs(found.fun).max():.1e}")
    return run.y[:, -1] + SCALE * found.x


def linearised(x: Array, u: Inputs = NOMINAL) -> tuple[Array, Array]:
    """A (20, 20) and B (20, 4), central differences, in units of `SCALE` per unit of u."""
    a, b = np.empty((20, 20)), np.empty((20, 4))
    for j in range(20):
        h = np.zeros(20)
        h[j] = 1e-4 * SCALE[j]
        a[:, j] = (dynamics(x + h, u) - dynamics(x - h, u)) / 2e-4 / SCALE
    for j in range(4):
        step = 1e-4 * max(abs(u[j]), 1e-3)
        up, down = list(u), list(u)
        up[j], down[j] = u[j] + step, u[j] - step
        b[:, j] = (dynamics(x, Inputs(*up)) - dynamics(x, Inputs(*down))) / (2.0 * step) / SCALE
    return a, b


def engine_system(a: Array, sigma: Array, largest: dict[str, float]) -> LinearSystem:
    """The scaled system whose z is the intake's burnt fraction in units of 0.01.

    `sigma` (20,): deviations of the process noise in units of `SCALE` (`process_noise`); `largest`: each sensor's
    largest deviation from the operating point, SI; noise is that times `ACCURACY` (29).
    """
    order = [STATES.index(name) for name in ("egr_dp", "maf_air", "maf_high", "maf")]
    deviation = [largest[name] * ACCURACY[name] / SCALE[i] for name, i in zip(SENSORS, order, strict=True)]
    return LinearSystem.one_row_each(
        a, np.diag(sigma), np.eye(20)[order], np.array(deviation), np.eye(20)[[INTAKE_BURNT]], SENSORS
    )
