"""The ranker that wants a collision."""

import math
from dataclasses import replace

import pytest

from sandra.actions import ActionPair
from sandra.describe import describe
from sandra.describe.types import ObstacleFacts, Situation
from sandra.rankers import as_ranker, create
from sandra.rankers.adversarial import nearest
from sandra.settings import Settings
from straight_road import Road

ROAD = Road()
LANES = ROAD.three_lanes()


def best(*cars: tuple[float, int, float], speed: float = 20.0) -> str:
    """What is preferred among cars at (s, lane, speed)."""
    others = [ROAD.obstacle(i, s, 3.5 * n, v) for i, (s, n, v) in enumerate(cars, start=10)]
    prompt = describe(ROAD.scene(*others, lanes=LANES, speed=speed))
    return str(create("adversarial").rank(prompt).pairs[0])


def car(gap: float, speed: float = 20.0, **changes: object) -> ObstacleFacts:
    facts = ObstacleFacts(
        1, "car", False, "same", True, gap, 0.0, speed, 0.0, 0.0, None, float("inf")
    )
    return replace(facts, **changes)  # type: ignore[arg-type]


def gap(pair: str, *cars: ObstacleFacts, speed: float = 20.0) -> tuple[float, float]:
    facts: Situation = describe(ROAD.scene(lanes=LANES, speed=speed)).situation
    return nearest(replace(facts, obstacles=cars), ActionPair.parse(pair))


@pytest.mark.parametrize(
    ("cars", "pair"),
    [
        ([], "accelerate,follow-lane"),
        ([(0.0, 1, 20.0)], "accelerate,left-lane"),  # into who is beside it
        ([(0.0, -1, 20.0)], "accelerate,right-lane"),
        ([(20.0, 0, 10.0)], "accelerate,follow-lane"),  # into the leader
        ([(60.0, 0, 20.0), (15.0, 1, 10.0)], "accelerate,left-lane"),
        ([(-12.0, 0, 22.0)], "stop,follow-lane"),  # in front of who follows closely
        ([(60.0, 0, 25.0), (-10.0, -1, 25.0)], "stop,right-lane"),
    ],
)
def test_it_prefers_the_nearest_to_a_collision(
    cars: list[tuple[float, int, float]], pair: str
) -> None:
    assert best(*cars) == pair


def test_gaps_are_those_of_constant_acceleration() -> None:
    # 20 m/s against 20 m/s: 5/2 * 4^2 = 40 m are gained in 4 s.
    assert gap("accelerate,follow-lane", car(50.0)) == pytest.approx((10.0, 4.0))
    assert gap("keep,follow-lane", car(50.0))[0] == pytest.approx(50.0)
    # A leader that brakes at 4 for a second loses 2 m in it and 4 m/s afterwards.
    assert gap("keep,follow-lane", car(50.0, acceleration=-4.0))[0] == pytest.approx(36.0)
    # Both stand before the look-ahead ends: 20^2 / 16 = 25 m; nobody drives backwards.
    assert gap("stop,follow-lane", car(26.0, speed=0.0))[0] == pytest.approx(1.0)
    # A follower at the same speed comes nearer by what the ego lets go: 2/2 * 4^2 = 16 m.
    assert gap("decelerate,follow-lane", car(-20.0)) == pytest.approx((4.0, 4.0))
    # Somebody who comes towards the ego, in its lane.
    assert gap("keep,follow-lane", car(60.0, speed=10.0, heading=math.pi)) == (0.0, 2.0)


def test_a_collision_is_a_gap_of_zero_and_the_sooner_the_worse() -> None:
    assert gap("keep,follow-lane", car(10.0, speed=0.0)) == (0.0, pytest.approx(0.6))
    assert gap("accelerate,left-lane", car(0.0, relation="left")) == (0.0, 0.0)
    assert gap("keep,follow-lane", car(0.0, relation="left")) == (math.inf, math.inf)
    touching = car(0.0, relation="left", in_ego_lane=True)
    assert gap("keep,follow-lane", touching) == (0.0, 0.0)


def test_the_lane_that_is_left_counts_while_the_change_lasts() -> None:
    leader = car(30.0, speed=0.0)
    assert gap("keep,left-lane", leader) == (0.0, pytest.approx(1.6))
    assert gap("keep,left-lane", car(50.0, speed=0.0))[0] == pytest.approx(14.0)


def test_nobody_knows_his_speed() -> None:
    assert gap("keep,follow-lane", car(100.0, speed=math.nan))[0] == pytest.approx(20.0)


def test_it_keeps_to_the_protocol() -> None:
    ranker = create("adversarial")
    assert as_ranker(ranker) is ranker
    prompt = describe(
        ROAD.scene(ROAD.obstacle(9, 25.0, 0.0, 15.0), lanes=LANES), settings=Settings(k=4)
    )
    ranking = ranker.rank(prompt)
    assert ranking == create(" adversarial ").rank(prompt)
    assert ranking.failure is None
    assert len(set(ranking.pairs)) == len(ranking.pairs) == 4
    gaps = [nearest(prompt.situation, pair) for pair in ranking.pairs]
    assert gaps == sorted(gaps)
    rest = set(prompt.feasible) - set(ranking.pairs)
    assert min(nearest(prompt.situation, pair) for pair in rest) >= gaps[-1]
    assert ranking.reasoning is not None
    assert str(ranking.pairs[0]) in ranking.reasoning
