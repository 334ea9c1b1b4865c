"""Full braking in the lane: closed forms on a straight road, and in a bend."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reach_scenes import Course
from sandra.planning import full_braking
from sandra.scene.types import Scene
from sandra.settings import Settings

SETTINGS = Settings()


def braking(scene: Scene, settings: Settings = SETTINGS) -> np.ndarray:
    found = full_braking(scene, settings)
    assert (found.kind, found.pair, found.dt) == ("fail-safe", None, scene.dt)
    assert found.fail_safe is None
    assert "not proven collision-free" in found.note
    now = scene.ego.state
    assert found.states[0, :4].tolist() == [now.x, now.y, now.heading, now.speed]
    return found.states


@pytest.mark.parametrize(
    ("speed", "level", "steps"),
    [(12.0, -6.0, 20), (12.1, -6.0, 21), (0.0, -6.0, 1), (3.0, -3.0, 10)],
)
def test_straight_on(speed: float, level: float, steps: int) -> None:
    states = braking(Course(step=5.0).scene(speed=speed), Settings(a_lon_min=level))
    assert states.shape == (steps + 1, 5)
    t = np.minimum(0.1 * np.arange(steps + 1), speed / -level)
    assert states[:, 0] == pytest.approx(speed * t + level * t**2 / 2)
    assert states[:, 1:3] == pytest.approx(0.0, abs=1e-12)
    assert states[:, 3] == pytest.approx(speed + level * t)
    moving = states[:, 3] > 1e-9
    assert states[moving, 4] == pytest.approx(level)
    assert (states[~moving, 4] == 0.0).all()
    assert states[-1, 3] == 0.0


def test_the_note_says_how_hard_and_how_far() -> None:
    note = full_braking(Course(step=5.0).scene(speed=12.0), SETTINGS).note
    assert "full braking in the lane with -6 m/s^2 to a standstill after 12.0 m" in note


def test_without_brakes_it_takes_long_but_ends() -> None:
    """a_lon_min = 0 allows no braking; a thousandth is taken then."""
    states = braking(Course(step=5.0).scene(speed=0.01), Settings(a_lon_min=0.0))
    assert len(states) == 101
    assert states[-1, 3] == 0.0
    assert states[1, 4] == pytest.approx(-1e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("d", [0.0, 0.5])
def test_the_speed_across_is_braked_off_with_the_lateral_limit(sign: float, d: float) -> None:
    angle = 0.1 * sign
    scene = Course(step=5.0).scene(speed=12.0, angle=angle, d=d)
    states = braking(scene)
    v_s, v_d = 12.0 * np.cos(angle), 12.0 * np.sin(angle)
    t = 0.1 * np.arange(len(states))
    until = np.minimum(t, abs(v_d) / 4.0)
    assert states[:, 1] == pytest.approx(d + v_d * until - sign * 4.0 * until**2 / 2)
    along = np.maximum(v_s - 6.0 * t, 0.0)
    across = v_d - sign * 4.0 * until
    assert states[1:, 3] == pytest.approx(np.hypot(along, across)[1:])
    moving = along > 0.1
    assert states[moving, 2] == pytest.approx(np.arctan2(across, along)[moving])
    assert states[~moving, 2] == pytest.approx(0.0)
    assert states[-1, 3] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("kappa", [0.02, -0.02])
@pytest.mark.parametrize("d", [0.0, 1.0])
def test_in_a_bend_speed_and_distance_are_those_of_the_own_path(kappa: float, d: float) -> None:
    """Along an arc the body drives speed^2 / 12, however far beside the centre it is."""
    course = Course(kappa, step=0.25)
    states = braking(course.scene(speed=10.0, d=d))
    t = np.minimum(0.1 * np.arange(len(states)), 10.0 / 6.0 / (1.0 - kappa * d))
    # Along the reference line it brakes with a_lon_min, from the speed of the foot point on.
    v_s = 10.0 / (1.0 - kappa * d) - 6.0 * t
    assert states[:, 3] == pytest.approx(np.maximum(v_s, 0.0) * (1.0 - kappa * d), abs=0.02)
    s = 10.0 / (1.0 - kappa * d) * t - 3.0 * t**2
    assert states[:, :2] == pytest.approx(course.at(s, d), abs=0.02)
    # The centre line is rounded where its points are: a little.
    assert states[:, 2] == pytest.approx(kappa * s, abs=0.01)


def test_against_the_lane_nobody_drives_backwards() -> None:
    scene = Course(step=5.0).scene(speed=5.0)
    turned = replace(scene.ego.state, heading=np.pi)
    states = braking(replace(scene, ego=replace(scene.ego, state=turned)))
    assert states[:, :2] == pytest.approx(0.0, abs=1e-9)
    assert states[1:, 3] == pytest.approx(0.0)
