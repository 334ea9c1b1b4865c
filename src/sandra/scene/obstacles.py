"""Other traffic participants: from commonroad-io's obstacles to `Obstacle`.

commonroad-io objects are typed `Any`: the library has no type information.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.errors import ScenarioError
from sandra.scene.convex import hull
from sandra.scene.types import Obstacle, Region, State

Array = NDArray[np.float64]

_EGO_POSITION = 0.5
"""A recording that starts this close to the ego's initial position may be the ego's [m]."""
_EGO_SPEED = 0.5
"""... with a speed that differs by less than this [m/s]."""
_EGO_HEADING = 0.2
"""... and a heading that differs by less than this [rad]."""


def regions_of(occupancy: Any) -> tuple[Region, ...]:
    """The convex regions of a commonroad-io occupancy; a non-convex polygon becomes its hull."""
    if hasattr(occupancy, "occupancies"):
        return tuple(region for part in occupancy.occupancies for region in regions_of(part))
    if hasattr(occupancy, "circle_center"):
        centre = np.array([[occupancy.circle_center.x, occupancy.circle_center.y]])
        return (Region(centre, float(occupancy.radius)),)
    return (Region(hull(np.array(occupancy.vertices))),)


def region_of(occupancy: Any) -> Region:
    """One convex region around a commonroad-io occupancy: the hull of its parts."""
    return _around(regions_of(occupancy))


def _around(regions: tuple[Region, ...]) -> Region:
    """One convex region that contains them all; discs in a group count as circumscribed 16-gons."""
    if len(regions) == 1:
        return regions[0]
    angles = np.arange(16) * (2 * np.pi / 16)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1) / math.cos(math.pi / 16)
    points = [
        (region.vertices[:, None, :] + region.radius * ring[None]).reshape(-1, 2)
        if region.radius > 0
        else region.vertices
        for region in regions
    ]
    return Region(hull(np.vstack(points)))


def _outline(shape: Any) -> tuple[Region, Array]:
    """The outline around the centre of its bounding box, and that centre in the file's frame."""
    from commonroad.scenario.state import InitialState

    origin = InitialState(
        time_step=0, position=np.zeros(2), orientation=0.0, velocity=0.0, acceleration=0.0
    )
    region = region_of(shape.compute_occupancy_for_state(origin))
    low, high = region.vertices.min(axis=0), region.vertices.max(axis=0)
    centre = (low + high) / 2
    return Region(region.vertices - centre, region.radius), centre


def number(value: Any) -> float:
    """An exact value, or the centre of an interval; NaN if there is none."""
    if value is None:
        return math.nan
    if hasattr(value, "start"):
        return (float(value.start) + float(value.end)) / 2
    return float(value)


def point(position: Any) -> tuple[Array, float]:
    """An exact position, or the centre of an uncertain one and how far it reaches [m]."""
    if position is None:
        return np.full(2, np.nan), 0.0
    if hasattr(position, "shapely_object"):
        region = region_of(position)
        centre = (region.vertices.min(axis=0) + region.vertices.max(axis=0)) / 2
        reach = np.linalg.norm(region.vertices - centre, axis=1).max() + region.radius
        return centre, float(reach)
    return np.asarray(position, dtype=float)[:2], 0.0


def _row(state: Any, offset: Array) -> Array:
    """x, y, heading, speed, acceleration of the body's centre; NaN where a value is absent."""
    centre, _ = point(getattr(state, "position", None))
    heading = number(getattr(state, "orientation", None))
    speed = number(getattr(state, "velocity", None))
    across = number(getattr(state, "velocity_y", None))
    if math.isnan(heading):
        # A point-mass state gives the velocity in the plane instead of speed and heading.
        heading = math.atan2(across, speed) if not math.isnan(across) else math.nan
        speed = math.hypot(across, speed) if not math.isnan(across) else speed
    acceleration = number(getattr(state, "acceleration", None))
    if offset.any() and not math.isnan(heading):
        c, s = math.cos(heading), math.sin(heading)
        centre = centre + np.array([c * offset[0] - s * offset[1], s * offset[0] + c * offset[1]])
    return np.array([*centre, heading, speed, acceleration])


