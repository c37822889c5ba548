"""One drive and its card, shared by the room's tests."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from trips import drive, smart


@pytest.fixture(scope="session")
def car():
    return smart()


@pytest.fixture(scope="session")
def trip():
    return drive(240.0)


@pytest.fixture(scope="session")
def card(trip, car):
    from sensors.box import record

    return record(trip, car)
