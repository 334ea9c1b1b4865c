"""Recorded vehicles as egos."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sandra
from sandra.errors import ScenarioError
from sandra.scene.tracks import Track, Tracks
from sandra.scene.writing import write


@pytest.fixture(scope="module")
def tracks() -> Tracks:
    return Tracks(sandra.example("merge"))


def test_the_vehicle_is_taken_out_and_seen_as_it_was(tracks: Tracks) -> None:
    before = tracks.scene(1003, 0)
    later = tracks.scene(1003, 12)
    assert before.recorded_ego is not None
    assert later.recorded_ego is not None
    np.testing.assert_array_equal(before.recorded_ego[12:], later.recorded_ego)
    assert 1003 not in {o.id for o in later.obstacles}
    state = later.ego.state
    row = later.recorded_ego[0]
    assert (state.x, state.y, state.heading, state.speed) == tuple(row[:4])
    others = {o.id: o for o in before.obstacles}
    for other in later.obstacles:
        if other.states is not None:
            earlier = others[other.id].states
            assert earlier is not None
            np.testing.assert_array_equal(earlier[12:], other.states)


def test_what_the_ego_did_is_not_told_to_the_scene(tracks: Tracks) -> None:
    assert tracks.scene(1003, 0).goal is None


def test_a_scene_tells_nothing_of_what_the_ego_does_next(tmp_path: Path) -> None:
    """Two egos that are the same up to a step, and then turn to different sides."""
    scene = sandra.load(sandra.example("recorded-ego"))
    assert scene.recorded_ego is not None
    states = []
    for turn in (0.2, -0.2):
        rows = scene.recorded_ego[:12].copy()
        rows[3:, 2] += 0.03
        rows[5:, 2] += turn
        path = write(replace(scene, recorded_ego=rows), tmp_path / f"{turn}.xml")
        states.append(Tracks(path).scene(scene.ego.id, 4).ego.state)
        turned = Tracks(path).scene(scene.ego.id, 3).ego.state
        assert turned.yaw_rate == pytest.approx(0.03 / scene.dt, abs=0.02)
        assert turned.steering_angle > 0.0
    assert states[0] == states[1]


def test_the_choice_is_seeded(tracks: Tracks) -> None:
    chosen = [tracks.choose(seed, 20) for seed in range(30)]
    assert chosen == [Tracks(tracks.path).choose(seed, 20) for seed in range(30)]
    assert len(set(chosen)) > 3
    assert set(chosen) <= set(tracks.all())


def test_windows_end_where_the_recording_ends() -> None:
    track = Track(1, "car", 5, 30)
    assert list(track.windows(10, 10)) == [5, 15]
    assert list(track.windows(25, 1)) == [5]
    assert not track.windows(26, 1)


def test_the_ego_of_a_problem_is_the_same_either_way() -> None:
    path = sandra.example("recorded-ego")
    given = sandra.load(path)
    tracks = Tracks(path)
    (own,) = {t.id for t in tracks.all()} - {o.id for o in given.obstacles}
    found = tracks.scene(own, tracks.problem_step)
    assert given.recorded_ego is not None
    assert found.recorded_ego is not None
    np.testing.assert_array_equal(given.recorded_ego, found.recorded_ego)
    assert {o.id for o in given.obstacles} == {o.id for o in found.obstacles}
    assert (found.ego.length, found.ego.width) == (given.ego.length, given.ego.width)
    assert [x.lanelets for x in found.lanes] == [x.lanelets for x in given.lanes]


def test_who_is_not_there_is_no_ego(tracks: Tracks) -> None:
    with pytest.raises(ScenarioError, match=r"vehicle 9 is not recorded at step 0; .*1003 \(0-60"):
        tracks.scene(9, 0)
    with pytest.raises(ScenarioError, match="vehicle 1003 is not recorded at step 61"):
        tracks.scene(1003, 61)
    with pytest.raises(ScenarioError, match="no vehicle is recorded for 999 steps"):
        tracks.choose(0, 999)
    assert tracks.all(kinds=("pedestrian",)) == ()
