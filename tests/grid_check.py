"""Whether a trajectory of the grid search is what it claims to be: by shapely, in the plane.

Shares nothing with the search but the data: bodies are polygons in the plane, what they cover
between two instants is a convex hull, and the formula is evaluated on the letters of the trace.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

from grid_search import Found
from grid_world import NOT_FOLLOWED, Body, World
from sandra.logic import Atom, Comparison, Specification
from sandra.logic.evaluate import evaluate
from sandra.logic.formula import atoms_of
from sandra.scene.types import Region

Array = np.ndarray
TOLERANCE = 1e-7
"""Numbers and distances count as kept up to this."""
INSTANTS = 16
"""So many parts of a step are checked, with all that the body covers within each."""


def shape(region: Region) -> shapely.Geometry:
    body = shapely.MultiPoint(region.vertices).convex_hull
    return body.buffer(region.radius, quad_segs=64) if region.radius > 0.0 else body


def fault(world: World, spec: Specification, found: Found) -> str | None:
    """What is wrong with a trajectory under the world's `body`; None if nothing is."""
    return (
        _wrong_motion(world, found)
        or _wrong_place(world, found)
        or (None if evaluate(spec.formula, letters(world, spec, found)) else "formula")
    )


def _wrong_motion(world: World, found: Found) -> str | None:
    values, dt = world.settings, world.drawn.scene.dt
    if not np.allclose(found.states[0], world.start(), atol=TOLERANCE):
        return "initial state"
    a, b = found.inputs.T
    if a.min() < values.a_lon_min - TOLERANCE or a.max() > values.a_lon_max + TOLERANCE:
        return "acceleration along the lane"
    if np.abs(b).max() > values.a_lat_max + TOLERANCE:
        return "acceleration across the lane"
    for (now, after), inputs in zip(pairwise(found.states), found.inputs, strict=True):
        if not np.allclose(moved(now, inputs, dt), after, atol=TOLERANCE):
            return "motion"
    v, w = found.states[:, 1], found.states[:, 3]
    if v.min() < -TOLERANCE or v.max() > values.v_max + TOLERANCE:
        return "speed along the lane"
    return "speed across the lane" if np.abs(w).max() > values.v_lat_max else None


def moved(state: Array, inputs: Array, time: float) -> Array:
    s, v, d, w = state
    a, b = inputs
    return np.array(
        [s + v * time + a * time**2 / 2, v + a * time, d + w * time + b * time**2 / 2, w + b * time]
    )


def body_at(
    world: World, state: Array, first: bool = False, slip: float | None = None
) -> shapely.Polygon:
    """The ego's rectangle in the plane; it points where it moves, turned by `slip`; if none is
    given, turned towards the road's direction as far as the lateral acceleration allows."""
    ego, road = world.drawn.scene.ego, world.drawn.road
    s, v, d, w = state
    course = float(np.arctan2(w, v)) if np.hypot(v, w) > 1e-9 else 0.0
    if slip is None:
        slip = -float(np.clip(course, -most_slip(world, state), most_slip(world, state)))
    heading = ego.state.heading if first else road.angle + course + slip
    x, y = road.at(s, d)
    return shapely.Polygon(ego.outline.placed(float(x), float(y), heading).vertices)


def most_slip(world: World, state: Array) -> float:
    """asin(l_r a_lat / v^2), the slip angle of a single-track model at its centre [rad]."""
    grip = world.drawn.scene.ego.wheelbase / 2 * world.settings.a_lat_max
    speed2 = state[1] ** 2 + state[3] ** 2
    return float(np.arcsin(grip / speed2)) if speed2 > grip else np.pi / 2


