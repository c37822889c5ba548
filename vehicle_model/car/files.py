"""Car files: the XML of seed 004, C.1.2, read and written whole; TOML for those who prefer it.

Every element and attribute of C.1.2 is known here; anything else is refused by name. What C.1.2 cannot say (redline,
gear losses, tolerances ...) stands in one element of our own, `rollingroad`, whose every value has a default, so that
a plain C.1.2 file works. The file's units (cc, kW, rpm, degrees of nothing: angles are rad) stay in the file; a `Car`
is SI.
"""

import re
import tomllib
from importlib import resources
from math import pi
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from vehicle_model.car.errors import BadInput
from vehicle_model.car.limits import check_car
from vehicle_model.car.parameters import Car, Driveline, Engine, Fuel, Injector, Mounting, Tolerances

GEAR_NAMES = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
RPM = 2.0 * pi / 60.0

# (element path, attribute) of C.1.2 -> None where it is required, else what is assumed when absent
FORM: dict[tuple[str, str], str | None] = {
    ("car/owner", "owner"): "",
    ("car/make", "make"): "",
    ("car/model", "model"): "",
    ("car/year", "year"): "",
    ("car/color", "color"): "",
    ("engine/type", "type"): "",
    ("engine/displacement", "displacement"): None,
    ("engine/power", "power"): None,
    ("engine/torque", "torque"): None,
    ("engine/compression", "comp"): None,
    ("engine/idle", "rpm"): None,
    ("engine/inertia", "lumped"): None,
    ("wheels/tire", "summer"): None,
    ("wheels/inertia", "lumped"): None,
    ("accelerometer", "type"): "",
    ("accelerometer/calibration/roll", "phi"): "0",
    ("accelerometer/calibration/pitch", "theta"): "0",
    ("accelerometer/calibration/yaw", "psi"): "0",
    ("accelerometer/calibration/scale", "scale"): "1",
    ("transmission", "type"): "",
    ("transmission/reverse", "gear"): "",
    **{(f"transmission/{name}", "gear"): "" for name in GEAR_NAMES},
    ("drag/aero", "Cd"): None,
    ("drag/rolling", "Crr"): None,
    ("area", "frontal"): None,
    ("mass", "wet"): None,
    ("inj/calibration", "fuelPerSecond"): None,
    ("inj/calibration", "lag"): "0",
    ("inj/timing", "pattern"): "sequential",
    ("vss/calibration", "metersPerTick"): None,
    # our own element
    ("rollingroad", "name"): "",
    ("rollingroad/engine", "cylinders"): "",
    ("rollingroad/engine", "redline"): "",
    ("rollingroad/engine", "turbocharged"): "",
    ("rollingroad/engine", "friction"): "1",
    ("rollingroad/engine", "throttling"): "1",
    ("rollingroad/fuel", "density"): "745",
    ("rollingroad/fuel", "heatingValue"): "43.0e6",
    ("rollingroad/driver", "mass"): "76",
    ("rollingroad/world", "airDensity"): "1.2",
    ("rollingroad/world", "gravity"): "9.805",
    ("rollingroad/wheels", "radius"): "",
    ("rollingroad/driveline", "loss"): "0.04",
    ("rollingroad/driveline", "dragTorque"): "6",
    ("rollingroad/driveline", "shiftTime"): "0.35",
    ("rollingroad/driveline", "launchRpm"): "0",
    ("rollingroad/driveline", "variable"): "no",
    ("rollingroad/driveline", "boostTime"): "-1",
    ("rollingroad/driveline", "scheduleRpm"): "0",
    ("rollingroad/driveline", "scheduleReserve"): "0.9",
    ("rollingroad/driveline", "electricalPower"): "350",
    ("rollingroad/tolerances", "mass"): "0.02",
    ("rollingroad/tolerances", "rollingResistance"): "0.03",
    ("rollingroad/tolerances", "dragArea"): "0.02",
    ("rollingroad/tolerances", "fuel"): "0.005",
    ("rollingroad/tolerances", "airDensity"): "0.005",
    ("rollingroad/tolerances", "wheelRadius"): "0.001",
    ("rollingroad/tolerances", "wind"): "0.4",
}
_LABELS = tuple(
    key for key, default in FORM.items() if default == "" and key[0].split("/")[0] in ("car", "accelerometer")
)
Values = dict[tuple[str, str], str]


