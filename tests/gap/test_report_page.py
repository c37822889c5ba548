"""The page of a diagnosis: the answer first, every size with its deviation, one file."""

import re

import pytest
from test_diagnose import garage  # noqa: F401 - a fixture

from rollingroad.gap.diagnose import weigh
from rollingroad.gap.report import lead, write_report
from sensors.packets import decode
from vehicle_model.car.files import read_car


@pytest.fixture(scope="module")
def page(garage, tmp_path_factory):  # noqa: F811
    """Two trips in a wind of 5 m/s from the north, diagnosed."""
    path, trip, reference = garage
    logs = [decode(trip(seed, {"wind_n": 5.0}, {}), f"trip_{seed}") for seed in (21, 22)]
    found = weigh(read_car(path), logs, reference, None, ())
    return write_report(found, tmp_path_factory.mktemp("diagnosis"))


def test_the_answer_comes_first_with_probability_size_and_place(page):
    html = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", page.read_text(), flags=re.S)
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html))
    before = text[: text.index("trips diagnosed")]
    assert re.search(r"head_wind \(probability [01]\.\d\d\)\. It lies in road_load", before)
    assert re.search(r"head_wind\.speed = \d\.\d+ ± \d\.\d+ m/s", text)
    assert "2 trips diagnosed, 3 reference trips" in text
    assert "on trips left out of the fit" in text
    assert "None" not in text.split("All numbers")[0] and "nan" not in text.split("All numbers")[0]


def test_it_is_one_file_that_needs_nothing_from_elsewhere(page):
    html = page.read_text()
    without_plotly = re.sub(r'<script type="application/octet-stream".*?</script>', "", html, flags=re.S)
    assert not re.search(r"""(src|href)=["'](?!#|data:)""", without_plotly)
    assert 'name="viewport"' in html
    assert [path.name for path in page.parent.iterdir()] == ["report.html"]


@pytest.mark.parametrize(("separators", "told"), [(["a coast-down"], " What would: a coast-down."), ([], "")])
def test_a_class_is_told_with_what_would_separate_it(separators, told):
    """Given two effects that the trips do not separate, then the first sentence names both and what would, if anything
    is known to."""
    row = {"effects": ["mass"], "class": ["mass", "drag_area"], "separated_by": separators, "probability": 0.6}
    sentence = lead({"causes": [row], "verdict": "class", "where": []})
    assert sentence == f"One of mass, drag_area; these trips do not separate them.{told}"
