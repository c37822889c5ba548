"""Printing: tables for people, one JSON object for programs, progress on a terminal only."""

import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn
from rich.text import Text

from rollingroad.cli.course import Course, spoken
from rollingroad.json_form import plain


def print_json(value: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output."""
    sys.stdout.write(json.dumps(plain(value), ensure_ascii=False, indent=1) + "\n")


def console() -> Console:
    """The console for people: standard output, colours only on a terminal (and never with NO_COLOR)."""
    return Console(highlight=False)


@contextmanager
def progress(quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Yield a function that tells what is being done, on standard error; silent when piped or `quiet`.

    Beside it stand the time taken and, as soon as it can be told, the time left: from "3 of 8" in the text, else from
    how long the same command took on this machine before.
    """
    if quiet or not sys.stderr.isatty():
        yield lambda text: None
        return
    course = Course(_remembered())
    errors = Console(stderr=True, highlight=False)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), _TimeLeft(course))
    with Progress(*columns, console=errors, transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def tell(text: str) -> None:
            course.tell(text)
            bar.update(task, description=text)

        yield tell
    _remember(course)


class _TimeLeft(ProgressColumn):
    def __init__(self, course: Course) -> None:
        super().__init__()
        self._course = course

    def render(self, task: Task) -> Text:
        left = self._course.left()
        return Text("" if left is None or left < 0.5 else f"about {spoken(left)} left", style="dim")


def _diary() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rollingroad" / "durations.json"


def _command() -> str:
    """What was asked, without options: two runs of it take about as long."""
    return " ".join(word for word in sys.argv[1:4] if not word.startswith("-"))


def _read_diary() -> dict[str, Any]:
    try:
        read = json.loads(_diary().read_text())
    except (OSError, ValueError):
        return {}
    return read if isinstance(read, dict) else {}


def _remembered() -> dict[str, float]:
    before = _read_diary().get(_command())
    sound = isinstance(before, dict) and all(isinstance(value, int | float) for value in before.values())
    return before if sound and before else {}


def _remember(course: Course) -> None:
    """Keep the course for the next time; a cache that cannot be written costs nothing but the estimate."""
    with contextlib.suppress(OSError):
        path = _diary()
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = path.with_name(f"{path.name}.{os.getpid()}")
        aside.write_text(json.dumps(_read_diary() | {_command(): course.finished()}))
        aside.replace(path)
