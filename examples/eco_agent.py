"""A Stable-Baselines3 agent that learns to drive `rollingroad/EcoDrive-v0` (`pip install rollingroad[learn]`).

`python examples/eco_agent.py --steps 20000 --workers 2` trains PPO in parallel processes (one libsumo each) and drives
seeds that it has not seen, beside a foot that always asks for the same push.
"""

import argparse

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize

ENV = "rollingroad:rollingroad/EcoDrive-v0"
TESTED = (1_000, 1_001, 1_002)
"""Seeds of traffic to be judged on."""
GENTLE = 0.6
"""The action of the foot beside it: 1.4 m/s2 wanted wherever traffic and limits allow."""


def judged(env: gymnasium.Env, policy) -> tuple[float, float, float]:
    """Mean fuel (MJ), time (s) and return over the seeds in `TESTED`."""
    rows = []
    for seed in TESTED:
        seen, _ = env.reset(seed=seed)
        ended, total, info = False, 0.0, {}
        while not ended:
            seen, reward, arrived, late, info = env.step(policy(seen))
            total += float(reward)
            ended = arrived or late
        rows.append((info["fuel_J"] / 1e6, info["time_s"], total))
    fuel, time, total = np.mean(rows, axis=0)
    return float(fuel), float(time), float(total)


def main() -> None:
    """Train, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scenario", default="town")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    makers = [lambda: gymnasium.make(ENV, scenario=asked.scenario) for _ in range(asked.workers)]
    training = VecNormalize(SubprocVecEnv(makers, start_method="spawn"), gamma=0.98)
    model = PPO("MlpPolicy", training, n_steps=512, batch_size=128, gamma=0.98, seed=asked.seed, device="cpu")
    env = gymnasium.make(ENV, scenario=asked.scenario)

    def learnt(seen: np.ndarray) -> np.ndarray:
        return model.predict(training.normalize_obs(seen), deterministic=True)[0]

    results = {
        "gentle foot": judged(env, lambda seen: np.array([GENTLE], np.float32)),
        "untrained": judged(env, learnt),
    }
    model.learn(asked.steps)
    training.training = False
    results[f"after {asked.steps} steps"] = judged(env, learnt)
    print(f"{asked.scenario}, mean of seeds {TESTED}")
    for name, (fuel, time, total) in results.items():
        print(f"{name:20} fuel {fuel:6.2f} MJ  time {time:6.1f} s  return {total:8.1f}")
    env.close()
    training.close()


if __name__ == "__main__":
    main()
