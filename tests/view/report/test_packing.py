"""Points and states as text: read back as they were, to the resolution."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandra.view.report.packing import (
    ABSENT,
    pack_frames,
    pack_rows,
    unpack_frames,
    unpack_rows,
)

SCALES = (100, 100, 1000, 100, 100)
numbers = st.floats(-1e6, 1e6)
rings = st.lists(st.tuples(numbers, numbers), max_size=5)


@given(st.lists(st.lists(rings, max_size=3), max_size=4))
def test_frames_come_back_to_half_a_centimetre(
    frames: list[list[list[tuple[float, float]]]],
) -> None:
    given_ = [[np.array(ring).reshape(-1, 2) for ring in frame] for frame in frames]
    found = unpack_frames(pack_frames(given_))
    assert [[ring.shape for ring in f] for f in found] == [[r.shape for r in f] for f in given_]
    for a, b in zip(found, given_, strict=True):
        for x, y in zip(a, b, strict=True):
            assert np.abs(x - y).max(initial=0.0) <= 0.00501


@given(st.lists(st.tuples(*[numbers | st.sampled_from([np.nan, np.inf])] * 5), max_size=6))
def test_rows_come_back_and_what_is_not_known_is_not(rows: list[tuple[float, ...]]) -> None:
    table = np.array(rows).reshape(-1, 5)
    found = unpack_rows(pack_rows(table, SCALES), SCALES)
    known = np.isfinite(table)
    assert np.array_equal(np.isfinite(found), known)
    assert np.abs(found - table)[known].max(initial=0.0) <= 0.00501


def test_what_is_farther_than_the_earth_is_large_is_drawn_there() -> None:
    assert unpack_rows(pack_rows(np.full((1, 5), 1e300), SCALES), SCALES)[0, 0] > 1e7
    assert -ABSENT > 1e9


def test_a_step_costs_about_a_byte_for_a_number() -> None:
    t = np.arange(900) / 15
    rows = np.column_stack([25 * t, 0.1 * np.sin(t), 0.01 * np.cos(t), 25 + 0 * t, 0 * t])
    assert len(pack_rows(rows, SCALES)) / rows.size == pytest.approx(1.7, abs=0.3)
