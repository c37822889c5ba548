"""The pages of an evaluation and of a challenge: the answer first, every figure with its interval, nothing invented."""

import re

import pytest
from browser import CHROMIUM, visit

from rollingroad.viz.challenge_page import write_scores
from rollingroad.viz.evaluation_page import write_evaluation

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
SAFETY = {"baseline_min_time_to_collision_s": 3.9, "harsh_braking": 1, "collisions": 0, "red_lights_run": 0}


def row(scenario, advisor, saving, half):
    """A row of `evaluate --json`; `saving` None: no price made the trip as long as the baseline's."""
    fair = saving is not None
    return {
        "scenario": scenario, "car": "smart", "advisor": advisor, "baseline": "good", "seeds": 5,
        "fair_saving_percent": saving, "ci95": [saving - half, saving + half] if fair else None,
        "time_difference_percent": 0.31 if fair else 4.2, "naive_saving_percent": 19.25, "oracle_fraction": 0.8,
        "limit_violations": 0, "min_time_to_collision_s": 2.9, "oracle_saving_percent": 9.5,
        "regret": dict(zip(("fit", "estimation", "optimiser", "driver", "traffic"), (0.5, 1.5, 0.25, 2.0, -1.25),
                           strict=True)) if fair else None,
        "safety": SAFETY, "seeds_not_bracketed": [3] if scenario == "hills" else [], "price_W": 900.0,
    }  # fmt: skip


FOUND = {
    "rows": [
        row("hills", "pontryagin", 6.5, 2.0),
        row("town", "pontryagin", 1.25, 3.0),
        row("town", "glide", None, 0.0),
    ],
    "failed": [{"scenario": "town", "car": "smart", "advisor": "glide", "baseline": "good", "error": "no price"}],
}


def score(value, low, high, n):
    return {"value": value, "ci95": [low, high], "n": n}


SCORES = {
    "false_alarm_rate": score(0.025, 0.004, 0.129, 40),
    "detection_rate": score(0.875, 0.7, 0.95, 24),
    "component_accuracy": score(0.75, 0.55, 0.88, 24),
    "regime_tv": {"value": None, "ci95": None, "n": 0},
    "top1": score(0.625, 0.43, 0.79, 24),
    "recovered_fraction": score(0.91, 0.7, 1.1, 24),
    "coverage90": score(0.9, 0.7, 0.97, 20),
    "detection_delay_km": score(14.3, 12.8, 27.2, 21),
    "curves": {"strength": [0.5, 1, 2, 4], "detection": [0, 0.2, 0.9, 1], "naming": [0, 0.1, 0.6, 0.7],
               "detection_50": 1.4, "naming_80": None},
    "more": {"pairs_both_named": score(0.33, 0.06, 0.79, 3)},
    "controls": {"permuted_key_top1": score(0.13, 0.09, 0.19, 160)},
    "confusion": {"head_wind": {"head_wind": 3, "drag_area": 1}},
    "cases": {"all": 80, "gap_free": 40, "known_at_2": 24},
}  # fmt: skip
READY = "document.documentElement.dataset.ready === 'yes'"


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    write_evaluation(FOUND, folder / "evaluation.html")
    write_scores(SCORES, folder / "scores.html")
    return folder


def readable(path):
    """What a reader without scripts sees: no scripts, no styles, no tags."""
    html = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", path.read_text(), flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html))


def test_the_evaluation_answers_first_and_counts_only_what_is_fair(pages):
    text = readable(pages / "evaluation.html")
    assert "pontryagin saves a median of 3.9 % (1.2 to 6.5 %)" in text  # median of 6.5 and 1.25
    assert "above nought with 95 % in 1 of 2 rows" in text
    assert "2 of 3" in text
    assert "glide saves" not in text


def test_every_saving_stands_beside_its_interval_and_a_missing_one_is_a_dash(pages):
    text = readable(pages / "evaluation.html")
    assert "+6.50 % 95 %: 4.50 to 8.50 %" in text
    assert "+1.25 % 95 %: −1.75 to 4.25 %" in text
    assert re.search(r"town, smart, good glide 5 — — \+19\.25 %", text)
    assert "None" not in text and "nan" not in text


def test_the_losses_sum_and_what_failed_is_told(pages):
    text = readable(pages / "evaluation.html")
    assert "+1.50 % +0.50 % +0.25 % +2.00 % −1.25 % +3.00 %" in text
    assert "scenario town, car smart, advisor glide, baseline good: no price" in text
    assert "seeds 3; they count in the means" in text


def test_an_evaluation_without_rows_still_makes_a_page(tmp_path):
    write_evaluation({"rows": [], "failed": []}, tmp_path / "evaluation.html")
    assert "No row has a saving" in readable(tmp_path / "evaluation.html")


def test_the_challenge_answers_first_with_counts_and_intervals(pages):
    text = readable(pages / "scores.html")
    assert "A gap was seen in 1 of 40 sets that had none" in text
    assert "21 of 24 were detected and 15 of 24 named first" in text
    assert "0.03 95 %: 0.00 to 0.13; 40 cases" in text or "0.02 95 %: 0.00 to 0.13; 40 cases" in text
    assert "14.3 km 12.8 to 27.2 km" in text
    assert "80 % are named never" in text
    assert "head wind 4 head wind 3, drag area 1" in text
    assert "None" not in text and "nan" not in text


@pytest.mark.parametrize("name", ["evaluation", "scores"])
def test_each_is_one_file_that_needs_nothing_from_elsewhere(pages, name):
    html = (pages / f"{name}.html").read_text()
    without_plotly = re.sub(r'<script type="application/octet-stream".*?</script>', "", html, flags=re.S)
    assert not re.search(r"""(src|href)=["'](?!#|data:)""", without_plotly)
    assert sorted(path.name for path in pages.iterdir()) == ["evaluation.html", "scores.html"]


@needs_browser
@pytest.mark.parametrize(("width", "height"), [(360, 740), (1440, 900)])
@pytest.mark.parametrize("name", ["evaluation", "scores"])
def test_in_a_browser_nothing_overflows_and_nothing_complains(pages, tmp_path, name, width, height):
    ask = ["document.documentElement.scrollWidth", "document.querySelectorAll('.live .main-svg').length > 0"]
    seen = visit((pages / f"{name}.html").as_uri(), tmp_path, width, height, ready=READY, ask=ask)
    assert seen.errors == []
    assert seen.answers == [width, True]
