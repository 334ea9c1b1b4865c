"""The reachable set, step by step: the readable specification of what is computed.

Method, Sec. "Reachable set"; Söntges & Althoff 2018 for the base sets, Lercher & Althoff 2024 for
the product with the automaton. Per step:

1. propagate each base set for any admissible input, and keep to the speed bounds;
2. unite what has the same label on the lattice, take the forbidden cells away, and cover the rest
   by boxes;
3. give each box the hull of what reaches it;
4. read the letter: cut to where its literals may hold, and move on in the automaton.

The set over-approximates: cells are forbidden only where the body collides for sure, boxes round
outwards, and a hull contains its parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sandra.reach.lattice import Box, Mask, boxes
from sandra.reach.moves import UNBOUNDED, Interval, Move
from sandra.reach.polygon import Polygon, cut, cut_x, cut_y, joined, propagate, range_x
from sandra.reach.problem import Problem, Region, in_groups
from sandra.reach.sets import BaseSet, ReachableSet

COVER_TOLERANCE = 2
"""Cells by which neighbouring rows may differ and still be covered by one box (it only grows)."""
EXACT_BELOW = 40
"""A cell of that tolerance for so many columns of a group: a narrow one is covered exactly."""


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A part of the set at the current step whose letter has not been read."""

    lon: Polygon
    lat: Polygon
    label: int
    came_with: Interval
    parents: tuple[int, ...]


def reachable_set(problem: Problem) -> ReachableSet:
    """Compute the set from step 0 until it is empty or the horizon is reached."""
    return reachable_sets([problem])[0]


def reachable_sets(problems: Sequence[Problem]) -> list[ReachableSet]:
    """The set of each problem; what differs in the last letter alone shares all steps before."""
    return in_groups(problems, _computed)


def _computed(problems: list[Problem]) -> list[ReachableSet]:
    """The sets of problems that are alike until the last letter is read."""
    problem = problems[0]
    lon, lat = cut_y(problem.lon, *problem.v_lon), cut_y(problem.lat, *problem.v_lat)
    parts = [_Candidate(lon, lat, problem.moves.initial, UNBOUNDED, ())] if lon and lat else []
    contested: Mask = np.zeros_like(problem.forbidden[0])
    steps: list[tuple[BaseSet, ...]] = []

    def emptied() -> ReachableSet:
        return ReachableSet(tuple(steps), problem.horizon, problem.lattice, contested)

    for k in range(problem.horizon):
        candidates = _covered(problem, parts, k, contested)
        sets = tuple(b for candidate in candidates for b in _read(problem, candidate, k))
        if not sets:
            return [emptied() for _ in problems]
        steps.append(sets)
        parts = _propagated(problem, sets, k + 1)
        contested[:] = False
    candidates = _covered(problem, parts, problem.horizon, contested)
    found = []
    for each in problems:
        last = tuple(b for c in candidates for b in _read(each, c, problem.horizon))
        whole = ReachableSet((*steps, last), problem.horizon, problem.lattice)
        found.append(whole if last else emptied())
    return found


def _propagated(problem: Problem, sets: tuple[BaseSet, ...], k: int) -> list[_Candidate]:
    """What each base set of step k - 1 reaches at step k."""
    found = []
    for index, b in enumerate(sets):
        lon = propagate(b.lon, *b.inputs, problem.dt, problem.v_lon, problem.tight)
        lat = propagate(b.lat, *problem.a_lat, problem.dt, problem.v_lat, problem.tight)
        if lon and lat:
            # Only the last letter asks with which input its state was reached.
            inputs = b.inputs if k == problem.horizon else UNBOUNDED
            found.append(_Candidate(lon, lat, b.label, inputs, (index,)))
    return found


