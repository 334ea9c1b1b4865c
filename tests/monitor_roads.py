"""Recordings on a road of parallel lanes, for the monitor and for conformance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from reach_scenes import Course
from sandra.certificate.atoms import Trace
from sandra.certificate.geometry import Reference, bodies, by_id
from sandra.certificate.types import RELATIONS, Body, Certificate, LaneOf, Participant, Pavement
from sandra.scene.types import Obstacle, Scene

DT = 0.2


def rows(
    course: Course, s: Any, d: Any = 0.0, speed: Any = 10.0, turn: Any = 0.0, a: Any = 0.0
) -> np.ndarray:
    """(n, 5) states at s along and d to the left, turned against the road by `turn`."""
    s, d, speed, turn, a = np.broadcast_arrays(
        *(np.asarray(x, float) for x in (s, d, speed, turn, a))
    )
    heading = np.array([course.heading(float(x)) for x in s]) + turn
    return np.column_stack([course.at(s, d), heading, speed, a])


def recording(
    course: Course, ego: np.ndarray, others: Sequence[Obstacle] = (), **options: Any
) -> Scene:
    """A scene whose recorded ego is `ego`; obstacles carry their `states`."""
    lanes = course.lanes(1, 1, end=400.0, **options)
    return replace(course.scene(lanes, others, dt=DT), recorded_ego=ego)


def car(course: Course, number: int, states: np.ndarray, **options: Any) -> Obstacle:
    """A car with its recording."""
    return replace(course.car(number, 0.0, 0.0, **options), states=states)


def as_trace(scene: Scene, base: Certificate) -> Trace:
    """The recording as the certificate's atoms see it; `base` lends what they do not look at."""
    states = scene.recorded_ego
    assert states is not None

    def known(o: Obstacle) -> np.ndarray:
        found = np.full((len(states), 5), np.nan)
        if o.states is not None:
            found[: len(o.states)] = o.states[: len(states)]
        return found

    others = tuple(
        Participant(o.id, o.kind, o.outline, o.is_static, known(o), (), ()) for o in scene.obstacles
    )
    certificate = replace(
        base,
        dt=scene.dt,
        ego=Body(scene.ego.id, scene.ego.length, scene.ego.width, scene.ego.wheelbase),
        lanes=tuple(LaneOf(x.relation, x.lanelets) for x in scene.lanes if x.relation in RELATIONS),
        lanelets=tuple(Pavement(x.id, x.left, x.right, x.speed_limit) for x in scene.lanelets),
        reference=scene.frame.line,
        obstacles=others,
    )
    return Trace(
        certificate,
        states,
        bodies(states, certificate.ego),
        Reference.of(certificate.reference),
        by_id(certificate.lanelets),
    )


def collided(scene: Scene) -> np.ndarray:
    """(n,) whether the ego's body touches another at a step."""
    states = scene.recorded_ego
    assert states is not None
    found = np.zeros(len(states), dtype=bool)
    for o in scene.obstacles:
        assert o.states is not None
        for k, (ours, theirs) in enumerate(zip(states, o.states, strict=False)):
            if np.isfinite(theirs).all():
                a, b = scene.ego.outline.placed(*ours[:3]), o.outline.placed(*theirs[:3])
                found[k] |= shapely.Polygon(a.vertices).intersects(shapely.Polygon(b.vertices))
    return found
