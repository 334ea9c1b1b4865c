"""A recording as arrays: every vehicle at every step, and what of it is no evidence."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.errors import ScenarioError
from sandra.prediction.observed import LANE_KINDS
from sandra.scene.sent import content_of, is_there
from sandra.scene.types import Obstacle, Scene, placed

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

CRASHED = ".crashed.json"
"""Beside RECORDING.xml, RECORDING.crashed.json holds {"ID": STEP, ...}: crashed from then on."""
METRICS = "metrics.json"
"""Of an episode in a run folder: beside its scenario.xml, with such an object as "crashed"."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """m vehicles at n steps of dt; the ego, where it is recorded, is the last of them.

    `there` (m, n) whether a vehicle is recorded and not yet crashed.
    """

    scene: Scene
    ids: tuple[int, ...]
    kinds: tuple[str, ...]
    outlines: Array
    """(m, c, 2) corners in the body frame [m]; those with fewer corners repeat their last one."""
    lengths: Array
    """(m,) [m]"""
    radii: Array
    """(m,) by which a body is wider than its corners [m]"""
    states: Array
    """(m, n, 5) x, y, heading, speed, acceleration; NaN where it is not recorded."""
    there: Bools
    has_ego: bool
    stride: int
    """Steps of the file between two steps here."""
    crashed_steps: int
    """Vehicle steps that are left out, because the vehicle has crashed."""

    @property
    def dt(self) -> float:
        """[s]"""
        return self.scene.dt

    @property
    def on_lanes(self) -> Bools:
        """(m,) vehicles of a kind that drives on lanes; the ego is none of the others."""
        return self._others([kind in LANE_KINDS for kind in self.kinds])

    @property
    def walking(self) -> Bools:
        """(m,) pedestrians."""
        return self._others([kind == "pedestrian" for kind in self.kinds])

    @property
    def others(self) -> Bools:
        """(m,) whoever moves and is no pedestrian, without the ego."""
        return self._others([kind != "pedestrian" for kind in self.kinds])

    def _others(self, chosen: list[bool]) -> Bools:
        mask = np.array(chosen, dtype=bool)
        if self.has_ego:
            mask[-1] = False
        return mask

    def corners(self, rows: Any, step: Any) -> Array:
        """(r, c, 2) the corners of vehicles `rows` at steps `step` (r,) [m]."""
        return placed(self.outlines[rows], self.states[rows, step, :3])

    def bodies(self, rows: Any, step: Any) -> Any:
        """(r,) shapely polygons of the same."""
        shapes = shapely.convex_hull(shapely.polygons(self.corners(rows, step)))
        wide = self.radii[rows] > 0.0
        shapes[wide] = shapely.buffer(shapes[wide], self.radii[rows][wide])
        return shapes


def recording(
    scene: Scene,
    crashed: Mapping[int, int] | None = None,
    *,
    touching: bool = False,
    step: float = 0.0,
) -> Recording:
    """The recorded vehicles of a scene.

    Args:
        scene: obstacles without a recording, and what stands by its nature, are left out.
        crashed: the step from which on a vehicle (by id) is no evidence any more.
        touching: a vehicle whose body touches another one's has crashed, too.
        step: every so many seconds only, as near as the recording allows; 0: at all its steps.

    Raises:
        ScenarioError: `crashed` names a vehicle that is not recorded, or no step.
    """
    several = [o for o in scene.obstacles if o.states is not None and not o.is_static]
    ego = scene.recorded_ego
    rows = [np.asarray(o.states) for o in several] + ([] if ego is None else [ego])
    outlines = [o.outline for o in several] + ([] if ego is None else [scene.ego.outline])
    ids = [o.id for o in several] + ([] if ego is None else [scene.ego.id])
    n = max(map(len, rows), default=0)
    states = np.full((len(rows), n, 5), np.nan)
    corners = np.zeros((len(rows), max([3, *(len(o.vertices) for o in outlines)]), 2))
    for k, (given, outline) in enumerate(zip(rows, outlines, strict=True)):
        states[k, : len(given)] = given
        corners[k] = outline.vertices[-1]
        corners[k, : len(outline.vertices)] = outline.vertices
    there = np.isfinite(states[:, :, :4]).all(axis=2)
    made = Recording(
        scene,
        tuple(ids),
        tuple([o.kind for o in several] + ([] if ego is None else ["car"])),
        corners,
        np.array([_length(o) for o in several] + ([] if ego is None else [scene.ego.length])),
        np.array([o.radius for o in outlines]),
        states,
        there,
        ego is not None,
        1,
        0,
    )
    until = np.full(len(ids), n)
    for id, at in (crashed or {}).items():
        if id not in ids or not step >= 0:
            raise ScenarioError(
                f"{scene.name}: crashed vehicle {id} at step {at}: neither a recorded vehicle "
                f"nor a step; recorded are {', '.join(map(str, sorted(ids))) or 'none'}"
            )
        until[ids.index(id)] = min(at, n)
    if touching:
        until = np.minimum(until, _first_contact(made))
    left = there & (np.arange(n) < until[:, None])
    values = {name: getattr(made, name) for name in Recording.__slots__}
    stride = max(1, round(step / scene.dt))
    there, left = there[:, ::stride], left[:, ::stride]
    values |= {
        "scene": replace(scene, dt=scene.dt * stride),
        "states": states[:, ::stride],
        "there": left,
        "stride": stride,
        "crashed_steps": int(there.sum() - left.sum()),
    }
    return Recording(**values)


def files_of(path: Path) -> tuple[Path, ...]:
    """A recording, and all that may say of it who has crashed."""
    return path, path.with_suffix(CRASHED), path.parent / METRICS


def marked_crashes(path: Path) -> dict[int, int]:
    """Who is marked as crashed beside a recording; nobody where there is no mark.

    Read are RECORDING.crashed.json, {"ID": STEP, ...}, and the metrics.json of a run folder.

    Raises:
        ScenarioError: marks that are none.
    """
    beside, metrics = path.with_suffix(CRASHED), path.parent / METRICS
    file = beside if is_there(beside) else metrics
    if not is_there(file):
        return {}
    try:
        data = json.loads(content_of(file).decode())
        marks = data if file == beside else data.get("crashed", {})
        found = {int(id): step for id, step in marks.items()}
    except (OSError, ValueError, AttributeError):
        found = {0: -1}
    if any(isinstance(x, bool) or not isinstance(x, int) or x < 0 for x in found.values()):
        raise ScenarioError(f'{file}: crashed must be steps by vehicle, {{"ID": STEP}}; mend it')
    return found


def _length(o: Obstacle) -> float:
    return o.length


def _first_contact(made: Recording) -> NDArray[np.int_]:
    """(m,) the first step at which a body touches another; n: never."""
    m, n = made.there.shape
    first = np.full(m, n)
    for k in range(n):
        rows = np.flatnonzero(made.there[:, k])
        bodies = made.bodies(rows, np.full(len(rows), k))
        a, b = shapely.STRtree(bodies).query(bodies, predicate="intersects")
        touched = rows[np.unique(a[a != b])]
        first[touched] = np.minimum(first[touched], k)
    return first