def _covered(
    problem: Problem, parts: list[_Candidate], k: int, contested: Mask
) -> list[_Candidate]:
    """Unite parts of the same label, take the forbidden cells away, cover the rest by boxes."""
    groups: dict[tuple[int, Interval], list[_Candidate]] = {}
    for part in parts:
        groups.setdefault((part.label, part.came_with), []).append(part)
    found = []
    for (label, came_with), members in groups.items():
        touched = [problem.lattice.touched(*range_x(m.lon), *range_x(m.lat)) for m in members]
        i0, i1 = min(b[0] for b in touched), max(b[1] for b in touched)
        j0, j1 = min(b[2] for b in touched), max(b[3] for b in touched)
        if i0 >= i1 or j0 >= j1:
            continue
        window = np.zeros((i1 - i0, j1 - j0), dtype=np.bool_)
        for a, b, c, d in touched:
            window[a - i0 : b - i0, c - j0 : d - j0] = True
        contested[i0:i1, j0:j1] |= window
        window &= ~problem.forbidden[k][i0:i1, j0:j1]
        for a, b, c, d in _cover(window, problem.tight):
            box = (a + i0, b + i0, c + j0, d + j0)
            candidate = _joined(problem, box, members, touched)
            if candidate is not None:
                lon, lat, parents = candidate
                found.append(_Candidate(lon, lat, label, came_with, parents))
    return found


def _cover(window: Mask, tight: bool) -> list[Box]:
    """Boxes over the cells of a window.

    They are as long as possible along the lane: few, but what got far ahead and what got far aside
    then share a box, which holds all pairs of what they do along and across the lane. If `tight`,
    they are as wide as possible across the lane, cover no cell that is not in the window, and end
    wherever its width changes, as behind a gap.
    """
    if tight:
        return boxes(window, along_s=False)
    return boxes(window, min(COVER_TOLERANCE, len(window) // EXACT_BELOW))


def _joined(
    problem: Problem, box: Box, members: list[_Candidate], touched: list[Box]
) -> tuple[Polygon, Polygon, tuple[int, ...]] | None:
    """The hull of all that lies in one box, and whose parents it has."""
    i0, i1, j0, j1 = box
    s_low, s_high, d_low, d_high = problem.lattice.bounds(box)
    lons: list[Polygon] = []
    lats: list[Polygon] = []
    parents: list[int] = []
    for member, (a, b, c, d) in zip(members, touched, strict=True):
        if a >= i1 or b <= i0 or c >= j1 or d <= j0:
            continue
        lon = cut_x(member.lon, s_low, s_high)
        lat = cut_x(member.lat, d_low, d_high) if lon else []
        if lat:
            lons.append(lon)
            lats.append(lat)
            parents.extend(member.parents)
    if not lons:
        return None
    if len(lons) == 1:
        return lons[0], lats[0], tuple(parents)
    return joined(lons), joined(lats), tuple(sorted(set(parents)))


def _read(problem: Problem, candidate: _Candidate, k: int) -> list[BaseSet]:
    """Read letter k: the parts in which a move of the automaton is possible."""
    last = k == problem.horizon
    found = []
    for move in (problem.moves.final if last else problem.moves.moves)[candidate.label]:
        if last:
            # The acceleration of the last letter is that of the last interval.
            low = max(move.inputs[0], candidate.came_with[0])
            if low > min(move.inputs[1], candidate.came_with[1]):
                continue
        elif move.target not in problem.moves.live[problem.horizon - k]:
            continue
        for lon, lat in _where(problem, move, candidate, k):
            found.append(BaseSet(lon, lat, move.target, move.inputs, candidate.parents))
    return found


def _where(
    problem: Problem, move: Move, candidate: _Candidate, k: int
) -> list[tuple[Polygon, Polygon]]:
    """The parts of a candidate in which all literals of a move may hold."""
    parts = [(candidate.lon, candidate.lat)]
    for atom, truth in move.literals:
        parts = [
            cell
            for lon, lat in parts
            for cell in _restricted(lon, lat, problem.answers[atom](truth, k, lon, lat))
        ]
    return parts


def _restricted(lon: Polygon, lat: Polygon, region: Region) -> list[tuple[Polygon, Polygon]]:
    parts = [(lon, lat)]
    for union in region:
        remaining = []
        for lon_part, lat_part in parts:
            for piece in union:
                s_low, s_high, d_low, d_high = piece.box
                new_lat = cut_x(lat_part, d_low, d_high)
                new_lon = cut_x(lon_part, s_low, s_high) if new_lat else []
                for a, b, c in piece.cuts:
                    if not new_lon:
                        break
                    new_lon = cut(new_lon, a, b, c)
                if new_lon:
                    remaining.append((new_lon, new_lat))
        parts = remaining
    return parts
