"""The gallery shows what the run holds."""

import re

import numpy as np
import pytest
from synthetic_run import synthetic_run

from observer.priors import tracks
from rollingroad.diesel_studies import ERROR, NODES
from rollingroad.viz import figures
from rollingroad.viz.charts import Heat
from rollingroad.viz.gallery import write
from rollingroad.viz.gallery.diesel import diesel_charts
from rollingroad.viz.gallery.efficiency import other_car_charts
from rollingroad.viz.gallery.priors import prior_charts
from rollingroad.viz.gallery.selection import selection_charts
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


def marks_of(chart, panel=0):
    return {mark.name: mark for mark in chart.panels[panel].marks}


def test_the_mean_of_the_sigma_points_lies_inside_the_circle_of_gravity(sensing, run):
    """Two points at +-0.6 rad and the centre, weight 0: their mean is g cos(0.6) up, which no pitch measures."""
    marks = marks_of(sensing["figure-3.1"])
    g = run.car.gravity
    assert np.hypot(marks["sigma points"].x, marks["sigma points"].y) == pytest.approx(g)
    assert marks["mean of the sigma points"].x[0] == pytest.approx(0.0, abs=1e-12)
    assert marks["mean of the sigma points"].y[0] == pytest.approx(g * np.cos(0.6))


def test_the_acceleration_route_marks_only_where_the_car_accelerates(sensing, run):
    hard = marks_of(sensing["figure-4.7"])["accelerating by more than 1 m/s²"]
    trip = run.baseline
    assert len(hard.x)
    for east, north in zip(hard.x[::7], hard.y[::7], strict=True):
        nearest = np.argmin((trip.east / 1e3 - east) ** 2 + (trip.north / 1e3 - north) ** 2)
        assert trip.acceleration[max(nearest - 50, 0) : nearest + 50].max() > 1.0


def test_another_car_s_map_holds_the_valid_cells_and_nothing_else(run):
    (raw,) = [chart for chart in other_car_charts(run) if chart.key == "figure-3.20"]
    (heat,) = [mark for mark in raw.panels[0].marks if isinstance(mark, Heat)]
    assert np.isfinite(heat.z).sum() == run.efficiency_map.valid.sum()
    assert np.nanmax(heat.z) == pytest.approx(100 * run.efficiency_map.mean[run.efficiency_map.valid].max())


def test_the_prior_figures_show_what_their_text_says():
    made = {chart.key: chart for chart in prior_charts()}
    assert list(made) == [f"priors-4.{number}" for number in range(2, 16)]
    weights = marks_of(made["priors-4.2"], panel=1)
    for mark in weights.values():
        assert np.interp(1.0, mark.x, mark.y) == pytest.approx(0.9, abs=1e-6)
    large = marks_of(made["priors-4.5"])
    away, back = slice(102, 112), slice(402, 412)
    setpoint = tracks.LARGE_STEPS[:, 0]
    # slower than the low-pass filter away from the prior, faster towards it
    for stretch, sign in ((away, 1.0), (back, -1.0)):
        behind = {name: np.abs(setpoint - large[name].y)[stretch].mean() for name in ("SPE", "low-pass")}
        assert sign * (behind["SPE"] - behind["low-pass"]) > 0.1


def test_the_diesel_figures_show_the_augmentation_s_gain_and_the_map():
    augmentation, adaptation = diesel_charts(seconds=120.0)
    assert [chart.key for chart in augmentation] == [f"bias-{number}" for number in range(1, 5)]
    assert [chart.key for chart in adaptation] == [f"adaptation-{number}" for number in range(1, 8)]
    errors = marks_of(augmentation[1], panel=1)
    assert abs(errors["augmented"].y.mean()) < 0.2 * abs(errors["default"].y.mean())
    found = marks_of(adaptation[4])["map found"]
    assert np.abs(found.y - 100 * np.interp(found.x, NODES, ERROR)).max() < 1.0


def test_the_selection_figures_carry_the_errors_of_the_study():
    made = {chart.key: chart for chart in selection_charts()}
    assert list(made) == [f"selection-{number}" for number in range(9, 17)]
    tracks_shown = marks_of(made["selection-9"])
    truth, blind = tracks_shown["true"], tracks_shown["none"]
    said = float(re.search(r"none ([\d.]+)", made["selection-9"].caption)[1])
    assert np.sqrt(np.mean((blind.y - truth.y) ** 2)) == pytest.approx(said, rel=0.02)


def test_the_gallery_is_one_page_and_one_picture_a_figure(run, sensing, tmp_path, monkeypatch):
    """The sections' making is tested above; here two figures stand for all, to be quick."""
    two = write.Section("thesis", "Optimal observers", (sensing["figure-2.2"], sensing["figure-3.1"]))
    monkeypatch.setattr(write, "gallery_sections", lambda run, other, tell: [two])
    paths = write.write_gallery(run, tmp_path / "gallery")
    assert [path.name for path in paths] == ["index.html", "figure-2.2.png", "figure-3.1.png"]
    page = paths[0].read_text()
    assert 'href="#figure-3.1"' in page and 'id="figure-3.1"' in page and "Optimal observers" in page
    assert sorted(path.name for path in paths[0].parent.iterdir()) == sorted(path.name for path in paths)
