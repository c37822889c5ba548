"""The road map: its files, and matching a drive to it."""

import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from trips import drive_along, smart, winding_route

from sensors import quadtile
from sensors.box import BoxSettings, record
from sensors.elevation import altitude_profile
from sensors.log import SensorLog
from sensors.matching import Matcher, events, observations
from sensors.packets import decode
from sensors.projection import to_geodetic, to_local
from sensors.road_files import inverse_transverse_mercator
from sensors.roadmap import RoadMap, from_osm, from_route, from_sumo_network, join, read_road
from vehicle_model.car.errors import BadInput

ROADS = Path(__file__).parents[2] / ".." / "shared" / "data" / "roads"


@pytest.fixture(scope="module")
def driven():
    route = winding_route(7000.0, tunnel=(3000.0, 3500.0))
    trip = drive_along(route)
    car = smart()
    road = from_route(route, 0)
    log = decode(record(trip, car))
    return route, trip, car, road, log, observations(log, road, car.metres_per_tick)


def test_matched_nodes_tell_heading_and_altitude_within_their_deviations(driven):
    _, trip, _, _, _, found = driven
    heading, altitude = (np.interp(found["t"], trip.time, getattr(trip, name)) for name in ("heading", "altitude"))
    off = (found["heading"] - heading + np.pi) % (2 * np.pi) - np.pi
    assert np.sqrt(np.mean((off / found["heading_sigma"]) ** 2)) < 1.2
    normal = (found["altitude"] - altitude) / found["altitude_sigma"]
    assert 0.7 < normal.std() < 1.3
    assert abs(normal.mean()) < 0.3


def test_almost_every_node_is_observed_once_and_in_order(driven):
    _route, trip, _, road, _, found = driven
    assert found.size > 0.9 * road.elevation.size
    s = np.interp(found["t"], trip.time, trip.distance)
    assert np.all(np.diff(s) > 25.0)


def test_matching_goes_on_in_the_tunnel_by_odometer_alone(driven):
    _, trip, _, _, _, found = driven
    s = np.interp(found["t"], trip.time, trip.distance)
    assert ((s > 3020.0) & (s < 3480.0)).sum() >= 8


def test_a_receiver_that_is_stuck_holds_the_car_nowhere(driven):
    """Given the same fix again and again for a minute, then what is passed is told as by the odometer alone."""
    _, trip, car, road, log, _ = driven
    fixes = log["gps"].copy()
    stuck = np.flatnonzero((fixes["t"] > 60.0) & (fixes["t"] < 120.0))
    for name in ("latitude", "longitude", "altitude", "speed", "course"):
        fixes[name][stuck] = fixes[name][stuck[0] - 1]
    found = observations(SensorLog({**log.streams, "gps": fixes}), road, car.metres_per_tick)
    while_stuck = found[(found["t"] > 62.0) & (found["t"] < 125.0)]
    assert while_stuck.size > 10
    off = while_stuck["altitude"] - np.interp(while_stuck["t"], trip.time, trip.altitude)
    assert np.abs(off / while_stuck["altitude_sigma"]).max() < 4.0


def test_what_is_passed_is_known_only_after_it_was_passed(driven):
    _, _, car, road, log, found = driven
    rows, place = events(log, road, car.metres_per_tick)
    known_at = rows[np.searchsorted(place, found["order"]), 0]
    assert np.all(found["t"] <= known_at)
    assert np.all(known_at - found["t"] <= 1.0)


def test_event_by_event_gives_the_same_bits_as_the_whole_log(driven):
    _, _, car, road, log, found = driven
    rows, place = events(log, road, car.metres_per_tick)
    matcher = Matcher(road)
    parts = [matcher.update(rows[i : i + 1]).copy() for i in range(12_000)]
    joined = np.concatenate(parts)
    joined["order"] = place[joined["order"].astype(int)]
    assert joined.tobytes() == found[: joined.size].tobytes()


