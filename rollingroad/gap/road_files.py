"""Roads for the diagnosis: OpenStreetMap XML (altitudes as `ele` of the nodes)."""

from pathlib import Path

import numpy as np
from defusedxml.ElementTree import parse

from rollingroad.gap.road import Road
from vehicle_model.car.errors import BadInput


def read_osm(path: Path) -> Road:
    """Return the ways of the file whose nodes carry altitudes. Raises BadInput where it is no OpenStreetMap XML."""
    try:
        root = parse(path).getroot()
    except Exception as error:
        raise BadInput(path, "", f"OpenStreetMap XML ({error})") from error
    nodes: dict[str, tuple[float, float, float]] = {}
    for node in root.iter("node"):
        ele = [tag.get("v") for tag in node.iter("tag") if tag.get("k") == "ele"]
        nodes[node.get("id", "")] = (float(node.get("lat", "nan")), float(node.get("lon", "nan")), float(ele[0]) if ele else np.nan)
    ways = []
    for way in root.iter("way"):
        points = np.array([nodes[ref.get("ref", "")] for ref in way.iter("nd") if ref.get("ref") in nodes])
        if len(points) > 1 and np.isfinite(points[:, 2]).all():
            ways.append(points)
    return Road(tuple(ways))