def _wrong_place(world: World, found: Found) -> str | None:
    scene, road, prediction = world.drawn.scene, world.drawn.road, world.prediction
    tarmac = shapely.union_all([x.area() for x in scene.lanelets]).buffer(TOLERANCE)

    def hit(body: shapely.Geometry, regions: list[Region]) -> bool:
        smaller = body.buffer(-TOLERANCE)
        return any(shape(region).intersects(smaller) for region in regions)

    for k, state in enumerate(found.states):
        body = body_at(world, state, first=k == 0)
        if world.body is Body.DISC:
            centre = shapely.Point(*road.at(state[0], state[2]))
            body = centre.buffer(scene.ego.width / 2, quad_segs=64)
        if not tarmac.covers(body):
            return f"road at step {k}"
        if hit(body, [r for o in prediction.obstacles for r in o.at[k]]):
            return f"collision at step {k}"
    if world.body is not Body.FULL:
        return None
    for k, inputs in enumerate(found.inputs):
        times = np.linspace(0.0, scene.dt, INSTANTS + 1)
        bodies = [
            body_at(world, moved(found.states[k], inputs, t), first=k == 0 and t == 0.0)
            for t in times
        ]
        regions = [r for o in prediction.obstacles for r in o.between[k]]
        for before, after in pairwise(bodies):
            swept = shapely.union(before, after).convex_hull
            if not tarmac.covers(swept):
                return f"road after step {k}"
            if hit(swept, regions):
                return f"collision after step {k}"
    return None


def letters(world: World, spec: Specification, found: Found) -> list[dict[Atom, bool]]:
    """The letters of the trace: the last one carries the acceleration of the last step."""
    inputs = [*found.inputs, found.inputs[-1]]
    return [
        {atom: _truth(world, atom, k, state, a[0]) for atom in atoms_of(spec.formula)}
        for k, (state, a) in enumerate(zip(found.states, inputs, strict=True))
    ]


def _truth(world: World, atom: Atom, k: int, state: Array, acceleration: float) -> bool:
    if isinstance(atom, Comparison):
        return atom.holds(
            {"s": state[0], "v": state[1], "d": state[2], "a": acceleration}[atom.variable]
        )
    match atom.name:
        case "in_lane":
            return any(
                _area(world, relation).intersects(body.buffer(TOLERANCE))
                for relation in [atom.argument]
                for body in _bodies(world, k, state)
            )
        case "keeps_safe_distance":
            return _keeps_distance(world, k, state)
        case "keeps_lane_speed_limit":
            limit = world.drawn.scene.current.speed_limits[0]
            return limit is None or bool(state[1] <= limit + TOLERANCE)
    raise AssertionError(f"no truth of {atom}")


def _bodies(world: World, k: int, state: Array) -> list[shapely.Polygon]:
    """The body; for the disc that stands for any of them, bodies with several angles of slip."""
    if k == 0 or world.body is not Body.DISC:
        return [body_at(world, state, first=k == 0)]
    most = most_slip(world, state)
    return [body_at(world, state, slip=slip) for slip in np.linspace(-most, most, 65)]


def _area(world: World, relation: str | None) -> shapely.Geometry:
    return shapely.union_all(
        [
            shapely.Polygon(x.polygon).buffer(0)
            for x in world.drawn.scene.lanes
            if x.relation == relation
        ]
    )


def _keeps_distance(world: World, k: int, state: Array) -> bool:
    scene, values, road = world.drawn.scene, world.settings, world.drawn.road
    body: shapely.Geometry = body_at(world, state, first=k == 0)
    if world.body is Body.DISC:
        centre = shapely.Point(*road.at(state[0], state[2]))
        body = centre.buffer(scene.ego.width / 2, quad_segs=64)
    front = state[0] + scene.ego.length / 2
    for relation in ("current", "left", "right", "opposite"):
        area = _area(world, relation)
        if not area.buffer(-TOLERANCE).intersects(body):
            continue
        ahead = []
        for each in world.prediction.obstacles:
            row = each.states[k]
            if each.obstacle.kind in NOT_FOLLOWED or not np.isfinite(row[:4]).all():
                continue
            outline = each.obstacle.outline.placed(*row[:3])
            if area.intersects(shape(outline)):
                rear = min(road.along(*p)[0] for p in outline.vertices) - outline.radius
                if rear > front:
                    ahead.append((rear, max(0.0, row[3] * np.cos(row[2] - road.angle))))
        if ahead:
            rear, speed = min(ahead)
            needed = (
                state[1] ** 2 / (2 * abs(values.a_min))
                - speed**2 / (2 * abs(values.a_obs_min))
                + state[1] * values.t_d
            )
            if rear - front <= needed - TOLERANCE:
                return False
    return True