def test_off_the_map_nothing_is_claimed(driven):
    _, _, car, _, log, _ = driven
    elsewhere = winding_route(3000.0)
    far = from_route(elsewhere, 0)
    moved = RoadMap(far.latitude + 0.5, far.longitude, far.way_start, far.way_nodes, far.elevation_start, far.elevation)
    assert observations(log, moved, car.metres_per_tick).size == 0


def test_a_fork_in_the_tunnel_is_ambiguous_until_a_fix_decides():
    """Two roads part in a tunnel at a small angle: nothing may be told between the fork and the next fixes."""
    route = winding_route(3000.0, tunnel=(1000.0, 1600.0))
    car, trip = smart(), drive_along(route)
    road = from_route(route, 0, BoxSettings(road_map_altitude_error=0.0))
    north, east = to_local(road.latitude, road.longitude, route.origin)
    s_of_node = np.array(
        [route.s[np.argmin(np.hypot(route.north - n, route.east - e))] for n, e in zip(north, east, strict=True)]
    )
    fork = int(np.argmin(np.abs(s_of_node - 1200.0)))
    direction = np.interp(s_of_node[fork], route.s, route.heading) + 0.15
    reach = np.arange(50.0, 1500.0, 50.0)
    branch = to_geodetic(north[fork] + reach * np.cos(direction), east[fork] + reach * np.sin(direction), route.origin)
    ways = [
        (road.way_nodes[slice(*nodes)], road.elevation[slice(*heights)])
        for nodes, heights in zip(pairwise(road.way_start), pairwise(road.elevation_start), strict=True)
    ]
    extra = np.arange(road.latitude.size, road.latitude.size + reach.size)
    ways.append((np.concatenate(([fork], extra)), np.full(30, 500.0)))
    forked = join(ways, np.concatenate((road.latitude, branch[0])), np.concatenate((road.longitude, branch[1])))
    found = observations(decode(record(trip, car)), forked, car.metres_per_tick)
    s = np.interp(found["t"], trip.time, trip.distance)
    assert ((s > 1030.0) & (s < 1170.0)).sum() >= 2
    assert ((s > 1320.0) & (s < 1580.0)).sum() == 0
    assert (s > 1800.0).sum() > 10
    assert np.abs(found["altitude"] - 500.0).min() > 50.0


def test_the_altitude_ahead_is_smoothed_from_the_map_alone():
    route = winding_route(8000.0)
    road = from_route(route, 1)
    altitude, pitch = altitude_profile(road, route.s, *to_geodetic(route.north, route.east, route.origin))
    assert (altitude - route.altitude).std() < 0.7
    assert (pitch - route.pitch).std() < 0.25 * route.pitch.std()


def test_grade_bias_and_shift_are_in_the_map():
    route = winding_route(2000.0)
    clean = from_route(route, 0, BoxSettings(road_map_altitude_error=0.0))
    biased = from_route(route, 0, BoxSettings(road_map_altitude_error=0.0, road_map_grade_bias=0.003))
    assert biased.elevation[-1] - clean.elevation[-1] == pytest.approx(6.0, rel=0.01)
    shifted = from_route(route, 0, BoxSettings(road_map_altitude_error=0.0, road_map_shift=20.0))
    at = np.linspace(0.0, 2000.0, clean.elevation.size)
    assert shifted.elevation[1:] == pytest.approx(np.interp(at[1:] - 20.0, route.s, route.altitude), abs=0.05)


def test_quad_tile_codes_follow_the_appendix():
    code = quadtile.quad_code(np.array([-25.0, 72.0]), np.array([134.0, -40.0]))
    assert [int(value) >> 62 for value in code] == [0b11, 0b00], "Australia in tile 11, Greenland in 00"


