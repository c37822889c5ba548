"""Given a scheduler, workers and a client that are real processes, whoever is killed: every answer arrives once."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rollingroad.evaluation import engine
from rollingroad.evaluation.engine import Outcome, run_units
from rollingroad.evaluation.store import Store, Unit

ROOT = Path(__file__).parents[2]
UNITS = [Unit("tests.rollingroad.units:nap", {"x": x}) for x in range(6)]
ANSWERS = [{"square": x * x} for x in range(6)]


class Cluster:
    """A Dask scheduler and one worker, each a process of its own on loopback."""

    def __init__(self) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = str(probe.getsockname()[1])
        self.address = f"tcp://127.0.0.1:{self._port}"
        self._processes: list[subprocess.Popen] = []

    def start(self) -> None:
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        scheduler = ["scheduler", "--host", "127.0.0.1", "--port", self._port, "--no-dashboard", "--no-show"]
        worker = ["worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        for name, *options in (scheduler, worker):
            command = [sys.executable, "-m", f"distributed.cli.dask_{name}", *options]
            self._processes.append(subprocess.Popen(command, env=environment, **quiet))

    def kill(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()
        self._processes = []


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    found = Cluster()
    found.start()
    yield found
    found.kill()


@pytest.mark.xdist_group("cluster")
def test_a_scheduler_killed_and_started_again_loses_no_answer(tmp_path: Path, cluster: Cluster) -> None:
    seen: list[Outcome] = []

    def kill_once(outcome: Outcome) -> None:
        seen.append(outcome)
        if len(seen) == 2:
            cluster.kill()
            cluster.start()

    outcomes = run_units(UNITS, Store(tmp_path), cluster=cluster.address, done=kill_once)
    assert [outcome.result for outcome in outcomes] == ANSWERS
    assert len(seen) == len(UNITS)


@pytest.mark.xdist_group("cluster")
def test_a_scheduler_that_stays_away_is_told_and_what_was_done_is_kept(
    tmp_path: Path, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store(tmp_path)
    monkeypatch.setattr(engine, "PATIENCE", 20.0)
    outcomes = run_units(UNITS, store, cluster=cluster.address, done=lambda outcome: cluster.kill())
    kept = [outcome for outcome in outcomes if outcome.result is not None]
    lost = [outcome for outcome in outcomes if outcome.result is None]
    assert kept and lost
    assert all("did not come back" in (outcome.error or "") for outcome in lost)
    again = run_units(UNITS, store, workers=0)
    assert [outcome.result for outcome in again] == ANSWERS
    assert sum(outcome.computed for outcome in again) == len(lost)


def test_a_client_killed_and_started_again_computes_only_what_is_missing(tmp_path: Path) -> None:
    program = (
        "from pathlib import Path\n"
        "from rollingroad.evaluation.engine import run_units\n"
        "from rollingroad.evaluation.store import Store, Unit\n"
        "units = [Unit('tests.rollingroad.units:nap', {'x': x}) for x in range(6)]\n"
        f"run_units(units, Store(Path({str(tmp_path)!r})), workers=0, done=lambda outcome: print('done', flush=True))\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    client = subprocess.Popen([sys.executable, "-c", program], env=environment, stdout=subprocess.PIPE, text=True)
    assert client.stdout is not None
    for _ in range(2):
        assert client.stdout.readline() == "done\n"
    client.send_signal(signal.SIGKILL)
    client.wait()
    time.sleep(0.1)
    outcomes = run_units(UNITS, Store(tmp_path), workers=0)
    assert [outcome.result for outcome in outcomes] == ANSWERS
    assert sum(not outcome.computed for outcome in outcomes) >= 2
