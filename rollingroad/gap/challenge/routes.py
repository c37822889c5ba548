"""Synthetic routes: towns with stops, rural hills and bends, motorways; and the road map as OpenStreetMap XML."""

import numpy as np

from rollingroad.gap.challenge.truth import Road

DS = 4.0
ORIGIN = (48.8, 2.1, 120.0)
"""Latitude, longitude (deg), altitude (m)."""
METRES_PER_DEGREE = 111_194.9
KINDS = {
    # limit m/s, bend radius m, straight m, grade sd, stop spacing m (0 none)
    "town": ((8.3, 13.9), (12.0, 80.0), (60.0, 300.0), 0.012, 350.0),
    "rural": ((19.4, 25.0), (80.0, 400.0), (100.0, 700.0), 0.030, 2500.0),
    "motorway": ((30.5, 33.5), (900.0, 2500.0), (500.0, 2000.0), 0.014, 0.0),
}


def draw(
    rng: np.random.Generator, length: float, mix: dict[str, float], *, hills: float = 1.0, straight: bool = False
) -> Road:
    """Draw a route of about `length` m; `mix` gives the share of each kind; `straight` keeps one heading."""
    total = sum(mix.values())
    curvature, wish, grade_sd, stops = [], [], [], []
    at = 0.0
    for kind in rng.permutation([k for k in mix if mix[k] > 0]):
        limits, radii, straights, sd, spacing = KINDS[kind]
        end = at + length * mix[kind] / total
        since_stop = 0.0
        while at < end:
            limit = rng.uniform(*limits)
            run = rng.uniform(*straights)
            pieces = [(run, 0.0)]
            radius = rng.uniform(*radii)
            turn = min(np.radians(95), rng.exponential(np.radians(40))) * rng.choice([-1, 1])
            if not straight:
                pieces.append((abs(turn) * radius, np.sign(turn) / radius))
            for stretch, kappa in pieces:
                n = max(1, int(stretch / DS))
                curvature.append(np.full(n, kappa))
                bend = np.sqrt(2.2 / abs(kappa)) if kappa else 99.0
                wish.append(np.full(n, min(limit, bend)))
                grade_sd.append(np.full(n, sd))
                at += n * DS
                since_stop += n * DS
            if spacing and since_stop > spacing * rng.uniform(0.5, 1.5):
                stops.append(at - 2 * DS)
                since_stop = 0.0
    stops.append(at - 15 * DS)
    bends = _smooth(np.concatenate(curvature), 3)
    wished = np.concatenate(wish)
    speed = _passable(_smooth(wished, 2, minimum=True))
    n = len(bends)
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(bends) * DS
    noise = _smooth(rng.normal(size=n), 60)
    grade = np.clip(hills * _smooth(np.concatenate(grade_sd), 50) * noise / max(noise.std(), 1e-9), -0.09, 0.09)
    pitch = np.arctan(grade)
    altitude = ORIGIN[2] + np.cumsum(np.sin(pitch)) * DS
    north = np.cumsum(np.cos(heading) * np.cos(pitch)) * DS
    east = np.cumsum(np.sin(heading) * np.cos(pitch)) * DS
    waits = rng.uniform(3, 35, len(stops))
    return Road(DS, altitude, pitch, heading, bends, speed, north, east, np.array(stops), waits, wished)


def osm(
    roads: list[Road], rng: np.random.Generator, *, altitude_error: float = 1.0, bias: float = 0.0, first: int = 1
) -> str:
    """The map: one way per route with nodes every 50 m, altitudes off by `altitude_error` m (sd).

    `bias` adds a false grade (rise per m, along the way); ids count from `first`.
    """
    nodes, ways, number = [], [], first
    for w, road in enumerate(roads):
        every = int(50 / road.step)
        index = np.arange(0, len(road.pitch), every)
        ele = road.altitude[index] + rng.normal(0, altitude_error, len(index)) + bias * index * road.step
        lat, lon = geodetic(road.north[index], road.east[index])
        refs = []
        for k in range(len(index)):
            nodes.append(
                f'<node id="{number}" lat="{lat[k]:.8f}" lon="{lon[k]:.8f}"><tag k="ele" v="{ele[k]:.2f}"/></node>'
            )
            refs.append(f'<nd ref="{number}"/>')
            number += 1
        ways.append(f'<way id="{first + w}">{"".join(refs)}<tag k="highway" v="secondary"/></way>')
    return '<?xml version="1.0" encoding="UTF-8"?>\n<osm version="0.6">\n' + "\n".join(nodes + ways) + "\n</osm>\n"


def joined(texts: list[str]) -> str:
    """Several maps as one file: nodes of all, then ways of all."""
    lines = [line for text in texts for line in text.splitlines()[2:-1]]
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<osm version="0.6">\n'
    return head + "\n".join(sorted(lines, key=lambda line: line.startswith("<way"))) + "\n</osm>\n"


def geodetic(north: np.ndarray, east: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Latitude and longitude, deg, of local metres: WGS 84 radii of curvature at the origin."""
    a, e2, lat0 = 6378137.0, 6.69437999014e-3, np.radians(ORIGIN[0])
    w = 1.0 - e2 * np.sin(lat0) ** 2
    meridian, prime = a * (1 - e2) / w**1.5, a / np.sqrt(w)
    return ORIGIN[0] + np.degrees(north / meridian), ORIGIN[1] + np.degrees(east / (prime * np.cos(lat0)))


def _smooth(x: np.ndarray, width: int, *, minimum: bool = False) -> np.ndarray:
    if minimum:
        pad = np.pad(x, width, mode="edge")
        return np.min([pad[i : i + len(x)] for i in range(2 * width + 1)], axis=0)
    kernel = np.hanning(2 * width + 3)
    kernel /= kernel.sum()
    return np.convolve(np.pad(x, width + 1, mode="edge"), kernel, mode="valid")


def _passable(speed: np.ndarray, decel: float = 1.1) -> np.ndarray:
    """Speed from which every lower one ahead can be reached by braking at `decel` m/s2."""
    v = speed.copy()
    for i in range(len(v) - 2, -1, -1):
        v[i] = min(v[i], np.sqrt(v[i + 1] ** 2 + 2 * decel * DS))
    return v
