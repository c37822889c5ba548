"""A nominal car from the few numbers that are public of any car, so that its real log can be diagnosed."""

from collections.abc import Sequence
from dataclasses import replace
from math import pi

import numpy as np

from vehicle_model.car.limits import check_car
from vehicle_model.car.parameters import Car, Driveline, Engine, Fuel, Injector

RPM = 2.0 * pi / 60.0
LBF, MPH = 4.4482216, 0.44704


def epa_road_load(a: float, b: float, c: float) -> tuple[float, float, float]:
    """Target coefficients of the EPA's test-car list (lbf, lbf/mph, lbf/mph2) in N, N s/m, N s2/m2."""
    return a * LBF, b * LBF / MPH, c * LBF / MPH**2


def nominal_car(
    name: str,
    mass: float,
    road_load: tuple[float, float, float],
    displacement: float,
    power: float,
    gears: int | Sequence[float],
    *,
    power_speed: float = 6000.0 * RPM,
    torque: float | None = None,
    torque_speed: float | None = None,
    compression: float = 10.5,
    cylinders: int = 4,
    turbocharged: bool = False,
    idle_speed: float = 750.0 * RPM,
    redline_speed: float | None = None,
    wheel_radius: float = 0.32,
    top_speed_per_rad: float | None = None,
    fuel: Fuel | None = None,
    driver_mass: float = 0.0,
) -> Car:
    """Return a plausible car of `mass` (kg, as tested) with `road_load` (A, B, C: force = A + B v + C v^2, N and m/s),
    `displacement` (m3), `power` (W) and `gears`: the overall ratios, engine to wheels, or just their number.

    Coefficients: C_rr and C_d A are the least-squares fit to A + B v + C v^2 over 3 to 35 m/s, after what the gearbox
    drags in neutral is taken off (a coast-down contains it, the plant adds it). With only a number of gears the steps
    narrow from first to top, and `top_speed_per_rad` (m per rad of the engine in top gear; default 0.13 m) places them.
    Torque (N m) defaults to the mean pressure of its kind, 12 bar or 20 turbocharged. Raises `BadInput` where the
    result is not plausible.
    """
    a, b, c = road_load
    driveline = Driveline()
    density, gravity = 1.2, 9.805
    v = np.linspace(3.0, 35.0, 65)
    dragged = 0.5 * driveline.drag_torque * (1.0 + v / wheel_radius / 60.0) / wheel_radius
    shape = np.column_stack([mass * gravity * np.ones_like(v), 0.5 * density * v**2])
    (rolling, drag_area), *_ = np.linalg.lstsq(shape, a + b * v + c * v**2 - dragged, rcond=None)
    largest = torque if torque is not None else (20e5 if turbocharged else 12e5) * displacement / (4.0 * pi)
    largest = max(largest, 1.01 * power / power_speed)
    at = torque_speed if torque_speed is not None else (0.5 if turbocharged else 0.68) * power_speed
    top = wheel_radius / (top_speed_per_rad or 0.13)
    ratios = gear_ladder(gears, top) if isinstance(gears, int) else tuple(float(ratio) for ratio in gears)
    area = 0.83 * 1.8 * 1.45
    car = Car(
        name=name,
        wet_mass=mass - driver_mass,
        drag_coefficient=float(drag_area) / area,
        frontal_area=area,
        rolling_resistance=float(rolling),
        wheel_radius=wheel_radius,
        wheel_inertia=0.9 * (wheel_radius / 0.31) ** 2,
        gear_ratios=ratios,
        metres_per_tick=2.0 * pi * wheel_radius / 8.0,
        engine=Engine(
            displacement=displacement,
            cylinders=cylinders,
            compression=compression,
            max_power=power,
            max_power_speed=power_speed,
            max_torque=largest,
            max_torque_speed=at,
            idle_speed=idle_speed,
            redline_speed=redline_speed or 1.08 * power_speed,
            inertia=0.07 * displacement / 1e-3,
            turbocharged=turbocharged,
        ),
        injector=Injector(flow=0.0, lag=-0.0004, pattern="sequential"),
        fuel=fuel or Fuel(),
        driver_mass=driver_mass,
        driveline=driveline,
        labels={"wheels.tire": "205/55 R16"},
    )
    # injectors for full load at an efficiency of 0.26, a tenth to spare
    flow = 1.1 * power / 0.26 / (car.fuel.density * car.fuel.heating_value)
    car = replace(car, injector=replace(car.injector, flow=flow))
    check_car(car, name)
    return car


def gear_ladder(gears: int, top: float) -> tuple[float, ...]:
    """Return `gears` overall ratios that end at `top` and spread as cars' do: 4 to 1 with five, 8 to 1 with eight."""
    spread = {1: 1.0, 2: 1.9, 3: 2.6, 4: 3.4, 5: 4.1, 6: 5.0, 7: 6.3}.get(gears, 7.6)
    place = np.linspace(1.0, 0.0, gears) if gears > 1 else np.array([0.0])
    return tuple(float(top * spread ** (0.75 * u + 0.25 * u * u)) for u in place)
