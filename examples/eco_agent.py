"""A Stable-Baselines3 agent that learns to drive `rollingroad/EcoDrive-v0` (`pip install rollingroad[learn]`).

`python examples/eco_agent.py --steps 13312 --workers 2` trains PPO in parallel processes (one libsumo each) and drives
seeds that it has not seen, beside the policy that it began with.

Two things make it learn. It corrects a steady foot: its action is added to a push of 0.6 m/s2, and traffic, limits and
signals allow less where they must, so that it can drive from the start. And in training every metre is worth what it
costs on average: an agent that looks a minute ahead does not see the arrival, and to stand still would be cheapest.
Over a whole trip the metres add the same to every policy; it is judged without them.
"""

import argparse
import time
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize

ENV = "rollingroad:rollingroad/EcoDrive-v0"
TESTED = tuple(range(1_000, 1_024))
"""Seeds of traffic to be judged on."""
STEADY = 0.3
"""The action of the steady foot: 0.6 m/s2 wanted wherever traffic and limits allow, which is timid."""
REACH = 1.0
"""How far (of the environment's action, 2.75 m/s2 each) the agent may depart from it."""
DISCOUNT = 0.98
"""A step is a second: the agent looks about 50 s ahead."""
TIME_VALUE = 8_000.0
"""W: what a second costs."""
METRE = 0.26
"""Reward of a metre in training: about what it costs the steady foot, fuel and time."""


class Corrected(gymnasium.ActionWrapper[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]):
    """The agent's action is what it adds to the steady foot's."""

    def action(self, action: NDArray[np.float32]) -> NDArray[np.float32]:
        """The environment's action."""
        return np.clip(STEADY + REACH * action, -1.0, 1.0).astype(np.float32)


class Progress(gymnasium.Wrapper[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]):
    """Rewards the metres driven, beside what they cost."""

    def reset(self, **options: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start anew."""
        seen, info = super().reset(**options)
        self._distance = info["distance_m"]
        return seen, info

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """A step, and `METRE` for every metre of it."""
        seen, reward, arrived, late, info = super().step(action)
        moved, self._distance = info["distance_m"] - self._distance, info["distance_m"]
        return seen, float(reward) + METRE * moved, arrived, late, info


def make(scenario: str) -> gymnasium.Env[Any, Any]:
    """The environment that is judged in; `Progress` of it is trained in."""
    return Corrected(gymnasium.make(ENV, scenario=scenario, time_value=TIME_VALUE))


def judged(env: gymnasium.Env[Any, Any], policy) -> NDArray[np.float64]:
    """Fuel (MJ), time (s) and return of every seed in `TESTED`, (seeds, 3)."""
    rows = []
    for seed in TESTED:
        seen, _ = env.reset(seed=seed)
        ended, total, info = False, 0.0, {}
        while not ended:
            seen, reward, arrived, late, info = env.step(policy(seen))
            total += float(reward)
            ended = arrived or late
        rows.append((info["fuel_J"] / 1e6, info["time_s"], total))
    return np.array(rows)


def with_interval(values: NDArray[np.float64]) -> str:
    """Mean and Student's 95 % interval."""
    half = student.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return f"{values.mean():+8.2f} ({values.mean() - half:+.2f} to {values.mean() + half:+.2f})"


def main() -> None:
    """Train, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=13_312)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scenario", default="town")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    makers = [lambda: Progress(make(asked.scenario)) for _ in range(asked.workers)]
    training = VecNormalize(SubprocVecEnv(makers, start_method="spawn"), gamma=DISCOUNT)
    training.seed(asked.seed)
    model = PPO(
        "MlpPolicy", training, n_steps=1024 // asked.workers, batch_size=128, gamma=DISCOUNT, gae_lambda=0.95,
        learning_rate=1e-3, policy_kwargs={"log_std_init": -1.0}, seed=asked.seed, device="cpu",
    )  # fmt: skip
    env = make(asked.scenario)

    def learnt(seen: NDArray[np.float32]) -> NDArray[np.float32]:
        return model.predict(training.normalize_obs(seen), deterministic=True)[0]

    before = judged(env, learnt)
    began = time.perf_counter()
    model.learn(asked.steps)
    took = time.perf_counter() - began
    training.training = False
    after = judged(env, learnt)
    print(f"{asked.scenario}, seeds {TESTED[0]} to {TESTED[-1]}; {asked.steps} steps took {took:.0f} s")
    for name, rows in (("untrained", before), ("trained", after)):
        fuel, duration, total = rows.mean(axis=0)
        print(f"{name:10} fuel {fuel:6.2f} MJ  time {duration:6.1f} s  return {total:8.1f}")
    for name, column in (("fuel, %", 0), ("time, %", 1)):
        print(f"{name:10} {with_interval(100.0 * (after[:, column] / before[:, column] - 1.0))}")
    print(f"{'return':10} {with_interval(after[:, 2] - before[:, 2])}")
    env.close()
    training.close()


if __name__ == "__main__":
    main()
