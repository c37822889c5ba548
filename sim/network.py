"""From a scenario's road to a compiled SUMO network with the ego's way through it."""

import itertools
import os
import subprocess
import tomllib
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pymap3d
import sumo
from defusedxml.ElementTree import ParseError, iterparse

from scenarios.files import ROADS
from scenarios.schema import Scenario
from sim.graph import WayGraph, unwind, way_graph
from sim.net_file import NetFile, read
from vehicle_model.car.errors import BadInput

WISHED_LENGTH = 8_000.0
"""m: a route through an extract is at least this long where the extract has one."""
LEAST_LENGTH = 3_000.0
"""m: and never shorter than this."""
NEAR = 300.0
"""m: how far from a drivable road an end of the journey may lie."""
SAME_ROAD = 15.0
"""m: edges no farther apart are one road's two directions."""


@dataclass(frozen=True)
class Network:
    """A network to drive in. Plain values: it can be pickled and sent to another process."""

    net: Path
    """The compiled .net.xml."""
    coordinated: dict[str, float]
    """Offsets (s) of the signals that are coordinated with each other; see `sim.signals`."""
    edges: tuple[str, ...]
    """The ego's way."""
    depart: float
    """m on the first edge."""
    arrival: float
    """m on the last edge."""
    origin: tuple[float, float, float]
    """Latitude, longitude (deg), altitude (m) of projected x = y = 0."""
    tunnels: frozenset[str]
    canyons: frozenset[str]
    source_weights: dict[str, float]
    """How much more traffic than usual begins at an edge."""
    altitude_smoothing: float
    """m: sigma of the Gaussian laid over z(s)."""
    grade_limit: float
    """Steepest grade that is believed, dz/ds."""
    notes: tuple[str, ...] = ()
    """What was done to the data and should be said."""


def build(scenario: Scenario, directory: Path) -> Network:
    """Compile the scenario's road into `directory` and find the ego's way.

    Raises BadInput for an extract that is not OSM, has no drivable roads, or has no way between the ends.
    """
    directory.mkdir(parents=True, exist_ok=True)
    if scenario.road.osm is not None:
        return _from_osm(scenario, directory)
    return _built_in(scenario, directory)


def _netconvert(arguments: list[str], directory: Path, source: object) -> Path:
    net = directory / "road.net.xml"
    aside = directory / "road.part.net.xml"
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), *arguments, "--output-file", str(aside)]
    # SUMO_HOME for the child alone: users need not set it.
    result = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "SUMO_HOME": sumo.SUMO_HOME}, check=False
    )
    if result.returncode != 0 or not aside.is_file():
        reasons = [line for line in result.stderr.splitlines() if line.startswith("Error")]
        raise BadInput(source, "", f"cannot be compiled into roads: {(reasons or ['netconvert failed'])[0]}")
    aside.replace(net)
    return net


def _built_in(scenario: Scenario, directory: Path) -> Network:
    name = str(scenario.road.name)
    folder = ROADS / name
    facts = tomllib.loads((folder / "road.toml").read_text())
    section = facts["sections"].get(scenario.road.section)
    if section is None:
        known = ", ".join(facts["sections"])
        raise BadInput(scenario.source or name, "road.section", f"no {scenario.road.section}; expected one of {known}")
    signals = facts["signals"]
    arguments = ["--node-files", str(folder / f"{name}.nod.xml"), "--edge-files", str(folder / f"{name}.edg.xml")]
    arguments += ["--no-turnarounds.except-deadend", "--precision", "4", "--offset.disable-normalization"]
    arguments += ["--junctions.corner-detail", "5", "--tls.cycle.time", str(signals["cycle"])]
    net = _netconvert(arguments, directory, name)
    graph = way_graph(read(net))
    stations = [section["start"][0], *section.get("via", []), section["end"][0]]
    way = [graph.index[stations[0]]]
    for here, there in itertools.pairwise(stations):
        _, before = graph.ways(np.array([graph.index[here]]))
        way += unwind(before[0], graph.index[here], graph.index[there])[1:]
    return Network(
        net=net,
        coordinated=section.get("offsets", signals["offsets"]),
        edges=tuple(graph.names[i] for i in way),
        depart=float(section["start"][1]),
        arrival=float(section["end"][1]),
        origin=(*facts["origin"], 0.0),
        tunnels=frozenset(facts["tunnels"]),
        canyons=frozenset(facts["canyons"]),
        source_weights=facts["sources_weight"],
        altitude_smoothing=30.0,
        grade_limit=0.12,
    )


