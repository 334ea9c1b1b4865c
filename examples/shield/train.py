"""Train a DQN of Stable-Baselines3, in minutes on one core; it knows nothing of the shield.

make .venv-shield
.venv-shield/bin/python examples/shield/train.py --steps 20000 --out demo/dqn.zip
"""

import argparse
import time
from pathlib import Path

import torch
from stable_baselines3 import DQN
from stable_baselines3.common.monitor import Monitor
from world import ENVIRONMENT, make

FIRST_SEED = 100_000
"""Of the training episodes, one after the other; compare.py uses others."""


class Seeded(Monitor):
    """An episode of its own seed after each reset, whoever resets."""

    def __init__(self, env):
        super().__init__(env)
        self.next = FIRST_SEED

    def reset(self, **arguments):
        self.next += 1
        return super().reset(seed=self.next - 1, options=arguments.get("options"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20_000, help="decisions to learn from")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("demo/dqn.zip"))
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    began = time.perf_counter()
    env = Seeded(make())
    model = DQN(
        "MlpPolicy",
        env,
        policy_kwargs={"net_arch": [64, 64]},
        learning_rate=5e-4,
        buffer_size=15_000,
        learning_starts=500,
        batch_size=64,
        gamma=0.8,
        train_freq=1,
        target_update_interval=50,
        exploration_fraction=0.5,
        exploration_final_eps=0.05,
        seed=arguments.seed,
        device="cpu",
    )
    model.learn(arguments.steps)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    model.save(arguments.out)
    returns = env.get_episode_rewards()
    print(
        f"{ENVIRONMENT}: {arguments.steps} decisions in {len(returns)} episodes, "
        f"{time.perf_counter() - began:.0f} s; return of the first 50 episodes "
        f"{sum(returns[:50]) / 50:.1f}, of the last 50 {sum(returns[-50:]) / 50:.1f}"
    )
    print(f"written: {arguments.out}")


if __name__ == "__main__":
    main()
