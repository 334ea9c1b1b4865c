"""What is true of states of the ego on a straight road, in plain numbers of the road's own frame.

For the exhaustive search in `grid_search`; shares nothing with `sandra.reach`. A state is (s, v, d,
w): along the road and across it [m, m/s]. Two bodies are known:

* the full body: a rectangle that points where it moves, up to its slip angle, clear of the others
  at each step and of all that they cover in the steps before and after it (`Body.FULL`), or at
  each step only (`Body.AT_STEPS`);
* the disc inscribed in it, clear of the others at each step, of a body that may slip as far as
  the lateral acceleration allows (`Body.DISC`): whatever any body can do, this one can as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property, lru_cache

import numpy as np

from random_scenes import Drawn
from sandra.logic import Atom, Comparison, Predicate
from sandra.prediction import Prediction
from sandra.scene.types import Region
from sandra.settings import Settings
from straight_road import WIDTH

Array = np.ndarray
NOT_FOLLOWED = ("pedestrian", "trafficIsland", "building", "pillar", "median_strip")
KNOWN_LANES = ("current", "left", "right", "opposite")


class Body(Enum):
    """What of the ego must be free of collisions, and when; each allows more than those before."""

    FULL = "full body, also between the steps"
    AT_STEPS = "full body, at the steps only"
    DISC = "inscribed disc, at the steps only"


@dataclass(eq=False)
class Cells:
    """All states at one step: any of (s, v)[row] with any of (d, w)[column].

    Many of them share a place, or both speeds: what depends on these alone is found once for each.
    """

    k: int
    s: Array
    v: Array
    d: Array
    w: Array

    @staticmethod
    def one(k: int, state: Array) -> Cells:
        """A single state: row 0 and column 0."""
        return Cells(k, *(np.array([x]) for x in state))

    @cached_property
    def places(self) -> tuple[Array, Array, Array, Array]:
        """Every s, the one of each row; every d, the one of each column."""
        return *np.unique(self.s, return_inverse=True), *np.unique(self.d, return_inverse=True)

    @cached_property
    def speeds(self) -> tuple[Array, Array, Array, Array]:
        """Every v, the one of each row; every w, the one of each column."""
        return *np.unique(self.v, return_inverse=True), *np.unique(self.w, return_inverse=True)


@dataclass(eq=False)
class World:
    """The truth about states at each step of a prediction; `rows` and `columns` name them (m,)."""

    drawn: Drawn
    prediction: Prediction
    settings: Settings
    body: Body

    @cached_property
    def size(self) -> tuple[float, float]:
        """Half length and half width of the ego [m]."""
        ego = self.drawn.scene.ego
        return ego.length / 2, ego.width / 2

    @cached_property
    def strips(self) -> list[tuple[str, float, float]]:
        """(relation, lowest d, highest d) of each lane."""
        return [
            (lane.relation, (place - 0.5) * WIDTH, (place + 0.5) * WIDTH)
            for lane in self.drawn.scene.lanes
            for place in [lane.lanelets[0] - 100]
        ]

    def start(self) -> tuple[float, float, float, float]:
        state = self.drawn.scene.ego.state
        s, d = self.drawn.road.along(state.x, state.y)
        angle = state.heading - self.drawn.road.angle
        return s, float(state.speed * np.cos(angle)), d, float(state.speed * np.sin(angle))

    def angles(self, cells: Cells) -> Array:
        """Angles between body and road [rad], for every v and every w of `cells.speeds`: that of
        the motion, up to the slip of a single-track model.

        The full body slips so as to be as parallel to the road as it may, the one that the disc
        stands for so as to reach as far to its sides as it may.
        """
        v, _, w, _ = cells.speeds
        v, w = v[:, None], w[None, :]
        if cells.k == 0:
            angle = self.drawn.scene.ego.state.heading - self.drawn.road.angle
            return np.full((v.size, w.size), angle)
        course = np.where(np.hypot(v, w) > 1e-9, np.arctan2(w, v), 0.0)
        grip = self.drawn.scene.ego.wheelbase / 2 * self.settings.a_lat_max
        slip = np.arcsin(np.minimum(1.0, grip / np.maximum(v**2 + w**2, 1e-9)))
        if self.body is Body.DISC:
            return np.minimum(np.abs(course) + slip, np.arctan2(*self.size))
        return np.sign(course) * np.maximum(np.abs(course) - slip, 0.0)

    def extent(self, cells: Cells, rows: Array, columns: Array) -> Array:
        """How far the body reaches to either side of its centre [m]."""
        angle = self.angles(cells)
        a, b = self.size
        extent = a * np.abs(np.sin(angle)) + b * np.abs(np.cos(angle))
        return extent[cells.speeds[1][rows], cells.speeds[3][columns]]

    # -------------------------------------------------------------- collisions

    @lru_cache  # noqa: B019  a world is short-lived
    def regions(self, k: int) -> list[Region]:
        """What must not be touched at step k, in the road's frame."""
        found = []
        for each in self.prediction.obstacles:
            found += each.at[k]
            if self.body is Body.FULL:
                found += each.between[k] if k < self.prediction.horizon else ()
                found += each.between[k - 1] if k > 0 else ()
        road = self.drawn.road
        return [
            Region(np.array([road.along(*p) for p in region.vertices]), region.radius)
            for region in found
        ]

    def free(self, cells: Cells, rows: Array, columns: Array) -> Array:
        """Whether the body is on the road and touches nobody."""
        low, high = min(x[1] for x in self.strips), max(x[2] for x in self.strips)
        side = self.size[1] if self.body is Body.DISC else self.extent(cells, rows, columns)
        d = cells.d[columns]
        free = (d - side >= low) & (d + side <= high)
        every_s, of_row, every_d, of_column = cells.places
        reach = float(np.hypot(*self.size))
        for region in self.regions(cells.k):
            least = region.vertices.min(axis=0) - region.radius - reach
            most = region.vertices.max(axis=0) + region.radius + reach
            i0, i1 = np.searchsorted(every_s, [least[0], most[0]])
            j0, j1 = np.searchsorted(every_d, [least[1], most[1]])
            if i0 == i1 or j0 == j1:
                continue
            near = np.stack(np.meshgrid(every_s[i0:i1], every_d[j0:j1], indexing="ij"), axis=-1)
            gaps = np.full((len(every_s), len(every_d)), np.inf)
            away = distance(near.reshape(-1, 2), region.vertices) - region.radius
            gaps[i0:i1, j0:j1] = away.reshape(near.shape[:2])
            gap = gaps[of_row[rows], of_column[columns]]
            hit = gap <= self.size[1]
            if self.body is not Body.DISC:
                unsure = np.flatnonzero(free & ~hit & (gap <= reach))
                at = rows[unsure], columns[unsure]
                centre = np.column_stack([cells.s[at[0]], cells.d[at[1]]])
                angle = self.angles(cells)[cells.speeds[1][at[0]], cells.speeds[3][at[1]]]
                hit[unsure] = touches(centre, angle, self.size, region)
            free &= ~hit
        return free

    # -------------------------------------------------------------- atoms

    def truth(self, atom: Atom, cells: Cells, rows: Array, columns: Array) -> Array:
        """Truth of an atom on the states; not of one about the acceleration."""
        if isinstance(atom, Comparison):
            of_row = {"s": cells.s, "v": cells.v}.get(atom.variable)
            value = cells.d[columns] if of_row is None else of_row[rows]
            return holds(atom, value)
        assert isinstance(atom, Predicate)
        match atom.name:
            case "in_lane":
                side, d = self.extent(cells, rows, columns), cells.d[columns]
                found = np.zeros(len(rows), dtype=bool)
                for relation, low, high in self.strips:
                    if relation == atom.argument:
                        found |= (d + side >= low) & (d - side <= high)
                return found
            case "keeps_safe_distance":
                return self._keeps_distance(cells, rows, columns)
            case "keeps_lane_speed_limit":
                limit = self.drawn.limit
                return np.full(len(rows), True) if limit is None else cells.v[rows] <= limit
        raise AssertionError(f"no truth of {atom}")

    @lru_cache  # noqa: B019
    def leaders(self, k: int) -> list[tuple[float, float, float, float]]:
        """(rear end, speed along the road, lowest d, highest d) of all who may precede."""
        found = []
        for each in self.prediction.obstacles:
            row = each.states[k]
            if each.obstacle.kind in NOT_FOLLOWED or not np.isfinite(row[:4]).all():
                continue
            outline = each.obstacle.outline.placed(*row[:3])
            points = np.array([self.drawn.road.along(*p) for p in outline.vertices])
            speed = max(0.0, float(row[3] * np.cos(row[2] - self.drawn.road.angle)))
            r = outline.radius
            low, high = points.min(axis=0) - r, points.max(axis=0) + r
            found.append((float(low[0]), speed, float(low[1]), float(high[1])))
        return found

    def _keeps_distance(self, cells: Cells, rows: Array, columns: Array) -> Array:
        """R_G1 towards the nearest in front in each lane that the body (or its disc) touches."""
        values = self.settings
        kept = np.ones(len(rows), dtype=bool)
        front, v = cells.s + self.size[0], cells.v
        side = self.size[1] if self.body is Body.DISC else self.extent(cells, rows, columns)
        d = cells.d[columns]
        needed = v**2 / (2 * abs(values.a_min)) + v * values.t_d
        for relation, low, high in self.strips:
            if relation not in KNOWN_LANES:
                continue
            ahead = sorted(x[:2] for x in self.leaders(cells.k) if x[2] <= high and x[3] >= low)
            if not ahead:
                continue
            rears, speeds = np.array([*ahead, (np.inf, 0.0)]).T
            nearest = np.searchsorted(rears[:-1], front, side="right")
            room = rears[nearest] - front + speeds[nearest] ** 2 / (2 * abs(values.a_obs_min))
            inside = (d + side >= low) & (d - side <= high)
            kept &= ~inside | (room > needed)[rows]
        return kept