def _bounds(extract: Path) -> tuple[float, float]:
    """Middle of an extract's nodes, (latitude, longitude). Raises BadInput if it is not OSM XML."""
    low, high, count = np.full(2, np.inf), np.full(2, -np.inf), 0
    try:
        for _, element in iterparse(extract, events=("end",)):
            if element.tag == "node":
                place = np.array([float(element.attrib["lat"]), float(element.attrib["lon"])])
                low, high, count = np.minimum(low, place), np.maximum(high, place), count + 1
            element.clear()
    except ParseError as error:
        raise BadInput(extract, f"line {error.position[0]}", "expected OpenStreetMap XML") from None
    except (KeyError, ValueError):
        raise BadInput(extract, f"node {count + 1}", "expected a node with lat and lon") from None
    except OSError as error:
        raise BadInput(extract, "", f"cannot be read: {error.strerror}") from None
    if count == 0:
        raise BadInput(extract, "", "no nodes in it; expected an OpenStreetMap extract with drivable roads")
    return float(0.5 * (low + high)[0]), float(0.5 * (low + high)[1])


def _from_osm(scenario: Scenario, directory: Path) -> Network:
    extract = Path(str(scenario.road.osm))
    if not extract.is_file():
        raise BadInput(extract, "", "no such file; expected an OpenStreetMap extract")
    latitude, longitude = _bounds(extract)
    typemap = Path(sumo.SUMO_HOME) / "data" / "typemap" / "osmNetconvert.typ.xml"
    variants = directory / "variants.typ.xml"
    variants.write_text(_variants(typemap))
    arguments = ["--osm-files", str(extract), "--type-files", f"{typemap},{variants}", "--osm.elevation", "true"]
    arguments += ["--geometry.remove", "--roundabouts.guess", "--junctions.join", "--ramps.guess"]
    arguments += ["--tls.guess-signals", "--tls.join", "--tls.discard-simple", "--no-turnarounds.except-deadend"]
    arguments += ["--keep-edges.by-vclass", "passenger", "--osm.extra-attributes", "tunnel,layer", "--precision", "3"]
    # A local transverse Mercator: north is up and a metre is a metre in the middle of the extract.
    arguments += ["--proj", f"+proj=tmerc +lat_0={latitude:.6f} +lon_0={longitude:.6f} +k=1 +ellps=WGS84 +units=m"]
    net_path = _netconvert(arguments, directory, extract)
    net = read(net_path)
    if not net.edges:
        raise BadInput(extract, "", "no drivable roads in it; expected an OpenStreetMap extract with roads for cars")
    graph = way_graph(net)
    origin = (latitude, longitude, 0.0)
    if scenario.road.start is not None and scenario.road.end is not None:
        way, depart, arrival = _way_between(scenario, net, graph, origin)
    else:
        way = _longest_sensible_way(net, graph, extract)
        depart, arrival = 5.0, net.edges[graph.names[way[-1]]].length - 2.0
    edges = tuple(graph.names[i] for i in way)
    flat = max(float(np.ptp(net.edges[name].lanes[0].shape[:, 2])) for name in edges) == 0.0
    return Network(
        net=net_path,
        coordinated={},
        edges=edges,
        depart=depart,
        arrival=arrival,
        origin=origin,
        tunnels=frozenset(name for name in edges if _underground(net.edges[name].params, net.edges[name].kind)),
        canyons=frozenset(),
        source_weights={},
        altitude_smoothing=60.0,
        grade_limit=0.12,
        notes=("the extract has no elevation: the road is flat",)
        if flat
        else ("altitude smoothed along the route by a Gaussian of 60 m, grades clipped at 12 %",),
    )


def _variants(typemap: Path) -> str:
    """Types such as highway.primary_tunnel, which some extracts use, as copies of the plain type."""
    rows = []
    for _, element in iterparse(typemap, events=("end",)):
        name = element.attrib.get("id", "")
        if element.tag == "type" and name.startswith("highway.") and "|" not in name:
            for suffix in ("_tunnel", "_bridge"):
                attributes = {**element.attrib, "id": name + suffix}
                rows.append("<type " + " ".join(f"{key}={quoteattr(text)}" for key, text in attributes.items()) + "/>")
    return "<types>\n" + "\n".join(rows) + "\n</types>\n"


def _underground(params: dict[str, str], kind: str) -> bool:
    if kind.endswith("_tunnel"):
        return True
    layer = params.get("layer", "0").split(";")[0]
    below = layer.lstrip("-").isdigit() and int(layer) < 0
    return params.get("tunnel", "no") not in ("no", "") or below


