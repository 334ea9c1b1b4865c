"""The graph on which vehicles are followed: where one can get from each lanelet by one link."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.lane_table import LaneTable
from sandra.prediction.lanes import START_ERROR, Place, Strip

Array = NDArray[np.float64]
Ints = NDArray[np.int_]
Mask = NDArray[np.bool_]

PLAIN, OWN, CUT = 0, 1, 2
"""How a vehicle came to a lanelet: OWN while it has never left the ego's lane, in which it started
behind the ego; CUT when it changed sideways into the ego's lane; PLAIN otherwise."""


@dataclass(frozen=True, slots=True)
class Rules:
    """What is assumed of one vehicle, where it starts, and the lanelets it may come to."""

    places: tuple[Place, ...]
    lateral_speed: float
    """inf: not bounded [m/s]."""
    reversing: bool
    starts_behind_ego: bool
    segments: dict[int, int]
    """Number of the segment for each lanelet (by id) that the vehicle may touch within the
    horizon."""
    ways: Array | None = None
    """(h,) way along its lane that it drives at least in each step [m]; None: 0."""


class Stretches(NamedTuple):
    """Progress m or more, y within [low, high] [m], for each node (n,), or row and node (T, n).

    m is inf where the vehicle cannot be on the node.
    """

    m: Array
    low: Array
    high: Array


class Ends(NamedTuple):
    """Links through the end of a lanelet, or back through its start.

    y of the node entered lies between y of the node left plus `lowest` and plus `highest` [m].
    """

    source: Ints
    target: Ints
    forward: Mask
    lowest: Array
    highest: Array


class Sides(NamedTuple):
    """Links to a lanelet beside; `left`: it lies to the left.

    `least` and `widest` are the bounds of its half width [m]; with `keeps_progress` the vehicle
    has as much progress there.
    """

    source: Ints
    target: Ints
    left: Mask
    least: Array
    widest: Array
    keeps_progress: Mask


@dataclass(frozen=True, slots=True, eq=False)
class LaneGraph:
    """n nodes: a lanelet, as one vehicle may use it, and how it came there."""

    segment: Ints
    lanelet: Ints
    """Number in the lane table."""
    how: Ints
    half: Array
    """Largest half width [m]."""
    stretch: Array
    """`Strip.stretch`."""
    lateral_speed: Array
    reversing: Mask
    ends: Ends
    sides: Sides
    start: Stretches
    ways: Array | None
    """(h, n) way along the lane that is driven at least in each step [m]; None: 0."""

    @staticmethod
    def of(table: LaneTable, vehicles: list[Rules], ego_lane: frozenset[int]) -> LaneGraph:
        """The nodes that can be come to from the vehicles' places, and all links between them."""
        growing = _Growing(table, ego_lane)
        for vehicle in vehicles:
            growing.add(vehicle)
        return growing.graph()


