"""The diagnosis of ten trips."""

import tempfile
from pathlib import Path

from benchmarks.timing import Row, least, row
from observer.observe import observe
from rollingroad.gap.diagnose import diagnose
from sensors.box import record
from sensors.packets import decode, write_log
from vehicle_model.car.files import read_car, write_car
from vehicle_model.plant.cycle import run_cycle

CYCLES = ("UDDS", "HWFET", "US06", "WLTC", "UDDS")
SETTINGS = {"head_wind.speed": 4.0}


def diagnose_10_trips(repeats: int = 1) -> list[Row]:
    """Ten trips of the Smart in 4 m/s of head wind, five reference trips; reference: the observer over the ten."""
    car = read_car("smart")
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        root = Path(folder)
        write_car(car, root / "car.xml")
        trips = {"reference": [({}, seed) for seed in range(5)], "logs": [(SETTINGS, seed) for seed in range(5, 15)]}
        cards = []
        for role, parts in trips.items():
            (root / role).mkdir()
            for settings, seed in parts:
                trip, _ = run_cycle(car, CYCLES[seed % len(CYCLES)], settings)
                cards.append(record(trip, car, seed=seed))
                write_log(root / role / f"{seed:02d}.dat", cards[-1])
        ten = [decode(card) for card in cards[5:]]
        observe(ten[0], car)
        observed = least(lambda: [observe(log, car) for log in ten], 2)
        # Once before, for what is compiled on the way.
        diagnose(root / "car.xml", root / "logs", root / "reference")
        spent = least(lambda: diagnose(root / "car.xml", root / "logs", root / "reference"), repeats)
    return [row("diagnose_10_trips", spent, "s", "the observer over the same trips", observed)]


BENCHMARKS = {"diagnose_10_trips": diagnose_10_trips}
"""Name of `rollingroad bench` -> the function that measures it."""
