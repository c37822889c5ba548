"""Quad-tile files: the road map byte for byte as appendix C.1.1 lays it out, but for two departures.

Six little-endian files. Data: `nodes.dat` (table C.1), `ways.dat` (C.2), `tiles.dat` (C.3). Trees: `nodes.idx` (C.4),
`ways.idx` (C.5), `tiles.idx` (C.6); the first entry of a tree is its root. Pointers within a tree are byte offsets of
its own file, 0 for none (nothing points at the root); pointers to data are byte offsets, all ones for none.

Departures (CLI.md, "At the door"): node ids are 64-bit, zoom 32, since a 32-bit id *is* its zoom-16 tile and collides
on any real road; counts are 16-bit. What the tables leave open: level 1 is in the two highest bits (note 31 leaves it
free), of each pair the high bit is right, the low bit bottom; tiles are of the spherical Mercator square; latitude and
longitude in 1e-7 degrees; an elevation is (metres + 10,000) x 1000, so that the sea floor is positive; a tile's way
counts where one of its segments crosses the tile's square.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vehicle_model.car.errors import BadInput

ZOOM = 16
"""Of the bounding boxes: at most 600 m on a side."""
DEGREE = 1e-7
NONE = 0xFFFF_FFFF_FFFF_FFFF
MOST = 0xFFFF
ELEVATION_BASE, ELEVATION_UNIT = 10_000.0, 1e-3
BINARY_ENTRY = {"nodes": struct.Struct("<QIIQ"), "ways": struct.Struct("<IIIQ")}
QUAD_ENTRY = struct.Struct("<QIIIIQ")
FILES = ("nodes.dat", "nodes.idx", "ways.dat", "ways.idx", "tiles.dat", "tiles.idx")


@dataclass(frozen=True)
class Database:
    """The arrays of a `RoadMap`."""

    latitude: NDArray[np.float64]
    longitude: NDArray[np.float64]
    way_start: NDArray[np.int64]
    way_nodes: NDArray[np.int64]
    elevation_start: NDArray[np.int64]
    elevation: NDArray[np.float64]


def coordinates(latitude: NDArray[np.floating], longitude: NDArray[np.floating]) -> tuple[NDArray, NDArray]:
    """Return (right, down) in the zoom-32 grid (uint64) of the spherical Mercator square."""
    sine = np.sin(np.radians(np.clip(latitude, -85.05112878, 85.05112878)))
    x = (np.asarray(longitude) + 180.0) / 360.0
    y = 0.5 - np.log((1.0 + sine) / (1.0 - sine)) / (4.0 * np.pi)
    return tuple(np.clip(np.floor(part * 2.0**32), 0, 2**32 - 1).astype(np.uint64) for part in (x, y))  # type: ignore[return-value]


def interleave(right: NDArray, down: NDArray) -> NDArray[np.uint64]:
    """Return the 64-bit quad-tile coordinates: pairs of bits (right, down), level 1 highest."""

    def spread(value: NDArray) -> NDArray[np.uint64]:
        out = value.astype(np.uint64)
        for shift, mask in (
            (16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF), (4, 0x0F0F0F0F0F0F0F0F),
            (2, 0x3333333333333333), (1, 0x5555555555555555),
        ):  # fmt: skip
            out = (out | (out << np.uint64(shift))) & np.uint64(mask)
        return out

    return (spread(right) << np.uint64(1)) | spread(down)


def quad_code(latitude: NDArray[np.floating], longitude: NDArray[np.floating]) -> NDArray[np.uint64]:
    """Return the 64-bit (zoom 32) quad-tile coordinate of places given in deg."""
    return interleave(*coordinates(np.asarray(latitude, dtype=np.float64), np.asarray(longitude, dtype=np.float64)))


def _rounded(degrees: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.round(degrees / DEGREE).astype(np.int64)


def tiles_of_ways(data: Database) -> list[tuple[int, NDArray[np.int64]]]:
    """Return (64-bit code of the zoom-16 tile, ways crossing it) in order of code."""
    right, down = (part.astype(np.float64) / 2.0**16 for part in coordinates(data.latitude, data.longitude))
    inside = np.ones(data.way_nodes.size, dtype=bool)
    inside[data.way_start[1:] - 1] = False
    a = np.flatnonzero(inside)
    way = np.repeat(np.arange(data.way_start.size - 1), np.diff(data.way_start))[a]
    first, second = data.way_nodes[a], data.way_nodes[a + 1]
    # Walk each segment in steps of at most a quarter tile, and count the cells of the steps' ends.
    steps = np.ceil(4.0 * np.maximum(np.abs(right[first] - right[second]), np.abs(down[first] - down[second]))) + 1
    steps = steps.astype(np.int64)
    offsets = np.cumsum(steps + 1) - (steps + 1)
    owner = np.repeat(np.arange(a.size), steps + 1)
    f = (np.arange(owner.size) - offsets[owner]) / steps[owner]
    column = np.floor(right[first][owner] + f * (right[second] - right[first])[owner]).astype(np.uint64)
    row = np.floor(down[first][owner] + f * (down[second] - down[first])[owner]).astype(np.uint64)
    code = interleave(column << np.uint64(16), row << np.uint64(16))
    pairs = np.unique(np.column_stack((code, way[owner].astype(np.uint64))), axis=0)
    codes, begins = np.unique(pairs[:, 0], return_index=True)
    groups = np.split(pairs[:, 1].astype(np.int64), begins[1:])
    return [(int(code), group) for code, group in zip(codes, groups, strict=True)]


def write(directory: Path, data: Database) -> None:
    """Write the six files into `directory` (made if need be); each aside, then renamed.

    Two nodes that share a zoom-32 tile (under 1 cm) become one. Raises BadInput for a way of more than 65,535 nodes.
    """
    directory.mkdir(parents=True, exist_ok=True)
    ways = data.way_start.size - 1
    counts = np.diff(data.way_start), np.diff(data.elevation_start)
    if ways and max(int(part.max()) for part in counts) > MOST:
        raise BadInput(directory, "ways.dat", f"ways of at most {MOST} nodes and elevations")
    latitude, longitude = _rounded(data.latitude), _rounded(data.longitude)
    codes = quad_code(latitude * DEGREE, longitude * DEGREE)
    ids, first, number = np.unique(codes, return_index=True, return_inverse=True)
    owner = np.repeat(np.arange(ways), counts[0])
    crossing = np.unique(np.column_stack((number.reshape(-1)[data.way_nodes], owner)), axis=0)
    begins = np.searchsorted(crossing[:, 0], np.arange(ids.size + 1))
    nodes = bytearray()
    node_at = []
    for i, code in enumerate(ids):
        of = crossing[begins[i] : begins[i + 1], 1]
        node_at.append(len(nodes))
        nodes += struct.pack("<QiiH", int(code), int(latitude[first[i]]), int(longitude[first[i]]), of.size)
        nodes += of.astype("<u4").tobytes()
    heights = np.round((data.elevation + ELEVATION_BASE) / ELEVATION_UNIT).astype("<u4")
    way_bytes = bytearray()
    way_at = []
    for i in range(ways):
        members = codes[data.way_nodes[data.way_start[i] : data.way_start[i + 1]]]
        levels = heights[data.elevation_start[i] : data.elevation_start[i + 1]]
        way_at.append(len(way_bytes))
        way_bytes += struct.pack("<IH", i, members.size) + members.astype("<u8").tobytes()
        way_bytes += struct.pack("<H", levels.size) + levels.tobytes()
    tiles = tiles_of_ways(data)
    tile_bytes = bytearray()
    tile_at = []
    for code, inside in tiles:
        tile_at.append(len(tile_bytes))
        tile_bytes += struct.pack("<QBH", code, ZOOM, inside.size) + inside.astype("<u4").tobytes()
    files = {
        "nodes.dat": bytes(nodes),
        "nodes.idx": _binary_tree("nodes", [int(code) for code in ids], node_at),
        "ways.dat": bytes(way_bytes),
        "ways.idx": _binary_tree("ways", list(range(ways)), way_at),
        "tiles.dat": bytes(tile_bytes),
        "tiles.idx": _quad_tree([code for code, _ in tiles], tile_at),
    }
    for name, content in files.items():
        aside = directory / (name + ".part")
        aside.write_bytes(content)
        aside.replace(directory / name)


def _binary_tree(kind: str, keys: list[int], data_at: list[int]) -> bytes:
    """A balanced binary search tree over sorted `keys`, root first."""
    entry = BINARY_ENTRY[kind]
    rows: list[list[int]] = []
    todo = [(0, len(keys), -1, 0)] if keys else []
    while todo:
        low, high, parent, side = todo.pop()
        middle = (low + high) // 2
        if parent >= 0:
            rows[parent][side] = len(rows) * entry.size
        rows.append([keys[middle], 0, 0, data_at[middle]])
        here = len(rows) - 1
        if middle + 1 < high:
            todo.append((middle + 1, high, here, 2))
        if low < middle:
            todo.append((low, middle, here, 1))
    return b"".join(entry.pack(*row) for row in rows)


def _quad_tree(codes: list[int], data_at: list[int]) -> bytes:
    """The quad search tree over zoom-16 tiles: the root is the whole world, children in the order 00, 01, 10, 11."""
    rows: list[list[int]] = [[0, 0, 0, 0, 0, NONE]]
    for code, at in zip(codes, data_at, strict=True):
        here = 0
        for level in range(1, ZOOM + 1):
            quarter = (code >> (64 - 2 * level)) & 3
            if rows[here][1 + quarter] == 0:
                rows[here][1 + quarter] = len(rows) * QUAD_ENTRY.size
                rows.append([code >> (64 - 2 * level) << (64 - 2 * level), 0, 0, 0, 0, NONE])
            here = rows[here][1 + quarter] // QUAD_ENTRY.size
        rows[here][5] = at
    return b"".join(QUAD_ENTRY.pack(*row) for row in rows)


def find(tree: bytes, kind: str, key: int) -> int | None:
    """Search a binary tree file (`nodes` or `ways`) for `key`; return the offset in the data file, or None.

    A damaged tree that leads back to itself ends after as many steps as it has entries.
    """
    entry = BINARY_ENTRY[kind]
    at = 0
    for _ in range(len(tree) // entry.size):
        if len(tree) < at + entry.size:
            break
        here, left, right, data = entry.unpack_from(tree, at)
        if here == key:
            return data
        at = left if key < here else right
        if at == 0:
            return None
    return None


def ways_at(directory: Path, latitude: float, longitude: float) -> NDArray[np.int64]:
    """Return the ids of the ways that cross the zoom-16 tile of a place (deg), by walking the quad search tree.

    Raises BadInput where a file is missing or points beyond its end.
    """
    code = int(quad_code(np.array([latitude]), np.array([longitude]))[0])
    try:
        tree, tiles = (directory / "tiles.idx").read_bytes(), (directory / "tiles.dat").read_bytes()
        at = 0
        for level in range(1, ZOOM + 1):
            at = QUAD_ENTRY.unpack_from(tree, at)[1 + ((code >> (64 - 2 * level)) & 3)]
            if at == 0:
                return np.empty(0, dtype=np.int64)
        data = QUAD_ENTRY.unpack_from(tree, at)[5]
        _, _, count = struct.unpack_from("<QBH", tiles, data)
        return np.frombuffer(tiles, dtype="<u4", count=count, offset=data + 11).astype(np.int64)
    except OSError as error:
        raise BadInput(directory, "tiles.idx, tiles.dat", f"quad-tile files ({error.strerror or error})") from error
    except (struct.error, ValueError, OverflowError) as error:
        raise BadInput(directory, "tiles.idx", "a tree whose pointers stay inside the files") from error


def read(directory: Path) -> Database:
    """Read the data files of `directory`. Raises BadInput where one is missing, cut or inconsistent."""
    content = {}
    for name in ("nodes.dat", "ways.dat"):
        try:
            content[name] = (directory / name).read_bytes()
        except OSError as error:
            raise BadInput(directory / name, "", f"a quad-tile file ({error.strerror or error})") from error
    ids, latitude, longitude = [], [], []
    at = 0
    nodes = content["nodes.dat"]
    try:
        while at < len(nodes):
            code, lat, lon, count = struct.unpack_from("<QiiH", nodes, at)
            ids.append(code)
            latitude.append(lat)
            longitude.append(lon)
            at += 18 + 4 * count
        if at != len(nodes):
            raise struct.error
    except struct.error as error:
        raise BadInput(directory / "nodes.dat", f"byte {at}", "a whole node entry (table C.1)") from error
    ways = content["ways.dat"]
    members, heights, way_start, height_start = [], [], [0], [0]
    at = 0
    try:
        while at < len(ways):
            _, count = struct.unpack_from("<IH", ways, at)
            (levels,) = struct.unpack_from("<H", ways, at + 6 + 8 * count)
            members.append(np.frombuffer(ways, dtype="<u8", count=count, offset=at + 6))
            heights.append(np.frombuffer(ways, dtype="<u4", count=levels, offset=at + 8 + 8 * count))
            way_start.append(way_start[-1] + count)
            height_start.append(height_start[-1] + levels)
            at += 8 + 8 * count + 4 * levels
    except (struct.error, ValueError) as error:
        raise BadInput(directory / "ways.dat", f"byte {at}", "a whole way entry (table C.2)") from error
    known = np.array(ids, dtype=np.uint64)
    wanted = np.concatenate(members) if members else np.empty(0, np.uint64)
    place = np.minimum(np.searchsorted(known, wanted), max(known.size - 1, 0))
    if wanted.size and (known.size == 0 or np.any(known[place] != wanted)):
        raise BadInput(directory / "ways.dat", "node ids", "nodes that nodes.dat holds, in order of id")
    elevation = np.concatenate(heights).astype(np.float64) if heights else np.empty(0)
    return Database(
        np.array(latitude) * DEGREE,
        np.array(longitude) * DEGREE,
        np.array(way_start, dtype=np.int64),
        place.astype(np.int64),
        np.array(height_start, dtype=np.int64),
        elevation * ELEVATION_UNIT - ELEVATION_BASE,
    )
