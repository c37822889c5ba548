"""What is free where there is no trip to calibrate on."""

import numpy as np
import pytest

from rollingroad.gap.calibration import BOX, FREEDOM, calibrate
from rollingroad.gap.trips import Layout, Lexicon

NAMES = ("map.idle", "state.fuel_1", "gnss.lag", "gnss.offset", "state.gnss_v2")


@pytest.mark.parametrize("freedom", [FREEDOM[0], FREEDOM[-1]])
def test_another_engine_does_not_make_another_receiver(freedom: float) -> None:
    """Given logs whose engine is taken for another one, then map and fuel are as free as that; the wheel's and the
    receiver's scale are not, or 1 % on a wheel would be nothing to tell."""
    sd = np.array([4000.0, 0.02, 0.06, 0.03, 5e-4])
    found = calibrate([], Layout(NAMES, sd, (), np.zeros(0), 0, 0), Lexicon((), ()), freedom=freedom)
    free = np.diag(found.information) ** -0.5 / sd
    np.testing.assert_allclose(free, [freedom, freedom, 1.0, BOX, BOX])