class _Growing:
    """A graph to which one vehicle after another is added."""

    def __init__(self, table: LaneTable, ego_lane: frozenset[int]) -> None:
        self.table, self.ego_lane = table, ego_lane
        self.widths = {x.id: (float(x.half.min()), float(x.half.max())) for x in table.strips}
        self.nodes: list[tuple[int, int, int, float, bool]] = []
        self.ends: list[tuple[int, int, bool, float, float]] = []
        self.sides: list[tuple[int, int, bool, float, float, bool]] = []
        self.start: list[tuple[int, float, float, float]] = []
        self.ways: list[Array | None] = []
        self._junctions: dict[tuple[int, int, bool], tuple[float, float]] = {}

    def add(self, vehicle: Rules) -> None:
        strips, segments = self.table.map.strips, vehicle.segments
        found: dict[tuple[int, int], int] = {}
        todo: list[tuple[int, int]] = []

        def node(lanelet: int, how: int) -> int:
            key = (lanelet, how)
            if key not in found:
                found[key] = len(self.nodes)
                self.ways.append(vehicle.ways)
                todo.append(key)
                self.nodes.append(
                    (
                        segments[lanelet],
                        self.table.number[lanelet],
                        how,
                        vehicle.lateral_speed,
                        vehicle.reversing,
                    )
                )
            return found[key]

        for place in vehicle.places:
            behind = vehicle.starts_behind_ego and place.lanelet in self.ego_lane
            rear = -np.inf if vehicle.reversing else place.p - START_ERROR
            start = node(place.lanelet, OWN if behind else PLAIN)
            self.start.append((start, rear, place.y - START_ERROR, place.y + START_ERROR))
        for lanelet, how in todo:
            source, strip = found[lanelet, how], strips[lanelet]
            for forward in (True, False) if vehicle.reversing else (True,):
                for i in strip.successors if forward else strip.predecessors:
                    if i in segments:
                        # Along the lane: what began in the ego's lane goes on so while it stays.
                        target = node(i, how if i in self.ego_lane else PLAIN)
                        shift = self._junction(strip, strips[i], forward)
                        self.ends.append((source, target, forward, *shift))
            for beside, left in ((strip.left_id, True), (strip.right_id, False)):
                if beside is not None and beside in segments:
                    keeps = beside in strip.shared and not vehicle.reversing
                    target = node(beside, self._sideways(lanelet, how, beside))
                    self.sides.append((source, target, left, *self.widths[beside], keeps))

    def graph(self) -> LaneGraph:
        segment, lanelet, how, lateral, reversing = zip(*self.nodes, strict=True)
        strips = [self.table.strips[i] for i in lanelet]
        start = Stretches(*(np.full(len(segment), x) for x in (np.inf, np.inf, -np.inf)))
        for node, *bounds in self.start:
            start.m[node], start.low[node], start.high[node] = bounds
        return LaneGraph(
            np.array(segment),
            np.array(lanelet),
            np.array(how),
            np.array([self.widths[x.id][1] for x in strips]),
            np.array([x.stretch for x in strips]),
            np.array(lateral),
            np.array(reversing),
            Ends(
                _ints(x[0] for x in self.ends),
                _ints(x[1] for x in self.ends),
                np.array([x[2] for x in self.ends], dtype=bool),
                np.array([x[3] for x in self.ends], dtype=float),
                np.array([x[4] for x in self.ends], dtype=float),
            ),
            Sides(
                _ints(x[0] for x in self.sides),
                _ints(x[1] for x in self.sides),
                np.array([x[2] for x in self.sides], dtype=bool),
                np.array([x[3] for x in self.sides], dtype=float),
                np.array([x[4] for x in self.sides], dtype=float),
                np.array([x[5] for x in self.sides], dtype=bool),
            ),
            start,
            self._ways(),
        )

    def _ways(self) -> Array | None:
        known = next((x for x in self.ways if x is not None), None)
        if known is None:
            return None
        return np.stack([np.zeros_like(known) if x is None else x for x in self.ways], axis=1)

    def _junction(self, strip: Strip, other: Strip, forward: bool) -> tuple[float, float]:
        """Bounds of the change of y on entering the next lanelet (or the one before)."""
        key = (strip.id, other.id, forward)
        if key not in self._junctions:
            end, begin = (-1, 0) if forward else (0, -1)
            gap = strip.centre[end] - other.centre[begin]
            shift = float(gap @ other.across[begin])
            turn = abs(float(strip.across[end] @ other.across[begin]))
            meet = turn >= 0.99 and float(np.hypot(*gap)) <= float(strip.half[end])
            # Where the cross-sections do not meet edge to edge, nothing is known of y.
            self._junctions[key] = (
                (shift - START_ERROR, shift + START_ERROR) if meet else (-np.inf, np.inf)
            )
        return self._junctions[key]

    def _sideways(self, lanelet: int, how: int, other: int) -> int:
        if other not in self.ego_lane:
            return PLAIN
        return how if lanelet in self.ego_lane else CUT


def _ints(values: Iterable[int]) -> Ints:
    return np.array(list(values), dtype=int)
