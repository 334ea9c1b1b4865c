"""The kernel on problems made by hand: closed bounds, forbidden cells, parents."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
import pytest

from sandra.reach import Lattice, Piece, Problem, ReachableSet, twin
from sandra.reach.kernel import _restricted, reachable_set
from sandra.reach.moves import UNBOUNDED, Interval, Move, Moves
from sandra.reach.polygon import range_x, range_y
from sandra.reach.problem import Region

DT = 0.5
LATTICE = Lattice(0.0, -2.0, 0.5, 0.25, 40, 16)


def moves(
    horizon: int, inputs: Interval, final: Sequence[Interval] | None = None, literals: tuple = ()
) -> Moves:
    """One class: any number of letters with `inputs`, then one with an acceleration in `final`."""
    step = Move(0, literals, inputs)
    last = tuple(Move(-1, literals, interval) for interval in (final or (inputs,)))
    live = (frozenset[int](), *[frozenset({0})] * (horizon + 1))
    return Moves(0, ((step,),), (last,), live)


def problem(horizon: int = 2, inputs: Interval = (-1.0, 1.0), **changes: object) -> Problem:
    free = np.zeros((LATTICE.columns, LATTICE.rows), dtype=bool)
    return replace(
        Problem(
            dt=DT,
            horizon=horizon,
            lon=[(2.0, 4.0)],
            lat=[(0.0, 0.0)],
            a_lat=(0.0, 0.0),
            v_lon=(0.0, 10.0),
            v_lat=(-5.0, 5.0),
            lattice=LATTICE,
            forbidden=(free,) * (horizon + 1),
            moves=moves(horizon, inputs),
            answers=(),
        ),
        **changes,
    )


def speeds(found: ReachableSet, k: int) -> tuple[float, float]:
    return min(b.speeds[0] for b in found.steps[k]), max(b.speeds[1] for b in found.steps[k])


# ------------------------------------------------------------------ motion and letters


def test_free_motion() -> None:
    found = reachable_set(problem())
    assert found.first_empty_step is None
    for k, (one,) in enumerate(found.steps):
        t = k * DT
        s_low, s_high, d_low, d_high = one.rectangle
        assert (s_low, s_high) == pytest.approx((2 + 4 * t - t * t / 2, 2 + 4 * t + t * t / 2))
        assert (d_low, d_high) == (0.0, 0.0)
        assert one.speeds == pytest.approx((4 - t, 4 + t))
        assert one.parents == (() if k == 0 else (0,))


@pytest.mark.parametrize("a", [0.0, 1.0, -0.5])
def test_a_single_admissible_input_is_enough(a: float) -> None:
    found = reachable_set(problem(inputs=(a, a)))
    assert found.first_empty_step is None
    ((lon,), (lat,)) = found.steps[2][0].lon, found.steps[2][0].lat
    assert lon == pytest.approx((2.0 + 4.0 + a / 2, 4.0 + a))
    assert lat == (0.0, 0.0)


@pytest.mark.parametrize(
    ("final", "empty"),
    [((1.0, 3.0), None), ((-3.0, -1.0), None), ((1.5, 3.0), 2), ((-3.0, -1.5), 2)],
)
def test_the_last_letter_reads_the_last_input_with_closed_bounds(
    final: Interval, empty: int | None
) -> None:
    found = reachable_set(problem(moves=moves(2, (-1.0, 1.0), [final])))
    assert found.first_empty_step == empty


def test_before_the_last_step_nothing_is_asked_of_the_input_it_came_with() -> None:
    """Sets that came with different inputs are one again; at the horizon they are told apart."""
    apart = (Move(0, (), (-2.0, -1.0)), Move(0, (), (1.0, 2.0)))
    last = (Move(-1, (), (1.0, 2.0)),)
    live = (frozenset[int](), *[frozenset({0})] * 3)
    found = reachable_set(problem(moves=Moves(0, (apart,), (last,), live)))
    assert [len(step) for step in found.steps] == [2, 2, 1]
    assert [b.inputs for b in found.steps[1]] == [(-2.0, -1.0), (1.0, 2.0)]
    assert found.steps[1][0].lon == found.steps[1][1].lon
    assert found.steps[1][0].parents == (0, 1)
    # first anything from -2 to 2 m/s^2, then 1 to 2 m/s^2
    assert speeds(found, 1) == pytest.approx((3.0, 5.0))
    assert speeds(found, 2) == pytest.approx((3.5, 6.0))
    assert found.steps[2][0].parents == (1,)


def test_a_class_from_which_acceptance_is_out_of_reach_is_left() -> None:
    dead_end = (Move(0, (), (-1.0, 1.0)), Move(1, (), (-1.0, 1.0)))
    both = Moves(0, (dead_end, ()), ((Move(-1, (), (-1.0, 1.0)),), ()), (frozenset(),) * 4)
    live = (frozenset[int](), *[frozenset({0})] * 3)
    found = reachable_set(problem(moves=replace(both, live=live)))
    assert {b.label for step in found.steps[:2] for b in step} == {0}
    assert {b.label for b in found.steps[2]} == {-1}
    nothing = reachable_set(problem(moves=replace(both, live=(frozenset(),) * 4)))
    assert nothing.first_empty_step == 0


# ------------------------------------------------------------------ speed bounds


def test_speeds_keep_to_their_bounds_along_and_across() -> None:
    found = reachable_set(
        problem(4, (-8.0, 8.0), v_lon=(3.0, 6.0), a_lat=(-4.0, 4.0), v_lat=(-0.5, 0.25))
    )
    for k in range(1, 5):
        assert speeds(found, k) == pytest.approx((3.0, 6.0))
        across = [range_y(b.lat) for b in found.steps[k]]
        assert min(a for a, _ in across) == pytest.approx(-0.5)
        assert max(b for _, b in across) == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("changes", "empty"),
    [
        ({"v_lon": (0.0, 4.0)}, None),
        ({"v_lon": (4.0, 9.0)}, None),
        ({"v_lon": (0.0, 3.5)}, 0),
        ({"v_lon": (4.5, 9.0)}, 0),
        ({"v_lat": (0.5, 1.0)}, 0),
        ({"v_lat": (-1.0, -0.5)}, 0),
        ({"v_lon": (0.0, 4.0), "inputs": (0.5, 1.0)}, 1),
        ({"a_lat": (0.5, 1.0), "v_lat": (-1.0, 0.0)}, 1),
    ],
)
def test_what_is_faster_than_allowed_is_not_there(
    changes: dict[str, object], empty: int | None
) -> None:
    found = reachable_set(problem(**changes))
    assert found.first_empty_step == empty
    assert len(found.steps) == (3 if empty is None else empty)


# ------------------------------------------------------------------ cells


def forbidding(k: int, i: slice, j: slice, horizon: int = 2) -> tuple[np.ndarray, ...]:
    masks = [np.zeros((LATTICE.columns, LATTICE.rows), dtype=bool) for _ in range(horizon + 1)]
    masks[k][i, j] = True
    return tuple(masks)


def test_forbidden_cells_part_a_set() -> None:
    """Columns 8 and 9, from 4 to 5 m, are forbidden at step 1; the set reaches 3 to 5.5 m."""
    start = [(1.5, 4.0), (3.0, 4.0)]
    found = reachable_set(
        problem(1, lon=start, forbidden=forbidding(1, slice(8, 10), slice(None), 1))
    )
    near, far = sorted(b.rectangle[:2] for b in found.steps[1])
    assert near == pytest.approx((1.5 + 2.0 - 0.125, 4.0), abs=1e-6)
    assert far == pytest.approx((5.0, 5.125), abs=1e-6)
    assert all(b.parents == (0,) for b in found.steps[1])


def test_what_is_forbidden_throughout_is_empty_and_says_where_it_would_be() -> None:
    found = reachable_set(problem(forbidden=forbidding(2, slice(None), slice(None))))
    assert found.first_empty_step == 2
    assert len(found.steps) == 2
    assert found.contested is not None
    # 5.5 to 6.5 m and d = 0, which touches two rows
    expected = np.zeros_like(found.contested)
    expected[10:14, 7:9] = True
    assert (found.contested == expected).all()
    assert reachable_set(problem()).contested is None


@pytest.mark.parametrize(
    ("lon", "lat"),
    [
        ([(-0.75, 0.0)], [(0.0, 0.0)]),
        ([(20.25, 0.0)], [(0.0, 0.0)]),
        ([(30.0, 0.0)], [(0.0, 0.0)]),
        ([(2.0, 0.0)], [(-2.25, 0.0)]),
        ([(2.0, 0.0)], [(2.25, 0.0)]),
        ([(2.0, 0.0)], [(9.0, 0.0)]),
    ],
)
def test_beyond_the_lattice_there_is_nothing(lon: list, lat: list) -> None:
    found = reachable_set(problem(lon=lon, lat=lat))
    assert found.first_empty_step == 0
    assert found.contested is not None
    assert not found.contested.any()


def test_the_ends_of_the_lattice_belong_to_it() -> None:
    for s in (0.0, 20.0):
        for d in (-2.0, 2.0):
            found = reachable_set(problem(lon=[(s, 0.0)], lat=[(d, 0.0)], inputs=(0.0, 0.0)))
            assert found.first_empty_step is None


def test_parts_that_meet_are_united_and_parts_that_do_not_are_not() -> None:
    """Three ranges of input lead to 6 m, to 6.0625 m, and, far from both, to 4 m."""
    ways = tuple(Move(0, (), (a, a)) for a in (0.0, 0.5, -16.0))
    live = (frozenset[int](), *[frozenset({0})] * 3)
    split = Moves(0, (ways,), ((Move(-1, (), UNBOUNDED),),), live)
    found = reachable_set(problem(lon=[(2.0, 8.0)], moves=split))
    parts = sorted({(b.rectangle[:2], b.parents) for b in found.steps[1]})
    assert [parents for _, parents in parts] == [(2,), (0, 1)]
    assert parts[0][0] == pytest.approx((4.0, 4.0))
    assert parts[1][0] == pytest.approx((6.0, 6.0625))
    (united, *_) = (b for b in found.steps[1] if b.parents == (0, 1))
    assert united.lon == [pytest.approx((6.0, 8.0)), pytest.approx((6.0625, 8.25))]
    # one that is wide enough reaches both
    wide = reachable_set(problem(lon=[(2.0, 8.0), (3.5, 8.0)], moves=split))
    assert {b.parents for b in wide.steps[1]} == {(0, 1, 2)}
    assert wide.steps[1][0].rectangle[:2] == pytest.approx((4.0, 7.5625))


# ------------------------------------------------------------------ literals


BOX = ([(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0)], [(-1.0, 0.0), (1.0, 0.0)])


def places(region: Region) -> np.ndarray:
    """(m, 4) s_low, s_high, d_low, d_high of each part."""
    return np.array([(*range_x(lon), *range_x(lat)) for lon, lat in _restricted(*BOX, region)])


def test_a_region_is_an_intersection_of_unions() -> None:
    left = Piece((-inf, inf, 0.0, inf))
    right = Piece((-inf, inf, -inf, -0.5))
    near, far = Piece((-inf, 1.0, -inf, inf)), Piece((3.0, inf, -inf, inf))
    assert _restricted(*BOX, ()) == [BOX]
    assert places(((left,),)) == pytest.approx(np.array([(0.0, 4.0, 0.0, 1.0)]), abs=1e-6)
    assert places(((left, right), (near, far))) == pytest.approx(
        np.array(
            [
                (0.0, 1.0, 0.0, 1.0),
                (3.0, 4.0, 0.0, 1.0),
                (0.0, 1.0, -1.0, -0.5),
                (3.0, 4.0, -1.0, -0.5),
            ]
        ),
        abs=1e-6,
    )
    assert _restricted(*BOX, ((left,), ())) == []
    assert _restricted(*BOX, ((Piece((5.0, 6.0, -inf, inf)),),)) == []
    assert _restricted(*BOX, ((Piece((-inf, inf, 1.5, 2.0)),),)) == []


def test_every_cut_of_a_piece_counts() -> None:
    some = Piece((1.0, 3.0, -inf, inf), ((0.0, 1.0, 1.0), (1.0, 1.0, 2.0)))
    ((lon, lat),) = _restricted(*BOX, ((some,),))
    assert lat == BOX[1]
    assert range_x(lon) == pytest.approx((1.0, 2.0))
    assert range_y(lon) == pytest.approx((0.0, 1.0))
    none = Piece((-inf, inf, -inf, inf), ((0.0, 1.0, -1.0), (1.0, 0.0, 9.0)))
    assert _restricted(*BOX, ((none, some),)) == [(lon, lat)]


def test_every_literal_of_a_move_counts_at_every_step() -> None:
    """One cuts along the lane from step 1 on, the other one across it."""
    asked = []

    def along(truth: bool, k: int, lon: list, lat: list) -> Region:
        asked.append(((0, truth), k))
        return ((Piece((-inf, inf if k == 0 else 4.0, -inf, inf)),),)

    def across(truth: bool, k: int, lon: list, lat: list) -> Region:
        asked.append(((1, truth), k))
        return ((Piece((-inf, inf, 0.0, inf)), Piece((-inf, inf, -inf, -1.0))),)

    found = reachable_set(
        problem(
            lat=[(-1.5, 0.0), (0.5, 0.0)],
            answers=(along, across),
            moves=moves(2, (-1.0, 1.0), literals=((0, True), (1, False))),
        )
    )
    assert set(asked) >= {((0, True), 0), ((0, True), 1), ((1, False), 0), ((1, False), 1)}
    sides = np.array(sorted(b.rectangle[2:] for b in found.steps[0]))
    assert sides == pytest.approx(np.array([(-1.5, -1.0), (0.0, 0.5)]), abs=1e-6)
    assert all(b.rectangle[1] == pytest.approx(4.0) for b in found.steps[1])
    assert found.first_empty_step == 2


def test_what_lies_next_to_a_line_touches_both_cells_but_is_only_where_it_is() -> None:
    """A state 0.1 micrometres before a line counts for the cell beyond it, and is not in it."""
    for s, empty in ((2.5 - 1e-7, 0), (2.5, None)):
        found = reachable_set(
            problem(
                1,
                (0.0, 0.0),
                lon=[(s, 0.0)],
                forbidden=forbidding(0, slice(4, 5), slice(None), 1),
            )
        )
        assert found.first_empty_step == empty


def test_speeds_of_the_start_that_are_out_of_bounds() -> None:
    """Speeds of the start beyond the bounds are cut off, those within go on."""
    start = [(2.0, -1.0), (2.0, 1.0)]
    found = reachable_set(problem(lon=start, inputs=(0.0, 0.0)))
    assert found.steps[0][0].lon == pytest.approx(np.array([(2.0, 0.0), (2.0, 1.0)]), abs=1e-8)


def test_a_trace_of_one_letter_has_no_input_to_ask_for() -> None:
    found = reachable_set(problem(0, (0.5, 1.0)))
    assert found.first_empty_step is None
    assert [b.lon for b in found.steps[0]] == [[(2.0, 4.0)]]


def test_moves_after_one_that_is_out_of_reach_count_as_well() -> None:
    """In whatever order they come: by the input at the last step, by what is live before."""
    for final in ([(2.0, 3.0), (0.0, 1.0)], [(0.0, 1.0), (2.0, 3.0)]):
        found = reachable_set(problem(moves=moves(2, (-1.0, 1.0), final)))
        assert [b.inputs for b in found.steps[2]] == [(0.0, 1.0)]
    alive, dead = Move(0, (), (-1.0, 1.0)), Move(1, (), (-1.0, 1.0))
    live = (frozenset[int](), *[frozenset({0})] * 3)
    for row in ((alive, dead), (dead, alive)):
        found = reachable_set(
            problem(moves=Moves(0, (row, ()), ((Move(-1, (), (-1.0, 1.0)),), ()), live))
        )
        assert [[b.label for b in step] for step in found.steps] == [[0], [0], [-1]]


@pytest.mark.parametrize(
    ("columns", "apart", "count"),
    [(39, 1, 2), (40, 1, 1), (79, 1, 1), (79, 2, 2), (80, 2, 1), (80, 3, 2), (160, 3, 2)],
)
def test_the_narrower_a_set_the_more_exact_is_its_cover(
    columns: int, apart: int, count: int
) -> None:
    """Two rows of cells, of which one is forbidden at its end: a box, or two."""
    lattice = Lattice(0.0, 0.0, 0.25, 0.25, 200, 2)
    forbidden = np.zeros((200, 2), dtype=bool)
    forbidden[columns - apart :, 1] = True
    end = columns * 0.25 - 0.1
    wide = problem(
        horizon=0,
        lon=[(0.1, 1.0), (end, 1.0), (end, 2.0), (0.1, 2.0)],
        lat=[(0.1, 0.0), (0.4, 0.0), (0.4, 0.1), (0.1, 0.1)],
        lattice=lattice,
        forbidden=(forbidden,),
    )
    assert [len(step) for step in reachable_set(wide).steps] == [count]
    assert [len(step) for step in twin.reachable_set(wide).steps] == [count]
