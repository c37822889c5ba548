"""The road `mixed`: town, hills, tunnel, motorway. `python -m scenarios.roads.mixed_design` writes its plain XML.

The ego drives: Mill Lane - Main Street (seven signals, four of them coordinated, a street canyon) - country road with
a village, grades to 8 % and a 600 m tunnel - motorway at 130 km/h - exit, two more signals, car park.
"""

import itertools
from pathlib import Path

import numpy as np

from scenarios.roads.draft import Alignment, Draft, alignment, ramp

QUARTER = np.pi / 2.0
# Bends as (length m, turn degrees).
MAIN_STREET = ((620, 0), (420, 12), (500, -6), (560, 10), (500, 0))
WINDING_UPHILL = ((300, -35), (260, 62), (180, -48), (320, 20), (200, -62), (240, 75), (150, -20))
VILLAGE_AND_DOWN = ((500, 10), (220, -80), (260, 92), (180, -55), (330, 30))
TUNNEL_AND_LAST_BENDS = ((900, 14), (250, -50), (280, 60), (330, -35))


def town_and_hills(draft: Draft) -> Alignment:
    """Mill Lane, Main Street and the country road up to the interchange; return the main alignment."""
    lane = alignment((0.0, 0.0, 268.0), 0.0, [(140.0, 8.0), (120.0, -8.0)], [(0.0, 0.0), (130.0, 1.5), (260.0, 0.5)])
    draft.node("mill_end", lane.at(0.0), "dead_end")
    junction = lane.at(lane.length)
    main = alignment(
        junction,
        90.0,
        [*MAIN_STREET, *WINDING_UPHILL, *VILLAGE_AND_DOWN, *TUNNEL_AND_LAST_BENDS],
        [
            (0, 0.4),
            (350, 1.2),
            (700, 2.5),
            (1050, 1.0),
            (1420, -1.5),
            (1850, -0.8),
            (2250, 1.5),
            (2600, 2.0),
            (2900, 5.5),
            (3150, 7.8),
            (3450, 7.6),
            (3700, 4.0),
            (3950, -1.0),
            (4150, 3.0),
            (4400, 0.6),
            (4750, 0.3),
            (5000, -3.5),
            (5250, -7.6),
            (5600, -7.8),
            (5900, -3.0),
            (6080, 1.0),
            (6400, 1.2),
            (6700, 1.0),
            (7000, -2.5),
            (7300, -6.0),
            (7600, -3.0),
            (7900, 1.5),
            (8200, 0.5),
        ],
    )
    signals = {"J1": 0, "J2": 330, "J3": 680, "J4": 1050, "J5": 1420, "J6": 1850, "J7": 2250}
    draft.node("J1", junction, "traffic_light")
    draft.road("mill", ("mill_end", "J1"), lane, (0.0, lane.length), limit=30, priority=3)
    west = alignment(junction, 270.0, [(240.0, -10.0), (160.0, 0.0)], [(0, -0.4), (400, 0.5)])
    draft.node("west_end", west.at(400.0), "dead_end")
    draft.road("west", ("J1", "west_end"), west, (0.0, 400.0), limit=50)
    draft.side_road("J1_north", "J1", junction, 0.0, 180.0, 30)
    names = list(signals)
    for name, chainage in list(signals.items())[1:]:
        place, heading = main.at(chainage), main.direction(chainage)
        draft.node(name, place, "traffic_light")
        draft.side_road(f"{name}_north", name, place, heading - QUARTER, 190.0, 50 if name in ("J3", "J6") else 30)
        draft.side_road(f"{name}_south", name, place, heading + QUARTER, 170.0, 50 if name in ("J3", "J6") else 30)
    for here, there in itertools.pairwise(names):
        lanes = 2 if signals[here] in (330, 680, 1050) else 1
        draft.road(
            f"main_{here}", (here, there), main, (signals[here], signals[there]), limit=50, lanes=lanes, priority=7
        )
    country = [
        ("town_edge", 2600, 50, None),
        ("bend", 3000, 70, None),
        ("climb", 3900, 100, "farm"),
        ("village_in", 4270, 70, None),
        ("village", 4560, 50, "church"),
        ("village_out", 4820, 50, None),
        ("descent", 5300, 80, "mill_brook"),
        ("valley", 5980, 80, None),
        ("tunnel_in", 6120, 80, None),
        ("tunnel", 6720, 80, None),
        ("tunnel_out", 7300, 80, "quarry"),
        ("D", round(main.length), 70, None),
    ]
    previous, begin = "J7", 2250
    for name, end, limit, side in country:
        node = draft.node(name, main.at(end), "priority", radius=8.0)
        draft.road(f"road_{name}", (previous, node), main, (begin, end), limit=limit, priority=7)
        if side:
            draft.side_road(
                side, node, main.at(end), main.direction(end) + (QUARTER if end % 200 else -QUARTER), 220.0, 50
            )
        previous, begin = node, end
    return main


