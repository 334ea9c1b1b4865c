"""The search inside a corridor made by hand: each reason why a candidate falls, and each count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from corridors import base, corridor, wide
from reach_scenes import Course, prediction
from sandra.actions import ActionPair
from sandra.logic import Part, Specification, parse
from sandra.planning.candidates import COARSE
from sandra.planning.cost import Weights
from sandra.planning.limits import MARGIN
from sandra.planning.tracking import advance
from sandra.planning.types import Trajectory
from sandra.planning.validity import CLEARANCE
from sandra.planning.witness import (
    BATCH,
    COARSE_GAP,
    MOST_AS_FAST,
    MOST_ASKED,
    MOST_DRIVEN,
    MOST_PER_PROFILE,
    Miss,
    Surroundings,
    _Search,
    _wrong_at_start,
    start_state,
    witness,
)
from sandra.reach import ground
from sandra.reach.sets import ReachableSet
from sandra.scene.types import Obstacle, Scene
from sandra.settings import Settings

COURSE = Course(step=5.0)
PAIR = ActionPair.parse("keep,follow-lane")
H = 10
START = 40.0
STEADY = (-MARGIN, MARGIN)
"""Inputs that leave one profile: to keep the speed."""


def around(scene: Scene | None = None) -> Surroundings:
    scene = COURSE.scene() if scene is None else scene
    return Surroundings.of(ground(scene, prediction(scene, H), Settings(horizon=H)))


AROUND = around()


def spec(text: str = "true") -> Specification:
    return Specification(PAIR, (Part("r", text, parse(text)),))


def search(
    where: ReachableSet | None = None, on: Surroundings = AROUND, text: str = "true"
) -> _Search:
    where = wide(H) if where is None else where
    return _Search(on, spec(text), where, Weights(), None)


def straight(speed: float = 10.0, d: float = 0.0, a: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    states, inputs = [[0.0, d, 0.0, speed, 0.0]], np.tile([a, 0.0], (2 * H, 1))
    for u in inputs.tolist():
        states.append(advance(states[-1], tuple(u), 0.05, 2.6))
    return np.array(states)[None], inputs[None]


# What is wrong with a candidate that was driven.


def test_nothing_is_wrong() -> None:
    assert search()._fault(*straight()) is None


def test_limits() -> None:
    assert search()._fault(*straight(a=6.0)) == "driven limits"  # a margin is kept
    assert search()._fault(*straight(a=6.0 - MARGIN)) is None


@pytest.mark.parametrize("k", range(1, H + 1))
def test_corridor(k: int) -> None:
    steps = [base() for _ in range(H + 1)]
    steps[k] = base(s=(START + k - 0.5, START + k - 1e-5))
    assert search(corridor(*steps))._fault(*straight()) == "driven corridor"
    steps[k] = base(s=(START + k - 0.5, START + k - 1e-7))
    assert search(corridor(*steps))._fault(*straight()) is None
    steps[k] = base(d=(0.1, 0.5))
    assert search(corridor(*steps))._fault(*straight()) == "driven corridor"


def parked(s: float, d: float, number: int = 7) -> Obstacle:
    return COURSE.car(number, s, d)


def test_collision() -> None:
    """The bodies are 1.8 m wide: 1 cm apart is too near, 3 cm is not."""
    for apart, fault in ((0.01, "driven collision"), (0.03, None)):
        on = around(COURSE.scene(obstacles=[parked(8.0, 1.8 + apart)]))
        assert search(on=on)._fault(*straight()) == fault


def test_road() -> None:
    on = around(COURSE.scene([COURSE.lane("current", 100, -1.75, 1.75)]))
    assert search(on=on)._fault(*straight(d=0.82)) is None
    assert search(on=on)._fault(*straight(d=0.84)) == "driven road"


def test_formula() -> None:
    assert search(text="G(v < 10.1)")._fault(*straight()) is None
    assert search(text="G(v < 9.9)")._fault(*straight()) == "driven formula"


def test_a_candidate_is_driven_by_the_model() -> None:
    made = search()
    candidates = made.sampler.stage(0)
    found = made._drive(candidates, 0)
    assert isinstance(found, Trajectory)
    assert made.driven == 1
    assert (found.tau, found.start) == (0.05, 0.0)
    assert np.array_equal(found.states[0], start_state(AROUND.ground))
    for x, u, after in zip(found.states[:-1], found.inputs, found.states[1:], strict=True):
        assert advance(x.tolist(), tuple(u.tolist()), 0.05, 2.6) == pytest.approx(after)
    refused = search(text="G(v < 0)")
    assert refused._drive(candidates, 0) is None
    assert refused.counts["driven formula"] == 1


def test_the_start_is_the_egos_state() -> None:
    scene = COURSE.scene(speed=7.0, d=0.2, angle=0.05)
    state = replace(scene.ego.state, steering_angle=0.03)
    on = around(replace(scene, ego=replace(scene.ego, state=state)))
    assert start_state(on.ground).tolist() == [state.x, state.y, 0.05, 7.0, 0.03]


# Which candidates are looked at.


def test_samples_off_the_road_and_in_others_fall_at_once() -> None:
    lane = COURSE.lane("current", 100, -2.0, 2.0)
    on = around(COURSE.scene([lane], [parked(7.0, 2.0)]))
    made = search(wide(H, d=(-3.0, 3.0)), on)
    candidates = made.sampler.stage(0)
    rows = np.arange(len(candidates))
    kept = made._clear(candidates, rows)
    bodies = made.sampler.bodies(candidates, rows)
    on_road = on.road.may_hold(bodies, on.ground.scene.ego)
    inputs = np.zeros((len(rows), H, 2))
    gap = on.occupied.gaps(bodies, inputs, 0.1, on.ground.scene.ego).min(axis=1)
    assert 0 < len(kept) < on_road.sum() < len(rows)
    assert sorted(kept) == np.flatnonzero(on_road & (gap > COARSE_GAP)).tolist()
    assert made.counts["road"] == (~on_road).sum()
    assert made.counts["collision"] == (on_road & (gap <= COARSE_GAP)).sum()
    # In the order of the whole cost: 2 (1 - gap)^2 more for passing near.
    total = candidates.cost + 2.0 * np.maximum(1.0 - gap, 0.0) ** 2
    assert (np.diff(total[kept]) >= -1e-12).all()
    assert (np.diff(kept) < 0).any()


def test_none_on_the_road() -> None:
    on = around(COURSE.scene([COURSE.lane("current", 100, -0.95, 0.95)]))
    made = search(wide(H, d=(-3.0, 3.0)), on)
    candidates = made.sampler.stage(0)
    away = np.flatnonzero(np.abs(candidates.motion.d[:, -1]) > 0.6)
    assert len(away)
    assert made._clear(candidates, away) == []
    assert made.counts["road"] == len(away)
    assert made.counts["collision"] == 0


def test_the_cheapest_is_found_and_the_same_again() -> None:
    """Without a cause to do otherwise: straight on."""
    scene = COURSE.scene(COURSE.lanes(limit=None))
    for _ in range(2):
        found = witness(around(scene), spec(), wide(H))
        assert isinstance(found, Trajectory)
        assert found.states[:, 1] == pytest.approx(0.0, abs=1e-9)
        assert found.states[:, 3] == pytest.approx(10.0)


def test_a_ground_will_do() -> None:
    assert isinstance(witness(AROUND.ground, spec(), wide(H)), Trajectory)


def test_at_most_so_many_are_shown() -> None:
    shown: list[Trajectory] = []

    def never(found: Trajectory) -> str:
        shown.append(found)
        return "none is good enough"

    missed = witness(AROUND, spec(), wide(H), accept=never)
    assert isinstance(missed, Miss)
    assert 1 < len(shown) <= MOST_ASKED
    assert len({found.inputs.tobytes() for found in shown}) == len(shown), "each is shown once"
    assert len(shown) <= dict(missed.counts)["are valid, but none is good enough"] <= MOST_ASKED
    assert "are valid, but none is good enough" in str(missed)
    assert "given up" not in str(missed)


def test_after_refusals_slower_ones_are_shown() -> None:
    shown: list[float] = []

    def not_fast(found: Trajectory) -> str | None:
        shown.append(float(found.states[round(COURSE.scene().dt / found.tau), 3]))
        return None if shown[-1] <= shown[0] - 0.3 else "is too fast"

    eager = Weights(speed=9.0, jerk=0.0, desired_speed=30.0)
    found = witness(AROUND, spec(), wide(H), weights=eager, accept=not_fast)
    assert isinstance(found, Trajectory)
    assert all(sum(v >= w for v in shown) <= MOST_AS_FAST for w in shown[:-1])


# When it ends without one.


def missed(where: ReachableSet, text: str = "true", on: Surroundings = AROUND) -> Miss:
    found = witness(on, spec(text), where)
    assert isinstance(found, Miss)
    return found


def test_an_empty_set() -> None:
    empty = ReachableSet(wide(H).steps[:4], H, wide(H).lattice)
    assert str(missed(empty)) == "the reachable set is empty at step 4"


def test_no_profile() -> None:
    found = missed(wide(H, a=(7.0, 8.0)))
    assert str(found) == "no acceleration profile within the inputs and speeds of the corridor"


ASIDE = (COARSE / 4, COARSE)
"""The ego begins so little beside these d that samples are let through, but no drive [m]."""


def test_given_up_after_so_many_drives() -> None:
    found = missed(wide(H, d=ASIDE))
    counts = dict(found.counts)
    assert counts["driven corridor"] == MOST_DRIVEN
    assert f"{MOST_DRIVEN} leave the corridor when driven with the single-track model" in str(found)
    assert str(found).endswith(f"(given up after {MOST_DRIVEN} drives)")
    # Of each profile at most so many: with sixty drives ten of the first twelve are seen.
    assert counts["skipped"] > 0


def test_of_one_profile_only_a_few_are_driven_in_vain() -> None:
    found = missed(wide(H, a=STEADY, d=ASIDE))
    counts = dict(found.counts)
    # In each of the two stages that have candidates here.
    assert counts["driven corridor"] == 2 * MOST_PER_PROFILE
    assert counts["skipped"] > 0
    assert f"{counts['skipped']} are like others that failed" in str(found)
    assert "given up" not in str(found)
    assert str(found).startswith(f"all {sum(counts.values())} candidates fail: ")
    assert [n for _, n in found.counts] == sorted(counts.values(), reverse=True)
    assert min(counts.values()) > 0


def test_what_breaks_the_formula_as_a_sample_is_not_driven() -> None:
    found = missed(wide(H), "G(v > 29)")
    counts = dict(found.counts)
    assert counts["formula"] > MOST_DRIVEN
    assert not any(name.startswith("driven") for name in counts)
    assert f"{counts['formula']} do not satisfy the formula" in str(found)
    assert "given up" not in str(found)


def test_every_sample_is_looked_at_or_counted() -> None:
    """One profile, twelve at a time and then more: none is forgotten between the batches."""
    made = search(wide(H, a=STEADY, d=(-2.0, 2.0)), text="G(v > 29)")
    assert list(made.trajectories()) == []
    rest = sum(n for name, n in made.counts.items() if name not in ("limits", "corridor"))
    sizes = [len(made.sampler.stage(i)) for i in range(3)]
    assert rest == sum(sizes)
    assert sizes[0] > BATCH
    assert sizes[1] == 0


def test_whom_the_best_of_them_hits() -> None:
    """A wall of cars across the road, the middle one 0.2 m further away than the others."""
    wall = [
        parked(12.0 + (0.2 if i == 2 else 0.0), d, 10 + i)
        for i, d in enumerate((-4.0, -2.0, 0.0, 2.0, 4.0))
    ]
    found = missed(wide(H, a=STEADY), on=around(COURSE.scene(obstacles=wall)))
    counts = dict(found.counts)
    assert counts["collision"] > 0
    assert f"{counts['collision']} collide with their full body" in str(found)
    assert "; the best of them lacks " in str(found)
    assert " m to car 1" in str(found)
    made = search(wide(H, a=STEADY), around(COURSE.scene(obstacles=wall)))
    assert list(made.trajectories()) == []
    assert made.closest is not None
    gap, _ = made.closest
    assert f"lacks {COARSE_GAP - gap:.2f} m" in str(found)
    for stage in (0, 2):
        candidates = made.sampler.stage(stage)
        bodies = made.sampler.bodies(candidates, np.arange(len(candidates)))
        gaps = made.around.occupied.gaps(
            bodies, np.zeros((len(bodies), H, 2)), 0.1, made.scene.ego
        ).min(axis=1, initial=5.0)
        assert gap >= gaps.max(initial=-9.0)


def test_nobody_is_named_where_nobody_is_hit() -> None:
    assert "the best of them" not in str(missed(wide(H), "G(v > 29)"))


# What cannot be mended from here on.


def start_at(**changes: float) -> Surroundings:
    scene = COURSE.scene([COURSE.lane("current", 100, -1.75, 1.75)])
    return around(replace(scene, ego=replace(scene.ego, state=replace(scene.ego.state, **changes))))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"speed": 30.1}, "the initial speed or steering angle breaks a limit"),
        ({"steering_angle": 1.1, "speed": 1.0}, "the initial speed or steering angle"),
        ({"steering_angle": 0.2}, "the initial speed or steering angle"),
        ({"y": 0.85}, "the ego's body is not on the road, or at its very border, at the start"),
        ({"y": -1.0}, "the ego's body is not on the road"),
    ],
)
def test_a_start_that_no_trajectory_can_have(changes: dict[str, float], reason: str) -> None:
    assert str(missed(wide(H), on=start_at(**changes))).startswith(reason)


def test_a_start_at_a_limit_is_none() -> None:
    """Limits are those of the settings, without the planner's margin."""
    assert _wrong_at_start(start_at(speed=30.0)) is None
    assert _wrong_at_start(start_at(y=0.82)) is None
    assert _wrong_at_start(start_at(speed=25.0)) is None


@pytest.mark.parametrize(("apart", "near"), [(CLEARANCE - 1e-4, True), (CLEARANCE + 1e-4, False)])
def test_a_start_in_touch_with_another(apart: float, near: bool) -> None:
    on = around(COURSE.scene(obstacles=[parked(0.0, 1.8 + apart)]))
    found = _wrong_at_start(on)
    assert found == (
        "the ego's body touches another one, or nearly so, at the start" if near else None
    )
