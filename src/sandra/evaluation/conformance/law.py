"""Who drives into whom from behind, and who cuts in too close: the two assumptions on traffic law.

Both are about the one that the prediction calls the ego. Here everybody is taken for it in turn, or
the recorded ego alone.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.evaluation.conformance.recording import Recording
from sandra.evaluation.conformance.road import Map
from sandra.prediction.observed import LANE_KINDS, safe_distance
from sandra.settings import Settings

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

REACHES = 0.02
"""A body is in a lane if it reaches farther than this into it [m]."""
FAR = 250.0
"""Vehicles farther behind or ahead along the lane are not looked at [m]."""


def law(r: Recording, road: Map, settings: Settings, towards: str) -> dict[str, Array]:
    """By assumption, (m, n) by how much a vehicle breaks it at a step; NaN where it is not there.

    no_rear_end: closing speed at the moment in which a body comes to touch that of the one ahead
    [m/s], at least 0.01. legal_cut_in: how much of d_safe of R_G1 is missing before the one in
    whose lane it appears, at that step [m].

    Args:
        towards: "all": every vehicle on lanes is taken for the ego in turn; "ego": the recorded
            one alone (without it nothing is broken).
    """
    looked = np.where(r.there & r.on_lanes[:, None], 0.0, np.nan)
    found = {"no_rear_end": looked.copy(), "legal_cut_in": looked.copy()}
    egos = np.array([kind in LANE_KINDS for kind in r.kinds], dtype=bool)
    if towards == "ego":
        egos &= ~r.on_lanes
        if not r.has_ego:
            egos[:] = False
    if egos.any():
        _rear_ends(r, egos, found["no_rear_end"])
        _cut_ins(r, road, egos, settings, found["legal_cut_in"])
    return found


def _rear_ends(r: Recording, egos: Bools, found: Array) -> None:
    n = r.there.shape[1]
    before: set[tuple[int, int]] = set()
    for k in range(n):
        rows = np.flatnonzero(r.there[:, k])
        bodies = r.bodies(rows, np.full(len(rows), k))
        a, b = shapely.STRtree(bodies).query(bodies, predicate="intersects")
        pairs = {(int(rows[i]), int(rows[j])) for i, j in zip(a, b, strict=True) if i != j}
        for ego, other in pairs - before:
            if not egos[ego] or not r.on_lanes[other] or k == 0:
                continue
            if r.there[ego, k - 1] and r.there[other, k - 1]:
                closing = _from_behind(r, ego, other, k)
                if closing is not None:
                    found[other, k] = max(found[other, k], closing)
        before = pairs


def _from_behind(r: Recording, ego: int, other: int, k: int) -> float | None:
    """The closing speed [m/s] if the other was behind the ego, in its way, a step before."""
    mine, theirs = r.states[ego, k - 1], r.states[other, k - 1]
    c, s = np.cos(mine[2]), np.sin(mine[2])
    dx, dy = theirs[:2] - mine[:2]
    along, across = c * dx + s * dy, c * dy - s * dx
    half = (_widths(r, ego) + _widths(r, other)) / 2
    if along >= 0.0 or abs(across) >= half:
        return None
    return max(float(theirs[3] * np.cos(theirs[2] - mine[2]) - mine[3]), 0.01)


def _widths(r: Recording, row: int) -> float:
    y = r.outlines[row, :, 1]
    return float(y.max() - y.min()) + 2 * float(r.radii[row])


def _cut_ins(r: Recording, road: Map, egos: Bools, settings: Settings, found: Array) -> None:
    touched, centred = _lanelets(r, road)
    n = r.there.shape[1]
    for other in np.flatnonzero(r.on_lanes):
        for k in range(1, n):
            now, then = touched[other].get(k), touched[other].get(k - 1)
            if now is None or then is None or now == then:
                continue
            for lanelet in now - then:
                links = road.lanelets[lanelet]
                if then.isdisjoint((*links.predecessors, *links.successors)):
                    missing = _missing(r, road, egos, settings, centred, int(other), k, lanelet)
                    found[other, k] = max(found[other, k], missing)


def _missing(
    r: Recording, road: Map, egos: Bools, settings: Settings,
    centred: list[dict[int, frozenset[int]]], other: int, k: int, lanelet: int,
) -> float:  # fmt: skip
    """How much of the safe distance is missing, over all egos in the lane entered [m]; 0: none."""
    offsets = _along(road, lanelet)
    frame = road.frame(lanelet)
    corners = r.corners(np.array([other]), np.array([k]))[0]
    s = frame.to_curvilinear(corners)[:, 0]
    rear, front = s.min() - r.radii[other], s.max() + r.radii[other]
    worst = 0.0
    for ego in np.flatnonzero(egos):
        if ego == other:
            continue
        here = centred[ego].get(k, frozenset()) & offsets.keys()
        if not here or not (centred[ego].get(k - 1, frozenset()) & offsets.keys()):
            continue
        i = min(here, key=lambda i: abs(offsets[i]))
        mine = road.frame(i).to_curvilinear(r.states[ego, k, None, :2])[0, 0] + offsets[i]
        half = float(r.lengths[ego]) / 2
        if mine - half - front >= 0.0:
            continue
        needed = safe_distance(abs(r.states[ego, k, 3]), abs(r.states[other, k, 3]), settings)
        worst = max(worst, needed - float(rear - mine - half) if rear < mine + half + needed else 0)
    return worst


def _along(road: Map, lanelet: int) -> dict[int, float]:
    """Where the lanelets before and after one begin, along it [m]; itself at 0."""
    found = {lanelet: 0.0}
    for links in ("predecessors", "successors"):
        todo = [lanelet]
        while todo:
            i = todo.pop()
            for j in getattr(road.lanelets[i], links):
                if j in found or j not in road.lanelets:
                    continue
                at = found[i] + (
                    road.frame(i).length if links == "successors" else -road.frame(j).length
                )
                near = at > -FAR - road.frame(j).length and at < FAR
                if near:
                    found[j] = at
                    todo.append(j)
    return found


def _lanelets(
    r: Recording, road: Map
) -> tuple[list[dict[int, frozenset[int]]], list[dict[int, frozenset[int]]]]:
    """Per vehicle, by step: the lanelets of its direction that its body is in; its centre is on."""
    m = len(r.ids)
    rows, steps = np.nonzero(r.there & np.array([k in LANE_KINDS for k in r.kinds])[:, None])
    touched: list[dict[int, frozenset[int]]] = [{} for _ in range(m)]
    centred: list[dict[int, frozenset[int]]] = [{} for _ in range(m)]
    if not len(rows):
        return touched, centred
    shapes = shapely.buffer(r.bodies(rows, steps), -REACHES)
    centres = shapely.points(r.states[rows, steps, :2])
    for result, geometries in ((touched, shapes), (centred, centres)):
        item, lanelet = road.tree.query(geometries, predicate="intersects")
        same = _same_way(r, road, rows[item], steps[item], lanelet)
        pairs: dict[int, set[int]] = {}
        for j, i in zip(item[same].tolist(), road.ids[lanelet[same]].tolist(), strict=True):
            pairs.setdefault(j, set()).add(i)
        for j, (row, step) in enumerate(zip(rows.tolist(), steps.tolist(), strict=True)):
            result[row][step] = frozenset(pairs.get(j, ()))
    return touched, centred


def _same_way(r: Recording, road: Map, rows: Array, steps: Array, lanelet: Array) -> Bools:
    found = np.zeros(len(rows), dtype=bool)
    for i in np.unique(lanelet):
        here = lanelet == i
        frame = road.frame(int(road.ids[i]))
        states = r.states[rows[here], steps[here]]
        course = frame.heading(frame.to_curvilinear(states[:, :2])[:, 0])
        found[here] = np.cos(states[:, 2] - course) > 0.0
    return found