def _nearest(
    scenario: Scenario, net: NetFile, origin: tuple[float, float, float], place: tuple[float, float], key: str
) -> list[tuple[str, float]]:
    """Edges nearest to a place (both directions of a road), and the metres along each.

    Raises BadInput if none is within `NEAR`.
    """
    east, north, _ = pymap3d.geodetic2enu(*place, 0.0, origin[0], origin[1], 0.0)
    point = np.array([east + net.offset[0], north + net.offset[1]])
    found: list[tuple[float, str, float]] = []
    for edge in net.edges.values():
        line = edge.lanes[0].shape[:, :2]
        step = np.diff(line, axis=0)
        length = np.maximum(np.hypot(*step.T), 1e-9)
        share = np.clip(((point - line[:-1]) * step).sum(axis=1) / length**2, 0.0, 1.0)
        gap = np.hypot(*(line[:-1] + share[:, None] * step - point).T)
        k = int(gap.argmin())
        along = float((length[:k].sum() + share[k] * length[k]) / length.sum() * edge.length)
        found.append((float(gap[k]), edge.id, along))
    best = min(found)[0]
    if best > NEAR:
        expected = f"the nearest drivable road is {best:.0f} m away; expected at most {NEAR:.0f} m"
        raise BadInput(scenario.road.osm, f"road.{key}", expected)
    return [(name, along) for gap, name, along in found if gap < best + SAME_ROAD]


def _way_between(
    scenario: Scenario, net: NetFile, graph: WayGraph, origin: tuple[float, float, float]
) -> tuple[list[int], float, float]:
    """The fastest way between the ends, on the side of the road that suits it; where it begins and ends (m)."""
    assert scenario.road.start is not None and scenario.road.end is not None
    firsts = _nearest(scenario, net, origin, scenario.road.start, "from")
    lasts = _nearest(scenario, net, origin, scenario.road.end, "to")
    times, before = graph.ways(np.array([graph.index[name] for name, _ in firsts]))
    best: tuple[float, int, int] | None = None
    for i, (first, depart) in enumerate(firsts):
        for j, (last, arrival) in enumerate(lasts):
            time = times[i, graph.index[last]]
            onward = first != last or arrival > depart + 50.0
            if np.isfinite(time) and onward and (best is None or time < best[0]):
                best = (float(time), i, j)
    if best is None:
        raise BadInput(scenario.road.osm, "road.from, road.to", "no way by car from one to the other")
    _, i, j = best
    (first, depart), (last, arrival) = firsts[i], lasts[j]
    way = unwind(before[i], graph.index[first], graph.index[last])
    depart = float(np.clip(depart, 5.0, max(net.edges[first].length - 1.0, 5.0)))
    return way, depart, float(np.clip(arrival, 1.0, max(net.edges[last].length - 1.0, 1.0)))


def _longest_sensible_way(net: NetFile, graph: WayGraph, extract: Path) -> list[int]:
    """A fastest way of 8 to 10 km, or the longest of at least 3 km: always the same one for the same extract.

    Fastest ways keep to through roads; among those of that length the slowest wins: a city's.
    Both ends lie on edges long enough to stand on.
    """
    strong = graph.largest_component()
    # An extract may be one long road: then there is no network to be strongly connected.
    usable = np.flatnonzero((graph.length > 40.0) & (strong if strong.sum() > 10 else True))
    if len(usable) == 0:
        raise BadInput(extract, "", "no drivable roads in it; expected an OpenStreetMap extract with roads for cars")
    origins = usable[np.linspace(0, len(usable) - 1, min(40, len(usable))).round().astype(int)]
    times, before = graph.ways(origins)
    best: tuple[float, list[int]] = (-1.0, [])
    for row, origin in enumerate(origins):
        # Lengths along the tree, in order of travel time: each edge after the one before it.
        length = np.full(len(graph.names), np.nan)
        length[origin] = 0.0
        for node in np.argsort(times[row], kind="stable"):
            if before[row, node] >= 0:
                length[node] = length[before[row, node]] + graph.length[before[row, node]]
        for end in usable[np.isfinite(length[usable])]:
            total = length[end] + graph.length[end]
            score = min(total, WISHED_LENGTH + 500.0) - max(total - WISHED_LENGTH - 1_500.0, 0.0)
            score += 0.01 * min(times[row, end], 900.0)
            if score > best[0]:
                best = (float(score), [row, int(end)])
    if not best[1] or best[0] < LEAST_LENGTH:
        raise BadInput(extract, "", f"no route of {LEAST_LENGTH / 1000:g} km in it; expected a larger extract")
    row, end = best[1]
    return unwind(before[row], int(origins[row]), end)
