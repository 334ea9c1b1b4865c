"""Condition `occupancies`: the predictions are not smaller than they say.

A full proof that regions hold everything that the assumptions allow is the predictor's business.
Here a few behaviours that are allowed for sure are played, and each body must lie within the
regions: staying where it is (static objects), the most likely trajectory (in its own prediction),
and going straight on with the strongest braking, without, and with the strongest acceleration, for
as long as the body stays within the lanelet it is in (in the set-based prediction).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.certificate.geometry import Shapes, convex, hulls, outlines
from sandra.certificate.report import Checked, Violation
from sandra.certificate.types import Certificate, Participant
from sandra.scene.types import Region

Array = NDArray[np.float64]

SLACK = 0.05
"""A body may stick out of its regions by so much [m]."""
TRAJECTORIES = ("recorded", "most-likely", "constant-velocity")
"""Kinds of prediction that are one trajectory each."""
VEHICLES = frozenset({"car", "truck", "bus", "taxi", "motorcycle", "priorityVehicle"})
"""Kinds that drive on lanes, as CommonRoad spells them."""
ALONG = math.radians(30.0)
"""A vehicle whose heading leaves its lanelet's by more is not played."""


class _Played(NamedTuple):
    """A place that a body may be at: `regions` must hold it.

    `within`: the lanelet that it must not leave, or it is not allowed for sure; None: it is.
    """

    obstacle: int
    kind: str
    interval: int
    regions: tuple[Region, ...]
    body: Any
    within: Any = None


def occupancies(c: Certificate) -> Checked | Violation:
    """No region is too small for behaviour that is allowed for sure."""
    played = [each for obstacle in c.obstacles for each in _trajectory(c, obstacle)]
    played += _standing_still(c) + _straight_on(c)
    shapes = np.array([each.body for each in played], dtype=object)
    homes = [each.within for each in played]
    allowed = np.array([home is None for home in homes], dtype=np.bool_)
    bound = np.flatnonzero(~allowed)
    allowed[bound] = shapely.covers([homes[i] for i in bound], shapes[bound])
    played = [played[i] for i in np.flatnonzero(allowed)]
    held = _held([each.regions for each in played], shapes[allowed])
    if not held.all():
        found = played[int(np.argmin(held))]
        return Violation(
            "occupancies",
            f"obstacle {found.obstacle}: its region in the {found.kind} prediction, interval "
            f"{found.interval}, does not hold a body that its assumptions allow there",
            found.interval,
            found.interval * c.dt,
        )
    return Checked("occupancies", f"{len(played)} allowed places of others lie in their regions")


def _trajectory(c: Certificate, o: Participant) -> Iterator[_Played]:
    """The most likely trajectory, where the prediction is one."""
    if c.prediction not in TRAJECTORIES or "recorded occupancies" in o.basis:
        return
    there = np.isfinite(o.states[:, 0])
    placed = np.full(len(o.states), None, dtype=object)
    placed[there] = _placed(o.outline, o.states[there, :3])
    for k in range(c.horizon):
        for body in placed[k : k + 2]:
            if body is not None:
                yield _Played(o.id, c.prediction, k, o.likely[k], body)


def _standing_still(c: Certificate) -> list[_Played]:
    """Static obstacles, where they are."""
    return [
        _Played(o.id, c.set_based, k, o.possible[k], body)
        for o in c.obstacles
        if o.is_static and np.isfinite(o.states[0, 0])
        for body in _placed(o.outline, o.states[:1, :3])
        for k in _some(len(o.possible))
    ]


def _some(steps: int) -> list[int]:
    """Intervals 0, 1, 2, 4, 8, ... and the last."""
    powers = [0, *(1 << i for i in range(20))]
    return sorted({k for k in powers if k < steps} | ({steps - 1} if steps else set()))


