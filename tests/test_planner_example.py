"""The example with a published planner: the real planner where its environment is there."""

import json
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sandra
from sandra.certificate import check_file

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "examples" / "reactive_planner"
PLANNER = ROOT / ".venv-planner" / "bin" / "python"


def run(script: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(script), *words],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.mark.skipif(not PLANNER.exists(), reason="no .venv-planner (make example-planner)")
def test_the_planner_is_certified_in_our_corridor(tmp_path: Path) -> None:
    result = run(EXAMPLE / "run.py", "roadworks", "decelerate,left-lane", "--output", str(tmp_path))
    assert result.returncode == 0, result.stderr + result.stdout
    assert "CERTIFIED" in result.stdout
    assert check_file(tmp_path / "certificate.json").accepted
    answer = json.loads((tmp_path / "trajectory.json").read_text(encoding="utf-8"))
    assert answer["planner"] == "commonroad-reactive-planner"
    assert np.isfinite(answer["states"]).all()
    assert (tmp_path / "planner.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.skipif(not PLANNER.exists(), reason="no .venv-planner (make example-planner)")
def test_a_pair_without_a_corridor_is_not_planned(tmp_path: Path) -> None:
    result = run(EXAMPLE / "run.py", "nothing-safe", "keep,follow-lane", "--output", str(tmp_path))
    assert result.returncode == 1
    assert "UNSAFE" in result.stdout
    assert not (tmp_path / "trajectory.json").exists()


def test_without_the_planner_one_line_says_how_to_get_it(tmp_path: Path) -> None:
    copy = tmp_path / "examples" / "reactive_planner"
    shutil.copytree(EXAMPLE, copy)
    result = run(copy / "run.py", "--output", str(tmp_path / "demo"))
    assert result.returncode == 2
    assert "make example-planner" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_the_picture_is_drawn_whatever_the_verdict(tmp_path: Path, shift: float) -> None:
    draw: Callable[..., Any] = runpy.run_path(str(EXAMPLE / "picture.py"))["draw"]
    scene = sandra.load(sandra.example("intersection"))
    verdicts = sandra.verify(scene, "decelerate,follow-lane")
    t = scene.dt * np.arange(verdicts.ground.horizon + 1)
    speed = scene.ego.state.speed - 2.0 * t
    s = scene.ego_curvilinear[0] + scene.ego.state.speed * t - t**2
    d = scene.ego_curvilinear[1] + shift * (t / t[-1]) ** 3
    points = scene.frame.to_cartesian(np.column_stack([s, d]))
    states = np.column_stack([points, scene.frame.heading(s), speed]).tolist()
    verdict = sandra.certify_trajectory(verdicts, 0, states)
    assert (verdict.status is sandra.Status.CERTIFIED) == (shift == 0.0), verdict
    path = draw(verdicts, verdict, states, tmp_path / "p.png", dpi=50)
    assert path.read_bytes().startswith(b"\x89PNG")
