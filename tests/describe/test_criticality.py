"""Headways and the brake threat number, by hand and against a search over simulated braking."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandra.describe import PromptOptions, describe
from sandra.describe.criticality import MEASURES, measures_of, required_braking
from sandra.errors import SettingsError
from sandra.scene.types import Scene
from sandra.settings import Settings
from straight_road import WIDTH, Road


@pytest.mark.parametrize(
    ("gap", "speed", "other", "acceleration", "expected"),
    [
        (20.0, 10.0, 0.0, 0.0, 2.5),  # 10^2 / (2 * 20)
        (8.0, 14.0, 10.0, 0.0, 1.0),  # 4^2 / (2 * 8)
        (8.0, 14.0, 10.0, -1.0, 2.0),  # both at 6 m/s after 4 s
        (8.0, 14.0, 10.0, 0.5, 0.5),
        (8.0, 14.0, 10.0, 3.0, 0.0),  # it drives away
        (8.0, 10.0, 12.0, 0.0, 0.0),
        (7.5, 10.0, 5.0, -5.0, 5.0),  # it stands after 2.5 m: 10^2 / (2 * 10)
        (5.0, 10.0, 10.0, -10.0, 5.0),  # it stands after 5 m, though no gap closes now
        (8.0, 0.0, 0.0, 0.0, 0.0),
    ],
)
def test_by_hand(
    gap: float, speed: float, other: float, acceleration: float, expected: float
) -> None:
    assert required_braking(gap, speed, other, acceleration) == pytest.approx(expected)


def test_nothing_is_said_where_nothing_is_known() -> None:
    assert math.isnan(required_braking(10.0, 10.0, math.nan, 0.0))
    assert math.isnan(required_braking(10.0, 10.0, 5.0, math.nan))
    assert math.isnan(required_braking(10.0, 10.0, -5.0, 0.0))


def _nearest(gap: float, speed: float, other: float, acceleration: float, braking: float) -> float:
    """The smallest gap while the ego brakes until it stands, both by their laws of motion."""
    end = speed / braking if braking > 0.0 else 120.0
    t = np.linspace(0.0, min(end, 120.0), 20_001)
    stops = other / -acceleration if acceleration < 0.0 else math.inf
    held = np.minimum(t, stops)
    ahead = gap + other * held + acceleration * held**2 / 2
    return float((ahead - (speed * t - braking * t**2 / 2)).min())


@given(st.floats(1.0, 60.0), st.floats(0.5, 30.0), st.floats(0.0, 30.0), st.floats(-8.0, 4.0))
def test_a_little_less_braking_hits_and_a_little_more_does_not(
    gap: float, speed: float, other: float, acceleration: float
) -> None:
    if abs(acceleration) < 0.3:
        acceleration = 0.0
    needed = required_braking(gap, speed, other, acceleration)
    assert _nearest(gap, speed, other, acceleration, 1.02 * needed + 0.01) > -1e-3
    if needed > 0.05:
        assert _nearest(gap, speed, other, acceleration, 0.9 * needed - 0.02) < 0.0


def told(scene: Scene, *measures: str, settings: Settings | None = None) -> list[str]:
    options = PromptOptions(measures=measures or MEASURES)
    user = describe(scene, settings=settings, options=options).user
    return [line for line in user.splitlines() if line.startswith(("  - ", "(Time headway"))]


@pytest.mark.parametrize("angle", [0.0, 0.8, 2.5])
def test_the_prompt_tells_them_of_the_leader(angle: float) -> None:
    road = Road(angle, 5.0, -7.0)
    scene = road.scene(road.obstacle(5, 24.5, 0.0, 4.0))
    meaning, line = told(scene)
    # 20 m from bumper to bumper, closing at 6 m/s: 36 / 40 of 6 m/s^2.
    assert line.endswith(
        "The time headway is 2.0 sec. The distance headway is 20.0 meters. "
        "The brake threat number is 0.15."
    )
    assert "6 m/s²" in meaning


def test_the_brake_threat_follows_the_strongest_braking() -> None:
    road = Road()
    scene = road.scene(road.obstacle(5, 24.5, 0.0, 4.0))
    (line,) = told(scene, "brake-threat", settings=Settings(a_lon_min=-3.0))
    assert line.endswith("sec. The brake threat number is 0.30.")


def test_they_are_not_told_of_what_is_not_in_the_way() -> None:
    road = Road()
    scene = road.scene(
        road.obstacle(5, 24.5, WIDTH, 4.0),
        road.obstacle(6, -24.5, 0.0, 4.0),
        road.obstacle(7, 0.0, -WIDTH, 4.0),
        lanes=road.three_lanes(),
    )
    assert not any("headway is" in line or "threat" in line for line in told(scene)[1:])


def test_somebody_coming_towards_the_ego_has_a_headway_and_no_brake_threat() -> None:
    road = Road()
    scene = road.scene(road.obstacle(5, 24.5, 0.0, 4.0, math.pi))
    line = told(scene)[1]
    assert "The distance headway is 20.0 meters." in line
    assert "brake threat" not in line


def test_a_standing_ego_has_no_time_headway() -> None:
    road = Road()
    line = told(road.scene(road.obstacle(5, 24.5, 0.0, 4.0), speed=0.0))[1]
    assert "time headway" not in line
    assert "The brake threat number is 0.00." in line


def test_names_of_measures() -> None:
    assert measures_of("") == ()
    assert measures_of("brake-threat, time-headway") == ("time-headway", "brake-threat")
    assert measures_of("all") == MEASURES
    with pytest.raises(SettingsError, match="'ttc': choose from time-headway"):
        measures_of("ttc")
    with pytest.raises(SettingsError, match="'ttc'"):
        PromptOptions(measures=("ttc",))
