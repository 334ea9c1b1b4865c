"""Trajectories of the reachability model, and the direct truth about each of them.

Particles are driven by bang-bang and random inputs that switch inside steps; those that leave the
road, collide, or break the specification die and are replaced by copies of survivors, mostly of
those farthest out. Collisions are decided by exact geometry and formulas by their definitions:
shapely, the Cartesian plane and plain numbers, nothing of `sandra.reach` but the data it is given.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from math import cos as cosine
from math import pi

import numpy as np
import shapely

from sandra.logic import Atom, Comparison, Formula, Predicate, Specification
from sandra.logic.formula import (
    And,
    Constant,
    Finally,
    Globally,
    Iff,
    Implies,
    Next,
    Not,
    Or,
    Release,
    Until,
    WeakNext,
    WeakUntil,
)
from sandra.reach import Ground, ReachableSet
from sandra.reach.moves import Moves, moves_of
from sandra.scene.types import Lane, Region

TOLERANCE = 1e-6
"""Distance from a base set up to which a state counts as inside [m, m/s]."""
ARC = 32
"""Segments per quarter circle of a buffer."""
NOT_FOLLOWED = ("pedestrian", "trafficIsland", "building", "pillar", "median_strip")


# ------------------------------------------------------------------ exact geometry


def outside(geometry: shapely.Geometry, radius: float) -> shapely.Geometry:
    """The geometry widened by a disc, by a polygon that holds all of it."""
    return geometry.buffer(radius / cosine(pi / (4 * ARC)), quad_segs=ARC)


def shape(region: Region) -> shapely.Geometry:
    """The region as a geometry, its round parts circumscribed."""
    body = shapely.MultiPoint(region.vertices).convex_hull
    return outside(body, region.radius) if region.radius > 0.0 else body


def road(ground: Ground) -> shapely.Geometry:
    """All lanelets together; slits below 10 cm between neighbours are no border."""
    parts = [
        shapely.Polygon(np.vstack([x.right, x.left[::-1]])).buffer(0) for x in ground.scene.lanelets
    ]
    return shapely.union_all(parts).buffer(0.05).buffer(-0.05)


def lane_area(ground: Ground, lane: Lane) -> shapely.Geometry:
    """The lanelets of a lane."""
    return shapely.union_all(
        [
            shapely.Polygon(np.vstack([x.right, x.left[::-1]])).buffer(0)
            for x in ground.scene.lanelets
            if x.id in lane.lanelets
        ]
    )


def rectangles(xy: np.ndarray, heading: np.ndarray, length: float, width: float) -> np.ndarray:
    """(m,) shapely rectangles about (m, 2) centres."""
    c, s = np.cos(heading), np.sin(heading)
    along, across = np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)
    a, b = length / 2 * along, width / 2 * across
    return shapely.polygons(np.stack([xy + a + b, xy - a + b, xy - a - b, xy + a - b], axis=1))


@dataclass(eq=False)
class World:
    """What is true of states of one ground, by exact geometry."""

    ground: Ground
    free_road: shapely.Geometry = field(init=False)
    radius: float = field(init=False)
    _near: dict[tuple[int, ...], tuple[shapely.Geometry, shapely.Geometry]] = field(
        init=False, default_factory=dict
    )

    def __post_init__(self) -> None:
        self.radius = self.ground.scene.ego.width / 2
        self.free_road = road(self.ground).buffer(
            -self.radius / cosine(pi / (4 * ARC)), quad_segs=ARC
        )
        shapely.prepare(self.free_road)

    @cached_property
    def taken(self) -> list[shapely.Geometry]:
        """At each step, where the centre must not be because of the others."""
        found = []
        for k in range(self.ground.horizon + 1):
            bodies = [shape(r) for o in self.ground.prediction.obstacles for r in o.at[k]]
            found.append(shapely.union_all([outside(b, self.radius) for b in bodies]))
            shapely.prepare(found[-1])
        return found

    def positions(self, states: np.ndarray) -> np.ndarray:
        """(m, 2) Cartesian positions of (m, 4) states s, v_s, d, v_d."""
        return self.ground.scene.frame.to_cartesian(states[:, [0, 2]])

    def free(self, states: np.ndarray, k: int) -> np.ndarray:
        """Whether the inscribed disc is on the road and touches nobody at step k."""
        x, y = self.positions(states).T
        on_road = shapely.contains_xy(self.free_road, x, y)
        on_road[on_road] = ~shapely.intersects_xy(self.taken[k], x[on_road], y[on_road])
        return on_road

    def headings(self, states: np.ndarray, k: int, rng: np.random.Generator) -> np.ndarray:
        """(m,) headings: of the motion and a random slip angle; the true one at step 0."""
        scene, settings = self.ground.scene, self.ground.settings
        if k == 0:
            return np.full(len(states), scene.ego.state.heading)
        s, v_s, d, v_d = states.T
        forward = v_s * (1.0 - scene.frame.curvature(s) * d)
        speed2 = np.maximum(forward**2 + v_d**2, 1e-9)
        most = np.arcsin(np.minimum(1.0, scene.ego.wheelbase / 2 * settings.a_lat_max / speed2))
        slip = np.where(
            rng.random(len(s)) < 0.5,
            rng.choice([-1.0, 1.0], len(s)),
            rng.uniform(-1.0, 1.0, len(s)),
        )
        return scene.frame.heading(s) + np.arctan2(v_d, forward) + slip * most

    def touches(
        self, key: tuple[int, ...], area: shapely.Geometry, xy: np.ndarray, heading: np.ndarray
    ) -> np.ndarray:
        """Whether the body's rectangle touches an area (named by `key`)."""
        ego = self.ground.scene.ego
        if key not in self._near:
            around = area.buffer(np.hypot(ego.length, ego.width) / 2 * 1.01)
            shapely.prepare(area)
            shapely.prepare(around)
            self._near[key] = area, around
        area, around = self._near[key]
        touching = shapely.contains_xy(area, xy[:, 0], xy[:, 1])
        maybe = np.flatnonzero(~touching & shapely.contains_xy(around, xy[:, 0], xy[:, 1]))
        bodies = rectangles(xy[maybe], heading[maybe], ego.length, ego.width)
        touching[maybe] = shapely.intersects(area, bodies)
        return touching

    def truth(
        self, atom: Atom, states: np.ndarray, xy: np.ndarray, heading: np.ndarray, k: int
    ) -> np.ndarray:
        """(m,) truth of an atom on the state, straight from its definition."""
        scene = self.ground.scene
        if isinstance(atom, Comparison):
            value = states[:, {"s": 0, "v": 1, "d": 2}[atom.variable]]
            return value <= atom.bound if atom.op == "<=" else value < atom.bound
        assert isinstance(atom, Predicate)
        match atom.name:
            case "in_lane":
                lanes = [x for x in scene.lanes if x.relation == atom.argument]
                found = np.zeros(len(states), dtype=bool)
                for lane in lanes:
                    area = lane_area(self.ground, lane)
                    found |= self.touches(lane.lanelets, area, xy, heading)
                return found
            case "in_lanelet":
                lanelet = next(x for x in scene.lanelets if str(x.id) == atom.argument)
                area = shapely.Polygon(np.vstack([lanelet.right, lanelet.left[::-1]])).buffer(0)
                return self.touches((lanelet.id,), area, xy, heading)
            case "keeps_safe_distance":
                return self.keeps_safe_distance(states, xy, k)
            case "keeps_lane_speed_limit":
                return self.keeps_lane_speed_limit(states, xy)
        raise AssertionError(f"no direct truth of {atom}")

    @cached_property
    def lanes(self) -> list[tuple[Lane, shapely.Geometry]]:
        known = ("current", "left", "right", "opposite")
        lanes = [x for x in self.ground.scene.lanes if x.relation in known]
        return [(lane, lane_area(self.ground, lane)) for lane in lanes]

    @cached_property
    def leaders(self) -> list[list[list[tuple[float, float, bool]]]]:
        """Per lane and step: rear end, speed along the lane, and whether R_G1 asks for a distance
        (with the exception: not for t_c after a vehicle came in)."""
        scene, settings = self.ground.scene, self.ground.settings
        exempt = round(settings.t_c / scene.dt) if settings.cut_in_exception else 0
        found = []
        for _, area in self.lanes:
            steps: list[list[tuple[float, float, bool]]] = [
                [] for _ in range(self.ground.horizon + 1)
            ]
            for predicted in self.ground.prediction.obstacles:
                entered, before = -exempt, True
                for k, row in enumerate(predicted.states):
                    if predicted.obstacle.kind in NOT_FOLLOWED or not np.isfinite(row[:4]).all():
                        continue
                    body = predicted.obstacle.outline.placed(*row[:3])
                    inside = shape(body).intersects(area)
                    if inside and not before:
                        entered = k
                    before = inside
                    if inside:
                        corners = scene.frame.to_curvilinear(body.vertices)
                        course = scene.frame.heading(corners[:, :1].mean(axis=0))[0]
                        speed = max(0.0, row[3] * np.cos(row[2] - course))
                        rear = corners[:, 0].min() - body.radius
                        steps[k].append((rear, speed, k - entered >= exempt))
            found.append(steps)
        return found

    def keeps_safe_distance(self, states: np.ndarray, xy: np.ndarray, k: int) -> np.ndarray:
        """R_G1: for each lane that the disc touches, the nearest vehicle in front there."""
        scene, settings = self.ground.scene, self.ground.settings
        kept = np.ones(len(states), dtype=bool)
        s, v = states[:, 0], states[:, 1]
        front = s + scene.ego.length / 2
        points = shapely.points(xy)
        for (_, area), steps in zip(self.lanes, self.leaders, strict=True):
            if not (leaders := steps[k]):
                continue
            shapely.prepare(area)
            inside = shapely.contains_xy(area, xy[:, 0], xy[:, 1])
            beside = np.flatnonzero(~inside)
            inside[beside] = shapely.dwithin(area, points[beside], self.radius)
            # The nearest rear end beyond the ego's front; none: nothing is asked.
            rears, speeds, asked = np.array([*sorted(leaders), (np.inf, 0.0, False)]).T
            nearest = np.searchsorted(rears[:-1], front, side="right")
            needed = (
                v**2 / (2 * abs(settings.a_min))
                - speeds[nearest] ** 2 / (2 * abs(settings.a_obs_min))
                + v * settings.t_d
            )
            kept &= ~inside | (asked[nearest] == 0.0) | (rears[nearest] - front > needed)
        return kept

    def keeps_lane_speed_limit(self, states: np.ndarray, xy: np.ndarray) -> np.ndarray:
        """R_G3: the limit of the lanelets of own lanes in which the centre is; where it is in none
        (on an opposite lane, say), that of the current lane at s. An unknown limit is kept."""
        scene = self.ground.scene
        by_id = {x.id: x for x in scene.lanelets}
        kept = np.ones(len(states), dtype=bool)
        beside = np.ones(len(states), dtype=bool)
        for lane in (scene.current, scene.left, scene.right):
            if lane is None:
                continue
            for lanelet_id, limit in zip(lane.lanelets, lane.speed_limits, strict=True):
                lanelet = by_id[lanelet_id]
                area = shapely.Polygon(np.vstack([lanelet.right, lanelet.left[::-1]])).buffer(0)
                shapely.prepare(area)
                inside = shapely.contains_xy(area, xy[:, 0], xy[:, 1])
                beside &= ~inside
                if limit is not None:
                    kept &= ~inside | (states[:, 1] <= limit)
        rows = np.flatnonzero(beside)
        limits = scene.speed_limit_at(states[rows, 0])
        bounds = np.array([np.inf if x is None else x for x in limits])
        kept[rows] &= states[rows, 1] <= bounds
        return kept