def holds(atom: Comparison, value: Array) -> Array:
    return value <= atom.bound if atom.op == "<=" else value < atom.bound


def distance(points: Array, polygon: Array) -> Array:
    """(m,) distances of points to a convex polygon, a segment or a point; 0 inside [m]."""
    best = np.full(len(points), np.inf)
    inside = np.full(len(points), len(polygon) > 2)
    turning = 0.0
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        turning += a[0] * b[1] - a[1] * b[0]
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        e = b - a
        length2 = max(float(e @ e), 1e-18)
        share = np.clip((points - a) @ e / length2, 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - share[:, None] * e, axis=1))
        side = e[0] * (points[:, 1] - a[1]) - e[1] * (points[:, 0] - a[0])
        inside &= side * np.sign(turning) >= 0.0
    best[inside] = 0.0
    return best


def touches(centre: Array, angle: Array, size: tuple[float, float], region: Region) -> Array:
    """(m,) whether rectangles touch a region, by separating axes.

    For a widened polygon this may say so too early, by less than half its radius; never too late.
    """
    a, b = size
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    x, y = (
        (region.vertices[None] - centre[:, None]) @ axis[:, :, None] for axis in (along, across)
    )
    x, y = x[:, :, 0], y[:, :, 0]
    if len(region.vertices) == 1:
        away = np.hypot(np.maximum(np.abs(x) - a, 0.0), np.maximum(np.abs(y) - b, 0.0))
        return away[:, 0] <= region.radius
    gap = np.max(
        [x.min(axis=1) - a, -x.max(axis=1) - a, y.min(axis=1) - b, -y.max(axis=1) - b], axis=0
    )
    edges = np.roll(region.vertices, -1, axis=0) - region.vertices
    for e in edges[np.linalg.norm(edges, axis=1) > 1e-9]:
        normal = np.array([e[1], -e[0]]) / np.linalg.norm(e)
        theirs = region.vertices @ normal
        ours = centre @ normal
        half = a * np.abs(along @ normal) + b * np.abs(across @ normal)
        gap = np.maximum(gap, np.maximum(theirs.min() - ours, ours - theirs.max()) - half)
    return gap <= region.radius
