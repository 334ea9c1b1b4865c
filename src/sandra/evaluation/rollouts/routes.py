"""Ways that a vehicle can take along lanes, sampled evenly, with the room beside them.

An adversary steers by these; whether its motion keeps the assumptions is decided by `referee`,
which knows nothing of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.evaluation.rollouts.actors import Actor
from sandra.evaluation.rollouts.ego import Drive
from sandra.evaluation.rollouts.road import Road

Array = NDArray[np.float64]

SPACING = 0.5
"""Of the samples [m]."""
MOST = 6
"""Routes per vehicle."""
SMOOTHING = 5.0
"""Centre lines are smoothed over this length [m]."""
TAPER = 0.06
"""Room beside the route shrinks no faster than this, per metre."""
EASY = 0.5
"""Share of the acceleration that bends may need."""


@dataclass(frozen=True, slots=True, eq=False)
class Routes:
    """R routes of M samples; `owner` (R,) is the index of the actor.

    `point` (R, M, 2), `course` (R, M) [rad], `low`, `high` (R, M): room for the body to the right
    and left [m]; `cap` (R, M): speed with which the bends ahead can be taken; `bend` (R, M)
    curvature [1/m], and `kink` (R, M) angle to the map's centre line [rad], >= 0; `closed_low`,
    `closed_high` (R, M): the ego's lane, from its right to its left border, if it may be entered
    only by law, else inf; `along` (R, M): s along the ego's lane; `length` (R,): of the way on the
    map [m]; `ego_s`, `ego_d` (R, T): the ego in the route's coordinates at fine steps.
    """

    owner: NDArray[np.int64]
    point: Array
    course: Array
    low: Array
    high: Array
    cap: Array
    bend: Array
    kink: Array
    closed_low: Array
    closed_high: Array
    along: Array
    length: Array
    ego_s: Array
    ego_d: Array

    def of(self, actor: int) -> NDArray[np.int64]:
        """The routes of one actor."""
        return np.flatnonzero(self.owner == actor)


def routes_of(
    actors: tuple[Actor, ...], road: Road, drive: Drive, rng: np.random.Generator
) -> Routes:
    """Up to `MOST` routes for each actor that keeps to lanes; those of an actor side by side."""
    rows: list[dict[str, Array]] = []
    owner: list[int] = []
    for index, actor in enumerate(actors):
        if actor.moves != "lanes":
            continue
        start = road.around(actor.start.x, actor.start.y, actor.start.heading)
        time = drive.times[-1]
        speed = min(abs(actor.start.speed) + actor.a_max * time, actor.v_max)
        reach = min(speed * time, abs(actor.start.speed) * time + actor.a_max / 2 * time**2) + 20.0
        shut = road.shut(start)[0] if actor.keeps_out else frozenset[int]()
        chains = _chains(road, start, reach, rng)
        for chain in chains:
            rows.append(_route(road, chain, reach, actor, shut))
            owner.append(index)
    most = max((len(row["course"]) for row in rows), default=2)

    def stacked(name: str) -> Array:
        padded = [
            np.concatenate([row[name], np.repeat(row[name][-1:], most - len(row[name]), axis=0)])
            for row in rows
        ]
        return np.array(padded) if padded else np.zeros((0, most))

    point, course = stacked("point"), stacked("course")
    length = np.array([SPACING * (len(row["course"]) - 1) for row in rows])
    open_end = np.array([bool(row["ends"][0]) for row in rows], dtype=bool)
    ego = [_seen_from(p[: round(n / SPACING) + 1], c, drive) for p, c, n in
           zip(point, course, length, strict=True)]  # fmt: skip
    steps = len(drive.states)
    return Routes(
        np.array(owner, dtype=np.int64),
        point.reshape(len(rows), most, 2),
        course,
        stacked("low"),
        stacked("high"),
        stacked("cap"),
        stacked("bend"),
        stacked("kink"),
        stacked("closed_low"),
        stacked("closed_high"),
        stacked("along"),
        np.where(open_end, length, np.inf),
        np.array([x[0] for x in ego]).reshape(len(rows), steps),
        np.array([x[1] for x in ego]).reshape(len(rows), steps),
    )


def _chains(
    road: Road, start: list[int], reach: float, rng: np.random.Generator
) -> list[list[int]]:
    """Chains of successors from the lanelets underneath and those beside them."""
    firsts = list(start)
    for i in firsts:
        firsts += [j for j in road.beside(i) if j not in firsts]
    found: list[list[int]] = []
    for first in firsts:
        todo = [([first], 0.0)]
        while todo and len(found) < 8 * MOST:
            chain, ahead = todo.pop()
            onward = [
                j
                for j in road.lanelets[chain[-1]].successors
                if j in road.lanelets and j not in chain
            ]
            if ahead > reach or not onward:
                found.append(chain)
                continue
            rng.shuffle(onward)
            todo += [([*chain, j], ahead + _length(road, j)) for j in onward]
    own = [chain for chain in found if chain[0] in start]
    others = [chain for chain in found if chain[0] not in start]
    own = [own[i] for i in rng.permutation(len(own))]
    others = [others[i] for i in rng.permutation(len(others))]
    return [*own[: MOST - min(2, len(others))], *others[:2]][:MOST]


def _length(road: Road, lanelet: int) -> float:
    line = road.lanelets[lanelet].center
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _route(
    road: Road, chain: list[int], reach: float, actor: Actor, shut: frozenset[int]
) -> dict[str, Array]:
    centre = np.vstack([road.lanelets[i].center for i in chain])
    part = np.concatenate([np.full(len(road.lanelets[i].left), i) for i in chain])
    apart = np.concatenate([[True], np.hypot(*np.diff(centre, axis=0).T) > 1e-3])
    centre, part = centre[apart], part[apart]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(centre, axis=0).T))])
    # From a little behind the vehicle on.
    here = float(
        shapely.line_locate_point(
            shapely.LineString(centre), shapely.Point(actor.start.x, actor.start.y)
        )
    )
    begin = max(0.0, here - 10.0)
    ends = way[-1] <= here + reach
    stations = np.arange(begin, min(way[-1], here + reach), SPACING)
    if len(stations) < 3:
        stations = way[-1] + SPACING * np.arange(-2, 1)
    raw = np.column_stack([np.interp(stations, way, centre[:, i]) for i in (0, 1)])
    lanelet = part[np.minimum(np.searchsorted(way, stations, side="right"), len(part) - 1)]
    point = _smooth(raw)
    tangent = np.gradient(point, axis=0)
    course = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    bend = np.abs(np.gradient(course)) / SPACING
    kink = np.abs(np.arctan2(*np.diff(raw, axis=0)[:, ::-1].T) - course[:-1])
    kink = np.minimum(np.append(kink, 0.0), 2 * np.pi - np.append(kink, 0.0))
    kink = np.maximum(kink, np.maximum(np.roll(kink, 1), np.roll(kink, -1)))
    cap = np.minimum(np.sqrt(EASY * actor.a_max / np.maximum(bend, 1e-6)), actor.v_max)
    if np.isfinite(actor.lateral):
        cap = np.minimum(cap, 0.7 * actor.lateral / np.maximum(np.sin(kink), 1e-3))
    slows = min(EASY * actor.a_max, 0.9 * actor.braking)
    for i in range(len(cap) - 2, -1, -1):
        cap[i] = min(cap[i], np.sqrt(cap[i + 1] ** 2 + 2 * slows * SPACING))
    low, high, closed_low, closed_high = (np.empty(len(stations)) for _ in range(4))
    for i in dict.fromkeys(lanelet.tolist()):
        rows = lanelet == i
        places = shapely.points(point[rows])
        left, beyond_left = _side(road, i, True, shut)
        right, beyond_right = _side(road, i, False, shut)
        high[rows] = shapely.distance(left, places)
        low[rows] = -shapely.distance(right, places)
        closed_low[rows], closed_high[rows] = np.inf, np.inf
        if i in shut:
            beyond_left, beyond_right = None, None
            closed_low[rows] = -shapely.distance(_line(road, i, False), places)
            closed_high[rows] = shapely.distance(_line(road, i, True), places)
        if beyond_left is not None:
            closed_low[rows], closed_high[rows] = (shapely.distance(x, places) for x in beyond_left)
        if beyond_right is not None:
            closed_high[rows], closed_low[rows] = (
                -shapely.distance(x, places) for x in beyond_right
            )
    for i in range(len(high) - 2, -1, -1):
        high[i] = min(high[i], high[i + 1] + TAPER * SPACING)
        low[i] = max(low[i], low[i + 1] - TAPER * SPACING)
    along = np.zeros(len(stations))
    if road.reference is not None:
        line = shapely.LineString(road.reference)
        along = shapely.line_locate_point(line, shapely.points(point))
    return {
        "point": point,
        "course": course,
        "low": low,
        "high": high,
        "cap": cap,
        "bend": bend,
        "kink": kink,
        "closed_low": closed_low,
        "closed_high": closed_high,
        "along": np.asarray(along),
        "ends": np.array([ends]),
    }


def _smooth(line: Array) -> Array:
    """Moving average that leaves both ends in place."""
    half = round(SMOOTHING / SPACING / 2)
    before = 2 * line[0] - line[half:0:-1] if len(line) > half else np.repeat(line[:1], half, 0)
    after = 2 * line[-1] - line[-2 : -half - 2 : -1] if len(line) > half else line[[-1] * half]
    padded = np.vstack([before, line, after])
    weight = np.hanning(2 * half + 3)[1:-1]
    weight /= weight.sum()
    return np.column_stack([np.convolve(padded[:, i], weight, "valid") for i in (0, 1)])


def _line(road: Road, lanelet: int, left: bool) -> shapely.LineString:
    x = road.lanelets[lanelet]
    return shapely.LineString(x.left if left else x.right)


def _side(
    road: Road, lanelet: int, left: bool, shut: frozenset[int]
) -> tuple[shapely.LineString, tuple[shapely.LineString, shapely.LineString] | None]:
    """The carriageway's border on one side, and the near and far border of a shut lane there."""
    seen = [lanelet]
    closed = None
    while True:
        x = road.lanelets[seen[-1]]
        side = x.adjacent_left if left else x.adjacent_right
        if side is None or not side[1] or side[0] not in road.lanelets or side[0] in seen:
            return _line(road, seen[-1], left), closed
        if side[0] in shut and closed is None:
            closed = _line(road, seen[-1], left), _line(road, side[0], left)
        seen.append(side[0])


def _seen_from(point: Array, course: Array, drive: Drive) -> tuple[Array, Array]:
    """(T,) s and d of the ego's centre in a route's coordinates at all fine steps."""
    line = shapely.LineString(point)
    places = shapely.points(drive.states[:, :2])
    s = np.asarray(shapely.line_locate_point(line, places))
    index = np.minimum(np.round(s / SPACING).astype(int), len(point) - 1)
    away = drive.states[:, :2] - point[index]
    d = -np.sin(course[index]) * away[:, 0] + np.cos(course[index]) * away[:, 1]
    return s, d
