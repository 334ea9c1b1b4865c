import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandra.actions import ActionPair
from sandra.describe import describe
from sandra.rankers import create
from sandra.rankers.rules import Ahead, idm
from sandra.rankers.wish import Wish, read_wish
from sandra.scene.types import Obstacle, Region, Scene, TrafficLight
from straight_road import WIDTH, Road

ROAD = Road(-1.9)
LANES = ROAD.three_lanes()
RULES = create("rules")


def best(scene: Scene, command: str | None = None) -> str:
    ranking = RULES.rank(describe(scene, command))
    assert ranking.failure is None
    assert ranking.reasoning
    return str(ranking.pairs[0])


def car(s: float, place: int, speed: float) -> Obstacle:
    return ROAD.obstacle(10 + place, s, place * WIDTH, speed)


def test_a_free_road_below_the_limit_is_used() -> None:
    assert best(ROAD.scene(speed=8.0)) == "accelerate,follow-lane"


def test_at_the_limit_the_speed_is_kept_and_above_it_reduced() -> None:
    assert best(ROAD.scene(speed=13.8)) == "keep,follow-lane"
    assert best(ROAD.scene(speed=16.0), "drive as fast as you can") == "decelerate,follow-lane"


def test_a_slow_leader_is_braked_for_or_overtaken_on_a_free_lane() -> None:
    assert best(ROAD.scene(car(20, 0, 3.0), speed=12.0)) == "decelerate,follow-lane"
    scene = ROAD.scene(car(20, 0, 3.0), speed=12.0, lanes=LANES)
    assert best(scene).endswith("left-lane")
    assert best(scene, "please do not change lanes too often") == "decelerate,follow-lane"


@pytest.mark.parametrize(
    "hindrance",
    [(0.0, 12.0), (3.0, 12.0), (8.0, 2.0), (-9.0, 20.0)],
    ids=["beside", "overlapping", "slow in front", "fast behind"],
)
def test_a_lane_that_is_not_free_is_not_entered(hindrance: tuple[float, float]) -> None:
    scene = ROAD.scene(
        car(18, 0, 3.0), car(hindrance[0], 1, hindrance[1]), speed=12.0, lanes=LANES[:2]
    )
    assert best(scene) == "decelerate,follow-lane"


def test_a_side_that_is_wished_for_is_taken_if_it_is_free() -> None:
    assert best(ROAD.scene(lanes=LANES), "change to the right lane").endswith("right-lane")
    blocked = ROAD.scene(car(0, -1, 10.0), lanes=LANES)
    assert best(blocked, "change to the right lane").endswith("follow-lane")


def test_lights() -> None:
    def at(state: str, distance: float, speed: float = 10.0) -> str:
        return best(ROAD.scene(speed=speed, lights=(TrafficLight(1, state, distance),)))

    assert at("red", 12.0) == "stop,follow-lane"
    assert at("red", 25.0).split(",")[0] in ("decelerate", "stop")
    assert at("red", 1.5, speed=0.0) == "stop,follow-lane"
    assert at("yellow", 30.0).split(",")[0] == "decelerate"
    assert at("yellow", 10.0) == "accelerate,follow-lane"  # too late to stop gently
    assert at("green", 12.0) == "accelerate,follow-lane"


def test_somebody_who_walks_into_the_lane_is_braked_for() -> None:
    walker = ROAD.obstacle(3, 20.0, -4.0, 1.5, math.pi / 2, "pedestrian", Region.disc(0.3))
    assert best(ROAD.scene(walker)).split(",")[0] in ("decelerate", "stop")
    away = ROAD.obstacle(3, 20.0, -4.0, 1.5, -math.pi / 2, "pedestrian", Region.disc(0.3))
    assert best(ROAD.scene(away)) == "accelerate,follow-lane"


def test_a_parked_car_beside_the_path_is_passed_and_one_in_it_is_not() -> None:
    aside = ROAD.obstacle(1, 20.0, -2.2, kind="parkedVehicle", is_static=True)
    ahead = ROAD.obstacle(1, 20.0, -1.2, kind="parkedVehicle", is_static=True)
    assert best(ROAD.scene(aside)) == "accelerate,follow-lane"
    assert best(ROAD.scene(ahead)).split(",")[0] in ("decelerate", "stop")


def test_an_unknown_speed_is_taken_for_standing() -> None:
    unknown = ROAD.obstacle(1, 20.0, 0.0, 10.0, speed_is_known=False)
    assert best(ROAD.scene(unknown)).split(",")[0] in ("decelerate", "stop")


def test_a_command_sets_the_pace_but_not_above_the_limit() -> None:
    scene = ROAD.scene(speed=13.2)
    assert best(scene) == "keep,follow-lane"
    assert best(scene, "drive slowly and carefully") == "decelerate,follow-lane"
    assert best(ROAD.scene(speed=8.0), "please stop here") == "stop,follow-lane"


@pytest.mark.parametrize(
    ("command", "wish"),
    [
        (None, Wish()),
        ("drive faster", Wish(pace=1)),
        ("Drive aggressively", Wish(pace=1)),
        ("Drive cautiously", Wish(pace=-1)),
        ("do not drive too fast", Wish()),
        ("fast but careful", Wish()),
        ("do not change lanes too often", Wish(stay=True)),
        ("please stay in your lane", Wish(stay=True)),
        ("keep to the left lane", Wish(side="left")),
        ("take the left or the right lane", Wish()),
        ("don't stop", Wish()),
        ("stop at the next corner", Wish(stop=True)),
        ("breakfast", Wish()),
    ],
)
def test_words_of_a_command(command: str | None, wish: Wish) -> None:
    assert read_wish(command) == wish


@given(st.text(max_size=200))
def test_no_command_is_too_odd(command: str) -> None:
    assert read_wish(command).pace in (-1, 0, 1)


@given(
    speed=st.floats(0, 40),
    d=st.floats(-1, 1),
    crowd=st.lists(
        st.tuples(st.floats(-60, 110), st.floats(-6, 6), st.floats(-5, 40), st.floats(-4, 4)),
        max_size=6,
    ),
    n=st.integers(1, 3),
)
def test_k_distinct_feasible_pairs_whatever_the_traffic(
    speed: float, d: float, crowd: list[tuple[float, float, float, float]], n: int
) -> None:
    obstacles = [ROAD.obstacle(i, *values) for i, values in enumerate(crowd)]
    prompt = describe(ROAD.scene(*obstacles, speed=speed, d=d, lanes=LANES[:n]))
    ranking = RULES.rank(prompt)
    assert ranking.failure is None
    assert len(set(ranking.pairs)) == len(ranking.pairs) == prompt.k
    assert set(ranking.pairs) <= set(prompt.feasible)
    assert all(isinstance(pair, ActionPair) for pair in ranking.pairs)


def test_idm_keeps_its_properties() -> None:
    assert idm(10.0, 10.0, 1.5, None) == pytest.approx(0.0)
    assert idm(0.0, 10.0, 1.5, None) == pytest.approx(1.5)
    near, far = (idm(10.0, 15.0, 1.5, Ahead(gap, 8.0, "")) for gap in (10.0, 60.0))
    assert near < far < idm(10.0, 15.0, 1.5, None)
    assert idm(30.0, 10.0, 1.5, Ahead(0.0, 0.0, "")) == -8.0
