"""The figures of optimal control show the solutions that they name."""

import numpy as np
import pytest

from rollingroad.viz import figures
from rollingroad.viz.gallery.control import control_charts


@pytest.fixture(scope="module")
def made():
    return {chart.key: chart for chart in control_charts()}


def panel(chart, label):
    return next(p for p in chart.panels if p.y_label.startswith(label))


def test_every_figure_of_the_thesis_is_there_and_can_be_drawn(made, tmp_path):
    numbers = ("4.1", "4.3", "4.3d", "4.5", "4.5d", "4.6", "4.6d", "4.8", "4.9", "4.10", "g.2")
    assert set(made) == {f"figure-{number}" for number in numbers}
    for chart in made.values():
        figures.save(figures.draw(chart), tmp_path / f"{chart.key}.png")
        assert (tmp_path / f"{chart.key}.png").stat().st_size > 5_000


def test_the_fixed_time_drive_coasts_then_ends_at_140_km_h_after_30_s(made):
    (speed,) = panel(made["figure-4.6"], "speed (km/h)").marks
    (torque,) = panel(made["figure-4.6"], "torque").marks
    assert (speed.x[-1], speed.y[-1]) == pytest.approx((30.0, 140.0), rel=1e-6)
    assert torque.y[torque.x < 7.0] == pytest.approx(5.0)


def test_the_hamiltonian_is_flat(made):
    for number in ("4.3", "4.5", "4.6"):
        (drift,) = panel(made[f"figure-{number}"], "(H").marks
        assert np.abs(drift.y).max() < 1e-6


def test_the_corner_slows_to_its_steady_speed_and_its_costate_ends_at_nought(made):
    speed = panel(made["figure-4.10"], "speed").marks[0].y
    costate = panel(made["figure-4.10"], "costate").marks[0].y
    drag, rolling = 0.5 * 1.2 * 0.39 * 1.93, 0.010 * 920 * 9.805
    v = speed[-1] / 3.6
    assert (drag * v**2 + rolling) * v == pytest.approx(850 * 2 * np.pi / 60 * 5.0, rel=1e-3)
    assert costate[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.all(costate[:-1] > 0.0)
