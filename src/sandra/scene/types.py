"""The scene: what the car knows about where it is, in the lane frame and in the plane.

Everything here is plain, frozen data; `sandra.scene.commonroad` makes it from CommonRoad files.
Angles in rad (counter-clockwise), lengths in m, time in s. `d > 0` is to the left.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sandra.scene.frame import Frame

if TYPE_CHECKING:
    from pathlib import Path

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A convex polygon widened by a disc: all points within `radius` of the polygon.

    A rectangle has radius 0, a pedestrian is one vertex with its radius, a segment with a radius
    is a capsule. Fields: `vertices` (n, 2) counter-clockwise [m], n >= 1; `radius` [m].
    """

    vertices: Array
    radius: float = 0.0

    @staticmethod
    def rectangle(length: float, width: float) -> Region:
        """A rectangle centred at the origin, length along x [m]."""
        a, b = length / 2, width / 2
        return Region(np.array([[-a, -b], [a, -b], [a, b], [-a, b]]))

    @staticmethod
    def disc(radius: float) -> Region:
        """A disc centred at the origin [m]."""
        return Region(np.zeros((1, 2)), radius)

    def placed(self, x: float, y: float, heading: float) -> Region:
        """The region rotated by `heading` and moved to (x, y)."""
        c, s = np.cos(heading), np.sin(heading)
        rotation = np.array([[c, s], [-s, c]])
        return Region(self.vertices @ rotation + np.array([x, y]), self.radius)

    def vertices_at(self, poses: Array) -> Array:
        """(m, n, 2) the vertices of `placed` for poses (m, 3) x, y, heading."""
        return placed(self.vertices, poses)


def placed(vertices: Array, poses: Array) -> Array:
    """(m, n, 2) vertices (n, 2), or (m, n, 2), about the origin at poses (m, 3) x, y, heading."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    rotation = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)
    return np.asarray(vertices @ rotation + poses[:, None, :2])


@dataclass(frozen=True, slots=True)
class State:
    """A vehicle's state at one time step; the position is the centre of its body."""

    x: float
    y: float
    heading: float
    speed: float
    acceleration: float = 0.0
    steering_angle: float = 0.0
    yaw_rate: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """Another traffic participant or object.

    `kind` is CommonRoad's obstacle type in lower case ("car", "truck", "bus", "bicycle",
    "pedestrian", "parkedVehicle", "constructionZone", ..., "unknown").
    `outline` is given in the body frame. `states` holds the recording, one row per step from
    step 0: (n, 5) array x, y, heading, speed, acceleration (NaN rows where it was not seen), or
    None where there is no recording. `occupancies` holds, per step, the regions of an obstacle
    that is recorded as a set (CommonRoad SetBasedPrediction), else None.
    """

    id: int
    kind: str
    outline: Region
    state: State
    is_static: bool = False
    states: Array | None = None
    occupancies: tuple[tuple[Region, ...], ...] | None = None
    speed_is_known: bool = True

    @property
    def length(self) -> float:
        """Extent along the body axis [m]."""
        x = self.outline.vertices[:, 0]
        return float(x.max() - x.min()) + 2 * self.outline.radius

    @property
    def width(self) -> float:
        """Extent across the body axis [m]."""
        y = self.outline.vertices[:, 1]
        return float(y.max() - y.min()) + 2 * self.outline.radius


@dataclass(frozen=True, slots=True, eq=False)
class Lane:
    """Connected lanelets (paper Sec. II-A), in the direction of travel.

    `relation` to the ego: "current", "left", "right" (adjacent, same direction), "opposite"
    (adjacent, opposite direction), "incoming-left", "incoming-right" (leads into the ego's route
    or crosses it at an intersection, coming from that side), or "other".
    `left`, `right`, `center` are (n, 2) polylines [m] in the lane's own direction of travel; all
    three have the same number of points. `lanelets` are CommonRoad ids in order.
    `speed_limits[i]` is the limit that the signs give for `lanelets[i]` [m/s], None if unknown.
    """

    relation: str
    lanelets: tuple[int, ...]
    left: Array
    right: Array
    center: Array
    speed_limits: tuple[float | None, ...]
    frame: Frame
    side: str | None = None
    """For "opposite" lanes: "left" or "right" of the current lane, else None."""

    @property
    def polygon(self) -> Array:
        """The lane's outline, (2n, 2), counter-clockwise up to crossings [m]."""
        return np.vstack([self.right, self.left[::-1]])


