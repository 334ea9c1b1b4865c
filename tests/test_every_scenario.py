"""Every scenario at hand, both predictions, with and without rules: decide and verify finish."""

from pathlib import Path

import numpy as np
import pytest

import sandra
from sandra.reach import Status

ROOT = Path(__file__).resolve().parents[1]
FILES = [
    *sandra.examples().values(),
    *sorted((ROOT.parent / "shared" / "data" / "scenarios").glob("*.xml")),
]
RULES = ("R_G1", "R_G2", "R_G3")


@pytest.mark.parametrize("prediction", ["most-likely", "set-based"])
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_decide_and_verify_all_finish(path: Path, prediction: str) -> None:
    scene = sandra.load(path)
    predicted = sandra.predict(scene, prediction)
    for rules in ((), RULES):
        decision = sandra.decide(
            scene,
            "rules",
            "drive faster",
            prediction=predicted,
            rules=rules,
            walk="all",
            accept="reachable",
        )
        decided(scene, decision)


def decided(scene: sandra.Scene, decision: sandra.Decision) -> None:
    """What holds of every decision in which all twelve pairs were verified."""
    assert len(decision.verdicts) == 12
    for verdict in decision.verdicts:
        found = verdict.reachable_set
        if verdict.status is Status.UNSAFE:
            assert verdict.reason
            assert verdict.first_empty_step == len(found.steps) <= 25
        else:
            corridor = found.corridor()
            assert corridor.first_empty_step is None
            sizes = zip(corridor.steps, found.steps, strict=True)
            assert all(0 < len(kept) <= len(sets) for kept, sets in sizes)
    ranked = decision.ranking.pairs
    holds = [pair for pair in ranked if decision.verdicts[pair].status is Status.REACHABLE]
    assert decision.maneuver.pair == (holds[0] if holds else None)
    assert np.isfinite(decision.maneuver.states).all()
    start = decision.maneuver.states[0]
    assert start[:4] == pytest.approx(
        [scene.ego.state.x, scene.ego.state.y, start[2], scene.ego.state.speed], abs=1e-3
    )
    assert str(decision)