# ------------------------------------------------------------------ formulas on arrays


def evaluate_many(formula: Formula, atoms: dict[Atom, np.ndarray]) -> np.ndarray:
    """(h+1, m) truth of a formula, from (h+1, m) truths of its atoms, by the definitions."""
    some = next(iter(atoms.values()))
    last = len(some) - 1

    def until(a: np.ndarray, b: np.ndarray, at_end: bool) -> np.ndarray:
        # a U b; at_end: what holds beyond the last step (True: the weak until)
        found = np.empty_like(b)
        after = np.full(b.shape[1], at_end)
        for k in range(last, -1, -1):
            after = b[k] | (a[k] & after)
            found[k] = after
        return found

    def of(f: Formula) -> np.ndarray:
        match f:
            case Constant():
                return np.full_like(some, f.value)
            case Atom():
                return atoms[f]
            case Not():
                return ~of(f.operands[0])
            case Next() | WeakNext():
                inner = of(f.operands[0])
                end = np.full((1, inner.shape[1]), isinstance(f, WeakNext))
                return np.vstack([inner[1:], end])
            case Globally() | Finally():
                inner = of(f.operands[0])
                high = last if f.upper is None else f.upper
                every = isinstance(f, Globally)
                found = np.full_like(inner, every)
                for k in range(last + 1):
                    window = inner[k + f.lower : k + high + 1]
                    found[k] = window.all(axis=0) if every else window.any(axis=0)
                return found
        a, b = (of(x) for x in f.operands)
        match f:
            case And():
                return a & b
            case Or():
                return a | b
            case Implies():
                return ~a | b
            case Iff():
                return a == b
            case Until():
                return until(a, b, False)
            case WeakUntil():
                return until(a, b, True)
            case Release():
                return ~until(~a, ~b, False)
        raise AssertionError(f"no direct truth of {f}")

    return of(formula)


