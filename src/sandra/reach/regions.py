"""Where a literal may hold: each predicate as pieces of the state space, over-approximated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import asin, atan2, cos, hypot, inf, pi, sin

import numpy as np
from numpy.typing import NDArray

from sandra.errors import FormulaError
from sandra.logic import Atom, Comparison, Predicate
from sandra.reach.ground import Ground
from sandra.reach.moves import Literal
from sandra.reach.polygon import Polygon, range_x, range_y
from sandra.reach.problem import Piece, Region, Regions, Union
from sandra.scene.types import Lane

Array = NDArray[np.float64]

EVERYWHERE: Region = ()
NOWHERE: Region = ((),)
BORDER_STEP = 0.25
"""Resolution at which lane borders are read [m]."""
BORDER_MARGIN = 0.02
"""Added outwards for what lies between two such points [m]."""
BORDER_MERGE = 0.1
"""Neighbouring stretches of a border are merged up to this difference [m]."""
TANGENT_STEP = 2.0
"""Spacing of the tangents to the safe-distance parabola [m/s]."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Part of a lane in the frame of the current lane: bounds of its two borders there [m]."""

    s_low: float
    s_high: float
    right_low: float
    right_high: float
    left_low: float
    left_high: float


@dataclass(frozen=True, slots=True)
class Leader:
    """Rear end [m] and speed [m/s] of a vehicle in a lane at some step."""

    rear: float
    speed: float


def regions_of(ground: Ground, atoms: tuple[Atom, ...]) -> Regions:
    """The regions of each atom of a specification.

    Raises:
        FormulaError: if an atom names a predicate, lane or lanelet that is not known here.
    """
    answers = [_answer(ground, atom) for atom in atoms]

    def regions(literal: Literal, k: int, lon: Polygon, lat: Polygon) -> Region:
        index, truth = literal
        return answers[index](truth, k, lon, lat)

    return regions


Answer = Callable[[bool, int, Polygon, Polygon], Region]


def _answer(ground: Ground, atom: Atom) -> Answer:
    if isinstance(atom, Comparison):
        return _comparison(atom)
    match atom.name:
        case "in_lane":
            return _in_lane(ground, _lanes(ground, atom))
        case "in_lanelet":
            return _in_lane(ground, (_lanelet(ground, atom),), exact=False)
        case "keeps_safe_distance" if atom.argument == "preceding":
            return _safe_distance(ground)
        case "keeps_lane_speed_limit":
            return _lane_speed_limit(ground)
    raise FormulaError(
        f"unknown predicate '{atom}': choose from in_lane(current|left|right|opposite), "
        "in_lanelet(ID), keeps_safe_distance(preceding), keeps_lane_speed_limit, in_standstill, "
        "or compare a, v, s or d with a number"
    )


