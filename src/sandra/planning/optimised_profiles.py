"""Speed profiles along a path that fit into the gaps between the others, by linear programming.

Whether to pass before or behind whatever blocks the path for a while is decided by a search over
the free stretches (`path_gaps`): from step to step the set of positions and speeds that can be
reached is followed through each of them, so that what leads nowhere is dropped early, mostly
without any optimisation. For each way through that ends at a standstill a linear program has the
smallest peak of |a|, and of those profiles the one that changes its acceleration least. It is
solved by HiGHS (`scipy.optimize.linprog`).

Nothing is accepted because the solver says so: profiles are driven and checked as any other.
After Magdici & Althoff, "Fail-safe motion planning of autonomous vehicles", 2016.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sandra.planning.path_gaps import Stretch, Track
from sandra.reach.polygon import (
    Polygon,
    area,
    contains,
    cut,
    cut_x,
    cut_y,
    propagate,
    range_x,
)

Array = NDArray[np.float64]

CREEP = 0.05
"""Until it stands the ego is no slower than this [m/s]."""
SMOOTH = 1e-3
"""Weight of the sum of all changes of the acceleration against its peak."""
MOST_WAYS = 6
"""So many ways through the gaps are followed at once; the widest are kept."""
MOST_SOLVED = 12
"""Linear programs for each path."""
INFEASIBLE = 2
"""The status by which the solver says that there is no solution."""
MOST_ITERATIONS = 2000
"""The solver gives up after so many: a bound that does not depend on the machine."""


@dataclass(frozen=True, slots=True, eq=False)
class _Node:
    """What can be reached at the end of a step in which the ego stays in `gap`.

    `polygon`: (position [m], speed [m/s]); `bound`: (c, m), speeds up to c + m s are allowed there;
    `choices`: which gap was taken wherever there was more than one.
    """

    polygon: Polygon
    gap: Stretch
    bound: tuple[float, float]
    parent: _Node | None
    choices: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Stop:
    """A way through the gaps: the nodes after each step but the last, and where it stands then."""

    nodes: tuple[_Node, ...]
    gap: Stretch
    place: Stretch


def profiles(track: Track) -> tuple[list[Array], str]:
    """Speeds at the fine grid points from the track's start to a standstill [m/s].

    Each fits into the gaps; they differ in the way through them, or in their duration. Where there
    is none, the text says why.
    """
    stops, reason = _stops(track)
    task = track.task
    found = []
    for stop in stops[:MOST_SOLVED]:
        speeds = _solve(track, stop)
        if isinstance(speeds, str):
            reason = speeds
        else:
            steps = len(speeds) - 1
            fine = np.arange(steps * track.intervals * task.per_step + 1)
            profile = np.interp(fine * task.tau, track.step * np.arange(steps + 1), speeds)
            profile[-1] = 0.0
            found.append(profile)
    # Of those that are equally mild the first is kept.
    return sorted(found, key=len), reason


def _stops(track: Track) -> tuple[list[_Stop], str]:
    """Standstills that may be reached, longest first for each way; or why there are none."""
    task, dt = track.task, track.step
    least, most = -float(task.levels[-1]), task.limits.a_lon_max
    front = [_Node([(0.0, task.speed)], (0.0, track.length), (np.inf, 0.0), None, ())]
    found: dict[tuple[tuple[int, ...], int], list[_Stop]] = {}
    stands = False
    for step in range(track.steps):
        farthest = max(s + v * dt + most * dt**2 / 2 for x in front for s, v in x.polygon)
        slowest = min(range_x(x.polygon)[0] for x in front)
        gaps = track.free(step, slowest, farthest)
        # Faster than this it could not stand when the prediction ends.
        fastest = -least * dt * (track.steps - step - 1)
        reached = []
        for node in front:
            for choice, gap, ahead in _ahead(node, gaps, least, most, dt):
                choices = node.choices if choice is None else (*node.choices, choice)
                last = cut_y(ahead, 0.0, 0.0)
                stands = stands or bool(last)
                for number, place in enumerate(track.places):
                    if _may_rest(last, place):
                        key = (choices, number)
                        found.setdefault(key, []).append(_Stop(_way(node), gap, place))
                moving = cut_y(ahead, CREEP, fastest)
                if moving:
                    bound = track.speed_bound(*range_x(moving))
                    moving = cut(moving, -bound[1], 1.0, bound[0])
                if moving:
                    reached.append(_Node(moving, gap, bound, node, choices))
        before, front = front, _widest(reached)
        if not front:
            break
    if not found:
        if stands:
            return [], "no place to stand outside conflict areas comes in reach in time"
        if any(_ahead(node, gaps, least, most, dt) for node in before):
            return [], "it cannot become slow enough in time"
        return [], f"at any speed it {track.in_the_way(step, slowest)}"
    ways = [(stops[-1], stops[len(stops) // 2], stops[0]) for stops in found.values()]
    ordered = [stop for kind in zip(*ways, strict=True) for stop in kind]
    return list(dict.fromkeys(ordered)), ""


def _may_rest(last: Polygon, place: Stretch) -> bool:
    """Whether some standstills lie in a place, not only at the very beginning of it."""
    resting = cut_x(last, *place)
    return bool(resting) and range_x(resting)[1] > place[0]


def _ahead(
    node: _Node, gaps: list[Stretch], least: float, most: float, dt: float
) -> list[tuple[int | None, Stretch, Polygon]]:
    """For each gap the ego may be in: its number if there are several, and what it can reach."""
    inside = [(i, gap, cut_x(node.polygon, *gap)) for i, gap in enumerate(gaps)]
    inside = [x for x in inside if x[2]]
    found: list[tuple[int | None, Stretch, Polygon]] = []
    for i, gap, part in inside:
        ahead = cut_x(propagate(part, least, most, dt), *gap)
        if ahead:
            found.append((i if len(inside) > 1 else None, gap, ahead))
    return found


def _widest(nodes: list[_Node]) -> list[_Node]:
    """At most `MOST_WAYS`, without those from which nothing more can be reached than from others.

    Two ways that come together in one gap stay two as long as each leads to states of its own.
    """
    kept: list[_Node] = []
    for node in sorted(nodes, key=lambda x: -area(x.polygon)):
        covered = any(
            node.gap == other.gap and all(contains(other.polygon, *p) for p in node.polygon)
            for other in kept
        )
        if not covered and len(kept) < MOST_WAYS:
            kept.append(node)
    return kept


def _way(node: _Node) -> tuple[_Node, ...]:
    """The nodes from the first step to this one, without the root."""
    nodes = []
    at: _Node = node
    while at.parent is not None:
        nodes.append(at)
        at = at.parent
    return tuple(nodes[::-1])


def _solve(track: Track, stop: _Stop) -> Array | str:
    """(n + 1,) speeds at the ends of the steps [m/s]; or why the solver finds none.

    Variables: speed and position at the end of each step (n each), the peak p, and how much the
    acceleration changes from step to step (n - 1).
    """
    from scipy.optimize import linprog

    task, dt, n = track.task, track.step, len(stop.nodes) + 1
    k, speed, place, peak = np.arange(n), np.arange(n), n + np.arange(n), 2 * n
    change = 2 * n + 1 + np.arange(n - 1)
    size = 3 * n
    acceleration = np.zeros((n, size))
    acceleration[k, speed] = 1.0 / dt
    acceleration[k[1:], speed[:-1]] = -1.0 / dt
    # Of the first step the speed at the start is given; this is its part [m/s^2].
    given = np.zeros(n)
    given[0] = -task.speed / dt
    over, under = acceleration.copy(), -acceleration
    over[:, peak] = under[:, peak] = -1.0
    more = np.diff(acceleration, axis=0)
    less = -more
    more[k[:-1], change] = less[k[:-1], change] = -1.0
    bounds = np.array([node.bound for node in stop.nodes]).reshape(n - 1, 2)
    slow = np.zeros((n - 1, size))
    slow[k[:-1], place[:-1]], slow[k[:-1], speed[:-1]] = -bounds[:, 1], 1.0
    moved = np.zeros((n, size))
    moved[k, place] = 1.0
    moved[k[1:], place[:-1]] = -1.0
    moved[k, speed] = -dt / 2
    moved[k[1:], speed[:-1]] -= dt / 2
    gaps = [*(node.gap for node in stop.nodes), stop.gap]
    inside = [(max(a[0], b[0]), min(a[1], b[1])) for a, b in pairwise([*gaps, stop.place])]
    full, push = float(task.levels[-1]), task.limits.a_lon_max
    cost = np.zeros(size)
    cost[peak], cost[change] = 1.0, SMOOTH
    solution = linprog(
        cost,
        A_ub=np.vstack([over, under, acceleration, -acceleration, more, less, slow]),
        b_ub=np.concatenate(
            [
                -given,
                given,
                push - given,
                full + given,
                -np.diff(given),
                np.diff(given),
                bounds[:, 0],
            ]
        ),
        A_eq=moved,
        b_eq=np.where(k == 0, dt / 2 * task.speed, 0.0),
        bounds=[
            *[(CREEP, task.top)] * (n - 1),
            (0.0, 0.0),
            *inside,
            (0.0, None),
            *[(0.0, None)] * (n - 1),
        ],
        method="highs",
        options={"maxiter": MOST_ITERATIONS},
    )
    if solution.status == INFEASIBLE:
        return "no speed profile leads through the gaps between the others"
    if solution.status != 0 or solution.x is None or not np.isfinite(solution.x).all():
        return "the solver gave up"
    found: Array = np.concatenate([[task.speed], np.maximum(solution.x[speed], 0.0)])
    return found
