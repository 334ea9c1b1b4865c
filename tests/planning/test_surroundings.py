"""Contacts of fail-safe candidates: the same answers as for each step by itself."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from reach_scenes import Course
from sandra.planning.surroundings import Surroundings
from sandra.planning.tracking import advance
from sandra.planning.validity import CLEARANCE, Occupied, corners
from sandra.prediction import PredictedObstacle, Prediction
from sandra.scene.frame import Frame
from sandra.scene.types import Lane, Region, Scene

COURSE = Course(step=5.0)
DT, TAU, HORIZON = 0.1, 0.05, 12
Cast = dict[int, dict[int, tuple[Region, ...]]]
"""By obstacle and interval: where it is."""


def predicted(cast: Cast) -> Prediction:
    nan = np.full((HORIZON + 1, 5), np.nan)
    found = []
    for number, regions in cast.items():
        between = tuple(regions.get(k, ()) for k in range(HORIZON))
        obstacle = COURSE.car(number, 100.0, 0.0)
        found.append(PredictedObstacle(obstacle, ((),) * (HORIZON + 1), between, nan))
    return Prediction("set-based", DT, HORIZON, tuple(found))


def made(cast: Cast, *incoming: Lane) -> Surroundings:
    lanes = [*COURSE.lanes(left=1, right=0), *incoming]
    return Surroundings.of(COURSE.scene(lanes), predicted(cast))


def block(x: float, y: float = 0.0, length: float = 1.0, width: float = 1.0) -> Region:
    return Region.rectangle(length, width).placed(x, y, 0.0)


def disc(x: float, y: float, radius: float) -> Region:
    return Region(np.array([[x, y]]), radius)


def straight(speed: float, n: int, y: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    t = TAU * np.arange(n + 1)
    states = np.column_stack([speed * t, 0 * t + y, 0 * t, 0 * t + speed, 0 * t])
    return states[None], np.zeros((1, n, 2))


def first(around: Surroundings, n: int, count: int | None = None, start: float = 0.0) -> int:
    states, inputs = straight(10.0, n)
    counts = np.array([n if count is None else count])
    return int(around.first_contact(states, inputs, counts, TAU, start)[0])


@pytest.mark.parametrize("step", range(10))
def test_the_first_contact_is_in_the_step_in_which_it_happens(step: int) -> None:
    """The front, at 2.25 + 0.5 i, comes to the block's side in the middle of a step."""
    side = 2.25 + 0.5 * step + 0.25
    around = made({7: {k: (block(side + 0.5),) for k in range(HORIZON)}})
    assert first(around, 10) == step
    assert first(around, 10, count=step + 1) == step
    # Steps from `count` on are not looked at.
    assert first(around, 10, count=max(step, 1)) == (-1 if step else 0)
    assert first(around, 20) == step
    assert first(around, step + 1) == step


def test_no_contact() -> None:
    assert first(made({}), 10) == -1
    assert first(made({7: {k: (block(5.0, 3.5),) for k in range(HORIZON)}}), 10) == -1


def test_a_block_counts_in_its_interval_only() -> None:
    """It is where the front is during the step i = 6, 0.3 to 0.35 s."""
    here = (block(2.25 + 3.25),)
    assert first(made({7: {3: here}}), 10) == 6
    assert first(made({7: {1: here}}), 10) == -1
    # The same, a step of the prediction later.
    assert first(made({7: {4: here}}), 10, start=0.1) == 6
    assert first(made({7: {2: here}}), 10, start=0.1) == -1


@pytest.mark.parametrize(("gap", "meets"), [(CLEARANCE - 1e-4, True), (CLEARANCE + 1e-4, False)])
def test_the_clearance(gap: float, meets: bool) -> None:
    beside = block(5.0, 0.9 + 0.5 + gap)
    assert (first(made({7: dict.fromkeys(range(HORIZON), (beside,))}), 10) >= 0) == meets
    states, inputs = straight(10.0, 10)
    free = made({7: dict.fromkeys(range(HORIZON), (beside,))}).ends_free(
        states, inputs, np.array([10]), TAU, 0.0
    )
    assert free[0] != meets


def test_several_at_once_are_each_for_itself() -> None:
    around = made({7: {k: (block(7.0),) for k in range(HORIZON)}})
    speeds = (10.0, 0.0, 20.0, 6.0, 10.0)
    parts = [straight(v, 20, y) for v, y in zip(speeds, (0, 0, 0, 0, 3.0), strict=True)]
    states = np.concatenate([x for x, _ in parts])
    inputs = np.concatenate([u for _, u in parts])
    counts = np.array([20, 20, 20, 20, 20])
    together = around.first_contact(states, inputs, counts, TAU, 0.0).tolist()
    alone = [int(around.first_contact(x, u, np.array([20]), TAU, 0.0)[0]) for x, u in parts]
    assert together == alone
    assert together[1] == together[4] == -1
    assert 0 < together[2] < together[0] < together[3]
    fewer = around.first_contact(states, inputs, np.array([20, 1, 2, 20, 3]), TAU, 0.0)
    assert fewer.tolist() == [together[0], -1, -1, together[3], -1]
    # Whoever stands before its contact has none, though others drive on.
    stands = around.first_contact(states, inputs, np.array([20, 1, together[2], 20, 3]), TAU, 0.0)
    assert stands.tolist() == [together[0], -1, -1, together[3], -1]