# ------------------------------------------------------------------ containment


def contained(
    found: ReachableSet, k: int, states: np.ndarray, labels: np.ndarray | None = None
) -> np.ndarray:
    """(m,) whether each (m, 4) state lies in the set at step k, in a base set of its label."""
    inside = np.zeros(len(states), dtype=bool)
    if k >= len(found.steps):
        return inside
    order = np.argsort(states[:, 0])
    s = states[order, 0]
    for base in found.steps[k]:
        s_low, s_high, d_low, d_high = base.rectangle
        part = order[
            np.searchsorted(s, s_low - TOLERANCE) : np.searchsorted(
                s, s_high + TOLERANCE, side="right"
            )
        ]
        d = states[part, 2]
        keep = (d >= d_low - TOLERANCE) & (d <= d_high + TOLERANCE) & ~inside[part]
        if labels is not None:
            keep &= labels[part] == base.label
        part = part[keep]
        if part.size:
            ok = in_polygon(base.lon, states[part, :2])
            ok[ok] = in_polygon(base.lat, states[part[ok], 2:])
            inside[part[ok]] = True
    return inside


def in_polygon(polygon: list[tuple[float, float]], points: np.ndarray) -> np.ndarray:
    """(m,) whether points lie in a convex polygon, segment or point, up to `TOLERANCE`."""
    corners = np.array(polygon)
    low, high = corners.min(axis=0) - TOLERANCE, corners.max(axis=0) + TOLERANCE
    inside = ((points >= low) & (points <= high)).all(axis=1)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        e = b - a
        size = np.hypot(*e)
        # The direction of an edge that is hardly longer than its corners' rounding means nothing.
        if size > 1e-9:
            side = e[0] * (points[:, 1] - a[1]) - e[1] * (points[:, 0] - a[0])
            inside &= side >= -TOLERANCE * size
    return inside


