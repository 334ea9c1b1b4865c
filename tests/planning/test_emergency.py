"""The emergency layer: of all that is tried, what stays clear longest."""

import numpy as np
import pytest

from sandra.planning import emergency
from sandra.planning.limits import Limits, within_limits
from sandra.planning.single_track import SPEED
from sandra.planning.surroundings import Surroundings
from sandra.prediction import predict
from sandra.settings import Settings
from straight_road import Road

ROAD = Road()
HARD = Settings(a_lon_min=-12.0)


def braked(gap: float, settings: Settings = HARD, speed: float = 20.0):
    """What is driven behind a car that stands so far ahead."""
    scene = ROAD.scene(ROAD.obstacle(7, gap + 4.5, 0.0), lanes=ROAD.three_lanes(), speed=speed)
    prediction = predict(scene, "set-based", 60, settings, instants=False)
    state = np.array([scene.ego.state.x, scene.ego.state.y, 0.0, speed, 0.0])
    found = emergency(scene, state, prediction, settings, Surroundings.of(scene, prediction))
    return scene, found


@pytest.mark.parametrize("gap", [5.0, 12.0, 30.0])
def test_it_brakes_as_hard_as_it_may_within_its_own_limits(gap: float) -> None:
    scene, found = braked(gap)
    assert found is not None
    trajectory, words = found
    assert trajectory.start == 0.0
    assert trajectory.states[0, SPEED] == 20.0
    assert trajectory.states[-1, SPEED] == pytest.approx(0.0, abs=1e-9)
    assert trajectory.inputs[:, 0].min() == pytest.approx(-12.0, abs=0.01)
    limits = Limits.of(HARD, 0.0)
    kept = within_limits(
        trajectory.states[None], trajectory.inputs[None], scene.ego.wheelbase, limits
    )
    assert kept[0]
    assert "at most 12.0 m/s^2" in words


def test_it_says_how_long_it_is_clear() -> None:
    near, far = (float(braked(gap)[1][1].split()[-2]) for gap in (5.0, 12.0))
    assert 0.0 < near < far


def test_without_brakes_there_is_nothing() -> None:
    _, found = braked(12.0, Settings(a_lon_min=0.0))
    assert found is None
