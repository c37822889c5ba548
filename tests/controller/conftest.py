"""A car and a Willans map for the tests here: written from first principles, not taken from the product."""

import numpy as np
import pytest

from observer.efficiency_map import FuelMap
from vehicle_model.car.parameters import Car, Engine, Injector

RPM = 2.0 * np.pi / 60.0


@pytest.fixture(scope="session")
def smart() -> Car:
    """The 2004 Smart Roadster Coupé of appendix C.1.2."""
    return Car(
        name="smart",
        wet_mass=844.0,
        drag_coefficient=0.39,
        frontal_area=1.93,
        rolling_resistance=0.0125,
        wheel_radius=0.2954,
        wheel_inertia=0.62,
        gear_ratios=(13.25, 9.604, 7.37, 5.796, 4.208, 3.23),
        metres_per_tick=0.270184,
        engine=Engine(
            displacement=698e-6,
            cylinders=3,
            compression=9.0,
            max_power=60e3,
            max_power_speed=5250 * RPM,
            max_torque=110.0,
            max_torque_speed=4500 * RPM,
            idle_speed=850 * RPM,
            redline_speed=6000 * RPM,
            inertia=0.061,
            turbocharged=True,
        ),
        injector=Injector(flow=0.008e-3, lag=-0.0004, pattern="sequential"),
    )


@pytest.fixture(scope="session")
def willans() -> FuelMap:
    """P_in = w (T + T_f(w)) / e(w): affine in torque at each engine speed, so that P_in is convex in thrust."""
    speed = np.linspace(800, 6000, 53) * RPM
    torque = np.arange(0.0, 121.0, 2.0)
    friction = 7.0 + 8.0 * (speed / (6000 * RPM)) ** 1.5
    indicated = 0.40 - 0.03 * ((speed - 3000 * RPM) / (3000 * RPM)) ** 2
    power = speed[:, None] * (torque[None, :] + friction[:, None]) / indicated[:, None]
    full = np.interp(speed / RPM, [800, 1500, 2500, 4500, 6000], [45.0, 75.0, 100.0, 108.0, 90.0])
    idle = float(np.interp(850 * RPM, speed, power[:, 0]))
    return FuelMap(speed, torque, power, full, -friction, idle, 850 * RPM)