@dataclass(frozen=True, slots=True, eq=False)
class Lanelet:
    """One lanelet of the map, for pictures and for predicates over single lanelets."""

    id: int
    left: Array
    right: Array
    kinds: tuple[str, ...]
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    adjacent_left: tuple[int, bool] | None
    """(id, same direction) or None."""
    adjacent_right: tuple[int, bool] | None
    speed_limit: float | None
    """From the signs that apply to this lanelet [m/s]; None if unknown."""
    _area: Any = field(init=False, repr=False, default=None)

    @property
    def center(self) -> Array:
        """(n, 2) centre line [m]."""
        return (self.left + self.right) / 2

    @property
    def outline(self) -> Array:
        """(2n, 2) along the right border and back along the left one [m]."""
        return np.vstack([self.right, self.left[::-1]])

    def area(self) -> Any:
        """The lanelet as a valid shapely geometry, also where its borders cross; made once."""
        return areas([self])[0]


def areas(lanelets: Sequence[Lanelet]) -> list[Any]:
    """The area of each, see `Lanelet.area`; all that are not yet known are made at once."""
    import shapely

    new = [lanelet for lanelet in lanelets if lanelet._area is None]
    if new:
        outlines = [lanelet.outline for lanelet in new]
        owner = np.repeat(np.arange(len(new)), [len(outline) for outline in outlines])
        rings = shapely.linearrings(np.concatenate(outlines), indices=owner)
        made = shapely.buffer(shapely.polygons(rings), 0.0)
        for lanelet, area in zip(new, made.tolist(), strict=True):
            object.__setattr__(lanelet, "_area", area)
    return [lanelet._area for lanelet in lanelets]


@dataclass(frozen=True, slots=True)
class TrafficLight:
    """A light that applies to the ego's route."""

    id: int
    state: str
    """"red", "yellow", "redYellow", "green", "inactive" or "unknown", at the current step."""
    distance: float
    """From the front of the ego to the stop line, or the end of its lanelet [m]."""


@dataclass(frozen=True, slots=True)
class TrafficSign:
    """A sign that applies to a lanelet of the ego's route ahead."""

    id: int
    name: str
    """CommonRoad's name in lower case, e.g. "max_speed", "yield", "stop"."""
    values: tuple[str, ...]
    distance: float
    """From the front of the ego to the start of the lanelet it applies to [m]; 0: here."""


