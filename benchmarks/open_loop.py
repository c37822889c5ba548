"""Open-loop checks: plans for the standard cycles and for real roads, driven by the plant alone.

`python -m benchmarks.open_loop` prints the table; real roads are those of `ROLLINGROAD_ROADS`, else skipped.
"""

import tempfile
from pathlib import Path

from scenarios.files import CITIES, load
from sensors.roadmap import from_route
from sim.network import build
from sim.open_loop import OpenLoop, cycle_check, road_check
from sim.route import true_route
from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car

CYCLES = ("udds", "hwfet", "us06", "nedc", "wltc_3b")
CARS = ("smart", "peugeot")


def checks(car_name: str) -> list[OpenLoop]:
    """Every cycle and every city whose extract is at hand."""
    from vehicle_model.plant.cycle import read_cycle

    car = read_car(car_name)
    found = [cycle_check(read_cycle(name), car) for name in CYCLES]
    for city in CITIES:
        try:
            scenario = load(city)
        except BadInput as reason:
            print(reason)
            continue
        with tempfile.TemporaryDirectory(prefix="open-loop-") as folder:
            route = true_route(build(scenario, Path(folder)))
        found.append(road_check(city, route, from_route(route, 0), car))
    return found


def main() -> None:
    """Print one line a check."""
    print("car      road        km   min  reference   saved  by speed  distance  moves kept")
    for car in CARS:
        for row in checks(car):
            columns = (
                f"{car:8} {row.name:9} {row.distance / 1e3:5.1f} {row.time / 60.0:5.1f}",
                f"{row.reference_fuel / 1e6:7.2f} MJ {row.saving_percent:+6.1f}% {row.by_speed_percent:+8.1f}%",
                f"{100.0 * row.distance_difference:+8.2f}% {row.kept:6d}",
            )
            print(*columns)


if __name__ == "__main__":
    main()