def _straight_on(c: Certificate) -> list[_Played]:
    """Vehicles that go straight on in the lanelet that holds them."""
    driving = [
        o
        for o in c.obstacles
        if o.kind in VEHICLES
        and not o.is_static
        and not {"no_rear_end", "legal_cut_in"} & set(o.assumptions)
        and np.isfinite(o.states[0, 0])
        and o.states[0, 3] >= 0.0
    ]
    areas = outlines(c.lanelets)
    courses = np.array([_mean_heading(x.left) for x in c.lanelets])
    now = [_placed(o.outline, o.states[:1, :3])[0] for o in driving]
    inside = shapely.covers(areas[None, :], np.array(now, dtype=object)[:, None])
    headings = np.array([o.states[0, 2] for o in driving])
    turned = courses - headings[:, None]
    turned = np.abs(turned - 2 * np.pi * np.round(turned / (2 * np.pi)))
    a = c.settings.assumptions
    found = []
    for o, homes in zip(driving, inside & (turned <= ALONG), strict=True):
        if not homes.any():
            continue
        home = areas[int(np.argmax(homes))]
        x, y, heading, speed = o.states[0, :4].tolist()
        slower = faster = a.max_acceleration
        if "max_braking" in o.assumptions:
            slower = min(slower, a.max_braking)
        if "max_driving" in o.assumptions:
            faster = min(faster, a.max_driving)
        plays = [(k, p) for k in _some(len(o.possible)) for p in (-slower, 0.0, faster)]
        way = [_travelled(speed, p, max(a.max_speed, speed), (k + 1) * c.dt) for k, p in plays]
        rows = [(x + s * math.cos(heading), y + s * math.sin(heading), heading) for s in way]
        for (k, _), body in zip(plays, _placed(o.outline, np.array(rows)), strict=True):
            found.append(_Played(o.id, c.set_based, k, o.possible[k], body, home))
    return found


def _travelled(speed: float, acceleration: float, top: float, time: float) -> float:
    """Way in `time` at constant acceleration until the speed is 0 or `top`, from there at that."""
    if acceleration == 0.0:
        return speed * time
    end = 0.0 if acceleration < 0.0 else top
    until = min(time, (end - speed) / acceleration)
    return speed * until + acceleration * until**2 / 2 + end * (time - until)


def _mean_heading(line: Array) -> float:
    dx, dy = line[-1] - line[0]
    return math.atan2(dy, dx)


def _placed(outline: Region, poses: Array) -> Shapes:
    """(n,) the outline at poses (n, 3) x, y, heading."""
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turned = np.stack([cosine, sine, -sine, cosine], axis=1).reshape(-1, 2, 2)
    shapes = hulls(outline.vertices @ turned + poses[:, None, :2])
    return np.atleast_1d(shapely.buffer(shapes, outline.radius)) if outline.radius > 0.0 else shapes


def _held(regions: list[tuple[Region, ...]], shapes: Shapes) -> NDArray[np.bool_]:
    """(n,) whether the union of regions i holds shape i, but for `SLACK`."""
    # Many shapes are looked for in the same regions.
    different = {id(several): several for several in regions}
    place = {key: i for i, key in enumerate(different)}
    sizes = np.array([len(several) for several in different.values()], dtype=int)
    begin = np.cumsum([0, *sizes])
    hulls, radii = convex(region for several in different.values() for region in several)
    mine = np.array([place[id(several)] for several in regions], dtype=int)
    owner = np.repeat(np.arange(len(shapes)), sizes[mine])
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(sizes[mine]) - sizes[mine], sizes[mine])
    held = np.zeros(len(shapes), dtype=np.bool_)
    # Mostly one region holds the body as it is, and no shape has to be widened or united.
    chosen = begin[mine[owner]] + rank
    np.logical_or.at(held, owner, _within(radii[chosen], hulls[chosen], shapes[owner]))
    for i in np.flatnonzero(~held):
        part = slice(begin[mine[i]], begin[mine[i] + 1])
        union = shapely.union_all(shapely.buffer(hulls[part], radii[part] + SLACK))
        held[i] = bool(shapely.covers(union, shapes[i]))
    return held


def _within(radii: Array, hulls: Shapes, shapes: Shapes) -> NDArray[np.bool_]:
    """(n,) whether convex shapes are within a radius of convex hulls: all their corners are."""
    points, owner = shapely.get_coordinates(shapes, return_index=True)
    near = np.asarray(shapely.intersects_xy(hulls[owner], points[:, 0], points[:, 1]))
    outside = np.flatnonzero(~near & (radii[owner] > 0.0))
    near[outside] = _distances(points[outside], hulls[owner[outside]]) <= radii[owner[outside]]
    corners = np.bincount(owner, minlength=len(shapes))
    held = np.bincount(owner[near], minlength=len(shapes))
    return np.asarray((held == corners) & (corners > 0))


def _distances(points: Array, shapes: Shapes) -> Array:
    """(n,) of points (n, 2) from shapes (n,) [m]; those that are points themselves, by hand."""
    found = np.empty(len(points))
    single = shapely.get_type_id(shapes) == shapely.GeometryType.POINT
    centres = np.column_stack([shapely.get_x(shapes[single]), shapely.get_y(shapes[single])])
    found[single] = np.hypot(*(points[single] - centres).T)
    found[~single] = shapely.distance(shapely.points(points[~single]), shapes[~single])
    return found
