"""The controller's car of seed 004, chapter 4: speed alone, phi = 1/efficiency as a polynomial, a gearbox or a CVT.

    dv/dt = (F - R(v)) / M_a,   F = T N (gears) or w T / v (CVT),   R = rho C_d A v^2 / 2 + M C_rr g         (4.1)
    P_in = w T phi(w, T),   phi = a0 + a1 w + a2 T + a3 w T + a4 w^2 + a5 T^2                        (table 4.1)

Control bounds are not printed there; CLI.md ("At the door") fixes 850 - 6000 rpm and 5 - 100 N m, no neutral, no shift
time. C_rr is table 3.1's 0.010, not the car file's 0.0125 (ERRATA).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_model.car.parameters import Car

RPM = 2.0 * np.pi / 60.0
PHI = (9.4360, -0.018136, -0.068797, 3.7201e-06, 2.1965e-05, 3.6204e-04)
"""Table 4.1, w in rad/s, T in N m."""


@dataclass(frozen=True)
class ControllerModel:
    """Parameters of (4.1) and of the control set; SI units. `ratios` empty stands for a CVT."""

    mass: float = 920.0
    accelerated_mass: float = 948.0
    gravity: float = 9.805
    rolling_resistance: float = 0.010
    drag_area: float = 0.39 * 1.93
    air_density: float = 1.2
    ratios: tuple[float, ...] = tuple(r / 0.2954 for r in (13.25, 9.604, 7.37, 5.796, 4.208, 3.23))
    """N = engine speed / speed, 1/m."""
    phi: tuple[float, ...] = PHI
    engine_speed: tuple[float, float] = (850.0 * RPM, 6000.0 * RPM)
    torque: tuple[float, float] = (5.0, 100.0)
    soft_limit: float = np.inf
    """rad/s: engine speed beyond which `penalty` is charged, in gears (B.2.5.3)."""
    penalty: float = 0.0
    """Weight of (w / soft_limit - 1)^2 in the running cost, W."""

    @property
    def cvt(self) -> bool:
        """Whether engine speed is free of road speed."""
        return not self.ratios

    def road_load(self, speed):
        """R(v), N."""
        return 0.5 * self.air_density * self.drag_area * speed**2 + self.mass * self.rolling_resistance * self.gravity

    def inverse_efficiency(self, engine_speed, torque):
        """phi(w, T)."""
        a0, a1, a2, a3, a4, a5 = self.phi
        w, t = engine_speed, torque
        return a0 + a1 * w + a2 * t + a3 * w * t + a4 * w * w + a5 * t * t

    def fuel_power(self, engine_speed, torque):
        """P_in = w T phi, W."""
        return engine_speed * torque * self.inverse_efficiency(engine_speed, torque)

    def running_cost(self, speed, ratio, torque):
        """L = P_in in a gear of `ratio` 1/m, with the penalty on engine speed if there is one, W."""
        fuel = self.fuel_power(ratio * speed, torque)
        if self.penalty == 0.0:
            return fuel
        excess = ratio * speed / self.soft_limit - 1.0
        return fuel + self.penalty * (0.5 * (excess + (excess**2) ** 0.5)) ** 2

    def acceleration(self, speed, engine_speed, torque):
        """dv/dt, m/s2; the same for gears (w = N v) and CVT."""
        return (engine_speed * torque / speed - self.road_load(speed)) / self.accelerated_mass

    def kernel_parameters(self) -> NDArray[np.float64]:
        """Flat, for the kernels: M_a, M C_rr g, rho C_d A / 2, phi (6), bounds of w and T, penalty, soft limit."""
        return np.array(
            [
                self.accelerated_mass,
                self.mass * self.rolling_resistance * self.gravity,
                0.5 * self.air_density * self.drag_area,
                *self.phi,
                *self.engine_speed,
                *self.torque,
                self.penalty,
                self.soft_limit,
            ]
        )


THESIS = ControllerModel()
"""The six-speed car of chapter 4."""
THESIS_CVT = ControllerModel(ratios=())
"""The same with a continuously variable transmission."""


def model_of(car: Car, *, cvt: bool = False) -> ControllerModel:
    """The controller model of another car: its masses, drag and gears, and table 4.1 stretched onto its engine.

    Engine speed and torque are scaled by the ratio of the speeds of maximum power and of the maximum torques to the
    Smart's (5250 rpm, 110 N m): the same efficiency at the same relative load. The Smart's
    own file keeps its C_rr of 0.0125: not to be mixed with the thesis' cases in one figure.
    """
    stretch_w = car.engine.max_power_speed / (5250.0 * RPM)
    stretch_t = car.engine.max_torque / 110.0
    a0, a1, a2, a3, a4, a5 = PHI
    phi = (a0, a1 / stretch_w, a2 / stretch_t, a3 / (stretch_w * stretch_t), a4 / stretch_w**2, a5 / stretch_t**2)
    return ControllerModel(
        mass=car.mass,
        accelerated_mass=car.accelerated_mass,
        gravity=car.gravity,
        rolling_resistance=car.rolling_resistance,
        drag_area=car.drag_area,
        air_density=car.air_density,
        ratios=() if cvt else tuple(r / car.wheel_radius for r in car.gear_ratios),
        phi=phi,
        engine_speed=(car.engine.idle_speed, car.engine.redline_speed),
        torque=(5.0 * stretch_t, 100.0 * stretch_t),
    )
