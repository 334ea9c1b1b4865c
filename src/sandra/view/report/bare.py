"""An episode in which nothing was decided or verified: a driver of its own drove."""

from __future__ import annotations

from sandra.scene.types import Scene
from sandra.view.report.document import Answer, Decided, Prompt
from sandra.view.report.scenery import marks_of
from sandra.view.shapes import View


def bare(view: View, scene: Scene, stride: int) -> Decided:
    """What stands for its decisions, so that the page has a place to begin."""
    ego, state = scene.ego, scene.ego.state
    return Decided(
        step=0,
        time=0.0,
        scenario=scene.name,
        dt=scene.dt * stride,
        horizon=0,
        map=0,
        focus=(-20.0, 60.0, -12.0, 12.0),
        ego={
            "id": ego.id,
            "length": ego.length,
            "width": ego.width,
            "x": 0.0,
            "y": 0.0,
            "heading": 0.0,
            "speed": state.speed,
            "acceleration": state.acceleration,
        },
        others=(),
        marks=marks_of(view),
        parts={},
        pairs=(),
        curves=(),
        executed={"kind": "not verified", "pair": None, "note": "a driver without a verifier"},
        settings={"speed_limit": scene.speed_limit, "notes": [], "rules": []},
        prompt=Prompt(0, "", 0, None),
        answer=Answer("", "", (), None, None, None, None, (), None, False),
        durations_s={},
        operation="unverified",
    )
