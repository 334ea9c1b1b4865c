"""The lattice and its cover by boxes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sandra.reach.lattice import Box, Lattice, Mask, boxes

masks = st.tuples(st.integers(1, 12), st.integers(1, 9)).flatmap(lambda n: arrays(np.bool_, n))


def painted(found: list[Box], shape: tuple[int, ...]) -> np.ndarray:
    count = np.zeros(shape, dtype=int)
    for i0, i1, j0, j1 in found:
        assert 0 <= i0 < i1 <= shape[0]
        assert 0 <= j0 < j1 <= shape[1]
        count[i0:i1, j0:j1] += 1
    return count


@given(masks, st.booleans())
def test_boxes_cover_the_mask_exactly_once(mask: Mask, along_s: bool) -> None:
    count = painted(boxes(mask, along_s=along_s), mask.shape)
    assert (count == mask).all()


@given(masks, st.integers(1, 3), st.booleans())
def test_boxes_only_grow(mask: Mask, tolerance: int, along_s: bool) -> None:
    count = painted(boxes(mask, tolerance, grow=True, along_s=along_s), mask.shape)
    assert (count[mask] > 0).all()
    # by no more than the tolerance along the lines
    lines, wide = (mask.T, count.T) if along_s else (mask, count)
    for line, got in zip(lines, wide, strict=True):
        near = np.convolve(line, np.ones(4 * tolerance + 1), "same") > 0
        near = near[: len(line)] if len(near) == len(line) else np.ones_like(line)
        assert (near | (got == 0)).all()


@given(masks, st.integers(1, 3), st.booleans())
def test_boxes_only_shrink(mask: Mask, tolerance: int, along_s: bool) -> None:
    count = painted(boxes(mask, tolerance, grow=False, along_s=along_s), mask.shape)
    assert (count[~mask] == 0).all()


def test_boxes_unite_equal_rows() -> None:
    mask = np.zeros((6, 4), dtype=bool)
    mask[1:4, :] = True
    assert boxes(mask) == [(1, 4, 0, 4)]
    mask[4, 2] = True
    assert len(boxes(mask)) == 3
    assert boxes(mask, tolerance=1) == [(1, 5, 0, 4)]
    assert boxes(mask, tolerance=1, grow=False) == [(1, 4, 0, 4)]
    assert boxes(np.zeros((3, 3), dtype=bool)) == []


def test_a_staircase_does_not_drift_away() -> None:
    mask = np.array([[i <= j for j in range(12)] for i in range(20)])
    for i0, i1, j0, j1 in boxes(mask, tolerance=1):
        assert (mask[i0:i1, j0:j1].sum(axis=0) >= (i1 - i0) - 2).all()


@given(
    st.floats(-100, 100),
    st.floats(0, 80),
    st.floats(-20, 20),
    st.floats(0, 15),
    st.sampled_from([(0.5, 0.2), (0.25, 0.1), (1.0, 0.3)]),
)
def test_around_covers_both_ranges(
    s: float, length: float, d: float, width: float, cell: tuple[float, float]
) -> None:
    lattice = Lattice.around((s, s + length), (d, d + width), *cell)
    low_s, high_s, low_d, high_d = lattice.bounds((0, lattice.columns, 0, lattice.rows))
    assert low_s <= s + 1e-9
    assert high_s >= s + length - 1e-9
    assert low_d <= d + 1e-9
    assert high_d >= d + width - 1e-9
    assert (high_s - low_s) - length <= 2 * cell[0] + 1e-9
    lines_s, lines_d = lattice.corners()
    assert len(lines_s) == lattice.columns + 1
    assert len(lines_d) == lattice.rows + 1
    middle_s, middle_d = lattice.centers()
    assert np.allclose(middle_s, (lines_s[1:] + lines_s[:-1]) / 2)
    assert np.allclose(middle_d, (lines_d[1:] + lines_d[:-1]) / 2)


@given(st.floats(-5, 25), st.floats(0, 10), st.floats(-8, 8), st.floats(0, 5))
def test_touched_rounds_outwards(s: float, length: float, d: float, width: float) -> None:
    lattice = Lattice.around((0.0, 20.0), (-5.0, 5.0), 0.5, 0.2)
    i0, i1, j0, j1 = lattice.touched(s, s + length, d, d + width)
    assert i0 >= 0
    assert i1 <= lattice.columns
    lines_s, lines_d = lattice.corners()
    for i in range(lattice.columns):
        if lines_s[i + 1] >= s and lines_s[i] <= s + length:
            assert i0 <= i < i1
        elif lines_s[i + 1] < s - 0.5 or lines_s[i] > s + length + 0.5:
            assert not i0 <= i < i1
    for j in range(lattice.rows):
        if lines_d[j + 1] >= d and lines_d[j] <= d + width:
            assert j0 <= j < j1


def test_a_point_on_a_line_touches_both_cells() -> None:
    lattice = Lattice.around((0.0, 10.0), (-1.0, 1.0), 0.5, 0.2)
    i0, i1, j0, j1 = lattice.touched(2.0, 2.0, 0.2, 0.2)
    assert (i0, i1) == (3, 5)
    assert (j0, j1) == (5, 7)


def test_rows_are_united_up_to_the_tolerance_at_both_ends() -> None:
    """Runs that begin, or end, by so many cells apart; one more, and they are two boxes."""
    for tolerance in (0, 1, 2):
        for apart, count in ((tolerance, 1), (tolerance + 1, 2)):
            mask = np.zeros((12, 2), dtype=bool)
            mask[4:8, 0] = True
            mask[4 - apart : 8, 1] = True
            assert len(boxes(mask, tolerance)) == count
            mask[:, 1] = False
            mask[4 : 8 + apart, 1] = True
            assert len(boxes(mask, tolerance)) == count


def test_two_runs_in_a_row_are_two_boxes() -> None:
    mask = np.zeros((9, 3), dtype=bool)
    mask[1:3, 0:2] = True
    mask[5:8, 0:2] = True
    assert boxes(mask) == [(1, 3, 0, 2), (5, 8, 0, 2)]
    assert boxes(mask, along_s=False) == [(1, 3, 0, 2), (5, 8, 0, 2)]
    mask[8, 2] = True
    assert boxes(mask) == [(1, 3, 0, 2), (5, 8, 0, 2), (8, 9, 2, 3)]


def test_rows_that_do_not_follow_each_other_are_apart() -> None:
    mask = np.zeros((4, 7), dtype=bool)
    mask[1:3, [1, 2, 4, 6]] = True
    assert boxes(mask, 2) == [(1, 3, 1, 3), (1, 3, 4, 5), (1, 3, 6, 7)]


def test_rows_that_share_nothing_leave_no_box_within() -> None:
    """With a tolerance as large as the runs themselves their common part is empty."""
    mask = np.zeros((4, 2), dtype=bool)
    mask[0, 0] = mask[1, 1] = True
    assert boxes(mask, 1, grow=False) == []
    assert boxes(mask, 1, grow=True) == [(0, 2, 0, 2)]
    mask[:, :] = False
    mask[0, 0] = mask[2, 1] = True
    assert boxes(mask, 2, grow=False) == []


def test_a_lattice_has_at_least_one_cell() -> None:
    assert Lattice.around((2.0, 2.0), (-0.5, -0.5), 0.5, 0.25) == Lattice(
        2.0, -0.5, 0.5, 0.25, 1, 1
    )
    assert Lattice.around((1.9, 3.1), (-0.6, 0.3), 0.5, 0.25) == Lattice(
        1.5, -0.75, 0.5, 0.25, 4, 5
    )


def test_places_of_a_lattice() -> None:
    lattice = Lattice(2.0, -1.0, 0.5, 0.25, 4, 3)
    assert lattice.bounds((1, 3, 0, 2)) == (2.5, 3.5, -1.0, -0.5)
    s, d = lattice.corners()
    assert s.tolist() == [2.0, 2.5, 3.0, 3.5, 4.0]
    assert d.tolist() == [-1.0, -0.75, -0.5, -0.25]
    s, d = lattice.centers()
    assert s.tolist() == [2.25, 2.75, 3.25, 3.75]
    assert d.tolist() == [-0.875, -0.625, -0.375]
    # a line touches the cells on both sides, within a millionth of a cell; the lattice is the end
    assert lattice.touched(2.5, 3.0, -0.75, -0.5) == (0, 3, 0, 3)
    assert lattice.touched(2.5 + 1e-6, 3.0 - 1e-6, -0.75 + 1e-6, -0.5 - 1e-6) == (1, 2, 1, 2)
    assert lattice.touched(2.5 + 4e-7, 3.0 - 4e-7, -0.75 + 2e-7, -0.5 - 2e-7) == (0, 3, 0, 3)
    assert lattice.touched(-9.0, 9.0, -9.0, 9.0) == (0, 4, 0, 3)


@pytest.mark.parametrize("away", [0.3, 1.0, 7.0])
def test_what_lies_beside_the_lattice_touches_no_cell(away: float) -> None:
    lattice = Lattice(2.0, -1.0, 0.5, 0.25, 4, 3)
    low, high = (2.0 - away, 2.0 - away), (4.0 + away, 4.0 + away)
    down, up = (-1.0 - away, -1.0 - away), (-0.25 + away, -0.25 + away)
    for s, d in [(low, (-0.9, -0.8)), (high, (-0.9, -0.8)), ((2.1, 2.2), down), ((2.1, 2.2), up)]:
        i0, i1, j0, j1 = lattice.touched(*s, *d)
        assert i0 >= i1 or j0 >= j1
        assert min(i0, i1, j0, j1) >= 0
