"""Adversaries that keep the assumptions stay inside their set-based predictions, everywhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from prediction.traffic import car
from rollout_scenes import stopping, two_lanes
from sandra.certificate.types import Participant
from sandra.evaluation.rollouts.actors import FIXED, LANES, actors_of
from sandra.evaluation.rollouts.adversary import BRAKE, CUT_IN, KINDS, plans
from sandra.evaluation.rollouts.ego import Drive, placed, rectangle
from sandra.evaluation.rollouts.referee import judge
from sandra.evaluation.rollouts.road import Road
from sandra.evaluation.rollouts.routes import routes_of
from sandra.evaluation.rollouts.traffic import Ego, Motion, simulate
from sandra.evaluation.rollouts.walkers import wander
from sandra.prediction import PredictedObstacle, predict
from sandra.prediction.straight_road import StraightRoad
from sandra.scenarios import examples
from sandra.scene import load
from sandra.scene.types import Scene
from sandra.settings import Assumptions, Settings

STEPS = 15
OPEN = Settings(assumptions=Assumptions(no_rear_end=False, legal_cut_in=False))
KINDS_PLAYED = [k for k in range(len(KINDS)) if k not in (BRAKE, CUT_IN)]


def braking(scene: Scene) -> Drive:
    """The ego goes straight on and brakes: something to aim at."""
    fine = int(np.ceil(scene.dt / 0.02 - 1e-9))
    h, ego = scene.dt / fine, scene.ego.state
    v = np.maximum(ego.speed - 4.0 * h * np.arange(STEPS * fine + 1), 0.0)
    way = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * h)])
    states = np.zeros((len(v), 5))
    states[:, 0] = ego.x + way * np.cos(ego.heading)
    states[:, 1] = ego.y + way * np.sin(ego.heading)
    states[:, 2], states[:, 3] = ego.heading, v
    body = rectangle(states[:, :2], states[:, 2], scene.ego.length, scene.ego.width)
    return Drive(h, states, np.full(len(v) - 1, -4.0), body, fine, fine, 0.0)


def escapes(
    scene: Scene, count: int, predicted: Settings = OPEN, driven: Settings = OPEN
) -> tuple[int, int]:
    """(how many bodies at fine steps lie outside their sets, how many were looked at).

    The others keep `driven`; the sets are made with `predicted`.
    """
    sets = predict(scene, "set-based", STEPS, predicted).obstacles
    allowed = {x.obstacle.id: x for x in predict(scene, "set-based", STEPS, driven).obstacles}
    c = replace(
        stopping(two_lanes()),
        settings=driven,
        obstacles=tuple(
            Participant(
                x.obstacle.id,
                x.obstacle.kind,
                x.obstacle.outline,
                x.obstacle.is_static,
                x.states,
                x.between,
                x.between,
                allowed[x.obstacle.id].assumptions,
                allowed[x.obstacle.id].dropped,
            )
            for x in sets
        ),
    )
    rng = np.random.default_rng(count)
    road, drive = Road(scene), braking(scene)
    actors = actors_of(c, scene, drive, road)
    routes = routes_of(actors, road, drive, rng)
    kinds = np.repeat(KINDS_PLAYED, count // len(KINDS_PLAYED))
    by_id = {x.obstacle.id: x for x in sets}
    outside = looked = 0
    for i, actor in enumerate(actors):
        ways = routes.of(i)
        if actor.moves == FIXED or (actor.moves == LANES and not len(ways)):
            continue
        wanted = plans(kinds, [ways] * len(kinds), float(drive.times[-1]), rng)
        them = [actor] * len(kinds)
        if actor.moves == LANES:
            ego = Ego.of(drive, road, scene.ego.length)
            motion = simulate(them, wanted, routes, drive, ego, driven)
        else:
            motion = wander(them, wanted, drive)
        judged = judge(actor, motion, np.arange(len(kinds)), drive, road, driven)
        found = _outside(by_id[actor.id], motion, judged.step, actor.appears, drive.per_dt)
        outside, looked = outside + found[0], looked + found[1]
    return outside, looked


def _outside(
    sets: PredictedObstacle, motion: Motion, breach: np.ndarray, appears: int, per_dt: int
) -> tuple[int, int]:
    outline = sets.obstacle.outline
    outside = looked = 0
    for k in range(STEPS):
        hulls = [shapely.MultiPoint(r.vertices).convex_hull.buffer(r.radius) for r in
                 sets.between[k]]  # fmt: skip
        area = shapely.union_all(hulls)
        shapely.prepare(area)
        for step in (k * per_dt, k * per_dt + per_dt // 2, (k + 1) * per_dt):
            there = np.flatnonzero((motion.until > step) & (breach > step))
            if step < appears or not len(there):
                continue
            corners = placed(
                outline.vertices, motion.position[step, there], motion.heading[step, there]
            )
            bodies = shapely.convex_hull(shapely.multipoints(corners))
            if outline.radius > 0.0:
                bodies = shapely.buffer(bodies, outline.radius)
            # Corners decide: each of them lies in one of the sets, up to rounding.
            points = shapely.points(shapely.get_coordinates(bodies))
            apart = shapely.distance(area, points) > 1e-6 + 0.001 * outline.radius
            owner = shapely.get_coordinates(bodies, return_index=True)[1]
            outside += len(np.unique(owner[apart]))
            looked += len(there)
    return outside, looked


@pytest.mark.parametrize("name", ["merge", "recorded-ego", "roadworks"])
def test_shipped_scenarios(name: str) -> None:
    outside, looked = escapes(load(examples()[name]), 24)
    assert outside == 0
    assert looked > 3000


def test_wide_steps_on_a_motorway(shared: Path) -> None:
    """Here a lane change that crossed a border within a step once left its set."""
    scene = load(shared / "data/scenarios/DEU_LocationALower-11_10_T-1.xml")
    assert scene.dt == pytest.approx(0.2)
    assert escapes(scene, 40)[0] == 0


def test_smaller_sets_are_left() -> None:
    scene = load(examples()["merge"])
    for bound in ({"max_acceleration": 11.0}, {"max_lateral_speed": 2.0}):
        less = Settings(assumptions=replace(OPEN.assumptions, **bound))
        assert escapes(scene, 24, less)[0] > 0


MILD = Settings(assumptions=replace(OPEN.assumptions, max_braking=5.0, max_driving=3.0))
"""Others that brake with 5 and drive with 3 m/s^2 at most, and steer with 12."""


@pytest.mark.parametrize("name", ["merge", "recorded-ego", "highway-dense"])
def test_who_brakes_and_drives_within_bounds_of_their_own(name: str) -> None:
    scene = load(examples()[name])
    outside, looked = escapes(scene, 24, MILD, MILD)
    assert outside == 0
    assert looked > 3000


@pytest.mark.parametrize("settings", [OPEN, MILD], ids=["open", "mild"])
def test_on_a_straight_road_where_sets_have_a_closed_form(settings: Settings) -> None:
    others = (
        car(1, -60.0, -1.75, speed=15.0),
        car(2, -120.0, 1.75, speed=25.0),
        car(3, -100.0, 2.4, 0.05, 8.0),
        car(4, -40.0, 1.0, -0.1, 0.0),
    )
    scene = two_lanes(*others)
    assert StraightRoad.of(scene.lanelets, 10.0) is not None
    outside, looked = escapes(scene, 80, settings, settings)
    assert outside == 0
    assert looked > 3000


def test_each_bound_is_what_holds_them() -> None:
    """Predicted with a little less of either bound, they leave their sets."""
    scene = load(examples()["highway-dense"])
    for bound in ({"max_braking": 3.0}, {"max_driving": 2.0}):
        less = Settings(assumptions=replace(MILD.assumptions, **bound))
        assert escapes(scene, 24, less, MILD)[0] > 0


@pytest.mark.soundness
@pytest.mark.parametrize("name", [n for n in examples() if n != "nothing-safe"])
def test_many_that_brake_and_drive_within_bounds(name: str) -> None:
    assert escapes(load(examples()[name]), 400, MILD, MILD)[0] == 0


@pytest.mark.soundness
@pytest.mark.parametrize("name", [n for n in examples() if n != "nothing-safe"])
def test_many(name: str) -> None:
    assert escapes(load(examples()[name]), 400)[0] == 0