def _uncertainty(state: Any, outline: Region) -> float:
    """How far the body can lie outside the outline at the centre of an uncertain state [m]."""
    _, reach = point(getattr(state, "position", None))
    orientation: Any = getattr(state, "orientation", None)
    if hasattr(orientation, "start"):
        swing = min(math.pi, (float(orientation.end) - float(orientation.start)) / 2)
        farthest = float(np.linalg.norm(outline.vertices, axis=1).max()) + outline.radius
        reach += 2 * math.sin(swing / 2) * farthest
    return reach


def _step(state: Any) -> int:
    return math.floor(number(state.time_step))


def static_obstacle(obstacle: Any) -> Obstacle:
    """A commonroad-io StaticObstacle: it stands where it is, for ever."""
    outline, offset = _outline(obstacle.obstacle_shape)
    row = _finite(_row(obstacle.initial_state, offset), obstacle.obstacle_id)
    spread = _uncertainty(obstacle.initial_state, outline)
    return Obstacle(
        id=obstacle.obstacle_id,
        kind=_kind(obstacle),
        outline=replace(outline, radius=outline.radius + spread),
        state=State(x=row[0], y=row[1], heading=row[2], speed=0.0),
        is_static=True,
    )


def environment_obstacle(obstacle: Any) -> Obstacle:
    """A commonroad-io EnvironmentObstacle (building, ...): its outline stands in the plane."""
    return _standing(obstacle.obstacle_id, _kind(obstacle), region_of(obstacle.occupancy))


def _standing(id: int, kind: str, region: Region) -> Obstacle:
    x, y = (region.vertices.min(axis=0) + region.vertices.max(axis=0)) / 2
    outline = Region(region.vertices - np.array([x, y]), region.radius)
    return Obstacle(id, kind, outline, State(float(x), float(y), 0.0, 0.0), is_static=True)


def phantom_obstacle(obstacle: Any, first: int) -> Obstacle | None:
    """A commonroad-io PhantomObstacle: a set of places that may be occupied; None if empty."""
    occupancies = _occupancies(obstacle.prediction, first, ())
    present = [regions for regions in occupancies if regions]
    if not present:
        return None
    body = _standing(obstacle.obstacle_id, "unknown", _around(present[0]))
    return replace(body, is_static=False, occupancies=occupancies, speed_is_known=False)


def dynamic_obstacle(
    obstacle: Any, first: int, dt: float, given: Collection[str] | None = None
) -> Obstacle | None:
    """A commonroad-io DynamicObstacle, seen from time step `first`; None if it is gone by then.

    An obstacle that appears later has NaN rows until then, and `state` is its first one. What the
    recording lacks is derived: speed and heading from positions, acceleration from speeds.

    Args:
        obstacle: the obstacle. first: the planning problem's initial time step, row 0 of `states`.
        dt: duration of a step [s]. given: names of the values that the file gives for the
            initial state (commonroad-io fills in 0 for the others); None if all are.

    Raises:
        ScenarioError: a NaN or infinite position, heading or speed.
    """
    outline, offset = _outline(obstacle.obstacle_shape)
    initial, prediction = obstacle.initial_state, obstacle.prediction
    trajectory = getattr(prediction, "trajectory", None)
    row = _finite(_row(initial, offset), obstacle.obstacle_id)
    absent = [k for k, name in _COLUMNS.items() if given is not None and name not in given]
    row[absent] = math.nan
    rows = {_step(initial): row}
    spread = _uncertainty(initial, outline)
    for state in trajectory.state_list if trajectory is not None else ():
        recorded = _row(state, offset)
        _finite(recorded[:2], obstacle.obstacle_id)
        rows.setdefault(_step(state), recorded)
        spread = max(spread, _uncertainty(state, outline))
    states: Array | None = None
    if trajectory is not None:
        if max(rows) < first:
            return None
        start = min(rows)
        every = np.full((max(rows) - start + 1, 5), np.nan)
        for step, values in rows.items():
            every[step - start] = values
        every = _derived(every, dt)
        _finite(every[~np.isnan(every[:, 0])], obstacle.obstacle_id)
        states = np.full((max(rows) - first + 1, 5), np.nan)
        states[max(0, start - first) :] = every[max(0, first - start) :]
        row = states[~np.isnan(states[:, 0])][0]
        states.setflags(write=False)
    occupancies = None
    if prediction is not None and trajectory is None:
        body = outline.placed(row[0], row[1], row[2])
        occupancies = _occupancies(prediction, first, (body,) if _step(initial) == first else ())
    x, y, heading, speed, acceleration = (float(value) for value in np.nan_to_num(row))
    return Obstacle(
        id=obstacle.obstacle_id,
        kind=_kind(obstacle),
        outline=replace(outline, radius=outline.radius + spread),
        state=State(x, y, heading, speed, acceleration),
        states=states,
        occupancies=occupancies,
        speed_is_known=3 not in absent,
    )


