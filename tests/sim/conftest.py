"""One compiled road and a few drives of it, shared by the tests of the room."""

from pathlib import Path

import pytest

from scenarios import files
from sim.drive import drive
from sim.drive_record import Drive
from sim.network import Network, build
from vehicle_model.car.files import read_car
from vehicle_model.car.parameters import Car


@pytest.fixture(scope="session")
def car() -> Car:
    return read_car("smart")


@pytest.fixture(scope="session")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Network:
    return build(files.load("mixed"), tmp_path_factory.mktemp("mixed"))


@pytest.fixture(scope="session")
def baseline(mixed: Network, car: Car) -> Drive:
    return drive(files.load("mixed"), car, 3, network=mixed)


@pytest.fixture
def grid_osm(tmp_path: Path) -> Path:
    """A small town as an extract: a ladder of streets 5 km long, one in a tunnel, on a slope."""
    path = tmp_path / "town.osm"
    path.write_text(ladder_osm())
    return path


def ladder_osm(rungs: int = 12) -> str:
    """OpenStreetMap XML of two parallel streets, 450 m apart rung to rung, joined by cross streets."""
    rows = ['<osm version="0.6">']
    for side in (0, 1):
        for i in range(rungs):
            lat, lon = 49.60 + 0.004 * side, 6.10 + 0.00622 * i
            rows.append(
                f'<node id="{100 * side + i + 1}" lat="{lat:.6f}" lon="{lon:.6f}">'
                f'<tag k="ele" v="{250 + 9 * i}"/></node>'
            )
    number = 1000
    for side, kind in ((0, "primary"), (1, "secondary")):
        for i in range(rungs - 1):
            tunnel = '<tag k="tunnel" v="yes"/><tag k="layer" v="-1"/>' if (side, i) == (0, 5) else ""
            rows.append(
                f'<way id="{number}"><nd ref="{100 * side + i + 1}"/><nd ref="{100 * side + i + 2}"/>'
                f'<tag k="highway" v="{kind}"/>{tunnel}</way>'
            )
            number += 1
    for i in range(rungs):
        rows.append(
            f'<way id="{number}"><nd ref="{i + 1}"/><nd ref="{100 + i + 1}"/><tag k="highway" v="residential"/></way>'
        )
        number += 1
    return "\n".join([*rows, "</osm>"])
