"""What the kernel is given, free of maps and formulas: polygons, masks, pieces and moves."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from sandra.reach.lattice import Lattice, Mask
from sandra.reach.moves import Interval, Moves
from sandra.reach.polygon import Polygon

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Piece:
    """A part of the state space in which a literal may hold.

    `box` = (s_low, s_high, d_low, d_high) [m], infinite where unbounded; `cuts` are half-planes
    (a, b, c): a s + b v_s <= c.
    """

    box: tuple[float, float, float, float]
    cuts: tuple[tuple[float, float, float], ...] = ()


Union = tuple[Piece, ...]
"""The union of its pieces."""

Region = tuple[Union, ...]
"""An intersection of unions; no unions at all: everywhere."""

Answer = Callable[[bool, int, Polygon, Polygon], Region]
"""(truth, step, (s, v_s) polygon, (d, v_d) polygon) -> where, within these polygons, an atom may
have that truth. Over-approximates: a state outside of it has the other truth for sure."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One reachability problem: method, Sec. "Reachable set".

    `lon` (s, v_s) and `lat` (d, v_d) are the initial polygons [m, m/s]. `forbidden[k]` marks
    cells in which the body collides for sure at step k, wherever in the cell its centre is.
    `answers[i]` tells where atom i, of which the moves' literals speak, may hold.
    """

    dt: float
    horizon: int
    lon: Polygon
    lat: Polygon
    a_lat: Interval
    v_lon: Interval
    v_lat: Interval
    lattice: Lattice
    forbidden: Sequence[Mask]
    moves: Moves
    answers: tuple[Answer, ...]
    tight: bool = False
    """Follow the true set more closely, at a price; see `sandra.settings.Settings.precision`."""

    def until_the_last_letter(self) -> Hashable:
        """All that decides the steps before the last one."""
        rows = tuple(
            tuple(
                (m.target, m.inputs, tuple((id(self.answers[i]), truth) for i, truth in m.literals))
                for m in row
            )
            for row in self.moves.moves
        )
        bounds = self.dt, self.horizon, self.a_lat, self.v_lon, self.v_lat, self.tight
        start = tuple(self.lon), tuple(self.lat), self.moves.initial
        return rows, self.moves.live, bounds, start, self.lattice, id(self.forbidden)


def in_groups(
    problems: Sequence[Problem], computed: Callable[[list[Problem]], Sequence[T]]
) -> list[T]:
    """What `computed` finds for each problem; it is given those that are alike together."""
    found: dict[int, T] = {}
    for group in alike(problems):
        found.update(zip(group, computed([problems[i] for i in group]), strict=True))
    return [found[i] for i in range(len(problems))]


def alike(problems: Sequence[Problem]) -> list[list[int]]:
    """Indices of problems, together where they differ in nothing but the last letter."""
    groups: dict[Hashable, list[int]] = {}
    for i, problem in enumerate(problems):
        groups.setdefault(problem.until_the_last_letter(), []).append(i)
    return list(groups.values())
