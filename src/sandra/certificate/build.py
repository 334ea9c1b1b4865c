"""From what a decision has computed to a certificate. Nothing is judged here."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from sandra.certificate.types import (
    RELATIONS,
    Body,
    Certificate,
    LaneOf,
    Occupancies,
    Participant,
    Pavement,
)
from sandra.errors import CertificateError
from sandra.logic import Predicate, Specification, Vocabulary
from sandra.logic.formula import atoms_of
from sandra.planning.types import Trajectory
from sandra.prediction.types import PredictedObstacle, Prediction
from sandra.scene.types import Lanelet, Region, Scene
from sandra.settings import Settings

Array = NDArray[np.float64]

NEAR = 50.0
"""Lanelets so far around the box of both trajectories belong to the road area [m]."""
ROUNDING = 1e-30
"""Smaller numbers are 0 [m, rad, m/s, ...]."""


def certificate(
    scene: Scene,
    specification: Specification,
    rules: Sequence[str],
    prediction: Prediction,
    set_based: Prediction,
    witness: Trajectory,
    t_dec: float,
    fail_safe: Trajectory,
    settings: Settings,
    *,
    vocabulary: Vocabulary | None = None,
    note: str = "",
) -> Certificate:
    """Put together the certificate of one decision.

    Args:
        specification: that of the pair under `rules`.
        rules: names of rules, or formulas, as they were asked for.
        prediction: the one that the witness was checked with.
        set_based: the set-based one, over a horizon that covers the fail-safe trajectory.
        witness: from time 0 to the horizon of `prediction`.
        t_dec: when the next decision is due [s].
        fail_safe: from `t_dec` to a standstill.
        vocabulary: the one that `specification` was made with, if not the packaged one.
        note: words to keep with it, e.g. when it was made.

    Raises:
        CertificateError: if the two predictions are of different participants.
    """
    ego, state = scene.ego, scene.ego.state
    initial = [state.x, state.y, state.heading, state.speed, state.steering_angle]
    lanes = tuple(
        LaneOf(lane.relation, lane.lanelets) for lane in scene.lanes if lane.relation in RELATIONS
    )
    # After a merge the incoming lane is the ego's own: traffic follows, no conflict remains.
    own = {i for lane in lanes if lane.relation != "opposite" for i in lane.lanelets}
    incoming = {i for lane in scene.incoming for i in lane.lanelets} - own
    limits = {
        i: limit
        for lane in scene.lanes
        for i, limit in zip(lane.lanelets, lane.speed_limits, strict=True)
    }
    # A formula may speak of lanelets anywhere in the map.
    named = {
        atom.argument
        for atom in atoms_of(specification.formula)
        if isinstance(atom, Predicate) and atom.name == "in_lanelet"
    }
    of_lanes = {i for lane in lanes for i in lane.lanelets}
    # Nothing is said about what comes after the end of the fail-safe trajectory.
    steps = max(1, math.ceil(fail_safe.end / scene.dt - 1e-6))
    points = np.vstack([witness.states[:, :2], fail_safe.states[:, :2]])
    kept = [
        lanelet
        for lanelet in scene.lanelets
        if lanelet.id in of_lanes or str(lanelet.id) in named or _near(lanelet, points)
    ]
    return Certificate(
        scenario=scene.name,
        dt=scene.dt,
        horizon=prediction.horizon,
        ego=Body(ego.id, ego.length, ego.width, ego.wheelbase),
        initial=_array(initial),
        pair=specification.pair,
        rules=tuple(rules),
        formula=str(specification.formula),
        parts=tuple((part.name, part.text) for part in specification.parts),
        lanes=lanes,
        lanelets=_pavements(kept, limits),
        reference=_array(scene.frame.line),
        conflicts=_pavements((x for x in scene.lanelets if x.id in incoming), limits),
        obstacles=_participants(prediction, set_based, steps),
        prediction=prediction.kind,
        set_based=set_based.kind,
        notes=tuple(dict.fromkeys((*prediction.notes, *set_based.notes))),
        witness=_trajectory(witness),
        t_dec=float(t_dec),
        fail_safe=_trajectory(fail_safe),
        settings=settings,
        vocabulary=_own(vocabulary),
        note=note,
        versions=versions(),
    )


def versions() -> Mapping[str, str]:
    """Versions of what computes and checks certificates."""
    names = ("sandra", "numpy", "shapely")
    found = {"python": platform.python_version(), **{n: metadata.version(n) for n in names}}
    return MappingProxyType(found)


def _near(lanelet: Lanelet, points: Array) -> bool:
    low, high = points.min(axis=0) - NEAR, points.max(axis=0) + NEAR
    border = np.vstack([lanelet.left, lanelet.right])
    return bool((border.max(axis=0) >= low).all() and (border.min(axis=0) <= high).all())


def _pavements(
    lanelets: Iterable[Lanelet], limits: Mapping[int, float | None]
) -> tuple[Pavement, ...]:
    return tuple(
        Pavement(x.id, _array(x.left), _array(x.right), limits.get(x.id, x.speed_limit))
        for x in lanelets
    )


def _participants(
    prediction: Prediction, set_based: Prediction, steps: int
) -> tuple[Participant, ...]:
    possible = {each.obstacle.id: each for each in set_based.obstacles}
    ids = sorted(each.obstacle.id for each in prediction.obstacles)
    if ids != sorted(each.obstacle.id for each in set_based.obstacles) or len(ids) != len(possible):
        raise CertificateError(
            "the two predictions are not of the same participants: predict both from one scene"
        )
    return tuple(
        _participant(each, possible[each.obstacle.id], steps) for each in prediction.obstacles
    )


def _participant(likely: PredictedObstacle, possible: PredictedObstacle, steps: int) -> Participant:
    obstacle = likely.obstacle
    return Participant(
        id=obstacle.id,
        kind=obstacle.kind,
        outline=_region(obstacle.outline),
        is_static=obstacle.is_static,
        states=_array(likely.states),
        likely=_occupancies(likely.between),
        possible=_occupancies(possible.between[:steps]),
        assumptions=possible.assumptions,
        dropped=possible.dropped,
        basis=likely.assumptions,
    )


def _occupancies(regions: Occupancies) -> Occupancies:
    """The regions as they are: there are too many of them to be copied without need."""
    found = [region.vertices for step in regions for region in step]
    if not found or not _tiny(np.concatenate(found)).any():
        return regions
    return tuple(tuple(_region(region) for region in step) for step in regions)


def _region(region: Region) -> Region:
    return Region(_array(region.vertices), float(region.radius))


def _trajectory(trajectory: Trajectory) -> Trajectory:
    return Trajectory(
        _array(trajectory.states),
        _array(trajectory.inputs).reshape(-1, 2),
        float(trajectory.tau),
        float(trajectory.start),
    )


def _array(values: object) -> Array:
    """A read-only copy; what is so small that it can only come from rounding becomes 0."""
    copy = np.array(values, dtype=np.float64)
    copy[_tiny(copy)] = 0.0
    copy.setflags(write=False)
    return copy


def _tiny(values: Array) -> NDArray[np.bool_]:
    return np.asarray((np.abs(values) < ROUNDING) & (values != 0.0))


def _own(vocabulary: Vocabulary | None) -> Mapping[str, Mapping[str, str]] | None:
    if vocabulary is None or vocabulary == Vocabulary.default():
        return None
    texts = {
        "actions": MappingProxyType(dict(vocabulary.actions)),
        "rules": MappingProxyType(dict(vocabulary.rules)),
        "predicates": MappingProxyType(dict(vocabulary.predicates)),
    }
    return MappingProxyType(texts)
