"""The ego's road as it truly is, made smooth from the lanes of a compiled network."""

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from sim.net_file import Lane, Link, NetFile, read
from sim.network import Network
from vehicle_model.car.route import CANYON, OPEN_SKY, TUNNEL, Route

STEP = 1.0
"""m between the points of a route."""
TURN, STREET, ROAD = 3.0, 9.0, 15.0
"""m: sigma of the Gaussian over the heading at turns, along streets (to 60 km/h) and on faster roads. A drawn line has
corners at its points; a car drives them as bends."""
TIGHT, HAIRPIN = 8.0, 6.0
"""m: below that radius sigma is this: half a turn then has a radius near 5 m."""
TURN_REACH = 15.0
"""m before and after a turn where the narrow Gaussian holds."""
SWERVE = 3.0
"""s over which a car moves over where the network's lanes jump aside at a junction (half before, half after)."""
STEERING, STEERING_LIMIT = 1.0 / 60.0, 0.06
"""rad/m and rad: how firmly the smooth line is steered back to the drawn one."""
OVERRUN = 2.0
"""m of road beyond the destination."""


def lane_path(net: NetFile, edges: tuple[str, ...]) -> list[tuple[int, int, Link | None]]:
    """For each edge the lane entered on, the lane left on and the link taken, with the fewest lane changes."""
    cost: dict[int, tuple[float, list]] = {lane: (0.0, []) for lane in range(len(net.edges[edges[0]].lanes))}
    for here, there in itertools.pairwise(edges):
        onward: dict[int, tuple[float, list]] = {}
        for link in net.links[here, there]:
            for lane, (spent, steps) in cost.items():
                total = spent + abs(link.from_lane - lane)
                if link.to_lane not in onward or total < onward[link.to_lane][0]:
                    onward[link.to_lane] = (total, [*steps, (lane, link.from_lane, link)])
        cost = onward
    lane, (_, steps) = min(cost.items(), key=lambda item: item[1][0])
    return [*steps, (lane, lane, None)]


