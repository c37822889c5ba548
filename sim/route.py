"""The ego's road as it truly is, made smooth from the lanes of a compiled network."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from sim.net_file import Lane, Link, NetFile, read
from sim.network import Network
from vehicle_model.car.route import CANYON, OPEN_SKY, TUNNEL, Route

STEP = 1.0
"""m between the points of a route."""
TURN_SMOOTHING, STREET_SMOOTHING, ROAD_SMOOTHING = 5.0, 10.0, 25.0
"""m: sigmas of the Gaussian laid over x(s), y(s): at a turn, along a street and on faster roads, where the steps from
lane to lane that a network has at its junctions must become the gentle swerves that a car drives."""
OVERRUN = 2.0
"""m of road beyond the destination."""
TURN_REACH = 30.0
"""m before and after a turn where the narrow Gaussian holds."""


def lane_path(net: NetFile, edges: tuple[str, ...]) -> list[tuple[int, int, Link | None]]:
    """For each edge the lane entered on, the lane left on and the link taken, with the fewest lane changes."""
    cost = {lane: (0.0, []) for lane in range(len(net.edges[edges[0]].lanes))}
    for here, there in zip(edges, edges[1:], strict=False):
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

    Altitude and plane are smoothed by Gaussians (`Network.altitude_smoothing`, `TURN_SMOOTHING` ...), grades clipped to
    `Network.grade_limit`. The smoothed line is shorter than SUMO's distance (corners are cut): it is stretched about
    its start by that ratio, a few 1e-4, so that geometry and distance agree exactly.
    """
    net = read(network.net)
    rows: list[NDArray[np.float64]] = []
    sky_spans: list[tuple[float, float, int]] = []
    limits: list[tuple[float, float, float]] = []
    turns: list[tuple[float, float]] = []
    at = -network.depart

    def lay(points: NDArray[np.float64], length: float) -> None:
        nonlocal at
        rows.append(np.column_stack([at + points[:, 0] * length, points[:, 1:]]))
        at += length

    for name, (entered, left, link) in zip(network.edges, lane_path(net, network.edges), strict=True):
        edge, begin = net.edges[name], at
        lay(_blend(edge.lanes[entered], edge.lanes[left]), edge.length)
        corner = at
        for via in link.via if link else ():
            lane = net.internal[via]
            lay(_blend(lane, lane), lane.length)
        if link and link.direction != "s":
            turns.append((corner - TURN_REACH, at + TURN_REACH))
        limits.append((begin, at, edge.speed))
        kind = TUNNEL if name in network.tunnels else CANYON if name in network.canyons else OPEN_SKY
        sky_spans.append((begin, at, kind))

    raw = np.concatenate(rows)
    raw = raw[np.concatenate([[True], np.diff(raw[:, 0]) > 1e-6])]
    s = np.arange(0.0, np.floor(at / STEP) * STEP + 0.5 * STEP, STEP)
    x, y, z = (np.interp(s, raw[:, 0], raw[:, k]) for k in (1, 2, 3))
    limit = np.empty_like(s)
    for begin, end, value in limits:
        limit[(s >= begin) & (s <= end)] = value
    x, y = _smooth_plane(s, x, y, limit, turns)
    z = _smooth(z, network.altitude_smoothing)
    grade = np.diff(z) / STEP
    if np.abs(grade).max() > network.grade_limit:
        z = np.concatenate([[z[0]], z[0] + np.cumsum(np.clip(grade, -network.grade_limit, network.grade_limit) * STEP)])
        z = _smooth(z, 15.0)

    # Even spacing in true arc length; the route's length stays SUMO's.
    arc = np.concatenate([[0.0], np.cumsum(np.sqrt(np.diff(x) ** 2 + np.diff(y) ** 2 + np.diff(z) ** 2))])
    stretch = s[-1] / arc[-1]
    x, y, z = (line[0] + stretch * (np.interp(s, arc * stretch, line) - line[0]) for line in (x, y, z))
    east, north = x - net.offset[0], y - net.offset[1]
    heading, pitch = _direction(x, y, z)
    sky = np.zeros(len(s), np.int8)
    for begin, end, kind in sky_spans:
        sky[(s >= begin) & (s <= end)] = kind
    last_edge = sky_spans[-1][0]
    n = min(int(np.ceil((last_edge + network.arrival + OVERRUN) / STEP)) + 1, len(s))
    return Route(
        s=s[:n],
        north=north[:n],
        east=east[:n],
        altitude=z[:n],
        heading=heading[:n],
        pitch=pitch[:n],
        straightness=np.gradient(heading, STEP)[:n],
        vertical_straightness=np.gradient(pitch, STEP)[:n],
        speed_limit=limit[:n],
        sky=sky[:n],
        origin=network.origin,
    )


def _smooth_plane(
    s: NDArray[np.float64],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    limit: NDArray[np.float64],
    turns: list[tuple[float, float]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    at_turn = np.zeros(len(s))
    for begin, end in turns:
        at_turn[(s >= begin) & (s <= end)] = 1.0
    at_turn = gaussian_filter1d(at_turn, 10.0 / STEP, mode="nearest")
    fast = gaussian_filter1d((limit > 60.0 / 3.6).astype(float), 20.0 / STEP, mode="nearest")

    def smooth(line: NDArray[np.float64]) -> NDArray[np.float64]:
        turn, street, road = (_smooth(line, sigma) for sigma in (TURN_SMOOTHING, STREET_SMOOTHING, ROAD_SMOOTHING))
        return at_turn * turn + (1.0 - at_turn) * (fast * road + (1.0 - fast) * street)

    return smooth(x), smooth(y)


def _direction(
    x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    dx, dy, dz = (gaussian_filter1d(np.gradient(line, STEP), 2.0, mode="nearest") for line in (x, y, z))
    return np.unwrap(np.arctan2(dx, dy)), np.arctan2(dz, np.hypot(dx, dy))


def _smooth(line: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Gaussian over an evenly spaced line, continued straight beyond its ends so that they stay in place."""
    n = min(int(4 * sigma / STEP) + 1, len(line) - 1)
    before = 2 * line[0] - line[n:0:-1]
    after = 2 * line[-1] - line[-2 : -n - 2 : -1]
    return gaussian_filter1d(np.concatenate([before, line, after]), sigma / STEP)[n : n + len(line)]
