"""What drives in traffic: the whole chain, and the Gymnasium environment; each beside SUMO alone, same traffic."""

import tempfile
import time
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np

from benchmarks.timing import Row, row
from rollingroad.chain import run_chain
from rollingroad.task import make_task
from scenarios.files import load
from sim.demand import demand
from sim.network import build
from sim.traffic import Traffic

SCENARIO = "mixed"
EPISODE = 300.0
"""s that the environment is driven for."""
JOURNEY = 900.0
"""s that SUMO alone drives for: about what the ego takes."""


def chain() -> list[Row]:
    """`rollingroad run mixed`, report and recording included: by default, and in one process like SUMO beside it."""
    rows = []
    for name, workers in (("SUMO alone, same traffic", None), ("SUMO alone, both in one process", 0)):
        with tempfile.TemporaryDirectory(prefix="bench-") as folder:
            results = run_chain(make_task(SCENARIO), Path(folder) / "run", workers=workers)
        rows.append(row("chain", results["real_time_factor"], "x_real_time", name, sumo_alone()))
    return rows


def eco_drive_env(repeats: int = 3) -> list[Row]:
    """`EcoDrive-v0` on `mixed`, 60 vehicles, one action a second; the five minutes after setting out."""
    env = gymnasium.make("rollingroad/EcoDrive-v0", scenario=SCENARIO).unwrapped
    action = np.array([0.6], np.float32)
    best = 0.0
    try:
        for _ in range(repeats):
            _, info = env.reset(seed=0)
            began, start, ended = time.perf_counter(), info["time_s"], False
            while not ended and info["time_s"] < start + EPISODE:
                _, _, arrived, late, info = env.step(action)
                ended = arrived or late
            best = max(best, (info["time_s"] - start) / (time.perf_counter() - began))
    finally:
        env.close()
    return [row("eco_drive_env", best, "x_real_time", "SUMO alone, same traffic", sumo_alone())]


@cache
def sumo_alone(repeats: int = 3) -> float:
    """Simulated over wall seconds of SUMO with the scenario's traffic and nobody looking at it."""
    import libsumo

    scenario = load(SCENARIO)
    best = 0.0
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        network = build(scenario, Path(folder))
        routes = Path(folder) / "demand.rou.xml"
        routes.write_text(demand(scenario, network, 0, '<vType id="ego" carFollowModel="IDM"/>', 2.0 * JOURNEY))
        for _ in range(repeats):
            with Traffic(network, routes, 0) as traffic:
                began = time.perf_counter()
                while traffic.time < JOURNEY:
                    libsumo.simulation.step()
                best = max(best, JOURNEY / (time.perf_counter() - began))
    return best


BENCHMARKS = {"chain": chain, "eco_drive_env": eco_drive_env}
"""Name of `rollingroad bench` -> the function that measures it."""