# ------------------------------------------------------------------ particles


@dataclass(eq=False)
class Outcome:
    """What became of the particles of one run.

    `checked` counts states compared with the set, `missing` those outside it; `survivors` are
    the trajectories (h+1, m, 4) that satisfy the formula by direct evaluation through the horizon.
    """

    launched: int
    checked: int
    missing: int
    first_missing: str
    survivors: np.ndarray
    extinct_at: int | None


def fly(
    world: World,
    spec: Specification,
    found: ReachableSet,
    n: int,
    seed: int,
) -> Outcome:
    """Drive n particles through the horizon; compare all that live with the set, by label."""
    ground, settings = world.ground, world.ground.settings
    rng = np.random.default_rng(seed)
    h, dt = ground.horizon, ground.scene.dt
    inputs = (settings.a_lon_min, settings.a_lon_max)
    dfa = spec.dfa
    moves = moves_of(dfa, inputs, h)
    of_input = [a for a in dfa.atoms if isinstance(a, Comparison) and a.variable == "a"]
    marks = sorted({*inputs, *(a.bound for a in of_input if inputs[0] < a.bound < inputs[1])})
    if len(marks) == 1:
        marks = marks * 2
    ranges = np.array(list(pairwise(marks)))
    middles = ranges.mean(axis=1)

    states = _initial(ground, n, rng)
    parents = np.arange(n)
    labels = np.full(n, moves.initial)
    which = rng.integers(len(ranges), size=n)
    mode = rng.choice([0, 1], (n, 2))
    everything: list[tuple[np.ndarray, ...]] = []
    checked = missing = 0
    where = ""
    for k in range(h + 1):
        if k > 0:
            redraw = rng.random((n, 2)) < 0.15
            mode[redraw] = rng.choice([0, 1], int(redraw.sum()))
            states = _advance(states, ranges[which], mode, settings, dt, rng)
        if k < h:
            change = rng.random(n) < 0.2
            which = np.where(change, rng.integers(len(ranges), size=n), which)
        alive = (states[:, 1] >= 0.0) & (states[:, 1] <= settings.v_max)
        alive &= np.abs(states[:, 3]) <= settings.v_lat_max
        alive[alive] = world.free(states[alive], k)
        truths = np.zeros((len(dfa.atoms), n), dtype=bool)
        xy = world.positions(states)
        bodies = any(isinstance(a, Predicate) and a.name.startswith("in_lane") for a in dfa.atoms)
        heading = world.headings(states, k, rng) if bodies else np.zeros(n)
        rows = np.flatnonzero(alive)
        for i, atom in enumerate(dfa.atoms):
            if atom in of_input:
                truths[i] = np.array([atom.holds(m) for m in middles])[which]
            else:
                truths[i, rows] = world.truth(atom, states[rows], xy[rows], heading[rows], k)
        next_labels = _read(moves, labels, truths, ranges[which], h - k)
        alive &= next_labels != _DEAD
        labels = next_labels
        rows = np.flatnonzero(alive)
        if rows.size == 0:
            return Outcome(n, checked, missing, where, np.zeros((h + 1, 0, 4)), k)
        inside = contained(found, k, states[rows], labels[rows])
        checked += len(rows)
        if not inside.all():
            missing += int((~inside).sum())
            where = where or f"step {k}, state {states[rows[~inside][0]].tolist()}"
        everything.append((states, truths, middles[which], parents, alive))
        if k < h:
            parents = _resampled(states, rows, n, rng)
            states, labels, which, mode = (
                states[parents],
                labels[parents],
                which[parents],
                mode[parents],
            )
    history, letters, accelerations = _traced(everything)
    satisfied = np.ones(history.shape[1], dtype=bool)
    if atoms := _atoms(spec.formula):
        values = {atom: np.zeros_like(accelerations, dtype=bool) for atom in atoms}
        for atom in atoms:  # comparisons that others imply are not in the automaton
            if isinstance(atom, Comparison):
                x = {"s": history[..., 0], "v": history[..., 1], "d": history[..., 2]}.get(
                    atom.variable, accelerations
                )
                values[atom] = x <= atom.bound if atom.op == "<=" else x < atom.bound
        values |= {atom: letters[:, i] for i, atom in enumerate(dfa.atoms)}
        satisfied = evaluate_many(spec.formula, values)[0]
    # What the automaton accepts and what the formula says must be the same.
    assert satisfied.all(), f"{int((~satisfied).sum())} accepted trajectories break the formula"
    # The corridor holds them as well: nothing that reaches the horizon was pruned.
    corridor = found.corridor()
    for k in range(h + 1):
        assert missing or contained(corridor, k, history[k]).all()
    return Outcome(n, checked, missing, where, history, None)


