"""Limits of the small steps: exactly at a tolerance, and with the smallest possible input."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from prediction.traffic import bend, car, lanelet, line, scene, straight_road
from sandra.errors import ScenarioError, SettingsError
from sandra.prediction import predict
from sandra.prediction.geometry import clip, unpadded
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.slicing import (
    END_CELLS,
    FEW_CORNERS,
    STRAIGHT,
    _is_straight,
    simplified,
    slices_of,
)
from sandra.scene.types import Region, State

ROAD = straight_road()


def test_what_touches_a_half_plane_up_to_rounding_is_left() -> None:
    normal = np.array([1.0, 0.0])
    for x, left in ((1e-9, True), (1.001e-9, False)):
        _, alive = clip(np.array([[[x, 0.0]]]), normal, np.zeros(1))
        assert alive.tolist() == [left]


@pytest.mark.parametrize("axis", [0, 1])
def test_vertices_no_further_apart_than_rounding_are_one(axis: int) -> None:
    for size, count in ((1e-9, 2), (1.001e-9, 3)):
        polygon = np.zeros((1, 3, 2))
        polygon[0, 1, axis] = size
        polygon[0, 2] = 1.0, 1.0
        assert len(unpadded(polygon)[0]) == count


def test_outlines_with_few_corners_stay() -> None:
    """Corners of a polygon that would hardly matter, if there were more of them."""
    for count in (FEW_CORNERS, FEW_CORNERS + 1):
        angle = np.linspace(0.0, 0.2, count)
        outline = np.column_stack([np.cos(angle), np.sin(angle)])
        assert (simplified(outline) is outline) == (count == FEW_CORNERS)


def test_rounded_corners_of_a_rectangle_become_square() -> None:
    """Each corner is cut off twice, by a few millimetres; its sides meet at right angles."""
    corner = np.array([[0.0, -0.004], [-0.001, -0.001], [-0.004, 0.0]])
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    outline = np.vstack(
        [
            corner @ np.linalg.matrix_power(turn, k).T + end
            for k, end in enumerate([(5.0, 2.0), (-5.0, 2.0), (-5.0, -2.0), (5.0, -2.0)])
        ]
    )
    found = simplified(np.roll(outline, -2, axis=0))
    assert sorted(map(tuple, np.round(found, 9).tolist())) == [
        (-5.0, -2.0), (-5.0, 2.0), (5.0, -2.0), (5.0, 2.0)
    ]  # fmt: skip


@pytest.mark.parametrize("length", [9, 16, 17, 18, 40, 81, 150])
def test_a_straight_lanelet_is_one_slice_between_its_ends(length: int) -> None:
    border = (line(0.0, 0.0, length, length), line(3.5, 0.0, length, length))
    strips = build_map((lanelet(1, *border, predecessors=(1,)),), 0.0).strips
    (slices,) = slices_of(tuple(strips.values()))
    ends = {0, END_CELLS, length - END_CELLS, length}
    marks = sorted(i for i in ends if i in (0, length) or END_CELLS <= i < length)
    assert [x.first for x in slices] + [slices[-1].last] == marks


def test_a_border_exactly_at_the_limit_is_straight() -> None:
    for away, straight in ((STRAIGHT, True), (STRAIGHT + 1e-9, False)):
        side = np.array([0.0, 1.0 + away * 1j, 2.0])
        assert _is_straight(np.column_stack([side, side + 4.0])) == straight


def test_a_single_step() -> None:
    for kind in ("most-likely", "set-based"):
        found = predict(scene(ROAD, (car(1, 0, 1.75),)), kind, 1)
        (each,) = found.obstacles
        assert (found.horizon, len(each.at), len(each.between)) == (1, 2, 1)
        assert each.at[1]
        assert each.between[0]


@pytest.mark.parametrize("radius", [math.inf, math.nan, -1e-9])
def test_radii_must_be_finite_and_not_negative(radius: float) -> None:
    bad = Region(np.zeros((1, 2)), radius)
    with pytest.raises(ScenarioError, match="its shape"):
        predict(scene(ROAD, (replace(car(1, 0, 1.75), outline=bad),)))
    with pytest.raises(ScenarioError, match="occupancy at step 1"):
        predict(scene(ROAD, (car(1, 0, 1.75, occupancies=((), (bad,))),)))
    good = scene(ROAD, (car(1, 0, 1.75),))
    own = predict(good, horizon=2)
    (each,) = own.obstacles
    with pytest.raises(SettingsError, match="obstacle 1 holds a region"):
        predict(good, replace(own, obstacles=(replace(each, between=((), (bad,))),)), 2)


def recording(n: int, first: int = 0) -> np.ndarray:
    t = 0.1 * np.arange(n)
    rows = np.column_stack([10 * t, 1.75 + 0 * t, 0 * t, 10 + 0 * t, np.nan * t])
    rows[:first] = np.nan
    return rows


def test_a_recording_that_ends_with_the_horizon_is_complete() -> None:
    now = scene(ROAD, (car(1, 0, 1.75, states=recording(11)),))
    assert predict(now, "recorded", 10).notes == ()
    sets = ((Region.rectangle(4, 2),),) * 11
    now = scene(ROAD, (car(1, 0, 1.75, occupancies=sets),))
    assert predict(now, "recorded", 10).notes == ()
    assert "end at step 10 of 11" in predict(now, "recorded", 11).notes[0]


@pytest.mark.parametrize("kind", ["recorded", "set-based"])
def test_who_is_first_seen_in_the_last_step_is_there_then(kind: str) -> None:
    now = scene(ROAD, (car(1, 0, 1.75, states=recording(15, first=10)),))
    (each,) = predict(now, kind, 10).obstacles
    assert [bool(x) for x in each.at] == [False] * 10 + [True]
    assert [bool(x) for x in each.between] == [False] * 9 + [True]
    assert each.states[10] == pytest.approx([10.0, 1.75, 0.0, 10.0, 0.0])
    (each,) = predict(now, kind, 9).obstacles
    assert not any(each.at)


def test_notes_name_twelve_obstacles() -> None:
    for count in (12, 13):
        several = tuple(car(i, 10.0 * i, 1.75, speed_is_known=False) for i in range(1, count + 1))
        (note,) = predict(scene(ROAD, several), "constant-velocity", 2).notes
        assert note.endswith("11, 12" if count == 12 else "11, 12, ...")


def test_up_to_45_degrees_off_a_vehicle_drives_along_its_lane() -> None:
    heading = math.radians(45.0)
    for turned, along in ((heading, True), (-heading, True), (heading + 1e-6, False)):
        obstacle = car(1, 0, 1.75, turned, 10.0)
        (each,) = predict(scene(ROAD, (obstacle,)), "constant-velocity", 10).obstacles
        assert (abs(each.states[10, 1] - 1.75) < 1e-9) == along


def test_most_likely_turns_where_the_lane_does() -> None:
    """Up to the last step: a longer prediction begins with the shorter one."""
    now = scene(bend(), (car(1, 0, -1.75, speed=10.0),), State(0, 100, 0, 1))
    short = predict(now, "constant-velocity", 10).obstacles[0].states
    long = predict(now, "constant-velocity", 20).obstacles[0].states
    assert short == pytest.approx(long[:11], abs=1e-9)


def test_what_was_assumed_is_named() -> None:
    several = (
        car(1, 0, 1.75, kind="parkedVehicle"),
        car(2, 20, 1.75, is_static=True),
        car(3, 0, 1.75, states=recording(11)),
        car(4, 0, 5.25),
        car(5, 0, 1.75, states=recording(11), speed_is_known=False),
    )
    found = predict(scene(ROAD, several), "most-likely", 10)
    assert [each.assumptions for each in found.obstacles] == [
        ("parked",),
        ("static",),
        ("recorded trajectory",),
        ("constant velocity along the lane",),
        ("recorded trajectory",),
    ]
    (note,) = found.notes
    assert note.startswith("no recording of obstacles 4;")
    notes = predict(scene(ROAD, several), "constant-velocity", 10).notes
    assert notes == ("speed unknown, taken for standing: obstacles 5",)
