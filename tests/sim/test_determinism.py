"""Given one scenario and seed, whoever asks gets the same bits: another process or hash seed, SUMO behind a socket."""

import os
import subprocess
import sys

import pytest

PROGRAM = """
import hashlib, sys
import sim.traffic
if sys.argv[1] == "traci":
    import traci
    from sumolib import checkBinary
    sim.traffic.libsumo = traci
    begin = traci.start
    traci.start = lambda arguments: begin([checkBinary("sumo"), *arguments[1:]])
from scenarios.files import load
from sim.drive import drive
from vehicle_model.car.files import read_car
town = load("town")
town = town.model_copy(update={"traffic": town.traffic.model_copy(update={"vehicles": 8})})
found = drive(town, read_car("smart"), 5)
digest = hashlib.sha256(repr(found.step_hashes).encode())
for name in sorted(found.trip.channels):
    digest.update(found.trip.channels[name].tobytes())
print(len(found.step_hashes), digest.hexdigest())
"""


def _drive(binding: str, hash_seed: str) -> str:
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
    command = [sys.executable, "-c", PROGRAM, binding]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def first() -> str:
    return _drive("libsumo", "0")


def test_another_process_with_another_hash_seed_drives_the_same_bits(first: str) -> None:
    assert int(first.split()[0]) > 1000
    assert _drive("libsumo", "4711") == first


def test_sumo_behind_a_socket_drives_the_same_bits_as_in_process(first: str) -> None:
    assert _drive("traci", "0") == first
