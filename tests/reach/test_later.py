"""What is computed when it is first looked at."""

from random_scenes import draw
from sandra.prediction import predict
from sandra.reach import ground
from sandra.reach.bands import leaders
from sandra.reach.later import Later
from sandra.settings import Settings


def test_it_is_made_once_and_only_when_looked_at() -> None:
    made = []

    def make() -> list[int]:
        made.append(1)
        return [3, 4, 5]

    later = Later(make)
    assert not made
    assert (len(later), later[1], list(later), later[-2:]) == (3, 4, [3, 4, 5], [4, 5])
    assert made == [1]


def test_the_leaders_of_a_ground_are_those_of_its_lanes() -> None:
    settings = Settings(horizon=5)
    some = 0
    for seed in range(20):
        scene = draw(seed, most=6).scene
        prediction = predict(scene, "most-likely", 5, settings)
        known = ("current", "left", "right", "opposite")
        lanes = tuple(lane for lane in scene.lanes if lane.relation in known)
        expected = leaders(scene, prediction, settings, lanes)
        assert tuple(ground(scene, prediction, settings).leaders) == expected
        some += any(step for steps in expected for step in steps)
    assert some > 5
