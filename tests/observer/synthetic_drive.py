"""A made-up drive as an Estimate: analytic engine, smooth random torque, six gears, errors as a smoother's."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from observer.estimate import STATES, Estimate
from vehicle_model.car.parameters import Car, Engine, Injector

RPM = np.pi / 30.0
CAR = Car(
    name="made up",
    wet_mass=815.0,
    drag_coefficient=0.38,
    frontal_area=1.9,
    rolling_resistance=0.0125,
    wheel_radius=0.281,
    wheel_inertia=0.5,
    gear_ratios=(14.2, 10.3, 7.4, 5.3, 3.9, 2.9),
    metres_per_tick=0.27,
    engine=Engine(
        displacement=698e-6, cylinders=3, compression=9.0, max_power=60e3, max_power_speed=5250 * RPM, max_torque=110.0,
        max_torque_speed=3000 * RPM, idle_speed=850 * RPM, redline_speed=6200 * RPM, inertia=0.1, turbocharged=True,
    ),
    injector=Injector(flow=9e-6, lag=-4e-4, pattern="sequential"),
)  # fmt: skip
IDLE_POWER = 6500.0
OVERRUN = -9.0
FULL_LOAD = 0.95
"""Of the declared maximum torque, flat over engine speed."""


def true_power(omega, torque):
    """P_in, W: a Willans engine with a bump that no quadratic holds."""
    fuel_torque = 14.0 + 8.0 * (omega / 600.0) ** 2 + (2.6 + 0.15 * omega / 600.0) * torque + 2.2e-3 * torque**2
    bump = 1.0 - 0.02 * np.exp(-(((omega - 320.0) / 60.0) ** 2) - ((torque - 60.0) / 15.0) ** 2)
    return omega * fuel_torque * bump


def true_efficiency(omega, torque):
    return omega * torque / true_power(omega, torque)


def drive(seed, seconds=1200.0, thrust_noise=15.0, fuel_noise=0.004, trip_error=0.0, offset=0.0):
    """One Estimate; the first 20 s stand at idle. `thrust_noise` N over 0.3 s, `trip_error` relative in thrust,
    `offset` N."""
    rng = np.random.default_rng(seed)
    step, n = 0.1, int(seconds / 0.1)
    wish = gaussian_filter1d(rng.normal(size=n), 40) * np.sqrt(40 * 3.54) * 40.0 + 20.0
    ratios = np.array(CAR.gear_ratios) / CAR.wheel_radius
    limit = FULL_LOAD * CAR.engine.max_torque
    mass, v, gear, shifting = CAR.accelerated_mass, 0.0, 1, 0
    rows = np.zeros((n, len(STATES)))
    energy = 0.0
    for k in range(n):
        standing = k < 200
        omega = max(ratios[gear - 1] * v, CAR.engine.idle_speed)
        load = CAR.rolling_resistance * CAR.mass * 9.805 + 0.6 * CAR.drag_area * v * v
        pull = min(max(wish[k] + 0.02 * load, -1.0) * (1.0 if v < 36 else -1.0), limit)
        locked = shifting == 0 and not standing and ratios[gear - 1] * v > CAR.engine.idle_speed
        if standing:
            net, power, torque, omega = 0.0, IDLE_POWER, 0.0, CAR.engine.idle_speed
        elif shifting:
            net, power, torque = -load, IDLE_POWER, 0.0
            omega *= 1.0 + 0.03 * shifting
            shifting -= 1
        elif pull <= 0.0 and v > 8.0:
            torque, power = OVERRUN, 0.0
            net = torque * ratios[gear - 1] - load
        else:
            torque = max(pull, 5.0) if v > 8.0 else 60.0
            power = true_power(omega, torque)
            net = torque * ratios[gear - 1] - load
        inertia = CAR.engine.inertia * ratios[gear - 1] ** 2 if locked else 0.0
        acceleration = net / (mass + inertia)
        thrust = mass * acceleration + load if not standing else 0.0
        energy += power * step
        values = {"speed": v, "thrust": thrust, "engine_speed": omega, "fuel_power": power, "fuel_energy": energy}
        for name, value in values.items():
            rows[k, STATES.index(name)] = value
        v = max(v + acceleration * step, 0.0)
        if not shifting and not standing:
            up, down = omega > (2300 + 40 * (k // 600 % 50)) * RPM and gear < 6, omega < 1200 * RPM and gear > 1
            if up or down:
                gear, shifting = gear + (1 if up else -1), 6
    noise = gaussian_filter1d(rng.normal(size=n), 3.0)
    noise *= thrust_noise / noise.std()
    noisy = rows.copy()
    thrust, fuel = STATES.index("thrust"), STATES.index("fuel_power")
    noisy[:, thrust] = rows[:, thrust] * (1.0 + trip_error) + offset + noise
    noisy[:, fuel] *= 1.0 + fuel_noise * rng.normal(size=n)
    variance = np.full((n, len(STATES)), 1e-6)
    variance[:, thrust] = thrust_noise**2
    variance[:, fuel] = (fuel_noise * rows[:, fuel]) ** 2 + 1.0
    return Estimate(
        time=np.arange(n) * step, state=noisy, variance=variance, smoothed=noisy, smoothed_variance=variance,
        records=np.empty(0), origin=(49.6, 6.1, 300.0), learnt={},
    )  # fmt: skip