def test_ends_free_looks_at_the_last_step_alone() -> None:
    """The block is passed, in time or in place, or it is there at the end."""
    states, inputs = straight(10.0, 20)

    def free(cast: Cast, count: int, start: float = 0.0) -> bool:
        found = made(cast).ends_free(states, inputs, np.array([count]), TAU, start)
        return bool(found[0])

    always = {7: {k: (block(2.25 + 3.0 + 0.51),) for k in range(HORIZON)}}
    assert free(always, 5)
    assert not free(always, 7)
    assert free({7: {k: (block(5.0),) for k in range(3)}}, 7)
    assert not free({7: {3: (block(5.0),)}}, 7)
    assert not free({7: {3: (block(5.0),)}}, 8)
    assert free({7: {3: (block(5.0),)}}, 9)
    assert free({7: {3: (block(5.0),)}}, 7, start=0.1)
    assert not free({7: {4: (block(5.0),)}}, 7, start=0.1)
    # Different counts at once.
    both = made(always).ends_free(
        np.concatenate([states] * 3), np.concatenate([inputs] * 3), np.array([5, 7, 5]), TAU, 0.0
    )
    assert both.tolist() == [True, False, True]


@pytest.mark.parametrize("seed", range(6))
def test_gaps_are_those_of_all_occupancies(seed: int) -> None:
    """What is left out because it is far away changes nothing within the range asked for."""
    rng = np.random.default_rng(seed)
    cast: Cast = {
        number: {
            k: tuple(
                block(*rng.uniform(-25, 25, 2), *rng.uniform(0.2, 4.0, 2))
                if rng.random() < 0.5
                else Region(rng.uniform(-25, 25, (1, 2)), float(rng.uniform(0.1, 2.0)))
                for _ in range(4)
            )
            for k in range(HORIZON)
        }
        for number in (7, 8)
    }
    around = made(cast)
    states, inputs = [], []
    for _ in range(3):
        one = [[*rng.uniform(-8, 8, 2), rng.uniform(-3, 3), rng.uniform(5, 25), 0.0]]
        u = np.column_stack([rng.uniform(-6, 6, 14), rng.uniform(-0.4, 0.4, 14)])
        for row in u.tolist():
            one.append(advance(one[-1], tuple(row), TAU, 2.6))
        states.append(one)
        inputs.append(u)
    x, u = np.array(states), np.array(inputs)
    every = Occupied.of(predicted(cast))
    for within in (0.04, 1.0, 5.0):
        found = around.gaps(x, u, TAU, 0.2, within)
        expected = every.gaps(x, u, TAU, around.ego, 0.2, within)
        assert found == pytest.approx(expected)
    contact = around.first_contact(x, u, np.full(3, 14), TAU, 0.2)
    touching = every.gaps(x, u, TAU, around.ego, 0.2, 1.0) <= CLEARANCE
    wanted = np.where(touching.any(axis=1), touching.argmax(axis=1), -1)
    assert contact.tolist() == wanted.tolist()


def test_who_is_nearest_during_a_step() -> None:
    around = made(
        {
            7: {k: (block(6.0),) for k in range(HORIZON)},
            8: {3: (block(0.0, 2.0),), 4: (block(0.0, 9.0),)},
            9: {
                k: (Region(np.array([[-8.0, 0.0]]), 5.4 if k > 8 else 1.0),) for k in range(HORIZON)
            },
        }
    )
    states = straight(10.0, 1)[0][0]
    assert around.nearest(states, 0.0) == 7
    assert around.nearest(states, 0.3) == 8
    assert around.nearest(states, 0.35) == 8
    assert around.nearest(states, 0.4) == 7
    assert around.nearest(states, 0.95) == 9  # its radius counts


def crossing(x: float) -> Lane:
    y = np.linspace(40.0, -40.0, 17)
    lines = [np.column_stack([np.full_like(y, x + d), y]) for d in (2.0, -2.0, 0.0)]
    return Lane("incoming-left", (300,), *lines, (None,), Frame(lines[2]))


def test_distance_from_conflict_areas() -> None:
    """The area covers x from 28 to 32; the body is 4.5 m long."""
    around = made({}, crossing(30.0))
    assert len(around.conflicts) == 1
    assert around.area is not None
    x = np.array([10.0, 25.0, 30.0, 40.0])
    states = np.column_stack([x, *np.zeros((4, 4))])
    assert around.from_conflicts(states) == pytest.approx([15.75, 0.75, 0.0, 5.75])
    turned = np.array([[20.0, 0.0, np.pi / 2, 0.0, 0.0]])
    body = shapely.Polygon(corners(turned[0], around.ego))
    assert around.from_conflicts(turned)[0] == pytest.approx(body.distance(around.area))
    assert around.from_conflicts(turned)[0] == pytest.approx(28.0 - 20.9)


def test_without_conflict_areas_there_is_no_distance() -> None:
    around = made({})
    assert around.conflicts == ()
    assert around.area is None
    assert around.from_conflicts(np.zeros((2, 5))).tolist() == [np.inf, np.inf]


def test_the_same_scene_and_prediction() -> None:
    scene: Scene = COURSE.scene()
    cast: Cast = {7: {0: (block(5.0), block(50.0))}, 8: {0: (block(9.0),), 2: (block(1.0),)}}
    around = Surroundings.of(scene, predicted(cast))
    assert around.ego is scene.ego
    assert around.ids == (7, 8)
    assert around.step.tolist() == [0, 0, 0, 2]
    assert around.low.tolist() == [[4.5, -0.5], [49.5, -0.5], [8.5, -0.5], [0.5, -0.5]]
    assert around.high.tolist() == [[5.5, 0.5], [50.5, 0.5], [9.5, 0.5], [1.5, 0.5]]
    round_one = Surroundings.of(scene, predicted({7: {0: (disc(3.0, 1.0, 0.5),)}}))
    assert (round_one.low.tolist(), round_one.high.tolist()) == ([[2.5, 0.5]], [[3.5, 1.5]])
