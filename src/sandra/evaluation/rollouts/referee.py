"""The referee: did the others keep what the certificate lists as assumed of them?

Judges by areas (shapely) and finite differences alone; shares no code with the predictor, and none
with the steering of the adversaries. An assumption that is not listed for a participant is not
asked of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.evaluation.rollouts.actors import Actor
from sandra.evaluation.rollouts.ego import Drive, placed
from sandra.evaluation.rollouts.road import Road
from sandra.evaluation.rollouts.traffic import Motion
from sandra.settings import Settings

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

TOLERANCE = 1e-6
SHARED_BORDER = 0.02
"""A body is in the ego's lane if it reaches farther than this into it [m]."""


@dataclass(slots=True)
class Breaches:
    """Per vehicle (N,) the first fine step at which it broke an assumption (T: never), and which.

    `cut_in` (N,): whether it came into the ego's lane ahead of the ego, as the law allows.
    """

    step: Ints
    name: NDArray[np.object_]
    cut_in: Bools

    @staticmethod
    def none(count: int, steps: int) -> Breaches:
        """Nobody has broken anything."""
        return Breaches(
            np.full(count, steps), np.full(count, "", dtype=object), np.zeros(count, dtype=bool)
        )

    def add(self, rows: Ints, broken: Bools, steps: Ints, name: str) -> None:
        """Enter breaches of `rows`: `broken` (len(steps), len(rows)) at the fine `steps`."""
        first = np.where(broken.any(axis=0), steps[broken.argmax(axis=0)], np.iinfo(int).max)
        earlier = first < self.step[rows]
        self.step[rows[earlier]] = first[earlier]
        self.name[rows[earlier]] = name


def judge(
    actor: Actor,
    motion: Motion,
    rows: Ints,
    drive: Drive,
    road: Road,
    settings: Settings,
    stride: int = 1,
) -> Breaches:
    """Judge the motions `rows` of one actor; those about the road at every `stride`-th step.

    Returns:
        One entry per row.
    """
    steps = len(motion.position)
    p, psi, v = (x[:, rows] for x in (motion.position, motion.heading, motion.velocity))
    since, until = actor.appears, motion.until[rows]
    found = Breaches.none(len(rows), steps)
    every = np.arange(len(rows))
    there = (np.arange(steps)[:, None] >= since) & (np.arange(steps)[:, None] < until)
    _dynamics(found, every, actor, p, psi, v, there, drive.step)
    looked = np.unique(np.append(np.arange(since, steps, stride), steps - 1))
    looked = looked[looked >= since]
    if actor.moves == "lanes":
        _on_road(found, every, actor, p, psi, v, there, looked, road, settings)
    if actor.keeps_out:
        _cuts_in(found, every, actor, p, psi, v, there, looked, drive, road, settings)
    return found


def _dynamics(
    found: Breaches, every: Ints, actor: Actor, p: Array, psi: Array, v: Array, there: Bools,
    h: float,
) -> None:  # fmt: skip
    step = np.arange(1, len(p))
    both = there[1:] & there[:-1]
    push = np.diff(v, axis=0) / h
    # A motion with constant acceleration in each step, and nothing else, has been driven.
    moved = np.diff(p, axis=0) - h * (v[1:] + v[:-1]) / 2
    jumps = np.abs(moved).max(axis=2) > TOLERANCE
    strong = np.hypot(push[..., 0], push[..., 1]) > actor.a_max + TOLERANCE
    found.add(every, both & (jumps | strong), step, "max_acceleration")
    speed = np.hypot(v[..., 0], v[..., 1])
    gain = np.diff(speed, axis=0) / h
    found.add(every, both & (gain < -actor.braking - TOLERANCE), step, "max_braking")
    found.add(every, both & (gain > actor.driving + TOLERANCE), step, "max_driving")
    found.add(every, there & (speed > actor.v_max + TOLERANCE), np.arange(len(p)), "max_speed")
    if actor.turning_radius > 0.0:
        way = np.cumsum(np.hypot(*np.moveaxis(np.diff(p, axis=0), -1, 0)), axis=0)
        turned = np.abs(_wrap(psi[1:] - psi[0]))
        # Chords are shorter than arcs: by a part in a thousand at most, with steps this fine.
        tight = turned > 1.001 * way / actor.turning_radius + TOLERANCE
        course = np.arctan2(v[..., 1], v[..., 0])
        slips = (np.abs(_wrap(psi - course)) > actor.slip + TOLERANCE) & (speed > 1e-3)
        found.add(every, both & (tight | slips[1:]), step, "bounded_heading")


