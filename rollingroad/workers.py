"""Drives in processes of their own: one libsumo per process, two drives side by side."""

import gc
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

COLLECT = (50_000, 20, 100)
"""Thresholds of Python's cycle collector. Compiling and importing make millions of objects that stay: at its own
thresholds the collector looks through them in vain for a twelfth of the time; at these it takes 20 MB more."""


class Inline(Executor):
    """Runs each call at once in this process: `--workers 0`, for debugging."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future:
        """Call `fn` now and return its finished future."""
        future: Future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except BaseException as error:
            future.set_exception(error)
        return future


def cores() -> int:
    """Processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


@contextmanager
def executor(workers: int | None = None) -> Iterator[Executor]:
    """Yield an executor with `workers` spawned processes: one per core by default, none (inline) for 0."""
    count = cores() if workers is None else workers
    if count == 0:
        yield Inline()
        return
    # Spawned, not forked: SUMO and numba keep threads and locks that do not survive a fork.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=gc.set_threshold, initargs=COLLECT)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
