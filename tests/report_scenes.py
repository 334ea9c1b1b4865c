"""Decisions and documents for tests of the page."""

from __future__ import annotations

import functools
import json
from dataclasses import replace

import numpy as np

from sandra.actions import ActionPair
from sandra.decision import Decision, decide
from sandra.describe import Prompt
from sandra.rankers import Failure, Ranking
from sandra.view.report import Document, decision_document
from sandra.view.report.document import Decided, Episode, Series, Track
from sandra.view.report.packing import pack_rows
from sandra.view.report.scenery import STATE, outline_of
from straight_road import CAR, Road

HOSTILE = (
    "</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    "<svg onload=alert(3)><a href='javascript:alert(4)'>x</a>\u2028]]>--><!--{{script}}"
)


class Hostile:
    """A ranker whose every word is an attack."""

    name = f"hostile {HOSTILE}"

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        return Ranking(
            (ActionPair.parse("keep,follow-lane"),),
            self.name,
            Failure.MALFORMED,
            HOSTILE,
            (HOSTILE,),
            HOSTILE,
            HOSTILE + "x" * 1_000_000,
        )


@functools.cache
def on_the_road() -> Decision:
    """A car ahead, a car beside; set-based, all pairs."""
    road = Road(angle=0.8, x=5.0, y=-30.0)
    scene = road.scene(
        road.obstacle(10, 22.0, 0.0, speed=6.0),
        road.obstacle(11, 4.0, 3.5, speed=11.0),
        lanes=road.three_lanes(),
        dt=0.2,
        speed=12.0,
    )
    return decide(
        scene,
        "rules",
        "be quick",
        prediction="set-based",
        rules=["R_G1", "G(v <= 13.9)"],
        horizon=8,
        walk="all",
    )


def hostile_document() -> Document:
    """All texts that come from a model or a file attack the page."""
    scene = replace(on_the_road().scene, name=HOSTILE)
    decision = decide(scene, Hostile(), HOSTILE, horizon=3, accept="reachable")
    return decision_document(decision)


@functools.cache
def crowded() -> Decided:
    """One decision among forty others."""
    road = Road()
    others = [
        road.obstacle(
            100 + i, -130.0 + 22.0 * (i // 3) + 5 * (i % 3), 3.5 * (i % 3 - 1), speed=10.0
        )
        for i in range(42)
        if abs(-130.0 + 22.0 * (i // 3) + 5 * (i % 3)) > 6.0
    ][:40]
    assert len(others) == 40
    scene = road.scene(*others, lanes=road.three_lanes(), dt=0.2, speed=10.0)
    decision = decide(
        scene, "rules", prediction="set-based", rules=["R_G1"], horizon=8, accept="reachable"
    )
    document = decision_document(decision)
    found = document.decisions[0]
    assert isinstance(found, Decided)
    assert len(found.others) == 40
    return found


def long_episode(steps: int = 300, ticks: int = 3) -> Document:
    """So many decisions among forty others, each with sets, predictions, texts; their ways."""
    first = crowded()
    document = decision_document(on_the_road())
    count = steps * ticks + 1
    t = np.arange(count) / 15.0
    rng = np.random.default_rng(1)
    tracks = []
    for i in range(41):
        wave = 1.5 * np.sin(0.3 * t + i)
        rows = np.column_stack(
            [
                10.0 * t + 20.0 * i - 400.0 * (i > 0),
                wave,
                0.04 * wave,
                10.0 + wave,
                rng.normal(size=count),
            ]
        )
        tracks.append(
            Track(1 if i == 0 else 99 + i, "car", outline_of(CAR), 0, pack_rows(rows, STATE))
        )
    decisions = tuple(
        replace(
            first,
            step=k,
            time=0.2 * k,
            operation=("certified", "carried")[k % 2],
            covered=True,
            prompt=replace(first.prompt, user=f"{first.prompt.user}\nStep {k}"),
        )
        for k in range(steps)
    )
    series = tuple(
        Series(rule, "m", 0.2, tuple(float(x) for x in np.sin(0.1 * np.arange(steps) + i)), (3, 4))
        for i, rule in enumerate(("R_G1", "R_G2", "R_G3"))
    )
    return Document(
        "episode",
        "long",
        (("ranked by", "rules"),),
        maps=document.maps,
        decisions=decisions,
        texts=("system", json.dumps({"type": "object"})),
        episode=Episode(1, 1 / 15, count, ticks, tuple(tracks), series, None, ()),
    )
