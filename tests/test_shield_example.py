"""The example with a trained agent: Stable-Baselines3 itself where its environment is there."""

import json
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "examples" / "shield"
PYTHON = ROOT / ".venv-shield" / "bin" / "python"

pytestmark = pytest.mark.skipif(not PYTHON.exists(), reason="no .venv-shield (make example-shield)")

VECTORISED = """
import gymnasium, highway_env
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv
from sandra import ActionPair
from sandra.simulation import Shield

config = {"vehicles_count": 2, "policy_frequency": 5, "duration": 0.6}
def make():
    return Monitor(Shield(gymnasium.make("highway-v0", config=config)))

env = DummyVecEnv([make, make])
env.seed(3)
env.reset()
for step in range(4):
    observations, rewards, done, infos = env.step([1, 3])
    assert observations.shape == (2, 5, 5)
    assert all(isinstance(info["proposed"], ActionPair) for info in infos)
    assert list(done) == [step == 2] * 2, done
    if step == 2:
        assert infos[0]["episode"]["l"] == 3
        assert infos[0]["TimeLimit.truncated"]
"""


def run(*words: str, timeout: float = 300.0) -> str:
    result = subprocess.run(
        [str(PYTHON), *words], capture_output=True, text=True, timeout=timeout, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_environments_of_stable_baselines() -> None:
    run("-c", VECTORISED)


@pytest.mark.slow
def test_an_agent_is_trained_and_compared(tmp_path: Path) -> None:
    model, rows = tmp_path / "dqn.zip", tmp_path / "shield.jsonl"
    assert "return of the" in run(str(EXAMPLE / "train.py"), "--steps", "510", "--out", str(model))
    words = [str(model), "--seeds", "2", "--duration", "1", "--out", str(rows)]
    first = run(str(EXAMPLE / "compare.py"), *words)
    found = [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()]
    assert [(row["condition"], row["seed"]) for row in found] == [
        ("without", 1), ("without", 2), ("shield", 1), ("shield", 2),
    ]  # fmt: skip
    assert all(row["decisions"] == sum(row["operations"].values()) for row in found)
    assert found[2]["decisions"] == 5
    assert "| shield | 2 |" in first
    # What is there already is not driven again.
    assert run(str(EXAMPLE / "compare.py"), *words) == first
    assert len(rows.read_text(encoding="utf-8").splitlines()) == 4
