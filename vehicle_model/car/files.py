"""Car files: the XML of seed 004, C.1.2, read and written whole; TOML for those who prefer it.

Every element and attribute of C.1.2 is known here; anything else is refused by name. What C.1.2 cannot say (redline,
gear losses, tolerances ...) stands in one element of our own, `rollingroad`, whose every value has a default, so that
a plain C.1.2 file works. The file's units (cc, kW, rpm, degrees of nothing: angles are rad) stay in the file; a `Car`
is SI.
"""

import re
import tomllib
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from vehicle_model.car.car_xml import car_xml
from vehicle_model.car.errors import BadInput
from vehicle_model.car.form import FORM, GEAR_NAMES, LABELS, RPM, Values
from vehicle_model.car.limits import check_car
from vehicle_model.car.parameters import Car, Driveline, Engine, Fuel, Injector, Mounting, Tolerances


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
            **{path.replace("/", "."): text(path, attribute) for path, attribute in LABELS},
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
    aside.write_text(car_xml(car), encoding="utf-8")
    aside.replace(path)
