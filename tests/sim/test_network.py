"""The road that ships is the road that was promised; extracts become roads or a clear refusal."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from scenarios import files
from sim.graph import way_graph
from sim.net_file import read
from sim.network import Network, build
from sim.route import true_route
from vehicle_model.car.errors import BadInput
from vehicle_model.car.route import CANYON, TUNNEL


def test_mixed_has_what_the_scenario_promises(mixed: Network) -> None:
    net, route = read(mixed.net), true_route(mixed)
    signals = sum(net.links[pair][0].state in "oO" for pair in zip(mixed.edges, mixed.edges[1:], strict=False))
    assert 12_000 <= route.length <= 15_000
    assert signals >= 6
    assert np.isclose((route.sky == TUNNEL).sum(), 600, atol=25)
    assert (route.sky == CANYON).sum() > 300
    grade = np.tan(route.pitch)
    assert 0.07 < grade.max() < 0.082 and -0.082 < grade.min() < -0.07
    fast = route.speed_limit > 36.0
    assert fast.sum() > 3_000
    assert len({round(v, 1) for v in route.speed_limit}) >= 5


def test_geometry_is_smooth_and_agrees_with_distance(mixed: Network) -> None:
    route = true_route(mixed)
    steps = np.sqrt(np.diff(route.north) ** 2 + np.diff(route.east) ** 2 + np.diff(route.altitude) ** 2)
    np.testing.assert_allclose(steps, np.diff(route.s), rtol=1e-4)
    # A street corner of 90 degrees is the sharpest bend, a bend of 8 m radius the tightest.
    assert np.abs(np.diff(route.heading)).max() < 1.0 / 8.0
    assert np.abs(np.diff(route.pitch)).max() < 2e-3
    moved = np.arctan2(np.diff(route.east), np.diff(route.north))
    middle = 0.5 * (route.heading[1:] + route.heading[:-1])
    assert np.abs(np.angle(np.exp(1j * (moved - middle)))).max() < 0.07


def test_route_lies_on_the_drawn_road(mixed: Network) -> None:
    from scipy.spatial import cKDTree

    net, route = read(mixed.net), true_route(mixed)
    drawn = []
    for name in mixed.edges:
        shape = net.edges[name].lanes[0].shape[:, :2] - np.array(net.offset)
        for a, b in itertools.pairwise(shape):
            drawn.append(np.linspace(a, b, int(np.hypot(*(b - a))) + 2))
    gap, _ = cKDTree(np.concatenate(drawn)).query(np.column_stack([route.east, route.north]))
    assert gap.mean() < 2.0


def test_the_route_that_ships_matches_its_design() -> None:
    """The plain XML in the repository is what the design script writes."""
    from scenarios.roads.draft import Draft
    from scenarios.roads.mixed_design import motorway, town_and_hills

    draft = Draft()
    motorway(draft, town_and_hills(draft))
    written = (files.ROADS / "mixed" / "mixed.edg.xml").read_text()
    assert written == "<edges>\n" + "\n".join(f"  {edge}" for edge in draft.edges) + "\n</edges>\n"


def test_extract_becomes_a_road_with_a_route_of_at_least_3_km(grid_osm: Path, tmp_path: Path) -> None:
    network = build(files.from_osm(grid_osm), tmp_path / "net")
    route = true_route(network)
    assert route.length > 3_000
    assert any("smoothed" in note for note in network.notes)
    assert np.abs(np.tan(route.pitch)).max() <= network.grade_limit
    # Each way of the route is a connection that the network has, and none of them turns round.
    net = read(network.net)
    links = [net.links[pair] for pair in zip(network.edges, network.edges[1:], strict=False)]
    assert all(link[0].direction != "t" for link in links)


def test_ends_are_taken_to_the_nearest_road_and_the_tunnel_is_dark(grid_osm: Path, tmp_path: Path) -> None:
    scenario = files.from_osm(grid_osm, (49.6001, 6.1005), (49.6002, 6.1650))
    network = build(scenario, tmp_path / "net")
    route = true_route(network)
    assert (route.sky == TUNNEL).sum() > 300
    assert abs(route.north[0]) < 300 and 4_000 < route.east[-1] - route.east[0] < 5_000


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<osm version='0.6'></osm>", "no nodes"),
        ("<osm version='0.6'><node id='1' lat='49' lon='6'/></osm>", "road"),
        ("this is not XML", "OpenStreetMap XML"),
        ("<osm><node id='1' lat='north' lon='6'/></osm>", "lat and lon"),
        (
            "<osm version='0.6'><node id='1' lat='49' lon='6'/><node id='2' lat='49.01' lon='6'/>"
            "<way id='3'><nd ref='1'/><nd ref='2'/><tag k='highway' v='footway'/></way></osm>",
            "road",
        ),
    ],
)
def test_unusable_extract_is_refused_in_one_line(text: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.osm"
    path.write_text(text)
    with pytest.raises(BadInput, match=expected) as refusal:
        build(files.from_osm(path), tmp_path / "net")
    assert str(path) in str(refusal.value) and "\n" not in str(refusal.value)
    assert not (tmp_path / "net" / "road.net.xml").exists() or "route" in str(refusal.value)


def test_no_way_between_the_ends_is_refused(tmp_path: Path) -> None:
    rows = []
    for island, lat in ((0, 49.600), (10, 49.650)):
        rows += [f"<node id='{island + i}' lat='{lat}' lon='{6.10 + 0.01 * i}'/>" for i in range(1, 5)]
    for island in (0, 10):
        for i in range(1, 4):
            rows.append(
                f"<way id='{100 + island + i}'><nd ref='{island + i}'/><nd ref='{island + i + 1}'/>"
                "<tag k='highway' v='primary'/></way>"
            )
    path = tmp_path / "islands.osm"
    path.write_text("<osm version='0.6'>" + "".join(rows) + "</osm>")
    with pytest.raises(BadInput, match="no way by car"):
        build(files.from_osm(path, (49.600, 6.111), (49.650, 6.121)), tmp_path / "net")
    with pytest.raises(BadInput, match="nearest drivable road"):
        build(files.from_osm(path, (49.62, 6.111), (49.650, 6.121)), tmp_path / "net2")


def test_fastest_ways_agree_with_a_slow_search(mixed: Network) -> None:
    """Dijkstra on the graph of connections against Bellman-Ford written out."""
    graph = way_graph(read(mixed.net))
    origin = graph.index[mixed.edges[0]]
    times, _ = graph.ways(np.array([origin]))
    arcs = graph.times.tocoo()
    slow = np.full(len(graph.names), np.inf)
    slow[origin] = 0.0
    for _ in range(len(graph.names)):
        np.minimum.at(slow, arcs.col, slow[arcs.row] + arcs.data)
    np.testing.assert_allclose(times[0], slow)


def test_an_extract_of_one_long_road_is_driven_along(tmp_path: Path) -> None:
    path = tmp_path / "road.osm"
    nodes = "".join(f"<node id='{i}' lat='{49.6 + 0.004 * i}' lon='6.1'/>" for i in range(1, 14))
    refs = "".join(f"<nd ref='{i}'/>" for i in range(1, 14))
    path.write_text(f"<osm version='0.6'>{nodes}<way id='1'>{refs}<tag k='highway' v='primary'/></way></osm>")
    assert true_route(build(files.from_osm(path), tmp_path / "net")).length > 5_000
