"""The environments keep Gymnasium's promises, and their car is ours."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from sim.envs import register

register()


@pytest.mark.parametrize("name", ["rollingroad/EcoDrive-v0", "rollingroad/HighwayEco-v0"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_environment_passes_the_checker(name: str) -> None:
    options = {"scenario": "town"} if "EcoDrive" in name else {}
    env = gymnasium.make(name, **options)
    try:
        check_env(env.unwrapped, skip_render_check=True)
    finally:
        env.close()


def test_same_seed_same_episode_and_fuel_is_counted() -> None:
    env = gymnasium.make("rollingroad/EcoDrive-v0", scenario="town")
    episodes = []
    for _ in range(2):
        first, _ = env.reset(seed=5)
        rows, rewards = [first], []
        for _ in range(30):
            seen, reward, _, _, info = env.step(np.array([0.6], np.float32))
            rows.append(seen)
            rewards.append(reward)
        episodes.append((np.stack(rows), rewards, info["fuel_J"], info["time_s"]))
    env.close()
    assert np.array_equal(episodes[0][0], episodes[1][0]) and episodes[0][1] == episodes[1][1]
    observations, rewards, fuel, time = episodes[0]
    assert observations[-1][0] > 3.0, "the car moves off"
    # The reward is fuel and time and nothing else: 30 periods of 1 s.
    start_fuel = fuel + 1e4 * (sum(rewards)) + 8_000.0 * 30.0
    assert 0.0 < start_fuel < 20_000.0, "what was burnt while parked before the first action"
    assert time == pytest.approx(32.0, abs=0.2)


def test_an_agent_that_never_moves_is_waited_for_and_not_lifted_out_of_the_way() -> None:
    """SUMO teleports who blocks the road for two minutes; a car that must obey the plant cannot be."""
    env = gymnasium.make("rollingroad/EcoDrive-v0", scenario="town", period=10.0)
    env.reset(seed=5)
    for _ in range(15):
        _, reward, arrived, late, info = env.step(np.array([-1.0], np.float32))
    env.close()
    assert info["time_s"] > 150.0 and info["distance_m"] < 1.0
    assert not arrived and not late and reward < 0.0


def test_highway_car_is_the_plant() -> None:
    """Full throttle from 25 m/s: highway-env's own car would do 5 m/s2, ours what its engine gives."""
    env = gymnasium.make("rollingroad/HighwayEco-v0", config={"vehicles_count": 0, "duration": 20})
    env.reset(seed=1)
    speeds, fuel = [], []
    for _ in range(8):
        _, _, _, _, info = env.step(3)  # FASTER
        speeds.append(info["speed"])
        fuel.append(info["fuel_J"])
    env.close()
    gains = np.diff(speeds)
    assert gains.max() < 2.0 and speeds[-1] > 26.0
    assert np.all(np.diff(fuel) > 5_000.0)


@pytest.mark.parametrize(
    "program",
    [
        'import gymnasium; gymnasium.make("rollingroad:rollingroad/HighwayEco-v0")',
        'import rollingroad, sys; assert "gymnasium" not in sys.modules and "numpy" not in sys.modules',
        'import rollingroad, gymnasium; gymnasium.spec("rollingroad/HighwayEco-v0")',
        'import rollingroad, gymnasium; gymnasium.spec("rollingroad/EcoDrive-v0")',
    ],
)
def test_environments_are_registered_whatever_is_imported_first_and_cost_nothing_before(program: str) -> None:
    """In a fresh interpreter, outside the repository."""
    subprocess.run([sys.executable, "-c", program], check=True, cwd="/")
