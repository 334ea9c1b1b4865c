"""Links between lanelets: what is known of y across a junction; the first cell of a map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from prediction.traffic import lanelet, line
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.lane_graph import CUT, OWN, PLAIN, LaneGraph, Rules, _Growing
from sandra.prediction.lane_sets import follow
from sandra.prediction.lane_table import LaneTable
from sandra.prediction.lanes import START_ERROR, Place
from sandra.prediction.pieces import Entries, Pieces
from sandra.prediction.touched import Touched
from sandra.scene.types import Lanelet

NONE = frozenset[int]()


def graph_of(table: LaneTable, start: int, lateral: float, reversing: bool) -> LaneGraph:
    """The graph of one vehicle on the middle of a lanelet."""
    segments = {x.id: i for i, x in enumerate(table.strips)}
    place = Place(start, 0.0, 0.0, 0.0, 0.0)
    return LaneGraph.of(table, [Rules((place,), lateral, reversing, False, segments)], NONE)


def joined(shift: float, turn: float = 0.0) -> LaneTable:
    """A lanelet, and one that begins at its end, `shift` to the left, with a slanted border."""
    a = lanelet(1, line(0.0, 0.0, 40.0), line(3.5, 0.0, 40.0), successors=(2,))
    right, left = line(shift, 40.0, 80.0), line(shift + 3.5, 40.0, 80.0)
    slant = 1.75 * np.tan(turn)
    right[0, 0] += slant
    left[0, 0] -= slant
    return LaneTable.of(build_map((a, lanelet(2, right, left, predecessors=(1,))), 0.0))


def test_y_goes_on_where_cross_sections_meet() -> None:
    """Up to half a lane beside each other; from there on nothing is known of it."""
    for shift, known in ((0.0, True), (1.0, True), (1.75, True), (1.76, False), (-1.75, True)):
        ends = graph_of(joined(shift), 1, 4.0, False).ends
        if known:
            assert ends.lowest[0] == pytest.approx(-shift - START_ERROR)
            assert ends.highest[0] == pytest.approx(-shift + START_ERROR)
        else:
            assert (ends.lowest[0], ends.highest[0]) == (-np.inf, np.inf)
    for turn, known in ((0.1, True), (0.2, False)):
        ends = graph_of(joined(0.0, turn), 1, 4.0, False).ends
        assert (ends.highest[0] < np.inf) == known
    back = graph_of(joined(1.0), 2, 4.0, True).ends
    backward = np.flatnonzero(~back.forward)
    assert back.lowest[backward] == pytest.approx(1.0 - START_ERROR)


def test_cross_sections_exactly_at_the_limit_meet() -> None:
    first, second = joined(0.0).strips
    slanted = replace(first, across=np.tile([np.sqrt(1 - 0.99**2), 0.99], (len(first.s), 1)))
    growing = _Growing(joined(0.0), NONE)
    assert growing._junction(slanted, second, True)[1] == pytest.approx(START_ERROR)
    more = replace(slanted, across=slanted.across * (1 - 1e-9))
    assert _Growing(joined(0.0), NONE)._junction(more, second, True) == (-np.inf, np.inf)


def two_roads() -> tuple[Lanelet, ...]:
    """Lanelet 1 comes first in the map; 2 leads to it, 3 is to its left."""
    return (
        lanelet(1, line(0.0, 0.0, 40.0), line(3.5, 0.0, 40.0), predecessors=(2,),
                adjacent_left=(3, True)),
        lanelet(2, line(0.0, -40.0, 0.0), line(3.5, -40.0, 0.0), successors=(1,)),
        lanelet(3, line(3.5, 0.0, 40.0), line(7.0, 0.0, 40.0), predecessors=(2,),
                adjacent_right=(1, True)),
    )  # fmt: skip


def reached(table: LaneTable, graph: LaneGraph, cells: dict[int, tuple[int, int]]) -> set[int]:
    """The lanelets on which the vehicle may be during one step, if it touches these cells."""
    first = np.full((3, len(table.strips)), 1 << 30)
    last = np.full((3, len(table.strips)), -1)
    for i, (a, b) in cells.items():
        number = table.number[i]
        first[:, number], last[:, number] = table.cell[number] + a, table.cell[number] + b
    found = follow(table, graph, first, last, 0.1)
    return {table.strips[graph.lanelet[n]].id for n in np.flatnonzero(found.m[2] < np.inf)}


def test_the_first_cell_of_the_map_can_be_left_like_any_other() -> None:
    """Who touches no other cell of the first lanelet may go back from it, or to the side."""
    table = LaneTable.of(build_map(two_roads(), 0.0))
    everywhere = {2: (0, 20), 3: (0, 20)}
    graph = graph_of(table, 1, np.inf, True)
    assert reached(table, graph, {1: (0, 0), **everywhere}) == {1, 2, 3}
    assert reached(table, graph, {1: (0, 0), 2: (0, 20)}) == {1, 2}
    graph = graph_of(table, 1, np.inf, False)
    assert reached(table, graph, {1: (0, 0), **everywhere}) == {1, 3}
    # Who cannot be in the first cell cannot go back through it.
    graph = graph_of(table, 1, 0.0, True)
    assert reached(table, graph, {1: (1, 5), **everywhere}) == {1}
    assert reached(table, graph, {1: (0, 5), **everywhere}) == {1, 2}


def test_exactly_as_far_from_the_border_as_positions_are_wrong_it_may_be_crossed() -> None:
    """A lane that is 0.1 m wide at its beginning, so that all numbers are exact."""
    right, left = line(0.0, 0.0, 40.0), line(3.5, 0.0, 40.0)
    left[0, 1] = 0.1
    one = lanelet(1, right, left, predecessors=(9,), adjacent_left=(3, True))
    above = left + np.array([0.0, 3.5])
    three = lanelet(3, left, above, predecessors=(9,), adjacent_right=(1, True))
    nine = lanelet(9, line(0.0, 500.0, 520.0), line(3.5, 500.0, 520.0))
    table = LaneTable.of(build_map((one, three, nine), 0.0))
    assert table.strips[0].half.min() == 0.05
    graph = graph_of(table, 1, 0.0, False)
    for high, crosses in ((0.05 - START_ERROR, True), (-0.0501, False)):
        highs = np.where(graph.start.m < np.inf, high, -np.inf)
        start = replace(graph, start=graph.start._replace(high=highs))
        assert (3 in reached(table, start, {1: (0, 5), 3: (0, 5)})) == crosses


def test_progress_up_to_the_end_of_a_slice_is_on_it() -> None:
    """And nothing is left out in the first row that is wanted."""
    table = LaneTable.of(build_map(two_roads(), 0.0))
    count = len(table.slices)
    touched = Touched(
        ({},), np.zeros(0, int), np.zeros((3, 0), int), np.zeros((3, 0), int),
        np.ones((1, 3, count), dtype=bool), np.zeros((1, 16, count)),
        np.ones((1, len(table.cells)), dtype=bool),
    )  # fmt: skip
    own = table.slices[: table.slice[1]]
    end = own[-1].ahead
    for m, found in ((end, 1), (np.nextafter(end, np.inf), 0), (own[0].ahead, len(own))):
        for row, wanted in ((1, False), (2, True)):
            entries = Entries(
                *(np.array([x]) for x in (0, row, 0)), *(np.array([x]) for x in (m, -1.0, 1.0))
            )
            pieces = Pieces.of(table, touched, entries, np.array([2]))
            assert len(pieces.slice) == found * wanted
            assert (pieces.bounds[:, 1:] - pieces.bounds[:, 1:].mean(axis=1)[:, None]) == (
                pytest.approx(np.tile([-1.0, 1.0], (len(pieces.slice), 1)))
            )


def test_how_a_vehicle_came_to_the_egos_lane_is_marked() -> None:
    """The ego is on lanelet 3, or on 1 and 2."""
    table = LaneTable.of(build_map(two_roads(), 0.0))
    segments = {x.id: i for i, x in enumerate(table.strips)}

    def nodes(start: int, behind: bool, ego_lane: set[int]) -> set[tuple[int, int]]:
        place = Place(start, 0.0, 0.0, 0.0, 0.0)
        rules = Rules((place,), 4.0, False, behind, segments)
        graph = LaneGraph.of(table, [rules], frozenset(ego_lane))
        pairs = zip(graph.lanelet.tolist(), graph.how.tolist(), strict=True)
        return {(table.strips[i].id, how) for i, how in pairs}

    assert len(nodes(3, True, {3})) == 3
    assert nodes(1, False, {3}) == {(1, PLAIN), (3, CUT)}
    assert nodes(3, False, {3}) == {(1, PLAIN), (3, CUT), (3, PLAIN)}
    # Who leaves the ego's lane and comes back has changed into it.
    assert nodes(3, True, {3}) == {(1, PLAIN), (3, CUT), (3, OWN)}
    # Along the lane it stays what it was; by a lane that leads into it, it is not marked.
    assert nodes(2, True, {1, 2}) == {(2, OWN), (1, OWN), (3, PLAIN), (1, CUT)}
    assert nodes(2, True, {1}) == {(2, PLAIN), (1, PLAIN), (3, PLAIN), (1, CUT)}
