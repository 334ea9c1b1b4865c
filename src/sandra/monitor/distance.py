"""R_G1 in metres: the gap to whoever precedes, less the safe distance (paper eq. 5 and 6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.monitor.lanes import DrivenLane
from sandra.scene.types import Obstacle, Scene, placed
from sandra.settings import Settings

Array = NDArray[np.float64]
Ints = NDArray[np.int_]
Bools = NDArray[np.bool_]

PRECEDES_NOBODY = frozenset({"pedestrian", "trafficIsland", "building", "pillar", "median_strip"})
"""Kinds of obstacles that are no traffic in a lane."""
NOBODY = -1


@dataclass(frozen=True, slots=True, eq=False)
class Others:
    """m bodies: each vehicle at each step (of n) at which it is there, vehicle after vehicle."""

    ids: Ints
    """(m,)"""
    step: Ints
    """(m,)"""
    states: Array
    """(m, 5)"""
    corners: Array
    """(m, c, 2) [m]; vehicles with fewer corners repeat their last one."""
    radius: Array
    """(m,) by which a body is wider than its corners [m]"""
    shapes: Any
    """(m,) shapely polygons."""
    first: Bools
    """(m,) whether the vehicle was not there at the step before."""

    @staticmethod
    def of(scene: Scene, n: int) -> Others:
        """All vehicles of a scene at steps 0, ..., n - 1; what stands stays where it is."""
        several = [o for o in scene.obstacles if o.kind not in PRECEDES_NOBODY]
        most = max((len(o.outline.vertices) for o in several), default=1)
        every = np.full((len(several), n, 5), np.nan)
        outlines = np.empty((len(several), max(most, 3), 2))
        for row, outline, other in zip(every, outlines, several, strict=True):
            known = _states(other, n)
            row[: len(known)] = known
            vertices = other.outline.vertices
            outline[: len(vertices)], outline[len(vertices) :] = vertices, vertices[-1]
        owner, step = np.nonzero(np.isfinite(every[:, :, :4]).all(axis=2))
        states = every[owner, step]
        corners = placed(outlines[owner], states[:, :3]) if len(owner) else np.empty((0, 3, 2))
        radius = np.array([o.outline.radius for o in several])[owner]
        shapes = np.asarray(shapely.polygons(corners), dtype=object)
        # A disc or a capsule: its corners are a point or two.
        thin = np.array([len(o.outline.vertices) < 3 for o in several], dtype=bool)[owner]
        shapes[thin] = shapely.convex_hull(shapes[thin])
        wide = radius > 0.0
        shapes[wide] = shapely.buffer(shapes[wide], radius[wide])
        ids = np.array([o.id for o in several], dtype=int)[owner]
        first = (np.diff(owner, prepend=-1) != 0) | (np.diff(step, prepend=-1) != 1)
        return Others(ids, step, states, corners, radius, shapes, first)


def _states(other: Obstacle, n: int) -> Array:
    if other.states is not None:
        return other.states[:n]
    s = other.state
    row = np.array([[s.x, s.y, s.heading, s.speed, s.acceleration]])
    # What moves without a recording is known at step 0 only.
    return np.repeat(row, n if other.is_static else 1, axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class Leaders:
    """Per step what precedes the ego: slack and gap [m] (inf: nobody), its id, d_safe [m]."""

    slack: Array
    gap: Array
    who: Ints


def leaders(
    states: Array,
    shapes: Any,
    length: float,
    lanes: list[DrivenLane],
    others: Others,
    s: Settings,
    dt: float,
) -> Leaders:
    """Whoever leaves the ego least, over the lanes that its body touches.

    In each lane the nearest vehicle in front precedes: the smallest rear end along the lane at or
    before the ego's front (centre plus half its length), the slower of two equally near ones. A
    vehicle that the ego has run into still precedes, with a negative gap.

    Args:
        states: (n, 5) of the ego. shapes: (n,) its body. length: of the ego [m].
    """
    n = len(states)
    slack, gap = np.full(n, np.inf), np.full(n, np.inf)
    who = np.full(n, NOBODY)
    for lane in lanes:
        step, room, speed, ids = _ahead(lane, states, shapes, length, others, s, dt)
        # Of two side by side the slower one demands more.
        order = np.lexsort((speed, room, step))
        k, first = np.unique(step[order], return_index=True)
        nearest = order[first]
        left = room[nearest] - safe_distance(states[k, 3], speed[nearest], s)
        # However fast it is, who was run into was too near.
        left = np.where(room[nearest] < 0.0, np.minimum(left, room[nearest]), left)
        worse = left < slack[k]
        k, nearest = k[worse], nearest[worse]
        slack[k], gap[k], who[k] = left[worse], room[nearest], ids[nearest]
    return Leaders(slack, gap, who)


def _ahead(
    lane: DrivenLane,
    states: Array,
    shapes: Any,
    length: float,
    others: Others,
    s: Settings,
    dt: float,
) -> tuple[Ints, Array, Array, Ints]:
    """Who is in front in a lane while the ego touches it: step, gap, speed along, id; each (m,)."""
    rows = np.flatnonzero(lane.touched[others.step])
    if s.cut_in_exception:
        inside = _reaching_into(lane, others.shapes)
        inside &= ~_just_cut_in(inside, others, s, dt)
        rows = rows[inside[rows]]
    else:
        rows = rows[_reaching_into(lane, others.shapes[rows])]
    centre = lane.frame.to_curvilinear(states[:, :2])[:, 0]
    theirs = lane.frame.to_curvilinear(others.states[rows, :2])[:, 0]
    near = _may_be_nearest(others, rows, theirs, centre, length)
    rows, theirs = rows[near], theirs[near]
    step, corners = others.step[rows], others.corners[rows]
    along = lane.frame.to_curvilinear(corners.reshape(-1, 2))[:, 0].reshape(corners.shape[:2])
    room = along.min(axis=1) - others.radius[rows] - (centre[step] + length / 2)
    turned = others.states[rows, 2] - lane.frame.heading(theirs)
    speed = np.maximum(others.states[rows, 3] * np.cos(turned), 0.0)
    before = room >= 0.0
    beside = np.flatnonzero(~before & (theirs > centre[step]))
    before[beside] = shapely.intersects(others.shapes[rows[beside]], shapes[step[beside]])
    return step[before], room[before], speed[before], others.ids[rows[before]]


def _may_be_nearest(others: Others, rows: Ints, s: Array, centre: Array, length: float) -> Bools:
    """Which bodies with their centres at s may be the nearest in front, or run into."""
    step = others.step[rows]
    away = others.corners[rows] - others.states[rows, None, :2]
    # Twice its size: in a sharp bend s grows faster than the way.
    reach = 2 * (np.linalg.norm(away, axis=2).max(axis=1) + others.radius[rows])
    sure = s - reach >= centre[step] + length / 2
    least = np.full(len(centre), np.inf)
    np.minimum.at(least, step[sure], (s + reach)[sure])
    return np.asarray((s + reach > centre[step]) & (s - reach <= least[step]))


def safe_distance(v: Array, v_o: Array, s: Settings) -> Array:
    """v^2 / (2 |a_min|) - v_o^2 / (2 |a_obs_min|) + v t_d [m]."""
    return np.asarray(v**2 / (2 * abs(s.a_min)) - v_o**2 / (2 * abs(s.a_obs_min)) + v * s.t_d)


def _reaching_into(lane: DrivenLane, shapes: Any) -> Bools:
    """Which bodies reach into a lane; only touching its border is not enough."""
    shapely.prepare(lane.area)
    found = np.asarray(shapely.intersects(lane.area, shapes))
    found[found] = ~shapely.touches(lane.area, shapes[found])
    return found


def _just_cut_in(inside: Bools, others: Others, s: Settings, dt: float) -> Bools:
    """(m,) which bodies entered the lane less than t_c ago; who appears in it was there before."""
    before = np.roll(inside, 1)
    entered = inside & ~others.first & ~before
    last = np.maximum.accumulate(np.where(entered, np.arange(len(inside)), -1))
    known = (last >= 0) & (others.ids[last] == others.ids)
    since = others.step - others.step[last]
    return np.asarray(known & (since < round(s.t_c / dt)))
