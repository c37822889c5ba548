"""How long a command still takes: from counts in what it tells, or from the last time."""

import re
import time
from collections.abc import Callable, Mapping

END = "(end)"
"""The stage at which a command is done."""
_COUNT = re.compile(r"\b(\d+) of (\d+)\b")


class Course:
    """The stages of a command with the s at which each began; `before` is the `finished()` of an earlier one."""

    def __init__(self, before: Mapping[str, float], clock: Callable[[], float] = time.monotonic) -> None:
        self._before, self._clock = before, clock
        self._start = clock()
        self._began: dict[str, float] = {}
        self._text = ""
        self._counted: tuple[float, int, int] | None = None
        """s since the start when the present count stood first, and the count of how many."""
        self._first: tuple[float, int] | None = None
        """The first count of this row, and its s."""

    def tell(self, text: str) -> None:
        """A stage begins, or a count within it grows."""
        now = self._clock() - self._start
        self._text = _COUNT.sub("n of m", text)
        self._began.setdefault(self._text, now)
        found = _COUNT.search(text)
        if found is None:
            self._counted = self._first = None
            return
        done, total = int(found[1]), int(found[2])
        if self._first is None:
            self._first = now, done
        self._counted = now, done, total

    def left(self) -> float | None:
        """s, or None where nothing is known yet."""
        now = self._clock() - self._start
        if self._counted is not None and self._first is not None:
            counted, done, total = self._counted
            since, first = self._first
            if done > first:
                return max((counted - since) / (done - first) * (total - done) - (now - counted), 0.0)
        if self._text in self._before and END in self._before:
            stage = now - self._began[self._text]
            return max(self._before[END] - self._before[self._text] - stage, 0.0)
        return None

    def finished(self) -> dict[str, float]:
        """Beginnings of the stages, and of the end; s."""
        return self._began | {END: self._clock() - self._start}


def spoken(seconds: float) -> str:
    """ "40 s", "3 min", "2 h"."""
    if seconds < 90.0:
        return f"{round(seconds)} s"
    return f"{round(seconds / 60.0)} min" if seconds < 5400.0 else f"{round(seconds / 3600.0)} h"
