"""The estimate by which the exhaustive ranker orders pairs."""

from dataclasses import replace

import pytest

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.describe import describe
from sandra.describe.types import ObstacleFacts, Situation
from sandra.rankers.progress import COST_OF_CONFLICT, HORIZON, progress
from straight_road import Road

ROAD = Road()
EMPTY = describe(ROAD.scene(lanes=ROAD.three_lanes(), speed=20.0)).situation


def car(relation: str, gap: float, speed: float) -> ObstacleFacts:
    return ObstacleFacts(
        1, "car", False, relation, True, gap, 0.0, speed, 0.0, 0.0, None, float("inf")
    )


def among(*cars: ObstacleFacts, **changes: object) -> Situation:
    return replace(EMPTY, obstacles=cars, speed_limit=30.0, **changes)  # type: ignore[arg-type]


def of(facts: Situation, pair: str) -> float:
    return progress(facts, ActionPair.parse(pair))


def best(facts: Situation) -> str:
    return str(max(ALL_PAIRS, key=lambda pair: progress(facts, pair)))


def test_on_an_empty_road_straight_on_and_fast() -> None:
    assert best(among()) == "accelerate,follow-lane"
    assert of(among(), "accelerate,follow-lane") > HORIZON * 20.0
    assert of(among(), "stop,follow-lane") < of(among(), "decelerate,follow-lane")


def test_a_slow_leader_is_passed_where_there_is_room() -> None:
    assert best(among(car("same", 25.0, 12.0))) in {"keep,left-lane", "accelerate,left-lane"}
    blocked = among(car("same", 25.0, 12.0), car("left", 10.0, 12.0), car("right", 10.0, 12.0))
    assert best(blocked).endswith("follow-lane")


@pytest.mark.parametrize("other", [("left", 0.0, 20.0), ("left", -8.0, 30.0)])
def test_nobody_is_pushed_aside(other: tuple[str, float, float]) -> None:
    free = of(among(), "keep,left-lane")
    assert of(among(car(*other)), "keep,left-lane") == pytest.approx(free - COST_OF_CONFLICT)


def test_who_is_far_behind_is_not_in_the_way() -> None:
    assert of(among(car("left", -80.0, 22.0)), "keep,left-lane") == of(among(), "keep,left-lane")


def test_a_leader_that_brakes_is_a_reason_to_leave_the_lane() -> None:
    braking = replace(car("same", 40.0, 20.0), acceleration=-6.0)
    steady = among(car("same", 40.0, 20.0))
    pair = "keep,follow-lane"
    assert of(among(braking), pair) < of(steady, pair)


def test_a_change_that_is_half_done_is_worth_more() -> None:
    slow = car("same", 15.0, 12.0)
    half = among(slow, lateral_offset=1.7)
    assert of(half, "keep,left-lane") > of(among(slow), "keep,left-lane")
    assert of(half, "keep,right-lane") == of(among(slow), "keep,right-lane")


def test_a_change_that_is_under_way_costs_nothing_more() -> None:
    going = among(past=(ActionPair.parse("keep,left-lane"),))
    assert of(going, "keep,left-lane") > of(among(), "keep,left-lane")
    assert of(going, "keep,right-lane") == of(among(), "keep,right-lane")


def test_an_unknown_speed_is_taken_as_standing() -> None:
    unknown, standing = car("same", 40.0, float("nan")), car("same", 40.0, 0.0)
    pair = "keep,follow-lane"
    assert of(among(unknown), pair) == of(among(standing), pair)