@dataclass(frozen=True, slots=True)
class Ego:
    """The vehicle for which decisions are made."""

    id: int
    state: State
    length: float
    width: float
    wheelbase: float

    @property
    def outline(self) -> Region:
        """The body's rectangle in the body frame."""
        return Region.rectangle(self.length, self.width)


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One decision problem.

    `frame` is the curvilinear frame of the current lane; s = 0 at the start of that lane's
    centre line. `lanes` holds every lane with a relation to the ego. `recorded_ego` is the ego's
    own recording (n, 5) where the file holds one (taken out of `obstacles`), else None.
    """

    name: str
    dt: float
    ego: Ego
    lanes: tuple[Lane, ...]
    obstacles: tuple[Obstacle, ...]
    lanelets: tuple[Lanelet, ...]
    road_type: str
    """"highway", "urban", "rural", "intersection", "residential", "merge" or "unknown"."""
    country: str | None = None
    """ISO 3166 alpha-3 code, None where the file names none (ZAM is no country)."""
    weather: str | None = None
    time_of_day: str | None = None
    location: tuple[float, float] | None = None
    """Latitude and longitude of the map [degrees]; None where the file gives none."""
    lights: tuple[TrafficLight, ...] = ()
    signs: tuple[TrafficSign, ...] = ()
    goal: Region | None = None
    recorded_ego: Array | None = None
    source: Path | None = field(default=None, repr=False)

    @property
    def current(self) -> Lane:
        """The lane that the ego follows along its route."""
        return next(lane for lane in self.lanes if lane.relation == "current")

    @property
    def left(self) -> Lane | None:
        """The left-adjacent lane with the same direction, or None."""
        return next((lane for lane in self.lanes if lane.relation == "left"), None)

    @property
    def right(self) -> Lane | None:
        """The right-adjacent lane with the same direction, or None."""
        return next((lane for lane in self.lanes if lane.relation == "right"), None)

    @property
    def incoming(self) -> tuple[Lane, ...]:
        """Lanes that lead into or across the ego's route."""
        return tuple(lane for lane in self.lanes if lane.relation.startswith("incoming"))

    @property
    def opposite(self) -> tuple[Lane, ...]:
        """Adjacent lanes with the opposite direction."""
        return tuple(lane for lane in self.lanes if lane.relation == "opposite")

    @property
    def frame(self) -> Frame:
        """The curvilinear frame of the current lane."""
        return self.current.frame

    @property
    def ego_curvilinear(self) -> tuple[float, float, float, float]:
        """The ego's (s, d, heading relative to the lane, lane heading) [m, m, rad, rad]."""
        state = self.ego.state
        s, d = self.frame.to_curvilinear(np.array([[state.x, state.y]]))[0]
        lane_heading = float(self.frame.heading(np.array([s]))[0])
        relative = (state.heading - lane_heading + np.pi) % (2 * np.pi) - np.pi
        return float(s), float(d), float(relative), lane_heading

    @property
    def speed_limit(self) -> float | None:
        """The limit on the ego's current lanelet [m/s]; None if no sign applies."""
        s = self.ego_curvilinear[0]
        return self.speed_limit_at(np.array([s]))[0]

    def speed_limit_at(self, s: Array) -> tuple[float | None, ...]:
        """The limit that applies on the current lane at each s [m]; None where unknown."""
        lane = self.current
        by_id = {lanelet.id: lanelet for lanelet in self.lanelets}
        lengths = [_length(by_id[i].center) for i in lane.lanelets]
        ends = np.cumsum(lengths)
        index = np.clip(np.searchsorted(ends, s, side="right"), 0, len(lengths) - 1)
        return tuple(lane.speed_limits[int(i)] for i in index)

    def __str__(self) -> str:
        state = self.ego.state
        s, d, relative, _ = self.ego_curvilinear
        limit = self.speed_limit
        kinds = Counter(obstacle.kind for obstacle in self.obstacles)
        counts = ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items()))
        lines = [
            f"{self.name}: {self.road_type}, dt = {self.dt:g} s, {self.recorded_steps} steps",
            f"  ego {self.ego.id}: s = {s:.2f} m, d = {d:.2f} m, v = {state.speed:.2f} m/s, "
            f"a = {state.acceleration:.2f} m/s^2, heading {np.degrees(relative):+.1f} deg to lane",
            "  speed limit: " + ("unknown" if limit is None else f"{limit:.2f} m/s"),
        ]
        for lane in self.lanes:
            side = f" ({lane.side})" if lane.side else ""
            ids = " ".join(str(i) for i in lane.lanelets)
            lines.append(f"  {lane.relation}{side}: {lane.frame.length:.0f} m, lanelets {ids}")
        lines += [f"  light {x.id}: {x.state} in {x.distance:.1f} m" for x in self.lights]
        lines += [f"  sign {x.name} {' '.join(x.values)} in {x.distance:.1f} m" for x in self.signs]
        lines.append(f"  obstacles: {counts or 'none'}")
        return "\n".join(lines)

    @property
    def recorded_steps(self) -> int:
        """The last step for which any other participant is recorded."""
        steps = [len(o.states) - 1 for o in self.obstacles if o.states is not None]
        return max(steps, default=0)


def _length(line: Array) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