def edge_starts(network: Network) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance of the ego at the start and at the end of each of its edges, m (SUMO's, 0 at the start of the drive)."""
    net = read(network.net)
    begins, ends, at = [], [], -network.depart
    for name, (_, _, link) in zip(network.edges, lane_path(net, network.edges), strict=True):
        begins.append(at)
        at += net.edges[name].length
        ends.append(at)
        at += sum(net.internal[lane].length for lane in link.via) if link else 0.0
    return np.array(begins), np.array(ends)


def _blend(entered: Lane, left: Lane) -> NDArray[np.float64]:
    """Points along an edge, moving over from one lane to the other along its length; columns share, x, y, z."""

    def share(lane: Lane) -> NDArray[np.float64]:
        gaps = np.hypot(*np.diff(lane.shape[:, :2], axis=0).T)
        return np.concatenate([[0.0], np.cumsum(gaps)]) / max(float(gaps.sum()), 1e-9)

    u = np.union1d(share(entered), share(left))
    a, b = (
        np.column_stack([np.interp(u, share(lane), lane.shape[:, k]) for k in range(3)]) for lane in (entered, left)
    )
    return np.column_stack([u, a + (b - a) * u[:, None]])


def true_route(network: Network) -> Route:
    """Return the ego's route over SUMO's distance: from 0 at its start to `OVERRUN` m beyond its destination.

    Headings of the lanes driven are smoothed, altitudes too (`Network.altitude_smoothing`), grades clipped to
    `Network.grade_limit`; position and altitude are the integrals of heading and pitch over the distance, so
    that all of them agree exactly; the line is steered back to the drawn one, from which it differs by a few metres.
    """
    line = _Line(network)
    s = np.arange(0.0, np.floor(line.end / STEP) * STEP + 0.5 * STEP, STEP)
    x, y, z = (np.interp(s, line.points[:, 0], line.points[:, k]) for k in (1, 2, 3))
    limit, sky = np.empty_like(s), np.zeros(len(s), np.int8)
    for begin, end, speed, kind in line.spans:
        inside = (s >= begin) & (s <= end)
        limit[inside], sky[inside] = speed, kind
    heading = _heading(s, x, y, limit, line.turns)
    grade = np.gradient(_smooth(z, network.altitude_smoothing), STEP)
    pitch = np.arctan(np.clip(grade, -network.grade_limit, network.grade_limit))
    pitch = gaussian_filter1d(pitch, 5.0 / STEP, mode="nearest")
    heading, north, east = _steer(heading, pitch, y, x)
    n = min(int(np.ceil((line.spans[-1][0] + network.arrival + OVERRUN) / STEP)) + 1, len(s))
    return Route(
        s=s[:n],
        north=north[:n],
        east=east[:n],
        altitude=(z[0] + _integral(np.sin(pitch)))[:n],
        heading=heading[:n],
        pitch=pitch[:n],
        straightness=np.gradient(heading, STEP)[:n],
        vertical_straightness=np.gradient(pitch, STEP)[:n],
        speed_limit=limit[:n],
        sky=sky[:n],
        origin=network.origin,
    )


class _Line:
    """The drawn line of the ego's way: `points` (n, 4) s, east, north, z; `spans` of edges; `turns`."""

    def __init__(self, network: Network) -> None:
        net = read(network.net)
        rows: list[NDArray[np.float64]] = []
        self.spans: list[tuple[float, float, float, int]] = []
        self.turns: list[tuple[float, float]] = []
        straight: list[tuple[float, float, float]] = []
        at = -network.depart
        for name, (entered, left, link) in zip(network.edges, lane_path(net, network.edges), strict=True):
            edge, begin = net.edges[name], at
            points = _blend(edge.lanes[entered], edge.lanes[left])
            rows.append(np.column_stack([at + points[:, 0] * edge.length, points[:, 1:]]))
            at = junction = at + edge.length
            for via in link.via if link else ():
                lane = net.internal[via]
                points = _blend(lane, lane)
                if link and link.direction != "s":
                    rows.append(np.column_stack([at + points[:, 0] * lane.length, points[:, 1:]]))
                at += lane.length
            if link and link.direction == "s":
                straight.append((junction, at, edge.speed))
            elif link:
                self.turns.append((junction - TURN_REACH, at + TURN_REACH))
            kind = TUNNEL if name in network.tunnels else CANYON if name in network.canyons else OPEN_SKY
            self.spans.append((begin, at, edge.speed, kind))
        self.end = at
        points = np.concatenate(rows)
        points[:, 1] -= net.offset[0]
        points[:, 2] -= net.offset[1]
        for junction, after, speed in straight:
            points = _move_over(points, junction, after, speed)
        self.points = points[np.concatenate([[True], np.diff(points[:, 0]) > 1e-6])]


def _move_over(points: NDArray[np.float64], junction: float, after: float, speed: float) -> NDArray[np.float64]:
    """Spread the sideways jump between the lanes before and after a straight junction over `SWERVE` seconds of road."""
    last = int(np.searchsorted(points[:, 0], junction + 1e-6)) - 1
    first = int(np.searchsorted(points[:, 0], after - 1e-6))
    if last < 1 or first + 1 >= len(points):
        return points
    before = points[last, 1:3] - points[last - 1, 1:3]
    beyond = points[first + 1, 1:3] - points[first, 1:3]
    along = before / max(np.hypot(*before), 1e-9) + beyond / max(np.hypot(*beyond), 1e-9)
    along /= max(np.hypot(*along), 1e-9)
    aside = np.array([-along[1], along[0]])
    jump = float(aside @ (points[first, 1:3] - points[last, 1:3]))
    reach = 0.5 * max(SWERVE * speed, 20.0)
    s = points[:, 0]
    # Enough points for the swerve's shape.
    extra = np.concatenate([np.linspace(junction - reach, junction, 9), np.linspace(after, after + reach, 9)])
    extra = extra[(extra > s[0]) & (extra < s[-1])]
    grid = np.union1d(s, extra)
    points = np.column_stack([grid, *(np.interp(grid, s, points[:, k]) for k in (1, 2, 3))])
    u = np.where(grid <= junction, 1.0 - (junction - grid) / reach, 1.0 - (grid - after) / reach)
    share = np.clip(u, 0.0, 1.0)
    share = 0.5 * share**2 * (3.0 - 2.0 * share)
    sign = np.where(grid <= 0.5 * (junction + after), 1.0, -1.0)
    points[:, 1:3] += jump * (sign * share)[:, None] * aside
    return points


def _heading(
    s: NDArray[np.float64],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    limit: NDArray[np.float64],
    turns: list[tuple[float, float]],
) -> NDArray[np.float64]:
    """Smooth heading of the line x, y: narrowly at turns, widely on fast roads, hairpins as a car can turn."""
    raw = np.unwrap(np.arctan2(np.diff(x), np.diff(y)))
    raw = np.append(raw, raw[-1])
    at_turn = np.zeros(len(s))
    for begin, end in turns:
        at_turn[(s >= begin) & (s <= end)] = 1.0

    def blurred(share: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
        return gaussian_filter1d(share, sigma / STEP, mode="nearest")

    at_turn = blurred(at_turn, 5.0)
    fast = blurred((limit > 60.0 / 3.6).astype(float), 20.0)
    heading = at_turn * blurred(raw, TURN) + (1.0 - at_turn) * (
        fast * blurred(raw, ROAD) + (1.0 - fast) * blurred(raw, STREET)
    )
    tight = blurred((np.abs(np.gradient(heading, STEP)) > 1.0 / TIGHT).astype(float), 8.0)
    tight = blurred(np.minimum(8.0 * tight, 1.0), 4.0)
    return tight * blurred(raw, HAIRPIN) + (1.0 - tight) * heading


def _steer(
    heading: NDArray[np.float64],
    pitch: NDArray[np.float64],
    drawn_north: NDArray[np.float64],
    drawn_east: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Integrate heading and pitch to a line, steering gently back to the drawn one; return heading, north, east."""
    count = len(heading)
    steered, north, east = np.empty(count), np.empty(count), np.empty(count)
    n, e = float(drawn_north[0]), float(drawn_east[0])
    correction = 0.0
    for i in range(count):
        psi = heading[i]
        off = (drawn_east[i] - e) * np.cos(psi) - (drawn_north[i] - n) * np.sin(psi)
        wanted = min(max(STEERING * off, -STEERING_LIMIT), STEERING_LIMIT)
        correction += (wanted - correction) * STEP / 15.0
        steered[i], north[i], east[i] = psi + correction, n, e
        advance = STEP * np.cos(pitch[i])
        n, e = n + advance * np.cos(steered[i]), e + advance * np.sin(steered[i])
    return steered, north, east


def _integral(slope: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]))]) * STEP


def _smooth(line: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Gaussian over an evenly spaced line, continued straight beyond its ends so that they stay in place."""
    n = min(int(4 * sigma / STEP) + 1, len(line) - 1)
    before = 2 * line[0] - line[n:0:-1]
    after = 2 * line[-1] - line[-2 : -n - 2 : -1]
    return gaussian_filter1d(np.concatenate([before, line, after]), sigma / STEP)[n : n + len(line)]
