"""Road maps from files that others made: OpenStreetMap XML with `ele`, SUMO networks."""

import math
import re
from pathlib import Path
from xml.etree.ElementTree import ParseError

import numpy as np
from defusedxml.ElementTree import iterparse
from numpy.typing import NDArray

from sensors.projection import to_geodetic
from sensors.roadmap import RoadMap, join
from vehicle_model.car.errors import BadInput

DRIVABLE = frozenset(
    [
        "motorway",
        "motorway_link",
        "trunk",
        "trunk_link",
        "primary",
        "primary_link",
        "secondary",
        "secondary_link",
        "tertiary",
        "tertiary_link",
        "unclassified",
        "residential",
        "living_street",
        "service",
        "road",
    ]
)
"""Values of OpenStreetMap's `highway` on which a car may be met."""
MOST_NODES = 2000


def read_osm(path: Path) -> RoadMap:
    """Read drivable ways; a way's elevations come from its nodes' `ele` (m above sea level), evenly spaced again.

    Way points without `ele` are filled from their neighbours on the way. Raises BadInput where the file is missing, no
    OpenStreetMap XML, or without drivable roads.
    """
    places: dict[str, tuple[float, float, float]] = {}
    ways: list[list[str]] = []
    root = None
    count = 0
    try:
        for event, element in iterparse(path, events=("start", "end")):
            if event == "start":
                if root is None:
                    root = element
                    if element.tag != "osm":
                        raise BadInput(path, f"element {element.tag}", "OpenStreetMap XML (<osm>)")
                continue
            if element.tag == "node":
                count += 1
                height = math.nan
                for tag in element.iter("tag"):
                    if tag.get("k") == "ele":
                        height = _metres(tag.get("v", ""))
                places[element.attrib["id"]] = (float(element.attrib["lat"]), float(element.attrib["lon"]), height)
            elif element.tag == "way" and _is_drivable(element):
                ways.append([part.get("ref", "") for part in element.iter("nd")])
            if element.tag in ("node", "way", "relation") and root is not None:
                root.clear()
    except OSError as error:
        raise BadInput(path, "", f"a readable file ({error.strerror or error})") from error
    except ParseError as error:
        raise BadInput(path, f"line {error.position[0]}", "well-formed OpenStreetMap XML") from error
    except (KeyError, ValueError) as error:
        raise BadInput(path, f"node {count}", "a node with id, lat and lon as numbers") from error
    used = {ref for way in ways for ref in way if ref in places}
    number = {ref: i for i, ref in enumerate(ref for ref in places if ref in used)}
    table = np.array([places[ref] for ref in number]).reshape(-1, 3)
    members = [np.array([number[ref] for ref in way if ref in number], dtype=np.int64) for way in ways]
    pieces = [piece for way in members for piece in _pieces(way) if piece.size > 1]
    if not pieces:
        raise BadInput(path, "", "at least one drivable way (highway=...) with two nodes")
    return join([(piece, _heights(table, piece)) for piece in pieces], table[:, 0], table[:, 1])


def _is_drivable(way) -> bool:
    return any(tag.get("k") == "highway" and tag.get("v") in DRIVABLE for tag in way.iter("tag"))


def _metres(text: str) -> float:
    match = re.fullmatch(r"\s*([-+]?\d+(?:\.\d+)?)\s*m?\s*", text)
    return float(match.group(1)) if match else math.nan


