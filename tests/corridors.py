"""Driving corridors made by hand, for tests of what plans inside them."""

from __future__ import annotations

from collections.abc import Sequence

from sandra.reach.lattice import Lattice
from sandra.reach.polygon import Polygon
from sandra.reach.sets import BaseSet, ReachableSet

LATTICE = Lattice(0.0, 0.0, 1.0, 1.0, 1, 1)
"""Of no meaning here: plans read the base sets alone."""
Range = tuple[float, float]


def box(x: Range, y: Range) -> Polygon:
    """A rectangle, counter-clockwise."""
    return [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]


def base(
    s: Range = (-100.0, 100.0),
    v: Range = (0.0, 50.0),
    d: Range = (-1.0, 1.0),
    a: Range = (-6.0, 6.0),
    parents: tuple[int, ...] = (0,),
    v_d: Range = (-5.0, 5.0),
) -> BaseSet:
    """One base set; s, d [m], v, v_d [m/s], a [m/s^2]."""
    return BaseSet(box(s, v), box(d, v_d), 0, a, parents)


def corridor(*steps: BaseSet | Sequence[BaseSet]) -> ReachableSet:
    """One base set, or several, for each step."""
    found = tuple((x,) if isinstance(x, BaseSet) else tuple(x) for x in steps)
    return ReachableSet(found, len(found) - 1, LATTICE)


def wide(horizon: int, a: Range = (-6.0, 6.0), **ranges: Range) -> ReachableSet:
    """The same wide base set at every step."""
    return corridor(*[base(a=a, **ranges) for _ in range(horizon + 1)])
