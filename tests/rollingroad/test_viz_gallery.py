"""The gallery shows what the run holds."""

import numpy as np
import pytest
from synthetic_run import synthetic_run

from rollingroad.viz import figures
from rollingroad.viz.gallery.sensing import sensing_charts


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return synthetic_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def sensing(run):
    return {chart.key: chart for chart in sensing_charts(run)}


def test_gps_errors_have_the_noise_that_was_put_in(sensing):
    """GIVEN 2 m of white noise east and north, THEN figure 2.2 scatters by 2 m about nought."""
    marks = sensing["figure-2.2"].panels[0].marks
    for axis in ("x", "y"):
        errors = np.concatenate([getattr(mark, axis) for mark in marks])
        assert abs(errors.mean()) < 0.4
        assert errors.std() == pytest.approx(2.0, rel=0.1)


def test_single_wheel_pulses_follow_the_true_speed(sensing):
    pulses, true = sensing["figure-3.2"].panels[0].marks
    assert np.allclose(pulses.y, np.interp(pulses.x, true.x, true.y), atol=1.5)


def test_the_track_by_speed_holds_every_place_once(run, sensing):
    classes = sensing["figure-f.1"].panels[0].marks
    assert sum(len(mark.x) for mark in classes) == len(run.baseline.time[:: max(len(run.baseline.time) // 3000, 1)])


def test_every_figure_can_be_drawn(sensing, tmp_path):
    for chart in sensing.values():
        figures.save(figures.draw(chart), tmp_path / f"{chart.key}.png")
        assert (tmp_path / f"{chart.key}.png").stat().st_size > 5_000
