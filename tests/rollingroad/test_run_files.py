"""A run read back is the run that was written."""

import numpy as np
import pytest
from synthetic_run import drive, road

from rollingroad.run_files import read_run, route_driven
from vehicle_model.car.errors import BadInput
from vehicle_model.car.route import CANYON, OPEN_SKY, TUNNEL


def test_the_route_driven_is_the_road():
    """GIVEN a drive over a road, THEN the route rebuilt from the drive has the road's shape, limits and tunnels."""
    truth = road()
    rebuilt = route_driven(drive(truth, 0.9))
    for name, tolerance in (("north", 0.5), ("east", 0.5), ("altitude", 0.1), ("pitch", 2e-3)):
        assert np.allclose(getattr(rebuilt, name), np.interp(rebuilt.s, truth.s, getattr(truth, name)), atol=tolerance)
    held = truth.sky[np.searchsorted(truth.s, rebuilt.s, side="right") - 1]
    assert (rebuilt.sky != held).mean() < 0.01
    changes = np.flatnonzero(np.diff(rebuilt.sky))
    assert rebuilt.sky[changes + 1].tolist() == [CANYON, OPEN_SKY, TUNNEL, OPEN_SKY]


def test_a_folder_without_a_run_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match=r"run\.json"):
        read_run(tmp_path)
    (tmp_path / "run.json").write_text("{ half")
    with pytest.raises(BadInput, match="line 1"):
        read_run(tmp_path)
