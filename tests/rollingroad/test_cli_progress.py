"""What is told while one waits: time left from counts or from the last time, nothing at all when piped."""

import io
import json
import sys

import pytest

from rollingroad.cli import output
from rollingroad.cli.course import Course, spoken


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def test_nothing_is_claimed_before_anything_is_known(clock):
    course = Course({}, clock)
    course.tell("driving")
    clock.now += 30.0
    assert course.left() is None


def test_counts_tell_the_time_left(clock):
    """GIVEN two cases in 20 s, THEN the other six take 60 s, and less as time goes by."""
    course = Course({}, clock)
    for done in (1, 2, 3):
        course.tell(f"{done} of 8 cases done")
        clock.now += 10.0
    clock.now -= 10.0
    assert course.left() == pytest.approx(50.0)
    clock.now += 4.0
    assert course.left() == pytest.approx(46.0)
    clock.now += 500.0
    assert course.left() == 0.0


def test_the_last_time_tells_the_time_left(clock):
    """GIVEN a run that drove for 20 s and planned for 5, WHEN driving for 8 s, THEN 17 s are left."""
    first = Course({}, clock)
    for stage, lasts in (("driving", 20.0), ("planning", 5.0)):
        first.tell(stage)
        clock.now += lasts
    second = Course(first.finished(), clock)
    second.tell("driving")
    clock.now += 8.0
    assert second.left() == pytest.approx(17.0)
    second.tell("something new")
    assert second.left() is None


@pytest.mark.parametrize(("seconds", "words"), [(0.4, "0 s"), (42.0, "42 s"), (200.0, "3 min"), (7200.0, "2 h")])
def test_time_is_spoken_as_people_say_it(seconds, words):
    assert spoken(seconds) == words


def test_piped_it_is_silent_and_remembers_nothing(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with output.progress() as tell:
        tell("driving")
    assert sys.stderr.getvalue() == ""
    assert not list(tmp_path.iterdir())


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_on_a_terminal_the_second_time_says_how_long(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "argv", ["rollingroad", "run", "mixed", "--seed", "3"])
    for said in (False, True):
        if said:  # the first time took no time: let it have taken 40 s
            diary = tmp_path / "rollingroad" / "durations.json"
            assert set(json.loads(diary.read_text())["run mixed"]) == {"driving", "(end)"}
            diary.write_text(json.dumps({"run mixed": {"driving": 0.0, "(end)": 40.0}}))
        screen = Terminal()
        monkeypatch.setattr(sys, "stderr", screen)
        with output.progress() as tell:
            tell("driving")
        assert "driving" in screen.getvalue()
        assert ("left" in screen.getvalue()) == said


@pytest.mark.parametrize("damage", ["", "[1, 2]", '{"run mixed": {"(end)": "soon"}}', "{"])
def test_a_damaged_memory_is_no_trouble(monkeypatch, tmp_path, damage):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "argv", ["rollingroad", "run", "mixed"])
    (tmp_path / "rollingroad").mkdir()
    (tmp_path / "rollingroad" / "durations.json").write_text(damage)
    monkeypatch.setattr(sys, "stderr", Terminal())
    with output.progress() as tell:
        tell("driving")
    assert "driving" in sys.stderr.getvalue()
