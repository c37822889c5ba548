"""The report: true to the run, whole in one file, legible in a real browser, with and without scripts."""

import copy
import dataclasses
import io
import re

import numpy as np
import pytest
from browser import CHROMIUM, visit
from PIL import Image
from synthetic_run import car, drive, road, synthetic_run

from rollingroad.viz import figures, interactive, views
from rollingroad.viz.accounts import energy_account
from rollingroad.viz.charts import Bars, Heat, Line
from rollingroad.viz.intervals import run_intervals
from rollingroad.viz.report import write_report

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return synthetic_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def page(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(run, path)
    return path


def readable(html):
    """What a reader without scripts sees: no scripts, no styles, no tags."""
    html = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", html, flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html))


def test_the_first_words_answer_the_question(page):
    text = readable(page.read_text())
    before_figures = text[: text.index("Speed, gear and altitude along the road")]
    for answer in ("6.0 km in 6 min", "+4.7 %", "+8.9 %", "oracle", "naive figure, not a saving", "41 % of the fuel"):
        assert answer in before_figures, answer


def test_without_a_bracket_no_saving_is_claimed(run, tmp_path):
    """GIVEN a run whose drives do not bracket the baseline's time, THEN the report says so and gives no figure."""
    results = copy.deepcopy(dict(run.results)) | {"saving_percent": None, "naive_saving_percent": None}
    results["advised"] = {"fuel_J": None, "time_s": None}
    write_report(dataclasses.replace(run, results=results), tmp_path / "report.html")
    text = readable((tmp_path / "report.html").read_text())
    assert "No drive with advice could be brought to the same trip time" in text
    assert "4.7 %" not in text and "None" not in text and "nan" not in text


def test_gears_that_were_not_told_are_not_called_advice(run):
    for told, name in ((True, "advice"), (False, "planned, not told")):
        results = dict(run.results) | {"advised": run.results["advised"] | {"gears_told": told}}
        (gears,) = (
            panel
            for panel in views.speed_chart(dataclasses.replace(run, results=results)).panels
            if panel.y_label == "gear"
        )
        assert [line.name for line in gears.marks] == [name, "baseline", "advised"]


def test_a_map_without_a_valid_cell_still_makes_a_report(run, tmp_path):
    found = run.efficiency_map
    nothing = np.zeros_like(found.valid)
    empty = dataclasses.replace(
        found, valid=nothing, mean=np.full_like(found.mean, np.nan), count=0 * found.count, fuel=0 * found.fuel
    )
    results = copy.deepcopy(dict(run.results))
    results["map"] = dict.fromkeys(results["map"], None)
    results["observer"] = dict.fromkeys(results["observer"], None)
    bare = dataclasses.replace(run, efficiency_map=empty, true_efficiency=None, fits={}, results=results)
    write_report(bare, tmp_path / "report.html")
    text = readable((tmp_path / "report.html").read_text())
    assert "None" not in text and "nan" not in text


def test_the_file_needs_nothing_from_elsewhere(page):
    html = page.read_text()
    without_plotly = re.sub(r'<script type="application/octet-stream".*?</script>', "", html, flags=re.S)
    assert not re.search(r"""(src|href)=["'](?!#|data:)""", without_plotly)
    assert page.stat().st_size < 4_000_000
    assert [path.name for path in page.parent.iterdir()] == ["report.html"]


def test_a_scenario_s_name_cannot_break_out_of_the_page(run, tmp_path):
    results = dict(run.results) | {"scenario": "</script><script>alert(1)</script>"}
    write_report(dataclasses.replace(run, results=results), tmp_path / "report.html")
    assert "<script>alert(1)" not in (tmp_path / "report.html").read_text()


def test_the_energy_account_is_closed_and_its_brakes_are_the_trip_s():
    """An energy account that does not add up to the fuel burnt hides something."""
    trip = drive(road(), 0.9)
    account = energy_account(trip, car())
    assert sum(account.parts.values()) == pytest.approx(account.fuel, rel=1e-9)
    by_hand = float(
        np.sum(0.5 * ((trip.brake_force * trip.speed)[1:] + (trip.brake_force * trip.speed)[:-1])) * trip.step
    )
    assert account.parts["brakes"] == pytest.approx(by_hand, rel=1e-9)


def test_both_drawings_hold_the_chart_s_data(run):
    """The still picture and the live one come from one description; here the live one is decoded and compared."""
    for chart in views.run_charts(run):
        drawn = interactive.plotly_figure(chart)
        names = {trace.get("name") for trace in drawn["data"]}
        still = figures.svg(figures.draw(chart))
        for panel in chart.panels:
            for mark in panel.marks:
                if isinstance(mark, Line | Bars):
                    assert mark.name in names
            assert panel.title in still and panel.x_label in still
        heats = [mark for panel in chart.panels for mark in panel.marks if isinstance(mark, Heat)]
        assert sum(trace["type"] == "heatmap" for trace in drawn["data"]) == 2 * len(heats)


def test_stops_survive_the_thinning_of_the_speed_curve(run):
    """GIVEN 20 s at rest, a point in distance and long in time, THEN the curve over distance goes down to nought."""
    trip = run.baseline
    at_rest = np.abs(trip.time - 200.0) < 10.0
    place = np.where(at_rest, trip.distance[at_rest][0], trip.distance)
    stopped = trip.channels | {"speed": np.where(at_rest, 0.0, trip.speed), "distance": place}
    chart = views.speed_chart(dataclasses.replace(run, baseline=dataclasses.replace(trip, channels=stopped)))
    line = next(mark for mark in chart.panels[0].marks if isinstance(mark, Line) and mark.name == "baseline")
    assert line.y.min() == 0.0
    assert len(line.x) < 3500


def test_interval_of_the_thrust_error_covers_a_known_noise(run):
    """GIVEN white noise of 50 N on the estimate, THEN the interval holds 50 N and is narrow, and repeats itself."""
    first, again = (run_intervals(run, seed=4) for _ in range(2))
    assert first == again
    assert first.thrust[0] < 50.0 < first.thrust[1]
    assert first.thrust[1] - first.thrust[0] < 10.0
    assert first.map_rmse[0] < 0.006 < first.map_rmse[1]
    assert first.fit_rmse == pytest.approx((0.003, 0.003))  # the synthetic fit is off by 0.003 everywhere


@needs_browser
@pytest.mark.parametrize(("width", "height"), [(360, 740), (1440, 900)])
def test_in_a_browser_nothing_overflows_and_nothing_complains(page, tmp_path, width, height):
    ask = ["document.documentElement.scrollWidth", "document.querySelectorAll('.live .main-svg').length > 0"]
    seen = visit(
        page.as_uri(), tmp_path, width, height, ready="document.documentElement.dataset.ready === 'yes'", ask=ask
    )
    assert seen.errors == []
    assert seen.answers == [width, True]


@needs_browser
@pytest.mark.parametrize("media", ["", "print"])
def test_without_scripts_and_in_print_the_still_pictures_are_there(page, tmp_path, media):
    """The still pictures carry vermilion and blue lines; an empty page does not."""
    seen = visit(page.as_uri(), tmp_path, 800, 2000, scripts=bool(media), media=media, settle=2.0,
                 ready="document.documentElement.dataset.ready === 'yes'")  # fmt: skip
    pixels = np.asarray(Image.open(io.BytesIO(seen.picture)).convert("RGB")).reshape(-1, 3).astype(int)
    for colour in ((0xD5, 0x5E, 0x00), (0x00, 0x72, 0xB2)):
        assert (np.abs(pixels - colour).max(axis=1) < 12).sum() > 500
