"""What bounded acceleration and speed allow, at the limits of the formulas."""

from __future__ import annotations

import numpy as np
import pytest

from sandra.prediction.geometry import directions
from sandra.prediction.motion import (
    MARGIN,
    Bounds,
    bodies,
    circumscribed,
    heading_change,
    position_offsets,
    travelled,
)
from sandra.scene.types import Region, State

TIMES = np.array([0.0, 0.5, 1.0, 4.0])


def test_way_is_that_of_full_acceleration_up_to_the_speed_limit() -> None:
    """From 10 m/s with 5 m/s^2: 20 m/s after 2 s and 30 m, then 20 m/s."""
    assert travelled(np.array(10.0), 5.0, 20.0, TIMES) == pytest.approx([0.0, 5.625, 12.5, 70.0])
    # Backwards first, against the direction that is looked at.
    assert travelled(np.array(-10.0), 5.0, 20.0, TIMES) == pytest.approx([0.0, -4.375, -7.5, 0.0])


def test_without_acceleration_the_speed_stays() -> None:
    for limit in (10.0, 50.0):
        assert travelled(np.array(10.0), 0.0, limit, TIMES) == pytest.approx(10.0 * TIMES)


def test_position_is_bounded_in_every_direction_by_its_own_component() -> None:
    normals = directions(4)
    state = State(3.0, -2.0, 0.0, 10.0)
    found = position_offsets(state, Bounds(5.0, 20.0, 10.0), np.array([1.0]), normals)
    assert found[0] == pytest.approx([3.0 + 12.5, -2.0 + 2.5, -3.0 - 7.5, 2.0 + 2.5])
    # A speed that is not known may be the greatest one at once, in any direction.
    found = position_offsets(state, Bounds(5.0, 20.0, None), np.array([1.0]), normals)
    assert found[0] == pytest.approx([3.0 + 20.0, -2.0 + 20.0, -3.0 + 20.0, 2.0 + 20.0])


def test_nobody_turns_in_no_time() -> None:
    for speed in (None, 0.0, 10.0):
        for radius in (0.0, 5.0):
            assert heading_change(Bounds(5.0, 20.0, speed, radius), TIMES)[0] == 0.0


def test_what_turns_on_the_spot_may_have_any_heading_at_once() -> None:
    for speed in (None, 0.0, 100.0):
        turned = heading_change(Bounds(5.0, 200.0, speed, 0.0), TIMES)
        assert (turned[1:] == np.pi).all()


def test_turning_needs_way() -> None:
    """From standstill 1/2 a t^2; where the speed is not known, v_max t; never more than pi."""
    from_rest = heading_change(Bounds(4.0, 20.0, 0.0, 5.0), TIMES)
    assert from_rest == pytest.approx([0.0, 0.1, 0.4, np.pi])
    unknown = heading_change(Bounds(4.0, 2.0, None, 5.0), TIMES)
    assert unknown == pytest.approx([0.0, 0.2, 0.4, 1.6])
    assert heading_change(Bounds(4.0, 20.0, None, 5.0), TIMES)[-1] == np.pi


def test_velocity_turns_by_no_more_than_the_acceleration_allows() -> None:
    """asin(a t / v) and the slip angle; once the speed can be 0, velocity may have any direction.

    A turning radius this small leaves the other bound without effect.
    """
    bounds = Bounds(5.0, 20.0, 5.0, 0.1, 0.05)
    times = np.array([0.0, 0.5, 0.999, 1.0, 1.001])
    turned = heading_change(bounds, times)
    assert turned[1:3] == pytest.approx(np.arcsin(times[1:3]) + 0.05)
    assert (turned[3:] == np.pi).all()
    backwards = heading_change(Bounds(5.0, 20.0, -5.0, 0.1, 0.05), times)
    assert backwards == pytest.approx(turned)


def test_body_at_every_heading() -> None:
    """The polygon holds the body at all headings, and touches it where it does not turn."""
    outline = Region(Region.rectangle(4.0, 2.0).vertices + np.array([1.0, 0.0]), 0.2)
    turned = np.array([0.0, 0.3, 1.0, np.pi])
    found = bodies(outline, 0.4, turned)
    normals = directions(8, 0.4)
    for polygon, most in zip(found, turned.tolist(), strict=True):
        support = (polygon @ normals.T).max(axis=0)
        exact = np.full(8, -np.inf)
        for angle in np.linspace(-most, most, 201) + 0.4:
            placed = outline.placed(0.0, 0.0, float(angle)).vertices
            exact = np.maximum(exact, (placed @ normals.T).max(axis=0) + 0.2)
        assert (support >= exact + MARGIN - 1e-9).all()
        assert (support <= exact + MARGIN + 1e-3).all()
    assert circumscribed(outline) == pytest.approx(np.hypot(3.0, 1.0) + 0.2)