def _pieces(way: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    way = way[np.concatenate(([True], np.diff(way) != 0))] if way.size else way
    return [way[i : i + MOST_NODES + 1] for i in range(0, max(way.size - 1, 0), MOST_NODES)]


def _heights(table: NDArray[np.float64], way: NDArray[np.int64]) -> NDArray[np.float64]:
    """Elevations of a way at even distances of about 50 m, both ends included; none where no node has one."""
    latitude, longitude, height = table[way].T
    known = np.isfinite(height)
    if not known.any():
        return np.empty(0)
    step = np.hypot(np.diff(latitude), np.diff(longitude) * math.cos(math.radians(latitude[0]))) * 111_200.0
    s = np.concatenate(([0.0], np.cumsum(step)))
    count = max(2, round(s[-1] / 50.0) + 1)
    return np.interp(np.linspace(0.0, s[-1], count), s[known], height[known])


def read_sumo_network(path: Path, origin: tuple[float, ...] | None = None) -> RoadMap:
    """Read the normal edges of a SUMO network; of two edges between the same junctions and opposite, one.

    Coordinates go back to latitude and longitude by the network's own projection (transverse Mercator or UTM); a
    network without one is a plane about `origin` (deg). Raises BadInput for a missing file, no network, an unknown
    projection, or a plane without an origin.
    """
    edges: list[tuple[str, str, str]] = []
    offset, projection = (0.0, 0.0), "!"
    root = None
    try:
        for event, element in iterparse(path, events=("start", "end")):
            if event == "start":
                if root is None:
                    root = element
                    if element.tag != "net":
                        raise BadInput(path, f"element {element.tag}", "a SUMO network (<net>)")
                continue
            if element.tag == "location":
                x, y = element.attrib["netOffset"].split(",")
                offset, projection = (float(x), float(y)), element.get("projParameter", "!")
            elif element.tag == "edge" and element.get("function", "normal") == "normal":
                lane = element.find("lane")
                shape = element.get("shape") or (lane.get("shape", "") if lane is not None else "")
                edges.append((element.attrib["from"], element.attrib["to"], shape))
            if element.tag in ("edge", "junction", "connection", "tlLogic") and root is not None:
                root.clear()
    except OSError as error:
        raise BadInput(path, "", f"a readable file ({error.strerror or error})") from error
    except ParseError as error:
        raise BadInput(path, f"line {error.position[0]}", "well-formed SUMO network XML") from error
    except (KeyError, ValueError) as error:
        raise BadInput(path, f"edge {len(edges)}", "edges with from, to and a shape of numbers") from error
    return _network_map(path, edges, offset, projection, origin)


def _network_map(path: Path, edges, offset, projection: str, origin) -> RoadMap:
    points: list[NDArray[np.float64]] = []
    ways = []
    junction: dict[str, int] = {}
    seen: set[tuple[str, str]] = set()
    count = 0

    def node(point: NDArray[np.float64]) -> int:
        nonlocal count
        points.append(point)
        count += 1
        return count - 1

    for begin, end, text in edges:
        if (end, begin) in seen:
            continue
        seen.add((begin, end))
        try:
            shape = np.array([[float(x) for x in part.split(",")] for part in text.split()])
        except ValueError as error:
            raise BadInput(path, f"edge {begin} to {end}", f"a shape of numbers, not {text[:40]!r}") from error
        if shape.ndim != 2 or shape.shape[0] < 2 or shape.shape[1] not in (2, 3):
            raise BadInput(path, f"edge {begin} to {end}", "a shape of at least two points")
        if shape.shape[1] == 2:
            shape = np.column_stack((shape, np.zeros(len(shape))))
        first = junction[begin] if begin in junction else junction.setdefault(begin, node(shape[0]))
        last = junction[end] if end in junction else junction.setdefault(end, node(shape[-1]))
        ways.append((np.array([first, *(node(point) for point in shape[1:-1]), last]), shape))
    if not ways:
        raise BadInput(path, "", "a network with at least one edge")
    xyz = np.array(points)
    x, y = xyz[:, 0] - offset[0], xyz[:, 1] - offset[1]
    latitude, longitude = _unproject(path, x, y, projection, origin)
    result = []
    for members, shape in ways:
        s = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(shape[:, :2], axis=0).T))))
        even = np.linspace(0.0, s[-1], max(2, round(s[-1] / 50.0) + 1))
        result.append((members, np.interp(even, s, shape[:, 2])))
    return join(result, latitude, longitude)


def _unproject(path: Path, x, y, projection: str, origin) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if projection in ("!", "-", ""):
        if origin is None:
            raise BadInput(path, "projParameter", "a projected network, or the origin of its plane")
        return to_geodetic(y, x, origin)
    words = dict(part.lstrip("+").split("=", 1) for part in projection.split() if "=" in part)
    kind = words.get("proj")
    if kind == "utm" and "zone" in words:
        false_north = 1e7 if "+south" in projection else 0.0
        return inverse_transverse_mercator(x - 5e5, y - false_north, 0.0, 6.0 * int(words["zone"]) - 183.0, 0.9996)
    if kind == "tmerc":
        scale = float(words.get("k", words.get("k_0", "1")))
        x, y = x - float(words.get("x_0", "0")), y - float(words.get("y_0", "0"))
        return inverse_transverse_mercator(x, y, float(words.get("lat_0", "0")), float(words.get("lon_0", "0")), scale)
    raise BadInput(path, "projParameter", f"a transverse Mercator or UTM projection, not {projection!r}")


def inverse_transverse_mercator(
    x: NDArray[np.float64], y: NDArray[np.float64], latitude_0: float, longitude_0: float, scale: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return latitude and longitude (deg, WGS 84) of transverse Mercator `x`, `y` (m): Krueger's series to n^3."""
    flattening = 1.0 / 298.257223563
    n = flattening / (2.0 - flattening)
    radius = 6378137.0 / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0)
    alpha = (n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16, 13 * n**2 / 48 - 3 * n**3 / 5, 61 * n**3 / 240)
    beta = (n / 2 - 2 * n**2 / 3 + 37 * n**3 / 96, n**2 / 48 + n**3 / 15, 17 * n**3 / 480)
    delta = (2 * n - 2 * n**2 / 3 - 2 * n**3, 7 * n**2 / 3 - 8 * n**3 / 5, 56 * n**3 / 15)
    phi = math.radians(latitude_0)
    e = 2.0 * math.sqrt(n) / (1.0 + n)
    conformal = math.atan(math.sinh(math.atanh(math.sin(phi)) - e * math.atanh(e * math.sin(phi))))
    start = conformal + sum(a * math.sin(2 * (j + 1) * conformal) for j, a in enumerate(alpha))
    xi, eta = np.asarray(y) / (scale * radius) + start, np.asarray(x) / (scale * radius)
    orders = [2 * (j + 1) for j in range(3)]
    xi_0 = xi - sum(b * np.sin(k * xi) * np.cosh(k * eta) for b, k in zip(beta, orders, strict=True))
    eta_0 = eta - sum(b * np.cos(k * xi) * np.sinh(k * eta) for b, k in zip(beta, orders, strict=True))
    chi = np.arcsin(np.sin(xi_0) / np.cosh(eta_0))
    latitude = chi + sum(d * np.sin(k * chi) for d, k in zip(delta, orders, strict=True))
    longitude = longitude_0 + np.degrees(np.arctan2(np.sinh(eta_0), np.cos(xi_0)))
    return np.degrees(latitude), longitude