def test_quad_tile_files_byte_for_byte(tmp_path):
    latitude, longitude = np.array([49.61, 49.62]), np.array([6.13, 6.14])
    road = join([(np.array([0, 1]), np.array([300.0, 301.5, 303.25]))], latitude, longitude)
    road.write(tmp_path)
    codes = sorted(int(code) for code in quadtile.quad_code(latitude, longitude))
    by_code = {
        int(c): (round(a * 1e7), round(b * 1e7))
        for c, a, b in zip(quadtile.quad_code(latitude, longitude), latitude, longitude, strict=True)
    }
    nodes = b"".join(struct.pack("<QiiHI", code, *by_code[code], 1, 0) for code in codes)
    assert (tmp_path / "nodes.dat").read_bytes() == nodes
    members = [int(code) for code in quadtile.quad_code(latitude, longitude)]
    heights = [round((10_000 + z) * 1000) for z in (300.0, 301.5, 303.25)]
    assert (tmp_path / "ways.dat").read_bytes() == struct.pack("<IH2QH3I", 0, 2, *members, 3, *heights)
    # Root: the upper of two keys; its left child holds the lower.
    assert (tmp_path / "nodes.idx").read_bytes() == struct.pack("<QIIQ", codes[1], 24, 0, 22) + struct.pack(
        "<QIIQ", codes[0], 0, 0, 0
    )
    assert (tmp_path / "ways.idx").read_bytes() == struct.pack("<IIIQ", 0, 0, 0, 0)


def test_the_trees_find_every_node_way_and_tile(tmp_path):
    road = from_route(winding_route(5000.0), 0)
    road.write(tmp_path)
    tree, data = (tmp_path / "nodes.idx").read_bytes(), (tmp_path / "nodes.dat").read_bytes()
    for code in quadtile.quad_code(np.round(road.latitude, 7), np.round(road.longitude, 7)):
        at = quadtile.find(tree, "nodes", int(code))
        assert at is not None
        assert struct.unpack_from("<Q", data, at)[0] == int(code)
    assert quadtile.find(tree, "nodes", 12345) is None
    ways = (tmp_path / "ways.dat").read_bytes()
    for way in range(road.ways):
        at = quadtile.find((tmp_path / "ways.idx").read_bytes(), "ways", way)
        assert struct.unpack_from("<I", ways, at)[0] == way
        for node in road.way_nodes[road.way_start[way] : road.way_start[way + 1]]:
            assert way in quadtile.ways_at(tmp_path, road.latitude[node], road.longitude[node])
    assert quadtile.ways_at(tmp_path, 10.0, 10.0).size == 0


def test_a_map_read_back_is_the_map_written(tmp_path):
    road = from_route(winding_route(5000.0), 0)
    road.write(tmp_path)
    back = read_road(tmp_path)
    for old, new in ((road.latitude, back.latitude), (road.longitude, back.longitude)):
        assert np.abs(old[road.way_nodes] - new[back.way_nodes]).max() < 6e-8
    assert np.abs(road.elevation - back.elevation).max() <= 0.5001e-3
    assert np.array_equal(road.way_start, back.way_start)


@pytest.mark.parametrize("name", ["nodes.dat", "ways.dat"])
def test_cut_or_missing_map_files_are_told(tmp_path, name):
    from_route(winding_route(1000.0), 0).write(tmp_path)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[:-3])
    with pytest.raises(BadInput, match=name):
        RoadMap.read(tmp_path)
    (tmp_path / name).unlink()
    with pytest.raises(BadInput, match=name):
        RoadMap.read(tmp_path)


def test_openstreetmap_with_ele(tmp_path):
    path = tmp_path / "road.osm"
    nodes = "".join(
        f'<node id="{i}" lat="{49.6 + 0.001 * i}" lon="6.1"><tag k="ele" v="{300 + 5 * i}"/></node>' for i in range(5)
    )
    refs = "".join(f'<nd ref="{i}"/>' for i in range(5))
    path.write_text(f'<osm version="0.6">{nodes}<way id="1">{refs}<tag k="highway" v="primary"/></way></osm>')
    road = from_osm(path)
    assert road.ways == 1
    assert road.elevation[0] == 300.0
    assert road.elevation[-1] == 320.0
    assert np.all(np.diff(road.elevation) > 0)
    _link, s, across = road.nearest(49.6015, 6.1001)
    assert s == pytest.approx(166.8, abs=1.0)
    assert across == pytest.approx(7.2, abs=0.2)
    assert road.nearest(49.6015, 6.1001, heading=np.pi / 2) is None


