"""Units of work on this machine's cores or on a Dask cluster: the same answers, and nothing lost when something dies.

Each Dask worker owns one child process and runs its units there. SUMO allows one simulation per process, a unit that
hangs inside a C++ library can only be stopped by killing its process, and one that crashes must not take the worker
along. By default the cluster lives in this process, with one worker, and so one child, per core.
"""

import atexit
import multiprocessing
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError
from concurrent.futures import TimeoutError as UnitTimeout
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from rollingroad.evaluation.store import Store, Unit
from rollingroad.workers import cores
from vehicle_model.car.errors import BadInput

PATIENCE = 60.0
"""s to wait for a scheduler, or for its workers, that went away."""


@dataclass(frozen=True)
class Outcome:
    """What became of a unit: a result, or one line of why not, with the log of the failure."""

    unit: Unit
    result: dict[str, Any] | None
    error: str | None = None
    log: str = ""
    computed: bool = True
    """False where the result was already in the store."""


def call(function: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """Call `function` ("module:name") with `arguments`; runs in the child process."""
    module, _, name = function.partition(":")
    return getattr(import_module(module), name)(**arguments)


_children = threading.local()
_all_children: list[Any] = []


def _child() -> Any:
    """This worker thread's own process, started when first needed and again after it was killed."""
    from pebble import ProcessPool

    if getattr(_children, "pool", None) is None or not _children.pool.active:
        _children.pool = ProcessPool(max_workers=1, context=multiprocessing.get_context("spawn"))
        _all_children.append(_children.pool)
    return _children.pool


@atexit.register
def stop_children() -> None:
    """End the child processes of this process's workers."""
    while _all_children:
        pool = _all_children.pop()
        pool.stop()
        pool.join()


def run_unit(unit: Unit, timeout: float | None) -> tuple[dict[str, Any] | None, str | None, str]:
    """Run `unit` in the worker's child process. Returns result, error line, log; never raises."""
    from pebble import ProcessExpired

    try:
        future = _child().schedule(call, args=(unit.function, dict(unit.arguments)), timeout=timeout)
        return future.result(), None, ""
    except UnitTimeout:
        return None, f"took longer than {timeout:g} s and was stopped", ""
    except ProcessExpired as death:
        return None, f"its process died (exit code {death.exitcode})", ""
    except BrokenExecutor as death:  # so fast that pebble gave the pool up; `_child` starts another
        return None, f"its process died ({death})", ""
    except Exception as error:
        return None, f"{type(error).__name__}: {error}", traceback.format_exc()


def run_units(
    units: Sequence[Unit],
    store: Store,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    client: Any = None,
    timeout: float | None = 900.0,
    done: Callable[[Outcome], None] = lambda outcome: None,
) -> list[Outcome]:
    """Outcomes of `units`, in their order; what `store` already holds is not computed again.

    `workers` processes on this machine (one per core by default; 0 runs in this process without Dask, for debugging),
    or the Dask scheduler at `cluster`, or an open `client` (see `opened`; several threads may use one). A unit that
    fails, hangs beyond `timeout` (s) or dies is reported in its outcome and leaves the others alone; a scheduler that
    is started again gets what it lost once more. A result that the disk would not keep is still returned, its error
    told. Raises BadInput where the scheduler cannot be reached or has no workers.
    """
    outcomes: dict[int, Outcome] = {}
    missing: list[int] = []
    for index, unit in enumerate(units):
        kept = store.read(unit)
        if kept is None:
            missing.append(index)
        else:
            outcomes[index] = Outcome(unit, kept, computed=False)
            done(outcomes[index])
    for index, (result, error, log) in _computed(units, missing, workers, cluster, client, timeout):
        unit = units[index]
        if result is not None:
            try:
                store.write(unit, result)
            except OSError as full:
                error = f"computed, but not kept: {full.strerror or full}"
        outcomes[index] = Outcome(unit, result, error, log)
        done(outcomes[index])
    return [outcomes[index] for index in range(len(units))]


def _local_cluster(workers: int) -> Any:
    """A Dask cluster inside this process: threads, each of which has a child process; status pages on loopback only."""
    from distributed import LocalCluster

    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=False,
        dashboard_address="127.0.0.1:0",
        worker_dashboard_address="127.0.0.1:0",
    )


@contextmanager
def opened(workers: int | None = None, cluster: str | None = None) -> Iterator[Any]:
    """Yield a client whose workers stay, with what they keep in mind, for several calls of `run_units`.

    None for `workers` 0. Raises BadInput where the scheduler at `cluster` cannot be reached or has no workers.
    """
    if workers == 0 and cluster is None:
        yield None
        return
    from distributed import Client

    try:
        client = Client(cluster or _local_cluster(workers or cores()), timeout="10s")
    except OSError as error:
        raise BadInput("--cluster", str(cluster), f"expected a Dask scheduler that answers ({error})") from None
    try:
        with client:
            if cluster is not None and not _reconnected(client):
                raise BadInput("--cluster", cluster, f"expected a Dask scheduler with workers within {PATIENCE:g} s")
            yield client
    finally:
        if cluster is None:
            stop_children()


def _computed(
    units: Sequence[Unit],
    missing: Sequence[int],
    workers: int | None,
    cluster: str | None,
    client: Any,
    timeout: float | None,
) -> Iterator[tuple[int, tuple[dict[str, Any] | None, str | None, str]]]:
    if not missing:
        return
    if client is not None:
        yield from _on(client, units, missing, timeout)
    elif workers == 0 and cluster is None:
        for index in missing:
            try:
                yield index, (call(units[index].function, dict(units[index].arguments)), None, "")
            except Exception as error:
                yield index, (None, f"{type(error).__name__}: {error}", traceback.format_exc())
    else:
        with opened(min(workers or cores(), len(missing)), cluster) as own:
            yield from _on(own, units, missing, timeout)


def _on(
    client: Any, units: Sequence[Unit], missing: Sequence[int], timeout: float | None
) -> Iterator[tuple[int, tuple[dict[str, Any] | None, str | None, str]]]:
    """Outcomes in the order in which they come; what a lost scheduler took with it is asked for again."""
    from distributed import as_completed

    left = set(missing)
    while left:
        try:
            futures = {client.submit(run_unit, units[i], timeout, pure=False, retries=3): i for i in sorted(left)}
            for future in as_completed(futures):
                error = future.exception()
                outcome = future.result() if error is None else (None, f"lost with its worker: {error}", "")
                left.discard(futures[future])
                yield futures[future], outcome
        except CancelledError:
            if not _reconnected(client):
                why = f"lost: the scheduler and its workers did not come back within {PATIENCE:g} s"
                yield from ((index, (None, why, "")) for index in sorted(left))
                return


def _reconnected(client: Any) -> bool:
    """Whether the client finds its scheduler, with workers, again within `PATIENCE`; it tries by itself."""
    until = time.monotonic() + PATIENCE
    while client.status != "closed" and time.monotonic() < until:
        if client.status == "running" and client.scheduler_info()["workers"]:
            return True
        time.sleep(0.2)
    return False
