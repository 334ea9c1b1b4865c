"""`predict`: kinds, shapes, recordings, bad input, predictions from outside."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from prediction.referee import body_points, inside_union
from prediction.traffic import CAR, bend, car, fork, scene, straight_road
from sandra.errors import ScenarioError, SettingsError
from sandra.prediction import KINDS, Prediction, predict
from sandra.scene.types import Obstacle, Region, Scene, State
from sandra.settings import Assumptions, Settings

ROAD = straight_road()


def recording(n: int, speed: float = 10.0, y: float = 1.75, dt: float = 0.1) -> np.ndarray:
    t = np.arange(n) * dt
    return np.column_stack([speed * t, 0 * t + y, 0 * t, 0 * t + speed, 0 * t])


@pytest.mark.parametrize("kind", KINDS)
def test_shapes(kind: str) -> None:
    obstacles = (
        car(1, 0, 1.75, states=recording(8)),
        car(2, 20, 5.25, speed=0.0, kind="parkedVehicle"),
        Obstacle(3, "pedestrian", Region.disc(0.3), State(50, -2, 1.5, 1.0)),
        car(4, 30, 1.75, is_static=True),
        car(5, 60, 1.75, kind="unknown", speed_is_known=False),
    )
    p = predict(scene(ROAD, obstacles), kind, 10)
    assert (p.kind, p.dt, p.horizon, len(p.obstacles)) == (kind, 0.1, 10, 5)
    for each in p.obstacles:
        assert (len(each.at), len(each.between), each.states.shape) == (11, 10, (11, 5))
        assert np.isfinite(each.states).all()
        for k in range(11):
            assert inside_union(each.states[k : k + 1, :2], each.at[k]).all()
            # What is there at t_k is there during the intervals that meet at t_k.
            points = body_points(each.obstacle.outline, *each.states[k, :3])
            for j in (k - 1, k):
                if 0 <= j < 10:
                    assert inside_union(points, each.between[j]).all()
    for fixed in (1, 3):
        first = p.obstacles[fixed].at[0][0].vertices
        assert all(np.array_equal(r[0].vertices, first) for r in p.obstacles[fixed].at)


def test_recording_that_ends_goes_on_along_the_lane() -> None:
    p = predict(scene(ROAD, (car(1, 0, 1.75, states=recording(21)),)), "recorded", 25)
    assert np.allclose(p.obstacles[0].states[:, 0], np.arange(26))
    assert p.notes == (
        "recording ends at step 20 of 25; beyond it 1 obstacle is assumed to keep "
        "its velocity along its lane",
    )
    several = tuple(car(i, 0, 1.75, states=recording(n)) for i, n in ((1, 21), (2, 21), (3, 11)))
    assert predict(scene(ROAD, several), "recorded", 25).notes == (
        "recording ends at step 10 of 25; beyond it 1 obstacle is assumed to keep "
        "its velocity along its lane",
        "recording ends at step 20 of 25; beyond it 2 obstacles are assumed to keep "
        "their velocity along their lane",
    )


def test_a_prediction_of_ones_own_needs_no_notes() -> None:
    assert Prediction("mine", 0.1, 0, ()).notes == ()


def test_recording_that_begins_at_the_next_step() -> None:
    states = recording(12)
    states[0] = np.nan
    each = predict(scene(ROAD, (car(1, 5, 1.75, states=states),)), "set-based", 10).obstacles[0]
    assert [bool(regions) for regions in each.at] == [False] + [True] * 10
    assert all(each.between)


def test_recording_that_begins_later() -> None:
    states = recording(12)
    states[:5] = np.nan
    for kind in ("recorded", "set-based"):
        p = predict(scene(ROAD, (car(1, 5, 1.75, states=states),)), kind, 10)
        each = p.obstacles[0]
        assert all(not regions for regions in each.at[:5])
        assert all(regions for regions in each.at[5:])
        assert np.isnan(each.states[:5]).all()
        assert len(each.at) == 11
        assert len(each.between) == 10
        assert not each.between[3]
        assert each.between[4]
        assert any("absent until then: obstacles 1" in note for note in p.notes)


def test_gap_and_missing_acceleration_in_a_recording() -> None:
    states = recording(11)
    states[4:6] = np.nan
    states[:, 4] = np.nan
    p = predict(scene(ROAD, (car(1, 0, 1.75, states=states),)), "recorded", 10)
    assert np.allclose(p.obstacles[0].states[:, 0], np.arange(11))
    assert (p.obstacles[0].states[:, 4] == 0).all()


def test_recorded_sets() -> None:
    sets = tuple((Region.rectangle(4.0 + k, 2.0).placed(k, 1.75, 0.0),) for k in range(4))
    p = predict(scene(ROAD, (car(1, 0, 1.75, occupancies=sets),)), "recorded", 5)
    each = p.obstacles[0]
    assert each.at[3] == sets[3] or np.array_equal(each.at[3][0].vertices, sets[3][0].vertices)
    assert each.at[5][0].radius == pytest.approx(2.0)
    assert len(each.between[0]) == 2
    assert "end at step 3 of 5" in p.notes[0]


def test_constant_velocity_ignores_recordings() -> None:
    obstacle = car(1, 0, 1.75, speed=5.0, states=recording(26))
    p = predict(scene(ROAD, (obstacle,)), "constant-velocity", 25)
    assert p.obstacles[0].states[25, 0] == pytest.approx(12.5)
    assert p.notes == ()


def test_along_a_bend_offset_and_relative_heading_stay() -> None:
    radius = 60.0 + 1.0
    p = predict(scene(bend(), (car(1, 0, -1.0, heading=0.05, speed=15.0),)), "most-likely", 30)
    states = p.obstacles[0].states
    away = states[:, :2] - [0.0, 60.0]
    assert np.allclose(np.hypot(*away.T), radius, atol=0.05)
    angle = np.arctan2(away[:, 0], -away[:, 1])
    assert angle[-1] == pytest.approx(45.0 / radius, abs=0.005)
    assert np.allclose(states[:, 2], angle + 0.05, atol=0.03)
    assert np.abs(np.diff(states[:, 2], 2)).max() < 0.02


def test_straightest_successor_and_beyond_the_map() -> None:
    p = predict(scene(fork(), (car(1, -10, 0.3, speed=20.0),)), "most-likely", 100)
    states = p.obstacles[0].states
    assert np.allclose(states[:, 1], 0.3)
    assert states[-1, 0] == pytest.approx(190.0)


def test_across_the_lane_or_off_it_goes_straight_on() -> None:
    obstacles = (
        car(1, 0, 1.75, heading=1.2, speed=2.0, kind="pedestrian"),
        car(2, 0, 50.0, heading=0.3, speed=2.0),
        car(3, 0, 1.75, heading=0.0, speed=-1.0),
    )
    p = predict(scene(ROAD, obstacles), "most-likely", 10)
    for each in p.obstacles:
        s = each.obstacle.state
        expected = np.array([s.x, s.y]) + s.speed * np.array([np.cos(s.heading), np.sin(s.heading)])
        assert np.allclose(each.states[10, :2], expected)


def test_between_holds_a_turning_body() -> None:
    states = recording(3)
    states[1, 2], states[2, 2] = 0.8, 1.6
    each = predict(scene(ROAD, (car(1, 0, 1.75, states=states),)), "recorded", 2).obstacles[0]
    for share in np.linspace(0, 1, 9):
        pose = (1 - share) * states[0, :3] + share * states[1, :3]
        assert inside_union(body_points(CAR, *pose), each.between[0]).all()


BAD_SCENES: list[tuple[dict[str, Any], str]] = [
    ({"state": State(np.nan, 0, 0, 1)}, "its state is NaN"),
    ({"state": State(0, 0, 0, np.inf)}, "its state is NaN"),
    ({"outline": Region(np.array([[np.nan, 0.0]]))}, "its shape"),
    ({"outline": Region(np.zeros((1, 2)), -1.0)}, "its shape"),
    ({"states": np.where(np.eye(3, 5) > 0, np.nan, 0.0)}, "at step 0"),
    ({"states": np.zeros((3, 4))}, r"shape \(3, 4\)"),
    ({"occupancies": ((Region(np.array([[np.inf, 0.0]])),),)}, "occupancy at step 0"),
]


@pytest.mark.parametrize(("changes", "message"), BAD_SCENES)
def test_bad_obstacles(changes: dict[str, Any], message: str) -> None:
    bad = replace(car(1, 0, 1.75), **changes)
    with pytest.raises(ScenarioError, match=message):
        predict(scene(ROAD, (bad,)))


def test_bad_scene_and_settings() -> None:
    good = scene(ROAD, (car(1, 0, 1.75),))
    for dt in (0.0, -1.0, np.nan):
        with pytest.raises(ScenarioError, match="dt ="):
            predict(replace(good, dt=dt))
    with pytest.raises(ScenarioError, match="ego"):
        predict(replace(good, ego=replace(good.ego, state=State(np.nan, 0, 0, 0))))
    broken = replace(ROAD[0], left=ROAD[0].left * np.nan)
    with pytest.raises(ScenarioError, match="lanelet 11"):
        predict(replace(good, lanelets=(broken,)), "constant-velocity")
    for horizon in (0, -3, True, 2.5):
        with pytest.raises(SettingsError, match="horizon"):
            predict(good, horizon=horizon)  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="recorded, most-likely, constant-velocity, set-based"):
        predict(good, "crystal-ball")
    with pytest.raises(SettingsError, match="max_acceleration"):
        predict(good, "set-based", 5, Settings(assumptions=Assumptions(max_acceleration=-1.0)))


def test_a_prediction_of_the_users_own() -> None:
    good = scene(ROAD, (car(1, 0, 1.75),))
    own = predict(good, horizon=7)
    assert predict(good, own, horizon=7) is own

    def predictor(scene: Scene, horizon: int, settings: Settings) -> Prediction:
        return predict(scene, "constant-velocity", horizon, settings)

    assert predict(good, predictor, 9).horizon == 9
    with pytest.raises(SettingsError, match="7 steps, 8 are asked for"):
        predict(good, own, horizon=8)
    with pytest.raises(SettingsError, match=r"dt = 0\.1 s, the scene 0\.2 s"):
        predict(replace(good, dt=0.2), own, horizon=7)
    each = own.obstacles[0]
    for wrong in (
        replace(each, at=each.at[1:]),
        replace(each, between=each.between + each.between),
        replace(each, states=each.states[:, :4]),
        replace(each, at=((Region(np.array([[np.nan, 0.0]])),), *each.at[1:])),
        replace(each, at=((Region(np.zeros((0, 2))),), *each.at[1:])),
    ):
        with pytest.raises(SettingsError, match="obstacle 1"):
            predict(good, replace(own, obstacles=(wrong,)), horizon=7)
    with pytest.raises(SettingsError, match="a str"):
        predict(good, lambda *_: "nothing", 7)  # type: ignore[arg-type, return-value]


def test_nobody_there() -> None:
    for kind in KINDS:
        assert predict(scene(ROAD, ()), kind, 3).obstacles == ()