def _on_road(
    found: Breaches, every: Ints, actor: Actor, p: Array, psi: Array, v: Array, there: Bools,
    looked: Ints, road: Road, settings: Settings,
) -> None:  # fmt: skip
    start = road.around(actor.start.x, actor.start.y, actor.start.heading)
    area = road.carriageway(start)
    shapely.prepare(area)
    corners = placed(actor.outline.vertices, p[looked], psi[looked])
    inside = shapely.contains_xy(area, corners[..., 0], corners[..., 1])
    out = np.zeros(inside.shape)
    away = ~inside & there[looked][..., None]
    out[away] = shapely.distance(area, shapely.points(corners[away]))
    beyond = out.max(axis=2)
    now = actor.outline.placed(actor.start.x, actor.start.y, actor.start.heading).vertices
    observed = float(shapely.distance(area, shapely.points(now)).max())
    allowed = max(settings.assumptions.max_overhang, observed)
    found.add(every, beyond > allowed + TOLERANCE, looked, "max_overhang")

    candidates = sorted(road.reachable(start))
    links = np.array([[j in road.onward(road.onward({i})) for j in candidates] for i in candidates])
    is_on = np.array([i in start for i in candidates])[None, :].repeat(len(every), axis=0)
    for k in looked.tolist():
        here = there[k]
        if not here.any():
            continue
        on, courses = _lanelets(road, candidates, p[k])
        is_on = (is_on @ links) & on
        found.add(every, (here & ~is_on.any(axis=1))[None], np.array([k]), "stay_on_carriageway")
        relative = np.arctan2(v[k, :, 1], v[k, :, 0])[:, None] - courses
        speed = np.hypot(v[k, :, 0], v[k, :, 1])[:, None]
        forward = speed * np.cos(relative) >= -TOLERANCE
        if "no_reversing" in actor.listed:
            wrong = here & is_on.any(axis=1) & ~(is_on & forward).any(axis=1)
            found.add(every, wrong[None], np.array([k]), "no_reversing")
            is_on &= forward
        across = np.where(is_on, np.abs(speed * np.sin(relative)), np.inf).min(axis=1)
        fast = here & is_on.any(axis=1) & (across > actor.lateral + TOLERANCE)
        if "follow_lanes" in actor.listed:
            found.add(every, fast[None], np.array([k]), "max_lateral_speed")


def _lanelets(road: Road, candidates: list[int], points: Array) -> tuple[Bools, Array]:
    """(N, L) whether points are on the candidates, and the direction of each there [rad]."""
    on = np.zeros((len(points), len(candidates)), dtype=bool)
    courses = np.zeros(on.shape)
    for j, i in enumerate(candidates):
        area: Any = road.areas[i]
        shapely.prepare(area)
        x0, y0, x1, y1 = area.bounds
        near = (points[:, 0] >= x0 - 0.1) & (points[:, 0] <= x1 + 0.1)
        near &= (points[:, 1] >= y0 - 0.1) & (points[:, 1] <= y1 + 0.1)
        rows = np.flatnonzero(near)
        if not len(rows):
            continue
        held = shapely.dwithin(area, shapely.points(points[rows]), 0.02)
        rows = rows[held]
        if len(rows):
            on[rows, j] = True
            courses[rows, j] = road.course(i, points[rows])
    return on, courses


def _cuts_in(
    found: Breaches, every: Ints, actor: Actor, p: Array, psi: Array, v: Array, there: Bools,
    looked: Ints, drive: Drive, road: Road, settings: Settings,
) -> None:  # fmt: skip
    """StVO 7(5): entering the ego's lane leaves the safe distance before, or is behind, the ego."""
    in_lane, gap_ahead, gap_behind, needed = lane_state(
        actor, p, psi, v, looked, drive, road, settings
    )
    in_lane &= there[looked]
    enters = in_lane.copy()
    enters[1:] &= ~in_lane[:-1]
    if actor.yields:  # It may have been in the lane from the beginning.
        enters[0] = False
    # Between two looks at it, distances change: half a metre is granted.
    legal = (gap_ahead >= needed - 0.5) | (gap_behind >= -0.5)
    found.add(every, enters & ~legal, looked, "legal_cut_in")
    found.cut_in |= (enters & (gap_ahead >= needed - 0.5)).any(axis=0)


def lane_state(
    actor: Actor, p: Array, psi: Array, v: Array, looked: Ints, drive: Drive, road: Road,
    settings: Settings,
) -> tuple[Bools, Array, Array, Array]:  # fmt: skip
    """(n, N) at the steps `looked`: in the ego's lane; gaps before and behind the ego; d_safe."""
    start = road.around(actor.start.x, actor.start.y, actor.start.heading)
    lane = shapely.buffer(road.shut_area(start), -SHARED_BORDER)
    shape = (len(looked), p.shape[1])
    in_lane = np.zeros(shape, dtype=bool)
    reference = shapely.LineString(road.reference)
    centre = shapely.line_locate_point(reference, shapely.points(p[looked]))
    ego = shapely.line_locate_point(reference, shapely.points(drive.states[looked, :2]))[:, None]
    ends = actor.length / 2
    half = float(np.hypot(*(drive.corners[0, 1] - drive.corners[0, 0]))) / 2
    gap_ahead, gap_behind = centre - ends - ego - half, ego - half - centre - ends
    speed = np.hypot(v[looked, :, 0], v[looked, :, 1])
    mine = drive.states[looked, 3][:, None]
    needed = mine**2 / (2 * abs(settings.a_min)) - speed**2 / (2 * abs(settings.a_obs_min))
    needed = np.maximum(needed + mine * settings.t_d, 0.0)
    if not lane.is_empty:
        shapely.prepare(lane)
        x0, y0, x1, y1 = lane.bounds
        r = actor.radius
        q = p[looked]
        near = (q[..., 0] >= x0 - r) & (q[..., 0] <= x1 + r)
        near &= (q[..., 1] >= y0 - r) & (q[..., 1] <= y1 + r)
        near &= shapely.dwithin(lane, shapely.points(q), r)
        rows = np.nonzero(near)
        if len(rows[0]):
            corners = placed(actor.outline.vertices, q[rows], psi[looked][rows])
            hulls = shapely.convex_hull(shapely.multipoints(corners))
            in_lane[rows] = shapely.dwithin(lane, hulls, actor.outline.radius)
    return in_lane, gap_ahead, gap_behind, needed


def _wrap(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
