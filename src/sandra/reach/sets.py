"""Reachable sets: labelled base sets per step, and the driving corridor within them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from sandra.reach.lattice import Box, Lattice, Mask
from sandra.reach.moves import Interval
from sandra.reach.polygon import Polygon, contains, range_x, range_y


@dataclass(frozen=True, slots=True)
class BaseSet:
    """The product of a convex polygon in (s, v_s) and one in (d, v_d) [m, m/s].

    `label` is the class of DFA states after the letter of its step; `inputs` the range of
    longitudinal acceleration with which it goes on [m/s^2]; `parents` are indices into the
    base sets of the step before.
    """

    lon: Polygon
    lat: Polygon
    label: int
    inputs: Interval
    parents: tuple[int, ...] = ()

    @property
    def rectangle(self) -> tuple[float, float, float, float]:
        """Projection on the positions: (s_low, s_high, d_low, d_high) [m]."""
        return (*range_x(self.lon), *range_x(self.lat))

    @property
    def speeds(self) -> tuple[float, float]:
        """(lowest, highest) v_s [m/s]."""
        return range_y(self.lon)

    def contains(self, s: float, v_s: float, d: float, v_d: float) -> bool:
        """Whether the state lies in the set, up to 1e-6."""
        return contains(self.lon, s, v_s) and contains(self.lat, d, v_d)


@dataclass(frozen=True, slots=True, eq=False)
class ReachableSet:
    """Every state that a compliant, collision-free trajectory of the model can reach, and more.

    `steps[k]` are the base sets at step k = 0..h; from `first_empty_step` on there are none (then
    `steps` ends before it). `contested` marks the cells that the set would have occupied at that
    step, before forbidden cells and labels were cut away.
    """

    steps: Sequence[tuple[BaseSet, ...]]
    horizon: int
    lattice: Lattice
    contested: Mask | None = None

    @property
    def sizes(self) -> tuple[int, ...]:
        """How many base sets each step has."""
        known: tuple[int, ...] | None = getattr(self.steps, "sizes", None)
        return tuple(len(step) for step in self.steps) if known is None else known

    @property
    def first_empty_step(self) -> int | None:
        """The first step without any base set; None if there are some through the horizon."""
        first = next((k for k, size in enumerate(self.sizes) if not size), len(self.sizes))
        return None if first > self.horizon else first

    def contains(self, k: int, s: float, v_s: float, d: float, v_d: float) -> bool:
        """Whether the state lies in the set at step k."""
        return k < len(self.steps) and any(b.contains(s, v_s, d, v_d) for b in self.steps[k])

    def area(self, k: int) -> float:
        """Drivable area at step k: of the union of all positions [m^2] (exact)."""
        if k >= len(self.steps):
            return 0.0
        return _union_area([b.rectangle for b in self.steps[k]])

    def boxes(self, k: int) -> list[Box]:
        """The lattice boxes that the base sets at step k touch."""
        return [self.lattice.touched(*b.rectangle) for b in self.steps[k]]

    def corridor(self) -> ReachableSet:
        """The driving corridor: only base sets from which the horizon is reached.

        Empty from step 0 on if the set itself becomes empty.
        """
        if self.first_empty_step is not None:
            return ReachableSet((), self.horizon, self.lattice, self.contested)
        kept: list[tuple[BaseSet, ...]] = []
        wanted = set(range(len(self.steps[-1])))
        for k in range(self.horizon, -1, -1):
            order = sorted(wanted)
            kept.append(tuple(self.steps[k][i] for i in order))
            wanted = {p for i in order for p in self.steps[k][i].parents}
        kept.reverse()
        return ReachableSet(_renumbered(self.steps, kept), self.horizon, self.lattice)


def _renumbered(
    steps: Sequence[tuple[BaseSet, ...]], kept: list[tuple[BaseSet, ...]]
) -> tuple[tuple[BaseSet, ...], ...]:
    found: list[tuple[BaseSet, ...]] = []
    place: dict[int, int] = {}
    for old, new in zip(steps, kept, strict=True):
        found.append(
            tuple(
                BaseSet(
                    b.lon,
                    b.lat,
                    b.label,
                    b.inputs,
                    tuple(place[p] for p in b.parents if p in place),
                )
                for b in new
            )
        )
        index_of = {id(b): i for i, b in enumerate(new)}
        place = {i: index_of[id(b)] for i, b in enumerate(old) if id(b) in index_of}
    return tuple(found)


def _union_area(rectangles: list[tuple[float, float, float, float]]) -> float:
    """Area of a union of rectangles: a sweep along s over the intervals in d."""
    marks = sorted({r[0] for r in rectangles} | {r[1] for r in rectangles})
    total = 0.0
    for low, high in pairwise(marks):
        spans = sorted((r[2], r[3]) for r in rectangles if r[0] <= low and r[1] >= high)
        covered, end = 0.0, float("-inf")
        for a, b in spans:
            covered += max(0.0, b - max(a, end))
            end = max(end, b)
        total += covered * (high - low)
    return total