@pytest.mark.parametrize("text", ["", "<osm>", "<net/>", "<osm></osm>", '<osm><node id="1" lat="x" lon="1"/></osm>'])
def test_what_is_no_road_is_told_in_one_line(tmp_path, text):
    path = tmp_path / "road.osm"
    path.write_text(text)
    with pytest.raises(BadInput):
        from_osm(path)


def test_sumo_network_in_a_local_transverse_mercator(tmp_path):
    path = tmp_path / "road.net.xml"
    path.write_text(
        '<net><location netOffset="0.00,0.00" projParameter="+proj=tmerc +lat_0=49.6 +lon_0=6.1 +k=1 +ellps=WGS84"/>'
        '<edge id="a" from="p" to="q" shape="0,0,100 0,500,110"><lane id="a_0" index="0" shape="3,0 3,500"/></edge>'
        '<edge id="-a" from="q" to="p" shape="0,500,110 0,0,100"><lane id="b_0" index="0" shape="-3,500 -3,0"/></edge>'
        "</net>"
    )
    road = read_road(path)
    assert road.ways == 1
    north, east = to_local(road.latitude, road.longitude, (49.6, 6.1))
    assert north == pytest.approx([0.0, 500.0], abs=0.01)
    assert east == pytest.approx([0.0, 0.0], abs=0.01)
    assert road.elevation[[0, -1]] == pytest.approx([100.0, 110.0])


def test_a_network_without_projection_needs_an_origin(tmp_path):
    path = tmp_path / "road.net.xml"
    path.write_text(
        '<net><location netOffset="0,0" projParameter="!"/><edge id="a" from="p" to="q" shape="0,0 0,500"/></net>'
    )
    with pytest.raises(BadInput, match="projParameter"):
        from_sumo_network(path)
    assert from_sumo_network(path, (49.6, 6.1)).ways == 1


def test_inverse_mercator_against_a_known_place():
    # Luxembourg's cathedral, 49.60917 N 6.13139 E, in UTM 32: 292,817.6 E, 5,499,092.9 N (by an independent series).
    latitude, longitude = inverse_transverse_mercator(np.array([0.0]), np.array([5_499_092.9]), 0.0, 9.0, 0.9996)
    assert longitude[0] == pytest.approx(9.0)
    # On the central meridian the meridian arc is known in closed form by quadrature.
    from scipy.integrate import quad

    e2 = 2 / 298.257223563 - (1 / 298.257223563) ** 2
    arc = quad(lambda p: 6378137.0 * (1 - e2) / (1 - e2 * np.sin(p) ** 2) ** 1.5, 0.0, np.radians(latitude[0]))[0]
    assert 0.9996 * arc == pytest.approx(5_499_092.9, abs=1e-3)


@pytest.mark.skipif(not (ROADS / "monaco" / "network.osm").is_file(), reason="the extract of Monaco is not at hand")
def test_a_real_city_reads_and_comes_back(tmp_path):
    road = from_osm(ROADS / "monaco" / "network.osm")
    assert road.ways > 500
    assert road.elevation.size > 1000
    road.write(tmp_path)
    back = RoadMap.read(tmp_path)
    assert back.ways == road.ways
    assert back.roads.start.size == road.roads.start.size


def test_damaged_trees_neither_hang_nor_crash(tmp_path):
    """A tree that leads back to itself, and one that points beyond its file."""
    loop = quadtile.BINARY_ENTRY["ways"].pack(5, 20, 20, 7) + quadtile.BINARY_ENTRY["ways"].pack(5, 20, 20, 7)
    assert quadtile.find(loop, "ways", 9) is None
    for name, content in (("tiles.idx", quadtile.QUAD_ENTRY.pack(0, *[2**31] * 4, 0)), ("tiles.dat", b"")):
        (tmp_path / name).write_bytes(content)
    with pytest.raises(BadInput, match="pointers"):
        quadtile.ways_at(tmp_path, 49.6, 6.1)
