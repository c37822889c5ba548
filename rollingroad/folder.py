"""The run folder: every product of the chain as a file, put in place only when it is whole."""

import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rollingroad.json_form import plain


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """Yield a folder to write in beside `folder`; it takes that place when the block succeeds, and is removed when not.

    What stood at `folder` before is replaced if it was a run's (it holds run.json) or empty; FileExistsError otherwise.
    """
    if folder.exists() and not (folder / "run.json").is_file() and any(folder.iterdir()):
        raise FileExistsError(17, "expected a new folder or one that holds an earlier run (run.json)", str(folder))
    aside = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    aside.mkdir(parents=True)
    try:
        yield aside
        old = folder.with_name(f".{folder.name}.{os.getpid()}.old")
        if folder.exists():
            folder.rename(old)
        aside.rename(folder)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    """Write `value` as JSON, aside and renamed."""
    aside = path.with_name(path.name + ".part")
    aside.write_text(json.dumps(plain(value), indent=1, ensure_ascii=False) + "\n")
    aside.replace(path)


class Stopwatch:
    """Wall time by stage, s: `lap` adds the time since the last lap to a stage."""

    def __init__(self) -> None:
        self._start = self._last = time.perf_counter()
        self.stages: dict[str, float] = {}

    def lap(self, stage: str) -> None:
        """Book the time since the last lap on `stage`."""
        now = time.perf_counter()
        self.stages[stage] = self.stages.get(stage, 0.0) + now - self._last
        self._last = now

    @property
    def total(self) -> float:
        """s since it was started."""
        return time.perf_counter() - self._start
