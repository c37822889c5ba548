"""Printing: tables for people, one JSON object for programs, progress on a terminal only."""

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console

from rollingroad.json_form import plain


def print_json(value: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output."""
    sys.stdout.write(json.dumps(plain(value), ensure_ascii=False, indent=1) + "\n")


def console() -> Console:
    """The console for people: standard output, colours only on a terminal (and never with NO_COLOR)."""
    return Console(highlight=False)


@contextmanager
def progress(quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Yield a function that tells what is being done, on standard error; silent when piped or `quiet`."""
    if quiet or not sys.stderr.isatty():
        yield lambda text: None
        return
    errors = Console(stderr=True, highlight=False)
    with errors.status("starting") as status:
        yield lambda text: status.update(text)
