"""Labels of trajectories that were made so that one knows what they are."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from sandra.actions import Lateral, Longitudinal
from sandra.errors import FormulaError, ScenarioError, SettingsError
from sandra.learn import Label, label
from sandra.learn.trace import Recorded
from sandra.logic.formula import Comparison, Predicate
from sandra.scene.types import Scene
from sandra.settings import Settings
from straight_road import WIDTH, Road

H, DT = 20, 0.1
A_LIM = Settings().a_lim


def driven(
    accelerations: list[float] | np.ndarray,
    speed: float = 10.0,
    sideways: list[float] | None = None,
    angle: float = 0.4,
    sides: tuple[str, ...] = ("left", "right"),
) -> Scene:
    """An ego that was driven with these accelerations, at these d (default: 0)."""
    road = Road(angle, 50.0, -20.0)
    n = len(accelerations)
    v = np.concatenate([[speed], speed + np.cumsum(accelerations) * DT])
    s = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * DT)])
    d = np.zeros(n + 1) if sideways is None else np.array(sideways)
    points = np.array([road.at(a, b) for a, b in zip(s, d, strict=True)])
    rows = np.column_stack([points, np.full(n + 1, angle), v, np.append(accelerations, 0.0)])
    places = {"left": 1, "right": -1}
    lanes = (road.lane("current", 0), *(road.lane(x, places[x]) for x in sides))
    return road.scene(speed=speed, lanes=lanes, recorded_ego=rows)


def change(to: float) -> list[float]:
    return [to * (1 - math.cos(math.pi * k / H)) / 2 for k in range(H + 1)]


def words(found: Label) -> str:
    return "unknown" if found.pair is None else str(found.pair)


@pytest.mark.parametrize("labeler", ["mean", "strict"])
@pytest.mark.parametrize(
    ("a", "speed", "to", "expected"),
    [
        (0.0, 10.0, 0.0, "keep,follow-lane"),
        (0.19, 10.0, 0.0, "keep,follow-lane"),
        (0.21, 10.0, 0.0, "accelerate,follow-lane"),
        (-0.19, 10.0, 0.0, "keep,follow-lane"),
        (-0.21, 10.0, 0.0, "decelerate,follow-lane"),
        (-4.0, 8.0, 0.0, "stop,follow-lane"),
        (0.0, 0.0, 0.0, "stop,follow-lane"),
        (1.0, 10.0, WIDTH, "accelerate,left-lane"),
        (-1.0, 10.0, -WIDTH, "decelerate,right-lane"),
        (0.0, 10.0, 2 * WIDTH, "unknown"),
    ],
)
def test_what_was_made_is_what_is_found(
    labeler: str, a: float, speed: float, to: float, expected: str
) -> None:
    found = label(driven([a] * H, speed, change(to)), H, labeler)
    assert words(found) == expected
    assert (found.reason is not None) == (expected == "unknown")


def test_noise_breaks_the_formulas_and_not_the_mean() -> None:
    noisy = np.tile([0.5, -0.5], H // 2)
    assert words(label(driven(noisy), H, "mean")) == "keep,follow-lane"
    found = label(driven(noisy), H, "strict")
    assert (found.longitudinal, found.lateral) == (None, Lateral.FOLLOW_LANE)
    assert found.reason == "no longitudinal formula holds on the trace"


def test_a_formula_is_asked_of_every_step_of_the_window_and_of_no_other() -> None:
    late = [0.0] * (H - 1) + [0.3]
    assert words(label(driven(late), H, "strict")) == "unknown"
    assert words(label(driven(late), H - 1, "strict")) == "keep,follow-lane"
    first = [0.3] + [0.0] * (H - 1)
    assert words(label(driven(first), H, "strict")) == "unknown"


def test_a_letter_holds_the_acceleration_of_the_interval_that_follows() -> None:
    jump = Comparison("a", "<=", 0.5)
    recorded = Recorded.of(driven([0.0, 1.0, 0.0, 1.0]), 4)
    assert [letter[jump] for letter in recorded.letters([jump])] == [
        True,
        False,
        True,
        False,
        False,
    ]
    slow = Comparison("v", "<=", 10.05)
    assert [letter[slow] for letter in recorded.letters([slow])] == [
        True,
        True,
        False,
        False,
        False,
    ]
    with pytest.raises(FormulaError, match="is no predicate of an action"):
        recorded.letters([Predicate("keeps_safe_distance", "preceding")])


def test_a_lane_that_is_not_there_is_no_label() -> None:
    found = label(driven([0.0] * H, 10.0, change(WIDTH), sides=("right",)), H, "mean")
    assert (found.longitudinal, found.lateral) == (Longitudinal.KEEP, None)
    assert found.reason == "at the end the centre is in no lane that an action names"


def test_of_several_pairs_that_hold_the_centre_decides() -> None:
    # The body, 1.8 m wide, touches both lanes from the first step to the last.
    for d, expected in ((WIDTH / 2 - 0.1, "follow-lane"), (WIDTH / 2 + 0.1, "left-lane")):
        found = label(driven([0.0] * H, sideways=[d] * (H + 1)), H, "strict")
        assert words(found) == f"keep,{expected}"
        assert {str(p) for p in found.holds} == {"keep,follow-lane", "keep,left-lane"}


def test_strict_labels_are_those_of_the_definitions_on_random_trajectories() -> None:
    source = random.Random(5)
    seen = set()
    for _ in range(150):
        base = source.choice([0.0, 0.0, 1.0, -1.0, -6.0])
        spread = source.choice([0.05, 0.15, 0.9])
        accelerations = [base + source.uniform(-spread, spread) for _ in range(H)]
        if base < -5.0:
            accelerations = [max(base, -3.0)] * H
        to = source.choice([0.0, 1.0, WIDTH, -WIDTH, 2 * WIDTH, -0.5])
        speed = source.choice([6.0, 6.05, 9.0])
        scene = driven(accelerations, speed, change(to), angle=0.0)
        assert scene.recorded_ego is not None
        v = scene.recorded_ego[:, 3]
        a = np.diff(v) / DT
        lon = {
            "keep": bool(np.all(np.abs(a) <= A_LIM)),
            "accelerate": bool(np.all(a > A_LIM)),
            "decelerate": bool(np.all(a < -A_LIM)),
            "stop": abs(v[-1]) <= Settings().v_err,
        }
        half = scene.ego.width / 2
        d = np.array(change(to))
        lat = {
            "follow-lane": bool(np.all(np.abs(d) <= WIDTH / 2 + half)),
            "left-lane": WIDTH / 2 - half <= d[-1] <= 3 * WIDTH / 2 + half,
            "right-lane": -3 * WIDTH / 2 - half <= d[-1] <= -WIDTH / 2 + half,
        }
        expected = {f"{x},{y}" for x, good in lon.items() for y, fine in lat.items() if good & fine}
        found = label(scene, H, "strict")
        assert {str(p) for p in found.holds} == expected
        assert (found.pair is None) == (not expected)
        seen.add(words(found))
    assert len(seen) >= 8


def test_the_largest_corridor_comes_first() -> None:
    found = label(driven([0.0] * H), H, "area")
    order = sorted(found.areas.values(), reverse=True)
    assert found.pair == found.holds[0]
    assert [found.areas[p] for p in found.holds] == order[:3]
    assert order[0] > 0.0
    assert len(found.areas) == 12


def test_where_nothing_is_reachable_the_area_is_unknown() -> None:
    scene = driven([0.0] * H, 20.0, sides=())
    road = Road(0.4, 50.0, -20.0)
    wall = road.obstacle(7, 6.0, 0.0, is_static=True)
    blocked = road.scene(wall, speed=20.0, lanes=scene.lanes, recorded_ego=scene.recorded_ego)
    found = label(blocked, H, "area")
    assert (words(found), found.holds, found.reason) == ("unknown", (), "no pair has a corridor")


def test_what_cannot_be_labelled_says_why() -> None:
    scene = driven([0.0] * H)
    with pytest.raises(ScenarioError, match="is recorded for 20 steps, not for 21"):
        label(scene, H + 1)
    with pytest.raises(ScenarioError, match="the ego is not recorded"):
        label(Road().scene(), H)
    with pytest.raises(SettingsError, match="unknown labeler 'best'"):
        label(scene, H, "best")
    with pytest.raises(ScenarioError, match="at least 1"):
        label(scene, 0)