def motorway(draft: Draft, main: Alignment) -> None:
    """From the interchange `D` over ramp and motorway to the car park."""
    heading = main.direction(main.length)
    x, y, z = main.at(main.length)
    bridge = alignment((x, y, z), np.rad2deg(heading), [(250, 0), (250, 12)], [(0, 0.5), (500, 2.0)])
    draft.node("east_end", bridge.at(500.0), "dead_end")
    draft.road("bridge", ("D", "east_end"), bridge, (0.0, 500.0), limit=70)

    # The motorway passes under the bridge 330 m east of D; it bears 62 degrees to the right of the country road.
    bearing = heading + np.deg2rad(62.0)
    under = bridge.at(330.0)
    back = 1000.0
    start = (under[0] - back * np.sin(bearing), under[1] - back * np.cos(bearing), under[2] - 7.0)
    mainline = alignment(
        start,
        np.rad2deg(bearing),
        [(1500, 0), (1300, 26), (900, -10), (1400, -30), (1300, 16), (400, 0)],
        [
            (0, -0.3),
            (1000, -0.4),
            (1700, -2.0),
            (2300, -3.5),
            (2800, -1.0),
            (3400, 2.8),
            (4000, 4.2),
            (4500, 1.5),
            (5100, -2.0),
            (5700, 0.4),
            (6800, 0.2),
        ],
    )
    merge, lane_drop, lane_add, diverge, far = 1420.0, 1720.0, 5300.0, 5560.0, mainline.length

    for name, chainage in (("m_start", 0.0), ("merge", merge), ("lane_drop", lane_drop), ("lane_add", lane_add)):
        draft.node(name, mainline.at(chainage))
    draft.node("m_half", mainline.at(3500.0))
    draft.node("diverge", mainline.at(diverge))
    draft.node("m_end", mainline.at(far))
    for name, ends, span, lanes in (
        ("m_in", ("m_start", "merge"), (0.0, merge), 2),
        ("m_accelerate", ("merge", "lane_drop"), (merge, lane_drop), 3),
        ("m_west", ("lane_drop", "m_half"), (lane_drop, 3500.0), 2),
        ("m_east", ("m_half", "lane_add"), (3500.0, lane_add), 2),
        ("m_decelerate", ("lane_add", "diverge"), (lane_add, diverge), 3),
        ("m_out", ("diverge", "m_end"), (diverge, far), 2),
    ):
        draft.edge(name, ends, mainline.points(*span), limit=130, lanes=lanes, priority=12)

    def beside(chainage: float, metres: float) -> tuple[float, float, float]:
        px, py, pz = mainline.at(chainage)
        psi = mainline.direction(chainage)
        return px + metres * np.cos(psi), py - metres * np.sin(psi), pz

    # The other carriageway, 14 m to the left.
    opposite = [beside(chainage, -14.0) for chainage in np.arange(far, -1.0, -20.0)]
    draft.node("o_start", opposite[0])
    draft.node("o_end", opposite[-1])
    draft.edge("opposite", ("o_start", "o_end"), opposite, limit=130, lanes=2, priority=12)

    on = ramp((x, y, z), heading + np.deg2rad(75.0), beside(merge, 9.6), mainline.direction(merge))
    draft.edge("ramp_on", ("D", "merge"), on.points(0.0, on.length), limit=80, priority=8, centred=True)

    psi = mainline.direction(diverge)
    exit_place = beside(diverge + 330.0, 200.0)
    exit_place = (exit_place[0], exit_place[1], exit_place[2] + 6.0)
    off = ramp(beside(diverge, 9.6), psi, exit_place, psi + np.deg2rad(80.0))
    draft.node("J8", exit_place, "traffic_light")
    draft.edge("ramp_off_1", ("diverge", "ramp_mid"), off.points(0.0, 190.0), limit=80, priority=8, centred=True)
    draft.node("ramp_mid", off.at(190.0))
    draft.edge("ramp_off_2", ("ramp_mid", "J8"), off.points(190.0, off.length), limit=50, priority=8, centred=True)
    cross = psi + np.deg2rad(80.0) - QUARTER
    park = alignment(
        exit_place, np.rad2deg(cross), [(120, 0), (300, 45), (380, -12), (280, 0)], [(0, 0.5), (500, -1.5), (1080, 0.3)]
    )
    draft.side_road("J8_south", "J8", exit_place, cross + np.pi, 300.0, 70)
    draft.node("J9", park.at(600.0), "traffic_light")
    draft.side_road("J9_north", "J9", park.at(600.0), park.direction(600.0) - QUARTER, 200.0, 50)
    draft.side_road("J9_south", "J9", park.at(600.0), park.direction(600.0) + QUARTER, 200.0, 50)
    draft.node("park_end", park.at(park.length), "dead_end")
    draft.road("park_1", ("J8", "J9"), park, (0.0, 600.0), limit=70)
    draft.road("park_2", ("J9", "park_end"), park, (600.0, park.length), limit=50)


def main() -> None:
    """Write mixed/mixed.nod.xml and mixed/mixed.edg.xml beside this file."""
    draft = Draft()
    motorway(draft, town_and_hills(draft))
    draft.write(Path(__file__).parent / "mixed", "mixed")


if __name__ == "__main__":
    main()
