"""A trained agent on seeds that it has not seen, without and with the shield.

    .venv-shield/bin/python examples/shield/compare.py demo/dqn.zip --seeds 20

Each episode is a line of a file, so that a run that was cut off goes on; the table is Markdown.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
from stable_baselines3 import DQN
from world import ENVIRONMENT, make

from sandra.evaluation.closed_loop.metrics import wilson
from sandra.simulation import Shield

CONDITIONS = ("without", "shield")


def episode(model: DQN, condition: str, seed: int, duration: float, density: float) -> dict:
    """Drive one episode to its end."""
    env = make(duration, density)
    if condition == "shield":
        env = Shield(env)
    observation, info = env.reset(seed=seed)
    start = float(env.unwrapped.vehicle.position[0])
    began, row = time.process_time(), {"reward": 0.0, "decisions": 0, "replacements": 0}
    operations: dict[str, int] = {}
    steps, over = 0, False
    while not over:
        action, _ = model.predict(observation, deterministic=True)
        observation, reward, terminated, truncated, info = env.step(int(action))
        steps, over = steps + 1, terminated or truncated
        row["reward"] += float(reward)
        for name in ("decisions", "replacements"):
            row[name] += info.get(name, 0)
        for one in getattr(env, "decided", ()):
            operations[one.operation.value] = operations.get(one.operation.value, 0) + 1
            last = one.operation.value
    return {
        "condition": condition,
        "seed": seed,
        "duration": duration,
        "density": density,
        "crashed": bool(info["crashed"]),
        "crashed_while": last if info["crashed"] and condition == "shield" else None,
        "ended": info.get("ended"),
        "steps": steps,
        "distance": float(env.unwrapped.vehicle.position[0]) - start,
        **row,
        "operations": operations,
        "cpu": time.process_time() - began,
    }


def table(rows: list[dict]) -> str:
    """Means over all episodes, those with a collision included."""
    lines = [
        "| | episodes | with a collision, % [95 %] | distance, m | reward | actions replaced, % |",
        "|---|---|---|---|---|---|",
    ]
    for condition in CONDITIONS:
        mine = [row for row in rows if row["condition"] == condition]
        if not mine:
            continue
        crashed = sum(row["crashed"] for row in mine)
        low, high = wilson(crashed, len(mine))
        decisions = sum(row["decisions"] for row in mine)
        replaced = sum(row["replacements"] for row in mine)
        lines.append(
            f"| {condition} | {len(mine)} | {100 * crashed / len(mine):.0f} "
            f"[{100 * low:.0f}, {100 * high:.0f}] | {np.mean([r['distance'] for r in mine]):.0f} "
            f"| {np.mean([r['reward'] for r in mine]):.1f} "
            f"| {f'{100 * replaced / decisions:.1f}' if decisions else '-'} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path, nargs="?", default=Path("demo/dqn.zip"))
    parser.add_argument("--seeds", type=int, default=20, help="1 to this many")
    parser.add_argument("--duration", type=float, default=15.0, help="of an episode [s]")
    parser.add_argument("--density", type=float, default=1.5, help="of the traffic; learnt in 1")
    parser.add_argument("--out", type=Path, default=Path("demo/shield.jsonl"))
    arguments = parser.parse_args()
    traffic = (arguments.duration, arguments.density)
    torch.set_num_threads(1)
    model = DQN.load(arguments.model, device="cpu")
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    if arguments.out.exists():
        rows = [json.loads(line) for line in arguments.out.read_text().splitlines()]
    if any((row["duration"], row["density"]) != traffic for row in rows):
        raise SystemExit(f"{arguments.out} holds episodes in other traffic: name another file")
    done = {(row["condition"], row["seed"]) for row in rows}
    for condition in CONDITIONS:
        for seed in range(1, arguments.seeds + 1):
            if (condition, seed) in done:
                continue
            rows.append(episode(model, condition, seed, *traffic))
            with arguments.out.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print(
        f"{ENVIRONMENT}, seeds 1 to {arguments.seeds}, {arguments.duration:g} s, "
        f"density {arguments.density:g}\n"
    )
    print(table(rows))
    shielded = [row for row in rows if row["condition"] == "shield"]
    operations = {}
    for row in shielded:
        for name, count in row["operations"].items():
            operations[name] = operations.get(name, 0) + count
    told = ", ".join(f"{name} {count}" for name, count in operations.items())
    decisions = sum(row["decisions"] for row in shielded)
    print(f"\ndriven by, decisions: {told}")
    print(
        f"a decision: {sum(row['cpu'] for row in shielded) / max(decisions, 1):.2f} s of CPU time"
    )
    for row in shielded:
        if row["crashed"]:
            print(f"collision with the shield: seed {row['seed']}, while {row['crashed_while']}")


if __name__ == "__main__":
    main()
