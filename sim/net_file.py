"""A compiled SUMO network, read: lanes with their shapes, and which lane leads to which."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from defusedxml.ElementTree import iterparse
from numpy.typing import NDArray


@dataclass(frozen=True)
class Lane:
    """One lane."""

    id: str
    length: float
    """m, as SUMO counts distance."""
    speed: float
    """Limit, m/s."""
    shape: NDArray[np.float64]
    """(n, 3): x, y, z, m."""


@dataclass(frozen=True)
class Link:
    """A connection from a lane of one edge to a lane of the next."""

    from_lane: int
    to_lane: int
    via: tuple[str, ...]
    """Internal lanes driven in between."""
    state: str
    """SUMO's right-of-way letter: M major, m minor, = equal, s stop, o/O signal ..."""
    direction: str
    """s straight, l, r, L, R, t turn-around."""


@dataclass(frozen=True)
class Edge:
    """A normal edge (internal ones are reached by `Link.via`)."""

    id: str
    start: str
    end: str
    lanes: tuple[Lane, ...]
    params: dict[str, str]
    kind: str
    """OSM type such as highway.primary, or empty."""

    @property
    def length(self) -> float:
        return self.lanes[0].length

    @property
    def speed(self) -> float:
        return self.lanes[0].speed


@dataclass(frozen=True)
class Programme:
    """The fixed-time programme of a signal."""

    id: str
    cycle: float
    """s."""


@dataclass(frozen=True)
class NetFile:
    """Normal edges open to cars, internal lanes, links[(from edge, to edge)], signals by name."""

    edges: dict[str, Edge]
    internal: dict[str, Lane]
    links: dict[tuple[str, str], tuple[Link, ...]]
    offset: tuple[float, float]
    """netOffset: net coordinates = projected coordinates + offset."""
    signals: dict[str, Programme]


def _points(text: str) -> NDArray[np.float64]:
    rows = [[float(part) for part in point.split(",")] for point in text.split()]
    return np.array([row if len(row) == 3 else [*row, 0.0] for row in rows])


def _open_to_cars(lane: dict[str, str]) -> bool:
    if "allow" in lane:
        return "passenger" in lane["allow"].split() or lane["allow"] == "all"
    return not {"passenger", "all"} & set(lane.get("disallow", "").split())


@lru_cache(maxsize=4)
def read(path: Path) -> NetFile:
    """Read a .net.xml. Lanes closed to cars keep their index but edges without any open lane are left out."""
    edges: dict[str, Edge] = {}
    internal: dict[str, Lane] = {}
    raw_links: list[dict[str, str]] = []
    offset = (0.0, 0.0)
    lanes: list[Lane] = []
    allowed = False
    params: dict[str, str] = {}
    signals: dict[str, Programme] = {}
    for _, element in iterparse(path, events=("end",)):
        tag, get = element.tag, element.attrib
        if tag == "lane":
            lanes.append(Lane(get["id"], float(get["length"]), float(get["speed"]), _points(get["shape"])))
            allowed = allowed or _open_to_cars(get)
        elif tag == "param":
            params[get["key"]] = get["value"]
        elif tag == "edge":
            if get.get("function") == "internal":
                internal.update((lane.id, lane) for lane in lanes)
            elif allowed and "from" in get:
                edges[get["id"]] = Edge(get["id"], get["from"], get["to"], tuple(lanes), params, get.get("type", ""))
            lanes, allowed, params = [], False, {}
        elif tag == "connection":
            raw_links.append(dict(get))
        elif tag == "location":
            east, north = (float(part) for part in get["netOffset"].split(","))
            offset = (east, north)
        elif tag == "tlLogic":
            cycle = sum(float(phase.attrib["duration"]) for phase in element.iter("phase"))
            signals[get["id"]] = Programme(get["programID"], cycle)
        if tag in ("edge", "junction", "connection", "tlLogic"):
            if tag != "edge":
                params = {}
            element.clear()
    following = {f"{c['from']}_{c['fromLane']}": c.get("via", "") for c in raw_links if c["from"].startswith(":")}
    links: dict[tuple[str, str], list[Link]] = {}
    for c in raw_links:
        if c["from"] not in edges or c["to"] not in edges:
            continue
        via, lane = [], c.get("via", "")
        while lane:
            via.append(lane)
            lane = following.get(lane, "")
        links.setdefault((c["from"], c["to"]), []).append(
            Link(int(c["fromLane"]), int(c["toLane"]), tuple(via), c.get("state", "M"), c.get("dir", "s"))
        )
    return NetFile(edges, internal, {pair: tuple(group) for pair, group in links.items()}, offset, signals)