_DEAD = -2


def _atoms(formula: Formula) -> set[Atom]:
    if isinstance(formula, Atom):
        return {formula}
    return {a for x in formula.operands for a in _atoms(x)}


def _initial(ground: Ground, n: int, rng: np.random.Generator) -> np.ndarray:
    parts = []
    for polygon in (ground.lon, ground.lat):
        corners = np.array(polygon)
        weights = rng.dirichlet(np.full(len(corners), 0.3), n)
        parts.append(weights @ corners)
    return np.hstack(parts)


def _advance(
    states: np.ndarray,
    ranges: np.ndarray,
    mode: np.ndarray,
    settings: object,
    dt: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """One step of both double integrators, with inputs that switch once inside it."""
    n = len(states)
    s, v, d, w = states.T
    low, high = ranges.T
    a, b, tau = _inputs(low, high, mode[:, 0], n, dt, rng)
    # At a bound of the speed: the excursion beyond it inside the step that ends exactly on it.
    span = np.maximum(high - low, 1e-12)
    ends = v + a * tau + b * (dt - tau)
    for beyond, first, second, bound in (
        (ends > settings.v_max, high, low, settings.v_max),
        (ends < 0.0, low, high, 0.0),
    ):
        time = (bound - v - second * dt) / np.where(first > second, span, -span)
        use = beyond & (time >= 0.0) & (time <= dt)
        a, b = np.where(use, first, a), np.where(use, second, b)
        tau = np.where(use, time, tau)
    s, v = _moved(s, v, a, b, tau, dt)
    # Rounding must not kill what ends on a bound.
    v = np.where(np.abs(v) < 1e-12, 0.0, v)
    v = np.where(np.abs(v - settings.v_max) < 1e-12, settings.v_max, v)
    limit = np.full(n, settings.a_lat_max)
    d, w = _moved(d, w, *_inputs(-limit, limit, mode[:, 1], n, dt, rng), dt)
    return np.stack([s, v, d, w], axis=1)


def _inputs(
    low: np.ndarray,
    high: np.ndarray,
    mode: np.ndarray,
    n: int,
    dt: float,
    rng: np.random.Generator,
) -> Iterator[np.ndarray]:
    corner = np.where(mode == 1, high, low)
    other = np.where(mode == 1, low, high)
    kind = rng.random(n)
    free = rng.uniform(low, high, (2, n))
    a = np.where(kind < 0.85, corner, free[0])
    b = np.where(kind < 0.60, corner, np.where(kind < 0.85, other, free[1]))
    yield from (a, b, rng.uniform(0.0, dt, n))


def _moved(
    x: np.ndarray, v: np.ndarray, a: np.ndarray, b: np.ndarray, tau: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    rest = dt - tau
    middle = v + a * tau
    return x + v * tau + a * tau**2 / 2 + middle * rest + b * rest**2 / 2, middle + b * rest


def _read(
    moves: Moves, labels: np.ndarray, truths: np.ndarray, ranges: np.ndarray, left: int
) -> np.ndarray:
    """The class after the letter; `_DEAD` where acceptance is out of reach."""
    after = np.full(len(labels), _DEAD)
    for label, row in enumerate(moves.final if left == 0 else moves.moves):
        for move in row:
            if left > 0 and move.target not in moves.live[left]:
                continue
            fits = (labels == label) & (move.inputs[0] <= ranges[:, 0])
            fits &= ranges[:, 1] <= move.inputs[1]
            for index, truth in move.literals:
                fits &= truths[index] == truth
            after[fits] = move.target
    return after


def _resampled(
    states: np.ndarray, rows: np.ndarray, n: int, rng: np.random.Generator
) -> np.ndarray:
    """n indices of parents: every survivor, and in place of the dead those farthest out."""
    dead = n - len(rows)
    spread = states[rows]
    # A tenth of all goes to the extremes in any case.
    extra = max(dead, n // 10)
    directions = np.vstack([np.eye(4), -np.eye(4), rng.normal(size=(8, 4))])
    scale = np.ptp(spread, axis=0)
    scaled = (spread - spread.min(axis=0)) / np.where(scale > 0.0, scale, 1.0)
    top = min(len(rows), 40)
    farthest = np.argpartition(-(scaled @ directions.T), top - 1, axis=0)[:top].ravel()
    half = extra // 2
    chosen = np.concatenate(
        [rng.choice(farthest, half), rng.integers(len(rows), size=extra - half)]
    )
    kept = rows if len(rows) <= n - extra else rng.choice(rows, n - extra, replace=False)
    return np.concatenate([kept, rows[chosen]])


def _traced(
    everything: list[tuple[np.ndarray, ...]],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whole trajectories of the last survivors: (h+1, m, 4) states, (h+1, atoms, m) truths, and
    (h+1, m) accelerations: of each the middle of the range from which it was drawn."""
    history, letters, accelerations = [], [], []
    index = np.flatnonzero(everything[-1][-1])
    for states, truths, middle, parents, _ in reversed(everything):
        history.append(states[index])
        letters.append(truths[:, index])
        accelerations.append(middle[index])
        index = parents[index]
    return np.array(history[::-1]), np.array(letters[::-1]), np.array(accelerations[::-1])