_COLUMNS = {3: "velocity", 4: "acceleration"}
"""Columns of a state row that commonroad-io fills with 0 where an initial state lacks them."""


def _derived(states: Array, dt: float) -> Array:
    """The same rows with speed, heading and acceleration derived where they are absent."""
    states = states.copy()
    for k in range(len(states)):
        near = k + 1 if k + 1 < len(states) else k - 1
        if near < 0:
            break
        move = (states[near, :2] - states[k, :2]) * (near - k)
        distance = float(np.hypot(*move))
        if math.isnan(states[k, 3]):
            states[k, 3] = distance / dt
        if math.isnan(states[k, 2]) and distance > 0:
            states[k, 2] = math.atan2(move[1], move[0])
    present = ~np.isnan(states[:, 0])
    states[present & np.isnan(states[:, 2]), 2] = 0.0
    states[present & np.isnan(states[:, 3]), 3] = 0.0
    for k in map(int, np.nonzero(present & np.isnan(states[:, 4]))[0]):
        near = k + 1 if k + 1 < len(states) and present[k + 1] else k - 1
        known = near >= 0 and present[near]
        states[k, 4] = (states[near, 3] - states[k, 3]) / ((near - k) * dt) if known else 0.0
    return states


def _occupancies(
    prediction: Any, first: int, now: tuple[Region, ...]
) -> tuple[tuple[Region, ...], ...]:
    """The regions per step from `first` on; `now` where step `first` itself is not recorded."""
    steps: dict[int, tuple[Region, ...]] = {}
    for time, occupancy in (prediction.occupancies if prediction is not None else {}).items():
        begin = math.floor(time.start) if hasattr(time, "start") else int(time)
        end = math.ceil(time.end) if hasattr(time, "end") else int(time)
        for step in range(begin, end + 1):
            steps[step] = steps.get(step, ()) + regions_of(occupancy)
    steps.setdefault(first, now)
    return tuple(steps.get(step, ()) for step in range(first, max(steps) + 1))


def _kind(obstacle: Any) -> str:
    return str(obstacle.obstacle_type.value) if obstacle.obstacle_type is not None else "unknown"


def _finite(rows: Array, id: int) -> Array:
    """The same rows, or a `ScenarioError` where position, heading or speed is no number."""
    if not np.isfinite(rows[..., :4]).all():
        raise ScenarioError(
            f"obstacle {id} has a state without a finite position, orientation or velocity: "
            "mend or remove it"
        )
    return rows


def split_ego(
    obstacles: tuple[Obstacle, ...], ego: State
) -> tuple[Obstacle | None, tuple[Obstacle, ...]]:
    """Take the ego's own recording out of the obstacles.

    It is the moving obstacle that starts where the ego starts (position within 0.5 m, speed within
    0.5 m/s, heading within 0.2 rad), the nearest if there are several; None if there is none.
    """

    def distance(obstacle: Obstacle) -> float:
        return math.hypot(obstacle.state.x - ego.x, obstacle.state.y - ego.y)

    def same(obstacle: Obstacle) -> bool:
        turn = (obstacle.state.heading - ego.heading + math.pi) % (2 * math.pi) - math.pi
        present = obstacle.states is None or not math.isnan(obstacle.states[0, 0])
        speed = not obstacle.speed_is_known or abs(obstacle.state.speed - ego.speed) < _EGO_SPEED
        return (
            not obstacle.is_static
            and obstacle.occupancies is None
            and present
            and distance(obstacle) < _EGO_POSITION
            and speed
            and abs(turn) < _EGO_HEADING
        )

    recorded = min(filter(same, obstacles), key=lambda o: (distance(o), o.id), default=None)
    return recorded, tuple(obstacle for obstacle in obstacles if obstacle is not recorded)
