"""A car written in the XML of seed 004, C.1.2: the file's units, numbers that are read back to the last bit."""

from xml.sax.saxutils import quoteattr

from vehicle_model.car.form import GEAR_NAMES, RPM
from vehicle_model.car.parameters import Car


def _exact(value: float, factor: float) -> float:
    """The file's number that the reader turns into exactly `value` by `factor`."""
    near = value / factor
    for digits in range(1, 18):
        candidate = float(f"{near:.{digits}g}")
        if candidate * factor == value:
            return candidate
    return near


def car_xml(car: Car) -> str:
    """The text of `car`'s file; the reader gives an equal car back."""
    e, t, d = car.engine, car.tolerances, car.driveline

    def say(tag: str, **attributes: object) -> str:
        parts = [f"{key}={quoteattr(v if isinstance(v, str) else repr(v))}" for key, v in attributes.items()]
        return f"<{' '.join([tag, *parts])} />"

    label = car.labels.get
    lines = ['<?xml version="1.0" encoding="UTF-8" ?>', "<ponthy_config>", "  <car>"]
    lines += [
        f"    {say(word, **{word: label(f'car.{word}', '')})}" for word in ("owner", "make", "model", "year", "color")
    ]
    power = f"{_exact(e.max_power, 1e3)!r}kW @{_exact(e.max_power_speed, RPM)!r}rpm"
    torque = f"{e.max_torque!r}Nm @{_exact(e.max_torque_speed, RPM)!r}rpm"
    lines += [
        "  </car>",
        "  <engine>",
        f"    {say('type', type=e.kind)}",
        f"    {say('displacement', displacement=f'{_exact(e.displacement, 1e-6)!r}cc')}",
        f"    {say('power', power=power)}",
        f"    {say('torque', torque=torque)}",
        f"    {say('compression', comp=f'{e.compression!r}:1')}",
        f"    {say('idle', rpm=_exact(e.idle_speed, RPM))}",
        f"    {say('inertia', lumped=e.inertia)}",
        "  </engine>",
        "  <wheels>",
        f"    {say('tire', summer=label('wheels.tire') or '205/45 R16')}",
        f"    {say('inertia', lumped=car.wheel_inertia)}",
        "  </wheels>",
        f"  <accelerometer type={quoteattr(label('accelerometer', ''))}>",
        "    <calibration>",
        f"      {say('roll', phi=car.mounting.roll)}",
        f"      {say('pitch', theta=car.mounting.pitch)}",
        f"      {say('yaw', psi=car.mounting.yaw)}",
        f"      {say('scale', scale=car.mounting.scale)}",
        "    </calibration>",
        "  </accelerometer>",
        f"  <transmission type={quoteattr(label('transmission', ''))}>",
        f"    {say('reverse', gear=label('transmission.reverse', ''))}",
    ]
    lines += [f"    {say(name, gear=ratio)}" for name, ratio in zip(GEAR_NAMES, car.gear_ratios, strict=False)]
    lines += [
        "  </transmission>",
        "  <drag>",
        f"    {say('aero', Cd=car.drag_coefficient)}",
        f"    {say('rolling', Crr=car.rolling_resistance)}",
        "  </drag>",
        f"  {say('area', frontal=car.frontal_area)}",
        f"  {say('mass', wet=car.wet_mass)}",
        "  <inj>",
        f"    {say('calibration', fuelPerSecond=_exact(car.injector.flow, 1e-3))}",
        f"    {say('calibration', lag=car.injector.lag)}",
        f"    {say('timing', pattern=car.injector.pattern)}",
        "  </inj>",
        "  <vss>",
        f"    {say('calibration', metersPerTick=car.metres_per_tick)}",
        "  </vss>",
        *(f"  {say('file', Name=name)}" for name in car.logs),
        f"  <rollingroad name={quoteattr(car.name)}>",
        "    "
        + say(
            "engine",
            cylinders=str(e.cylinders),
            redline=_exact(e.redline_speed, RPM),
            turbocharged="yes" if e.turbocharged else "no",
            friction=e.friction,
            throttling=e.throttling,
        ),
        f"    {say('fuel', density=car.fuel.density, heatingValue=car.fuel.heating_value)}",
        f"    {say('driver', mass=car.driver_mass)}",
        f"    {say('world', airDensity=car.air_density, gravity=car.gravity)}",
        f"    {say('wheels', radius=car.wheel_radius)}",
        "    "
        + say(
            "driveline",
            loss=d.loss,
            dragTorque=d.drag_torque,
            shiftTime=d.shift_time,
            launchRpm=_exact(d.launch_speed, RPM) if d.launch_speed else 0.0,
            variable="yes" if d.continuously_variable else "no",
            boostTime=d.boost_time,
            scheduleRpm=_exact(d.schedule_speed, RPM) if d.schedule_speed else 0.0,
            scheduleReserve=d.schedule_reserve,
            electricalPower=d.electrical_power,
        ),
        "    "
        + say(
            "tolerances",
            mass=t.mass,
            rollingResistance=t.rolling_resistance,
            dragArea=t.drag_area,
            fuel=t.fuel,
            airDensity=t.air_density,
            wheelRadius=t.wheel_radius,
            wind=t.wind,
        ),
        "  </rollingroad>",
        "</ponthy_config>",
    ]
    return "\n".join(lines) + "\n"
