"""Drawing roads the way a road engineer does: an alignment of bends and grades, cut into edges at chainages.

The output is SUMO's plain XML (nodes and edges with x, y, z shapes), which netconvert compiles. East is x, north y, m.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

STEP = 1.0
"""m between the points of an alignment."""
SHAPE_STEP = 12.0
"""m between the points that are written."""


@dataclass(frozen=True)
class Alignment:
    """The centre line of a road. Arrays (n,) over chainage, every `STEP` metres."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]
    heading: NDArray[np.float64]
    """rad, 0 = north, clockwise."""

    @property
    def length(self) -> float:
        return (len(self.x) - 1) * STEP

    def at(self, chainage: float) -> tuple[float, float, float]:
        """Position at a chainage, m."""
        grid = np.arange(len(self.x)) * STEP
        return tuple(float(np.interp(chainage, grid, line)) for line in (self.x, self.y, self.z))  # type: ignore[return-value]

    def direction(self, chainage: float) -> float:
        """Heading at a chainage, rad."""
        return float(np.interp(chainage, np.arange(len(self.x)) * STEP, self.heading))

    def points(self, start: float, end: float) -> list[tuple[float, float, float]]:
        """Shape points from chainage `start` to `end` (which may be smaller: the way back)."""
        count = max(2, round(abs(end - start) / SHAPE_STEP) + 1)
        return [self.at(chainage) for chainage in np.linspace(start, end, count)]


def alignment(
    start: tuple[float, float, float],
    heading: float,
    bends: Sequence[tuple[float, float]],
    grades: Sequence[tuple[float, float]] = (),
) -> Alignment:
    """Lay out a road from `start` (x, y, z), heading in degrees.

    `bends`: (length m, turn degrees, to the right positive), one after the other; inside each the curvature rises and
    falls as 1 - cos, so that heading and curvature are continuous; the tightest radius is length / (2 turn).
    `grades`: knots (chainage m, grade in per cent), joined monotonically; altitude is their integral.
    """
    curvature = []
    for length, turn in bends:
        u = (np.arange(round(length / STEP)) + 0.5) * STEP / length
        curvature.append(np.deg2rad(turn) / length * (1.0 - np.cos(2.0 * np.pi * u)))
    steps = np.concatenate(curvature) * STEP
    psi = np.deg2rad(heading) + np.concatenate([[0.0], np.cumsum(steps)])
    middle = 0.5 * (psi[1:] + psi[:-1])
    chainage = np.arange(len(psi)) * STEP
    if len(grades) > 1:
        knots, values = zip(*grades, strict=True)
        grade = PchipInterpolator(knots, values, extrapolate=False)(np.clip(chainage, knots[0], knots[-1])) / 100.0
    else:
        grade = np.full(len(psi), (grades[0][1] if grades else 0.0) / 100.0)
    x = start[0] + np.concatenate([[0.0], np.cumsum(np.sin(middle))]) * STEP
    y = start[1] + np.concatenate([[0.0], np.cumsum(np.cos(middle))]) * STEP
    z = start[2] + np.concatenate([[0.0], np.cumsum(0.5 * (grade[1:] + grade[:-1]))]) * STEP
    return Alignment(x, y, z, psi)


def ramp(
    start: tuple[float, float, float], start_heading: float, end: tuple[float, float, float], end_heading: float
) -> Alignment:
    """A smooth link between two points with given headings (rad): one cubic in the plane, one in height."""
    a, b = np.array(start), np.array(end)
    reach = float(np.hypot(*(b - a)[:2])) * 1.1
    u = np.linspace(0.0, 1.0, 2001)

    def tangent(heading: float) -> NDArray[np.float64]:
        return np.array([np.sin(heading), np.cos(heading), 0.0]) * reach

    curve = CubicHermiteSpline([0.0, 1.0], [a, b], [tangent(start_heading), tangent(end_heading)])(u)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(curve[:, :2], axis=0).T))])
    grid = np.arange(0.0, along[-1], STEP)
    x, y, z = (np.append(np.interp(grid, along, curve[:, i]), curve[-1, i]) for i in range(3))
    return Alignment(x, y, z, np.unwrap(np.arctan2(np.gradient(x), np.gradient(y))))


@dataclass
class Draft:
    """Nodes and edges being drawn."""

    nodes: dict[str, str] = field(default_factory=dict)
    edges: list[str] = field(default_factory=list)

    def node(self, name: str, place: tuple[float, float, float], kind: str = "priority", radius: float = 6.0) -> str:
        """Add a node; `kind` is SUMO's (`priority`, `traffic_light`, `dead_end` ...)."""
        x, y, z = place
        tl = f' tl="{name}"' if kind == "traffic_light" else ""
        self.nodes[name] = (
            f'<node id="{name}" x="{x:.3f}" y="{y:.3f}" z="{z:.3f}" type="{kind}" radius="{radius:g}"{tl}/>'
        )
        return name

    def edge(
        self,
        name: str,
        ends: tuple[str, str],
        points: Sequence[tuple[float, float, float]],
        *,
        limit: float,
        lanes: int = 1,
        priority: int = 5,
        centred: bool = False,
    ) -> None:
        """Add a one-way edge; `limit` in km/h. Lanes lie right of `points` unless `centred`."""
        shape = " ".join(f"{x:.2f},{y:.2f},{z:.3f}" for x, y, z in points)
        spread = "center" if centred else "right"
        self.edges.append(
            f'<edge id="{name}" from="{ends[0]}" to="{ends[1]}" numLanes="{lanes}" speed="{limit / 3.6:.3f}" '
            f'priority="{priority}" spreadType="{spread}" shape="{shape}"/>'
        )

    def road(
        self,
        name: str,
        ends: tuple[str, str],
        line: Alignment,
        span: tuple[float, float],
        *,
        limit: float,
        lanes: int = 1,
        priority: int = 5,
    ) -> None:
        """Add both directions of a piece of `line`: `name` there, `-name` back."""
        there = line.points(*span)
        self.edge(name, ends, there, limit=limit, lanes=lanes, priority=priority)
        self.edge(f"-{name}", ends[::-1], there[::-1], limit=limit, lanes=lanes, priority=priority)

    def side_road(
        self, name: str, junction: str, place: tuple[float, float, float], heading: float, length: float, limit: float
    ) -> None:
        """Add a straight two-way road that leads from `junction` (at `place`) away at `heading` (rad) to a dead end."""
        line = alignment(place, np.rad2deg(heading), [(length, 0.0)])
        end = self.node(f"{name}_end", line.at(length), "dead_end")
        self.road(name, (junction, end), line, (0.0, length), limit=limit, priority=2)

    def write(self, folder: Path, name: str) -> None:
        """Write `name`.nod.xml and `name`.edg.xml into `folder`."""
        for suffix, root, lines in (("nod", "nodes", self.nodes.values()), ("edg", "edges", self.edges)):
            body = "\n".join(f"  {line}" for line in lines)
            (folder / f"{name}.{suffix}.xml").write_text(f"<{root}>\n{body}\n</{root}>\n")
