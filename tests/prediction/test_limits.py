"""Limits of the small steps: exactly at a tolerance, and with the smallest possible input."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from prediction.traffic import bend, car, fork, lanelet, line, scene, straight_road
from sandra.errors import ScenarioError, SettingsError
from sandra.prediction import predict, slicing
from sandra.prediction.geometry import clip, minkowski, unpadded
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.most_likely import _bend, _path, trajectories
from sandra.prediction.set_based import _Maps, _Plan, _plan
from sandra.prediction.slicing import (
    END_CELLS,
    FEW_CORNERS,
    STRAIGHT,
    _is_straight,
    _meeting,
    simplified,
    slices_of,
)
from sandra.prediction.touched import Vehicle
from sandra.scene.types import Region, State
from sandra.settings import Settings

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


def test_corners_of_a_sum_between_parallel_edges_are_left_out() -> None:
    """Parallel up to 1e-7 rad."""
    limit = math.tan(1e-7)
    assert np.arctan2(limit, 1.0) == 1e-7
    for turn, count in ((limit, 3), (1.001e-7, 4)):
        polygon = np.array([[[0.0, 0.0], [1.0, 0.0], [2.0, turn], [0.0, 1.0]]])
        found = unpadded(minkowski(polygon, np.zeros((1, 1, 2))))[0]
        assert len(found) == count


def test_edges_of_an_outline_meet_if_they_turn() -> None:
    for turn, meet in ((1e-9, False), (1.001e-9, True)):
        assert (_meeting([0j, 1.0 + 0j], [1.0 + 0j, 1.0 + turn * 1j], 0, 1) is not None) == meet


def test_corners_are_left_out_up_to_the_growth(monkeypatch: pytest.MonkeyPatch) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 20, endpoint=False)
    outline = np.column_stack([np.cos(angle), np.sin(angle)])
    p = [complex(*x) for x in [*outline, outline[0]]]
    edges = [(b - a) / abs(b - a) for a, b in pairwise(p)]
    further = _meeting(p, edges, 0, 2)
    assert further is not None
    assert slicing.GROWTH <= 0.01
    growth = max((edges[k].conjugate() * (p[k] - further)).imag for k in (1, 2))
    for most, first in ((growth, further), (math.nextafter(growth, 0.0), p[1])):
        monkeypatch.setattr("sandra.prediction.slicing.GROWTH", most)
        assert complex(*simplified(outline)[0]) == first


def test_what_has_no_length_is_not_straight() -> None:
    for length, straight in ((1e-9, True), (0.999e-9, False)):
        assert _is_straight(np.array([[0j, 0j], [length, 1.0]])) == straight


def test_heading_begins_to_turn_before_the_lane_does() -> None:
    """The path ends exactly where the bend begins; its heading turns evenly between edges."""
    road = tuple(x for x in fork() if x.id != 2)
    now = scene(road, (car(1, -20, 0, speed=20.0),))
    states = predict(now, "constant-velocity", 10).obstacles[0].states
    assert states[10, :2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert 0.01 < states[10, 2] < 0.05


def test_points_of_a_path_are_apart() -> None:
    """A point of the map 5 cm ahead is left out, one further ahead is not."""
    lane_map = build_map(straight_road(1, 80.0), 0.0)
    for x, count in ((-0.05, 4), (-0.0501, 5)):
        place = lane_map.places(x, 1.75, 0.0, 0.0)[0]
        assert len(_path(lane_map, place, np.array([x, 1.75]), 0.0, 15.0)) == count


@pytest.mark.parametrize("heading", [0.0, 3.0, -3.0])
def test_how_far_a_lanelet_turns_away(heading: float) -> None:
    """In either direction, also where headings jump from pi to -pi."""
    for turn in (-2.0, -0.3, 0.0, 0.3, 2.0):
        strips = []
        for angle in (heading, heading + turn):
            ahead = np.array([np.cos(angle), np.sin(angle)])
            right = np.array([[0.0], [20.0]]) * ahead
            left = right + 3.5 * np.array([-ahead[1], ahead[0]])
            one = lanelet(1, right, left, predecessors=(1,))
            strips.append(build_map((one,), 0.0).strips[1])
        assert _bend(*strips) == pytest.approx(abs(turn))


def test_a_lanelet_without_length_does_no_harm() -> None:
    end = np.array([[0.0, 0.0], [0.0, 0.0]])
    lanelets = (
        lanelet(1, line(0.0, -60.0, 0.0), line(3.5, -60.0, 0.0), successors=(2,)),
        lanelet(2, end, end + np.array([0.0, 3.5]), predecessors=(1,), successors=(3,)),
        lanelet(3, line(0.0, 0.0, 60.0), line(3.5, 0.0, 60.0), predecessors=(2,)),
    )
    strips = tuple(build_map(lanelets, 0.0).strips.values())
    assert np.hypot(*slices_of(strips)[1][0].along) == 1.0
    each = predict(scene(lanelets, (car(1, -5.0, 1.75),)), "set-based", 15).obstacles[0]
    assert max(r.vertices[:, 0].max() for r in each.at[15]) >= -5.0 + 15.0 + 13.5 + 2.25


def test_nothing_is_computed_beyond_the_horizon() -> None:
    """Of a vehicle that is first seen at step 4 of 10: six steps, seven times."""
    now = scene(ROAD, (car(1, 0, 1.75, states=recording(15, first=4)),))
    likely, _ = trajectories(now, 10, use_recordings=True)
    plan = _plan(now, likely[0], _Maps(now, 20.0), 10, Settings())
    assert isinstance(plan, _Plan)
    assert isinstance(plan.participant, Vehicle)
    rows = np.isfinite(plan.participant.offsets)
    assert rows.all(axis=1).tolist() == [True] * 7 + [False] * 4 + [True] * 6 + [False] * 4
    assert not rows[~rows.all(axis=1)].any()


def test_recorded_sets_have_a_middle() -> None:
    sets = tuple((Region.rectangle(4, 2).placed(10.0 + k, 1.75, 0.0),) for k in range(6))
    now = scene(ROAD, (car(1, 10.0, 1.75, speed=10.0, occupancies=sets),))
    (each,) = predict(now, "recorded", 5).obstacles
    assert each.states[:, :2] == pytest.approx(np.array([[10.0 + k, 1.75] for k in range(6)]))


def test_headings_in_a_gap_turn_the_short_way() -> None:
    """From 3.1 rad to -3.1 rad, past pi."""
    rows = recording(5)
    rows[:, 2] = [3.1, np.nan, np.nan, np.nan, -3.1]
    rows[1:4] = np.nan
    (each,) = predict(scene(ROAD, (car(1, 0, 1.75, states=rows),)), "recorded", 4).obstacles
    turned = np.mod(each.states[:, 2] - 3.1 + np.pi, 2 * np.pi) - np.pi
    assert turned == pytest.approx(np.arange(5) * (2 * np.pi - 6.2) / 4)


def test_offset_from_the_lane_stays_from_lanelet_to_lanelet() -> None:
    """In a bend of 60 m radius that consists of two lanelets."""
    whole = bend()[0]
    n = len(whole.right) // 2
    lanelets = (
        lanelet(1, whole.right[: n + 1], whole.left[: n + 1], successors=(2,)),
        lanelet(2, whole.right[n:], whole.left[n:], predecessors=(1,)),
    )
    start = np.array([0.0, -2.5])
    states = predict(scene(lanelets, (car(1, *start, speed=20.0),)), "most-likely", 40)
    away = states.obstacles[0].states[:, :2] - [0.0, 60.0]
    assert np.hypot(*away.T) == pytest.approx(62.5, abs=0.05)
    assert float(np.arctan2(away[-1, 0], -away[-1, 1])) > 1.2
