"""Frames that the peer's coordinate system can follow.

It is nowhere wider than its sharpest bend allows, and drops what lies partly outside of it. Where
our lane bends too sharply for that, both get another frame, and the same one: the set and the road
are what they were, only their coordinates change.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sandra.scene import Frame
from sandra.scene.frame import smoothed
from sandra.scene.types import Scene

SHARPEST = 15.0
"""Where neighbouring normals meet nearer than this, a line goes straight on [m]."""


def framed(scene: Scene) -> Iterator[tuple[Scene, str]]:
    """The scene in its own frame, and in others that bend less; each with what was changed."""
    yield scene, ""
    yield _with(scene, Frame(smoothed(scene.frame.line))), "its line smoothed"
    line = straight_on(scene)
    if len(line) < len(scene.frame.line):
        yield _with(scene, Frame(line)), "straight on where its line bends sharply"


def straight_on(scene: Scene) -> np.ndarray:
    """(n, 2) the part of the reference line around the ego without sharp bends [m]."""
    frame = scene.frame
    line, segments = frame.line, len(frame.line) - 1
    here = int(np.searchsorted(frame.stations, scene.ego_curvilinear[0], side="right")) - 1
    here = min(max(here, 0), segments - 1)
    # Of a segment with its two neighbours: how far away their normals meet.
    sharp = [Frame(line[max(0, i - 1) : i + 3]).clearance < SHARPEST for i in range(segments)]
    first = max((i + 1 for i in range(here) if sharp[i]), default=0)
    last = min((i for i in range(here + 1, segments) if sharp[i]), default=segments)
    return line[first : last + 1]


def _with(scene: Scene, frame: Frame) -> Scene:
    lanes = tuple(
        replace(lane, frame=frame) if lane.relation == "current" else lane for lane in scene.lanes
    )
    return replace(scene, lanes=lanes)
