"""Cars of the challenge: what the file declares, and what the car truly is inside the declared tolerances."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TOLERANCE = {
    "mass": 0.02, "rolling_resistance": 0.03, "drag_area": 0.02, "fuel": 0.005, "air_density": 0.005,
    "wheel_radius": 0.001, "wind": 0.4,
}  # fmt: skip
"""Limits of CLI.md, "At the door"; m/s for the wind."""

XML = """<?xml version="1.0" encoding="UTF-8" ?>
<ponthy_config>
  <car>
    <owner owner="challenge" />
    <make make="{make}" />
    <model model="{model}" />
    <year year="2004" />
    <color color="grey" />
  </car>
  <engine>
    <type type="{displacement_cc:.0f}cc Inline {cylinders}{charger}" />
    <displacement displacement="{displacement_cc:.0f}cc" />
    <power power="{power:.1f}kW @{power_rpm:.0f}rpm" />
    <torque torque="{torque:.1f}Nm @{torque_rpm:.0f}rpm" />
    <compression comp="{compression}:1" />
    <idle rpm="{idle:.0f}" />
    <inertia lumped="{engine_inertia:.4f}" />
  </engine>
  <wheels>
    <tire summer="{tyre}" />
    <inertia lumped="{wheel_inertia:.3f}" />
  </wheels>
  <accelerometer type="LIS3LV02DL">
    <calibration>
      <roll phi="{roll:.6f}" />
      <pitch theta="{pitch:.6f}" />
      <yaw psi="{yaw:.6f}" />
      <scale scale="{scale:.6f}" />
    </calibration>
  </accelerometer>
  <transmission type="{gears}-spd manual">
    <reverse gear="" />
{gear_lines}
  </transmission>
  <drag>
    <aero Cd="{cd:.4f}" />
    <rolling Crr="{crr:.5f}" />
  </drag>
  <area frontal="{area:.4f}" />
  <mass wet="{wet:.1f}" />
  <inj>
    <calibration fuelPerSecond="{flow:.6f}" />
    <calibration lag="{lag:.6f}" />
    <timing pattern="sequential" />
  </inj>
  <vss>
    <calibration metersPerTick="{tick:.9f}" />
  </vss>
</ponthy_config>
"""
ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth")


@dataclass(frozen=True)
class Car:
    """One drawn car: `declared` as in the file, `true` the constants of `truth.CAR_FIELDS`, `box` of the sensors."""

    declared: dict[str, float]
    true: dict[str, float]
    ratios: NDArray[np.float64]
    box: dict[str, float]
    xml: str


def draw(rng: np.random.Generator) -> Car:
    """Draw a car near one of the two of the thesis: other mass, drag, gearing and engine constants."""
    small = rng.random() < 0.6
    if small:
        ratios = np.array([13.25, 9.604, 7.37, 5.796, 4.208, 3.23])
        d: dict[str, float] = dict(displacement_cc=698.0, cylinders=3, power=60.0, power_rpm=5250.0, torque=110.0,
                 torque_rpm=4500.0, idle=850.0, engine_inertia=0.061, wheel_inertia=0.62, cd=0.39,
                 crr=0.0125, area=1.93, wet=844.0,
                 flow=0.008, lag=-0.0004, tick=0.270183975491887, compression=9,
                 radius=0.2954, stroke=0.067)  # fmt: skip
        words = dict(tyre="205/45 R16", make="Smart", charger=" Turbo", model="Roadster")
    else:
        ratios = np.array([13.1, 7.72, 5.58, 4.36, 3.46])
        d = dict(displacement_cc=1997.0, cylinders=4, power=130.0, power_rpm=7000.0, torque=202.0, torque_rpm=4750.0,
                 idle=850.0, engine_inertia=0.16, wheel_inertia=0.8, cd=0.33, crr=0.0115, area=2.08, wet=1100.0,
                 flow=0.0152, lag=-0.0005, tick=0.29, compression=11,
                 radius=0.298, stroke=0.088)  # fmt: skip
        words = dict(tyre="205/40 R17", make="Peugeot", charger="", model="206RC")
    for name, spread in (("wet", 0.06), ("cd", 0.05), ("crr", 0.08), ("displacement_cc", 0.05), ("torque", 0.05)):
        d[name] *= 1.0 + spread * rng.uniform(-1, 1)
    d["power"] = min(d["power"], 0.93 * d["torque"] * d["power_rpm"] / 9549.3)
    ratios = np.round(ratios * (1.0 + 0.03 * rng.uniform(-1, 1)), 3)
    d |= dict(
        roll=rng.normal(0, 0.03), pitch=rng.normal(0, 0.04), yaw=rng.normal(0, 0.05), scale=1.0 + rng.normal(0, 0.01)
    )
    lines = "\n".join(f'    <{ORDINALS[i]} gear="{g:.3f}" />' for i, g in enumerate(ratios))
    xml = XML.format(**d, **words, gears=len(ratios), gear_lines=lines)

    def inside(name: str) -> float:
        return 1.0 + TOLERANCE[name] * rng.uniform(-1, 1)

    displacement = round(d["displacement_cc"]) * 1e-6
    mass = (round(d["wet"], 1) + 76.0) * inside("mass")
    radius = d["radius"] * inside("wheel_radius")
    boosted = 1.35 if small else 1.0
    true = dict(
        mass=mass, wheel_inertia_mass=4 * d["wheel_inertia"] / radius**2, c_rr=round(d["crr"],
            5) * inside("rolling_resistance"),
        cd_a=round(d["cd"], 4) * round(d["area"], 4) * inside("drag_area"), rho=1.2 * inside("air_density"), g=9.805,
        radius=radius, displacement=displacement, stroke=d["stroke"], engine_inertia=d["engine_inertia"],
        f0=rng.uniform(0.65, 0.95) * 1e5, f1=rng.uniform(0.03, 0.06) * 1e5, f2=rng.uniform(0.0010, 0.0028) * 1e5,
        p0=rng.uniform(0.35, 0.6) * 1e5, p1=rng.uniform(0.9, 1.6), eta0=rng.uniform(0.355, 0.405),
        eta_n=rng.uniform(0.015, 0.045), n0=rng.uniform(230, 330), eta_l=rng.uniform(0.5, 2.2),
        t_max=round(d["torque"]) * boosted / 1.35 * rng.uniform(0.98, 1.06), n_peak=d["torque_rpm"] / 9.549 * 0.85,
        t_flat=rng.uniform(0.25, 0.5), idle_speed=d["idle"] / 9.549, redline=d["power_rpm"] * 1.12 / 9.549,
        eta_gear=rng.uniform(0.945, 0.972), drag_out=rng.uniform(5.0, 15.0), accessory=rng.uniform(150.0, 350.0),
    )  # fmt: skip
    box = dict(
        fuel=inside("fuel"), flow=d["flow"], lag=d["lag"], tick=d["tick"] * radius / d["radius"],
        roll=d["roll"], pitch=d["pitch"], yaw=d["yaw"], scale=d["scale"], cylinders=float(d["cylinders"]),
        bias_x=rng.uniform(-0.3, 0.3), bias_y=rng.uniform(-0.3, 0.3), bias_z=rng.uniform(-0.3, 0.3),
        mount_pitch=np.radians(rng.normal(0, 0.1)), mount_roll=np.radians(rng.normal(0, 0.1)),
    )  # fmt: skip
    return Car(d, true, ratios, box, xml)
