"""The road `mountain`: a pass with hairpins between two villages.

`python -m scenarios.roads.mountain_design` writes its plain XML.

The ego drives from the car park of the lower village over the pass (some 330 m higher) to the square of the upper one.
"""

from pathlib import Path

import numpy as np

from scenarios.roads.draft import Draft, alignment

QUARTER = np.pi / 2.0
HAIRPINS = [(420, 12), (75, 165), (380, -8), (80, -170), (350, 14), (75, 168), (400, -14), (85, -160), (360, 10)]
BENDS = [(300, -40), (350, 55), (280, -48), (400, 30), (500, -20), (260, 60), (380, -35), (300, 25), (450, -15)]
GRADES = [
    (0, 0.8),
    (500, 1.5),
    (800, 5.0),
    (1100, 8.5),
    (1700, 9.0),
    (2300, 8.0),
    (2900, 9.2),
    (3400, 7.5),
    (3900, 8.4),
]
GRADES += [(4400, 6.0), (4800, 1.0), (5100, -2.0), (5500, -6.5), (6200, -7.5), (6800, -5.0), (7300, -7.0), (7900, -3.0)]
GRADES += [(8300, -0.5), (9000, 0.3)]


def pass_road(draft: Draft) -> None:
    """Lower village, hairpins, crest, descent, upper village."""
    main = alignment((0.0, 0.0, 420.0), 60.0, [(700, 8), *HAIRPINS, (600, -25), *BENDS, (800, 10)], GRADES)
    stages = [
        ("bridge", 320, 50, "J_low"),
        ("sawmill", 760, 50, None),
        ("climb", 3000, 80, "alp"),
        ("crest", 4900, 80, "chapel"),
        ("descent", 7200, 80, "quarry"),
        ("village", round(main.length) - 420, 50, "J_up"),
        ("square", round(main.length), 50, None),
    ]
    draft.node("start", main.at(0.0), "dead_end")
    previous, begin = "start", 0
    for name, end, limit, side in stages:
        signal = side is not None and side.startswith("J_")
        kind = "traffic_light" if signal else "dead_end" if name == "square" else "priority"
        draft.node(name, main.at(end), kind, radius=7.0)
        draft.road(name, (previous, name), main, (begin, end), limit=limit, priority=7)
        if side:
            heading = main.direction(end)
            draft.side_road(f"{side}_left", name, main.at(end), heading - QUARTER, 180.0, 50)
            if signal:
                draft.side_road(f"{side}_right", name, main.at(end), heading + QUARTER, 180.0, 50)
        previous, begin = name, end


def main() -> None:
    """Write mountain/mountain.nod.xml and mountain/mountain.edg.xml beside this file."""
    draft = Draft()
    pass_road(draft)
    draft.write(Path(__file__).parent / "mountain", "mountain")


if __name__ == "__main__":
    main()
