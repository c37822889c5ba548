"""How far a trip's fuel comes right: the coefficients that the other trips gave, and no more."""

from types import SimpleNamespace

import numpy as np
import pytest

from rollingroad.gap.blocks import CHANNELS
from rollingroad.gap.calibration import Calibration
from rollingroad.gap.design import FUEL, Columns
from rollingroad.gap.noise import default_noise
from rollingroad.gap.shrinkage import _trip_fuel
from rollingroad.gap.trips import Layout, Trip

LAYOUT = Layout(("map",), np.array([2.0]), (), np.zeros(0), 1, 2)
CALIBRATION = Calibration(np.array([[1e6]]), np.array([0.0]), default_noise(), 1.0, 3)


def _trip(excess: float) -> Trip:
    """Ten blocks of 4 samples of 1000 W of measured fuel, of which `excess` W are the second regressor's; one block of
    another channel."""
    channel = np.append(np.full(10, FUEL), CHANNELS.index("gnss_speed"))
    parts = {"fuel_power": (np.arange(40), np.repeat(np.arange(10), 4), np.full(10, 4))}
    p = SimpleNamespace(
        layout=SimpleNamespace(channel=channel, parts=parts), samples=SimpleNamespace(fuel=np.full(40, 1000.0))
    )
    generic = np.stack([np.full(11, 7.0), np.ones(11)], axis=1)
    none = Columns.of([], 11)
    return Trip(
        p, np.append(np.full(10, excess), 0.3), Columns.of([("map", np.ones(11), 2.0)], 11), none, none,  # type: ignore[arg-type]
        np.zeros((11, 1)), generic,
    )  # fmt: skip


@pytest.mark.parametrize("second, after", [(30.0, 0.0), (20.0, 1.0), (60.0, 3.0)])
def test_the_fuel_error_after_is_what_the_coefficients_leave(second: float, after: float) -> None:
    """Given trips that burn 3 % more, then a term of so many W leaves the rest of it; a term of no size leaves all."""
    trips = [_trip(30.0), _trip(30.0)]
    index = LAYOUT.effects + np.arange(2)
    found = _trip_fuel(trips, index, [np.array([0.0, second])] * 2, LAYOUT, CALIBRATION)
    assert found == pytest.approx((3.0, after))
    assert _trip_fuel(trips, index, [np.zeros(2)] * 2, LAYOUT, CALIBRATION) == pytest.approx((3.0, 3.0))