def read_car(name_or_path: str | Path) -> Car:
    """Return the shipped car of that name ("smart", "peugeot", ...) or the car in that XML or TOML file.

    Raises `BadInput` naming the file, the element and what was expected there.
    """
    path = Path(name_or_path)
    shipped = resources.files("vehicle_model") / "cars" / f"{name_or_path}.xml"
    if path.suffix == "" and shipped.is_file():
        return _car(
            _read_xml(shipped.read_bytes(), f"{name_or_path}.xml"), (), str(name_or_path), f"{name_or_path}.xml"
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        known = ", ".join(shipped_cars())
        raise BadInput(path, "", f"is neither a shipped car ({known}) nor a readable file") from error
    if path.suffix.lower() == ".toml":
        values, logs = _read_toml(data, path)
    else:
        values, logs = _read_xml(data, path), ()
    return _car(values, logs, path.stem, path)


def shipped_cars() -> list[str]:
    """Names of the cars that come with the package."""
    folder = resources.files("vehicle_model") / "cars"
    return sorted(entry.name.removesuffix(".xml") for entry in folder.iterdir() if entry.name.endswith(".xml"))


def _read_xml(data: bytes, source: object) -> Values:
    try:
        root = fromstring(data)
    except (ElementTree.ParseError, DefusedXmlException, ValueError) as error:
        raise BadInput(source, "", f"well-formed XML without entities, found {error}") from error
    if root.tag != "ponthy_config":
        raise BadInput(source, root.tag, "the root element is ponthy_config")
    values: Values = {}
    logs: list[str] = []
    elements = {path for path, _ in FORM}
    parents = {path.rsplit("/", 1)[0] for path in elements if "/" in path} | {"accelerometer/calibration"}

    def walk(element: ElementTree.Element, path: str) -> None:
        for child in element:
            place = f"{path}/{child.tag}" if path else str(child.tag)
            if place == "file":
                logs.append(child.attrib.get("Name", ""))
                continue
            if place not in elements and place not in parents:
                raise BadInput(source, place, "is no element of a car file (C.1.2)")
            for attribute, text in child.attrib.items():
                key = (place, attribute)
                if key not in FORM:
                    raise BadInput(source, place, f"has no attribute {attribute!r}")
                if key in values:
                    raise BadInput(source, f"{place} {attribute}", "stands there twice")
                values[key] = text.strip()
            if (child.text or "").strip():
                raise BadInput(source, place, f"holds no text, found {(child.text or '').strip()[:40]!r}")
            walk(child, place)

    walk(root, "")
    values[("file", "Name")] = "\n".join(logs)
    return values


def _read_toml(data: bytes, source: object) -> tuple[Values, tuple[str, ...]]:
    """The same tree as tables: [engine.displacement] displacement = "698cc", or engine.displacement = "698cc"."""
    try:
        tree = tomllib.loads(data.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(source, "", f"valid TOML, found {error}") from error
    values: Values = {}
    logs = tree.pop("file", [])
    if not isinstance(logs, list) or not all(isinstance(entry, str) for entry in logs):
        raise BadInput(source, "file", "a list of the log files' names")
    by_element: dict[str, list[str]] = {}
    for path, attribute in FORM:
        by_element.setdefault(path, []).append(attribute)

    def walk(table: dict, path: str) -> None:
        for name, value in table.items():
            place = f"{path}/{name}" if path else name
            if isinstance(value, dict):
                if place not in by_element and not any(known.startswith(place + "/") for known in by_element):
                    raise BadInput(source, place.replace("/", "."), "is no element of a car file (C.1.2)")
                walk(value, place)
            elif (path, name) in FORM:
                values[(path, name)] = str(value)
            elif len(by_element.get(place, ())) == 1:
                values[(place, by_element[place][0])] = str(value)
            else:
                raise BadInput(source, place.replace("/", "."), "is no element of a car file (C.1.2)")

    walk(tree, "")
    return values, tuple(logs)


def _car(values: Values, logs: tuple[str, ...], name: str, source: object) -> Car:
    def text(path: str, attribute: str) -> str:
        found = values.get((path, attribute), FORM[(path, attribute)])
        if found is None:
            raise BadInput(source, f"{path} {attribute}", "is missing")
        return found

    def number(path: str, attribute: str, pattern: str = r"([-+0-9.eE]+)") -> float:
        found = text(path, attribute)
        match = re.fullmatch(pattern, found.strip(), re.IGNORECASE)
        try:
            return float(match.group(1)) if match else float("x")
        except ValueError:
            raise BadInput(source, f"{path} {attribute}", f"a number, found {found!r}") from None

    def at_speed(path: str, attribute: str, unit: str) -> tuple[float, float]:
        found = text(path, attribute)
        match = re.fullmatch(rf"([0-9.]+)\s*{unit}\s*@\s*([0-9.]+)\s*rpm", found.strip(), re.IGNORECASE)
        if not match:
            raise BadInput(source, f"{path} {attribute}", f'"<number>{unit} @<number>rpm", found {found!r}')
        return float(match.group(1)), float(match.group(2)) * RPM

    kind = text("engine/type", "type")
    power, power_speed = at_speed("engine/power", "power", "kW")
    torque, torque_speed = at_speed("engine/torque", "torque", "Nm")
    turbo_text = text("rollingroad/engine", "turbocharged").lower()
    if turbo_text not in ("", "yes", "no"):
        raise BadInput(source, "rollingroad/engine turbocharged", f"yes or no, found {turbo_text!r}")
    variable = text("rollingroad/driveline", "variable").lower()
    if variable not in ("yes", "no"):
        raise BadInput(source, "rollingroad/driveline variable", f"yes or no, found {variable!r}")
    redline = text("rollingroad/engine", "redline")
    engine = Engine(
        displacement=number("engine/displacement", "displacement", r"([0-9.]+)\s*(?:cc|cm3)?") * 1e-6,
        cylinders=_cylinders(kind, text("rollingroad/engine", "cylinders"), source),
        compression=number("engine/compression", "comp", r"([0-9.]+)\s*(?::\s*1)?"),
        max_power=power * 1e3,
        max_power_speed=power_speed,
        max_torque=torque,
        max_torque_speed=torque_speed,
        idle_speed=number("engine/idle", "rpm") * RPM,
        redline_speed=(number("rollingroad/engine", "redline") * RPM) if redline else 1.15 * power_speed,
        inertia=number("engine/inertia", "lumped"),
        turbocharged=turbo_text == "yes"
        if turbo_text
        else bool(re.search(r"turbo|suprex|t-?gdi", kind, re.IGNORECASE)),
        friction=number("rollingroad/engine", "friction"),
        throttling=number("rollingroad/engine", "throttling"),
        kind=kind,
    )
    ratios = _gears(values, source)
    tyre = text("wheels/tire", "summer")
    radius = text("rollingroad/wheels", "radius")
    if not logs:
        logs = tuple(entry for entry in values.get(("file", "Name"), "").split("\n") if entry)
    car = Car(
        name=text("rollingroad", "name") or name,
        wet_mass=number("mass", "wet"),
        drag_coefficient=number("drag/aero", "Cd"),
        frontal_area=number("area", "frontal"),
        rolling_resistance=number("drag/rolling", "Crr"),
        wheel_radius=number("rollingroad/wheels", "radius") if radius else tyre_radius(tyre, source),
        wheel_inertia=number("wheels/inertia", "lumped"),
        gear_ratios=ratios,
        metres_per_tick=number("vss/calibration", "metersPerTick"),
        engine=engine,
        injector=Injector(
            flow=number("inj/calibration", "fuelPerSecond") * 1e-3,
            lag=number("inj/calibration", "lag"),
            pattern=_pattern(text("inj/timing", "pattern"), source),
        ),
        fuel=Fuel(number("rollingroad/fuel", "density"), number("rollingroad/fuel", "heatingValue")),
        mounting=Mounting(
            roll=number("accelerometer/calibration/roll", "phi"),
            pitch=number("accelerometer/calibration/pitch", "theta"),
            yaw=number("accelerometer/calibration/yaw", "psi"),
            scale=number("accelerometer/calibration/scale", "scale"),
        ),
        tolerances=Tolerances(
            mass=number("rollingroad/tolerances", "mass"),
            rolling_resistance=number("rollingroad/tolerances", "rollingResistance"),
            drag_area=number("rollingroad/tolerances", "dragArea"),
            fuel=number("rollingroad/tolerances", "fuel"),
            air_density=number("rollingroad/tolerances", "airDensity"),
            wheel_radius=number("rollingroad/tolerances", "wheelRadius"),
            wind=number("rollingroad/tolerances", "wind"),
        ),
        driver_mass=number("rollingroad/driver", "mass"),
        air_density=number("rollingroad/world", "airDensity"),
        gravity=number("rollingroad/world", "gravity"),
        driveline=Driveline(
            loss=number("rollingroad/driveline", "loss"),
            drag_torque=number("rollingroad/driveline", "dragTorque"),
            shift_time=number("rollingroad/driveline", "shiftTime"),
            launch_speed=number("rollingroad/driveline", "launchRpm") * RPM,
            continuously_variable=variable == "yes",
            boost_time=number("rollingroad/driveline", "boostTime"),
            schedule_speed=number("rollingroad/driveline", "scheduleRpm") * RPM,
            schedule_reserve=number("rollingroad/driveline", "scheduleReserve"),
            electrical_power=number("rollingroad/driveline", "electricalPower"),
        ),
        labels={
            **{path.replace("/", "."): text(path, attribute) for path, attribute in _LABELS},
            "transmission": text("transmission", "type"),
            "transmission.reverse": text("transmission/reverse", "gear"),
            "wheels.tire": tyre,
        },
        logs=logs,
    )
    check_car(car, source)
    return car


def _cylinders(kind: str, declared: str, source: object) -> int:
    """Cylinders: declared in our element, else read off the type ("Inline 3", "V6", "4 cylinder"), else 4."""
    if declared:
        if not declared.isdigit():
            raise BadInput(source, "rollingroad/engine cylinders", f"a whole number, found {declared!r}")
        return int(declared)
    match = re.search(
        r"(?:inline|in-line|straight|flat|boxer|\b[vil])[\s-]*(\d{1,2})\b|\b(\d{1,2})[\s-]*cyl", kind, re.IGNORECASE
    )
    return int(match.group(1) or match.group(2)) if match else 4


def _gears(values: Values, source: object) -> tuple[float, ...]:
    ratios: list[float] = []
    ended = ""
    for name in GEAR_NAMES:
        found = values.get((f"transmission/{name}", "gear"), "")
        if not found:
            ended = ended or name
            continue
        if ended:
            raise BadInput(source, f"transmission/{ended} gear", f"is missing although there is a {name} gear")
        try:
            ratios.append(float(found))
        except ValueError:
            raise BadInput(source, f"transmission/{name} gear", f"a number, found {found!r}") from None
    if not ratios:
        raise BadInput(source, "transmission/first gear", "is missing")
    return tuple(ratios)


def _pattern(found: str, source: object) -> str:
    if found in ("sequential", "simultaneous") or re.fullmatch(r"grouped:\d+", found):
        return found
    raise BadInput(source, "inj/timing pattern", f"sequential, grouped:N or simultaneous, found {found!r}")


def tyre_radius(size: str, source: object) -> float:
    """Nominal radius (m) of a tyre such as 205/45 R16: half the rim's diameter plus the side wall."""
    match = re.fullmatch(r"\s*(\d{3})\s*/\s*(\d{2})\s*Z?R\s*(\d{2})\s*", size, re.IGNORECASE)
    if not match:
        raise BadInput(source, "wheels/tire summer", f'a size such as "205/45 R16", found {size!r}')
    width, aspect, rim = (float(part) for part in match.groups())
    return 0.5 * rim * 0.0254 + width * 1e-3 * aspect * 1e-2


def write_car(car: Car, path: str | Path) -> None:
    """Write `car` as XML (C.1.2 and our own element), aside and renamed; `read_car` gives an equal car back."""
    path = Path(path)
    aside = path.with_name(path.name + ".part")
    aside.write_text(_xml(car), encoding="utf-8")
    aside.replace(path)


def _exact(value: float, factor: float) -> float:
    """The file's number that the reader turns into exactly `value` by `factor`."""
    near = value / factor
    for digits in range(1, 18):
        candidate = float(f"{near:.{digits}g}")
        if candidate * factor == value:
            return candidate
    return near


def _xml(car: Car) -> str:
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