def _comparison(atom: Comparison) -> Answer:
    bound = atom.bound

    def answer(truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        upper = truth
        if atom.variable == "v":
            cut = (0.0, 1.0, bound) if upper else (0.0, -1.0, -bound)
            return ((Piece((-inf, inf, -inf, inf), (cut,)),),)
        low, high = (-inf, bound) if upper else (bound, inf)
        if atom.variable == "s":
            return ((Piece((low, high, -inf, inf)),),)
        return ((Piece((-inf, inf, low, high)),),)

    return answer


def _lanes(ground: Ground, atom: Predicate) -> tuple[Lane, ...]:
    scene = ground.scene
    match atom.argument:
        case "current":
            return (scene.current,)
        case "left":
            return () if scene.left is None else (scene.left,)
        case "right":
            return () if scene.right is None else (scene.right,)
        case "opposite":
            return scene.opposite
    raise FormulaError(f"unknown lane in '{atom}': choose current, left, right or opposite")


def _lanelet(ground: Ground, atom: Predicate) -> tuple[Array, Array]:
    for lanelet in ground.scene.lanelets:
        if str(lanelet.id) == atom.argument:
            return lanelet.left, lanelet.right
    raise FormulaError(f"no lanelet {atom.argument} in the map: check the id in '{atom}'")


def _in_lane(
    ground: Ground, lanes: tuple[Lane | tuple[Array, Array], ...], exact: bool = True
) -> Answer:
    """in_lane(x, L): the body touches a lanelet of L (paper Sec. III-C)."""
    bands = [
        stretches(ground, *(lane if isinstance(lane, tuple) else (lane.left, lane.right)))
        for lane in lanes
    ]
    inner = ground.scene.ego.width / 2
    radius = hypot(ground.scene.ego.length, ground.scene.ego.width) / 2

    def answer(truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        if truth:
            side = half_extent(ground, k, lon, lat)
            return (tuple(p for band in bands for p in _touching(band, side, radius)),)
        if not exact:
            return EVERYWHERE
        # Outside of all lanes at once: an intersection over the lanes.
        return tuple(_not_touching(band, inner) for band in bands)

    return answer


def _touching(band: list[Stretch], side: float, radius: float) -> list[Piece]:
    if not band:
        return []
    last = len(band) - 1
    return [
        Piece(
            (
                x.s_low - (radius if i == 0 else 0.0),
                x.s_high + (radius if i == last else 0.0),
                x.right_low - side,
                x.left_high + side,
            )
        )
        for i, x in enumerate(band)
    ]


def _not_touching(band: list[Stretch], inner: float) -> Union:
    if not band:
        return (Piece((-inf, inf, -inf, inf)),)
    pieces = [
        Piece((-inf, band[0].s_low, -inf, inf)),
        Piece((band[-1].s_high, inf, -inf, inf)),
    ]
    for x in band:
        pieces.append(Piece((x.s_low, x.s_high, -inf, x.right_high - inner)))
        pieces.append(Piece((x.s_low, x.s_high, x.left_low + inner, inf)))
    return tuple(pieces)


def half_extent(ground: Ground, k: int, lon: Polygon, lat: Polygon) -> float:
    """How far the body can reach sideways from its centre [m], for all states of a base set.

    The body heads where it moves, up to the slip angle of a single-track model at its centre,
    asin(l_r a_lat / v^2); a body as long as ours bends out of a curved lane by l^2 kappa / 8.
    """
    ego = ground.scene.ego
    i0, i1, _, _ = ground.lattice.touched(*range_x(lon), 0.0, 0.0)
    columns = slice(i0, max(i1, i0 + 1))
    kappa = max(
        float(np.abs(ground.curvature[0][columns]).max(initial=0.0)),
        float(np.abs(ground.curvature[1][columns]).max(initial=0.0)),
    )
    d_low, d_high = range_x(lat)
    if k == 0:
        angle = abs(ground.scene.ego_curvilinear[2])
    else:
        stretch = max(0.1, 1.0 - kappa * max(abs(d_low), abs(d_high)))
        forward = max(range_y(lon)[0], 0.0) * stretch
        sideways = max(abs(v) for v in range_y(lat))
        angle = atan2(sideways, forward)
        grip = ego.wheelbase / 2 * ground.settings.a_lat_max
        angle += asin(min(1.0, grip / forward**2)) if forward > 0.0 else pi / 2
    a, b = ego.length / 2, ego.width / 2
    angle = min(angle, atan2(a, b))  # beyond the diagonal the extent would shrink again
    return a * sin(angle) + b * cos(angle) + a * a * kappa / 2


def stretches(ground: Ground, left: Array, right: Array) -> list[Stretch]:
    """A lane's borders along the lattice's columns; empty where the lane is elsewhere.

    Borders are read every `BORDER_STEP`; where they are not functions of s (a lanelet that
    crosses), the highest and lowest d per column bound the touching region from outside.
    """
    lattice = ground.lattice
    frame = ground.scene.frame
    lines = lattice.corners()[0]
    first, last = _per_column(frame.to_curvilinear(_dense(right)), lines)
    low_left, high_left = _per_column(frame.to_curvilinear(_dense(left)), lines)
    found: list[Stretch] = []
    for i in range(lattice.columns):
        values = (first[i], last[i], low_left[i], high_left[i])
        if not np.isfinite(values).all():
            continue
        low = min(first[i], low_left[i]) - BORDER_MARGIN
        high = max(last[i], high_left[i]) + BORDER_MARGIN
        new = Stretch(
            float(lines[i]),
            float(lines[i + 1]),
            float(low),
            float(last[i]) + BORDER_MARGIN,
            float(low_left[i]) - BORDER_MARGIN,
            float(high),
        )
        joined = _join(found[-1], new) if found else None
        if joined is None:
            found.append(new)
        else:
            found[-1] = joined
    return found


def _join(a: Stretch, b: Stretch) -> Stretch | None:
    if abs(a.s_high - b.s_low) > 1e-6:
        return None
    right = (min(a.right_low, b.right_low), max(a.right_high, b.right_high))
    left = (min(a.left_low, b.left_low), max(a.left_high, b.left_high))
    if right[1] - right[0] > BORDER_MERGE or left[1] - left[0] > BORDER_MERGE:
        return None
    return Stretch(a.s_low, b.s_high, *right, *left)


def _dense(line: Array) -> Array:
    """The polyline with points at most `BORDER_STEP` apart."""
    pieces = [line[:1]]
    for a, b in zip(line[:-1], line[1:], strict=True):
        n = max(1, int(np.ceil(np.linalg.norm(b - a) / BORDER_STEP)))
        pieces.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.vstack(pieces)


def _per_column(points: Array, lines: Array) -> tuple[Array, Array]:
    """Lowest and highest d of a border in each column; NaN where it does not pass."""
    columns = len(lines) - 1
    low, high = np.full(columns, np.inf), np.full(columns, -np.inf)
    s, d = points[:, 0], points[:, 1]
    for a in range(len(points) - 1):
        s_a, s_b = sorted((s[a], s[a + 1]))
        if s_b < lines[0] or s_a > lines[-1]:
            continue
        i0 = max(0, int(np.searchsorted(lines, s_a, side="right")) - 1)
        i1 = min(columns, int(np.searchsorted(lines, s_b, side="left")))
        down, up = min(d[a], d[a + 1]), max(d[a], d[a + 1])
        low[i0:i1] = np.minimum(low[i0:i1], down)
        high[i0:i1] = np.maximum(high[i0:i1], up)
    missing = ~np.isfinite(low)
    low[missing], high[missing] = np.nan, np.nan
    return low, high


def _safe_distance(ground: Ground) -> Answer:
    """R_G1's keeps_safe_distance towards whatever precedes (paper eq. (5) and (6)).

    Where the inscribed disc touches a lane, the nearest vehicle in front there precedes. The states
    (s, v) that keep the distance are convex: s + v t_d + v^2 / (2 |a_min|) <= const; tangents to
    the parabola cut it from outside.
    """
    half = ground.scene.ego.length / 2
    inner = ground.scene.ego.width / 2
    settings = ground.settings
    lanes = [x for x in (ground.scene.current, ground.scene.left, ground.scene.right) if x]
    bands = [stretches(ground, lane.left, lane.right) for lane in lanes]
    leaders = [_leaders(ground, lane, band) for lane, band in zip(lanes, bands, strict=True)]
    speeds = np.arange(0.0, settings.v_max + TANGENT_STEP, TANGENT_STEP)
    braking = 2 * abs(settings.a_min)

    def cuts(leader: Leader) -> tuple[tuple[float, float, float], ...]:
        room = leader.rear - half + leader.speed**2 / (2 * abs(settings.a_obs_min))
        return tuple(
            (1.0, settings.t_d + 2 * float(u) / braking, room + float(u) ** 2 / braking)
            for u in speeds
        )

    tables = [
        [[(leader.rear - half, cuts(leader)) for leader in step] for step in steps]
        for steps in leaders
    ]

    def answer(truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        if not truth:
            return EVERYWHERE  # the complement is not convex; nothing is lost but tightness
        s_low, s_high = range_x(lon)
        d_low, d_high = range_x(lat)
        region: list[Union] = []
        for band, table in zip(bands, tables, strict=True):
            near = [x for x in band if x.s_low <= s_high and x.s_high >= s_low]
            step = table[k]
            if not step or not near or s_low > step[-1][0]:
                continue
            low, high = _sure_band(near, s_low, s_high, inner)
            if low >= high or d_high < low or d_low > high:
                continue
            pieces = [Piece((-inf, inf, -inf, low)), Piece((-inf, inf, high, inf))]
            start = -inf
            for end, tangents in step:
                if end >= s_low and start <= s_high:
                    pieces.append(Piece((start, end, low, high), tangents))
                start = end
            pieces.append(Piece((start, inf, low, high)))
            region.append(tuple(pieces))
        return tuple(region)

    return answer


def _sure_band(
    near: list[Stretch], s_low: float, s_high: float, inner: float
) -> tuple[float, float]:
    """Where the inscribed disc touches a lane for sure, over a whole range of s."""
    if near[0].s_low > s_low + 1e-6 or near[-1].s_high < s_high - 1e-6:
        return 0.0, 0.0
    return max(x.right_high for x in near) - inner, min(x.left_low for x in near) + inner


def _leaders(ground: Ground, lane: Lane, band: list[Stretch]) -> list[list[Leader]]:
    """For each step, the vehicles in a lane, rear ends ascending (most likely prediction)."""
    found: list[list[Leader]] = [[] for _ in range(ground.horizon + 1)]
    if not band:
        return found
    exempt = round(ground.settings.t_c / ground.scene.dt)
    for predicted in ground.prediction.obstacles:
        obstacle = predicted.obstacle
        if obstacle.kind in ("pedestrian", "trafficIsland", "buildings", "median_strip"):
            continue
        rows = predicted.states
        present = np.flatnonzero(np.isfinite(rows[:, :4]).all(axis=1))
        if present.size == 0:
            continue
        bodies = [obstacle.outline.placed(*rows[k, :3]).vertices for k in present]
        size = len(bodies[0])
        corners = ground.scene.frame.to_curvilinear(np.vstack(bodies)).reshape(-1, size, 2)
        radius = obstacle.outline.radius
        entered: int | None = None
        was_inside = False
        for k, body in zip(present.tolist(), corners, strict=True):
            rear = float(body[:, 0].min()) - radius
            d_low = float(body[:, 1].min()) - radius
            d_high = float(body[:, 1].max()) + radius
            middle = float(body[:, 0].mean())
            inside = any(
                x.s_low <= middle <= x.s_high
                and d_high > x.right_high
                and d_low < x.left_low
                for x in band
            )
            if inside and not was_inside and k > 0:
                entered = k
            was_inside = inside
            cut_in = entered is not None and k - entered < exempt
            if inside and not (ground.settings.cut_in_exception and cut_in):
                heading = float(ground.scene.frame.heading(np.array([middle]))[0])
                speed = float(rows[k, 3]) * cos(float(rows[k, 2]) - heading)
                found[k].append(Leader(rear, max(0.0, speed)))
    return [sorted(step, key=lambda x: x.rear) for step in found]


def _lane_speed_limit(ground: Ground) -> Answer:
    """keeps_lane_speed_limit: the signs' limit where it is known, the loosest lane's if several.

    An unknown limit is unknown: the predicate may then hold and may not.
    """
    limits = _limits(ground)

    def answer(truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        pieces = []
        for s_low, s_high, lowest, highest in limits:
            bound = highest if truth else lowest
            if bound is None:
                cuts: tuple[tuple[float, float, float], ...] = ()
            else:
                cuts = ((0.0, 1.0, bound),) if truth else ((0.0, -1.0, -bound),)
            pieces.append(Piece((s_low, s_high, -inf, inf), cuts))
        return (tuple(pieces),)

    return answer


def _limits(ground: Ground) -> list[tuple[float, float, float | None, float | None]]:
    """(s_low, s_high, lowest, highest limit) over the lanes that the ego may use, along s."""
    scene = ground.scene
    by_id = {lanelet.id: lanelet for lanelet in scene.lanelets}
    spans: list[tuple[float, float, float | None]] = []
    for lane in (scene.current, scene.left, scene.right):
        if lane is None:
            continue
        for lanelet_id, limit in zip(lane.lanelets, lane.speed_limits, strict=True):
            center = by_id[lanelet_id].center
            s = scene.frame.to_curvilinear(center[[0, -1]])[:, 0]
            spans.append((float(s.min()), float(s.max()), limit))
    marks = sorted({x for a, b, _ in spans for x in (a, b)})
    found: list[tuple[float, float, float | None, float | None]] = []
    edges = [-inf, *marks, inf]
    for a, b in zip(edges, edges[1:], strict=False):
        here = [limit for low, high, limit in spans if low <= a + 1e-6 and high >= b - 1e-6]
        known = [limit for limit in here if limit is not None]
        complete = bool(here) and len(known) == len(here)
        pair = (min(known), max(known)) if complete else (None, None)
        if found and found[-1][2:] == pair:
            found[-1] = (found[-1][0], b, *pair)
        elif b - a > 1e-9:
            found.append((a, b, *pair))
    return found
