"""Which assumptions hold for one participant, given what is seen of it now."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SettingsError
from sandra.prediction.lanes import Place
from sandra.prediction.motion import Bounds
from sandra.scene.types import Lane, Obstacle, Scene, State
from sandra.settings import Assumptions, Settings

Array = NDArray[np.float64]

LANE_KINDS = frozenset({"car", "truck", "bus", "taxi", "motorcycle", "priorityVehicle"})
"""Participants that drive on lanes; bicycles do too, but may leave them at any time."""
FIXED_KINDS = frozenset(
    {"parkedVehicle", "constructionZone", "roadBoundary", "building", "pillar", "median_strip"}
)
"""Objects that stay where they are (CommonRoad's obstacle types, as spelt there)."""

WRONG_WAY = math.radians(60.0)
"""A vehicle whose heading leaves its lane's by more follows that lane no longer."""
ON_LANE = 0.02
"""Points this close to a lanelet are on it [m]."""
BACKWARDS = 0.05
"""Speeds below minus this are reversing, above it noise [m/s]."""


@dataclass(frozen=True, slots=True)
class Observed:
    """How one participant is predicted. `places` is empty where no lane is assumed."""

    bounds: Bounds
    places: tuple[Place, ...]
    lateral_speed: float
    reversing: bool
    assumptions: tuple[str, ...]
    dropped: tuple[str, ...]
    braking: float = math.inf
    """On its lanes, its speed falls no faster [m/s^2]; inf: no bound."""


def is_fixed(obstacle: Obstacle) -> bool:
    """True for what does not move by its nature."""
    return obstacle.is_static or obstacle.kind in FIXED_KINDS


def check_assumptions(assumptions: Assumptions) -> None:
    """Raises `SettingsError` on a negative or non-finite bound."""
    for name in (
        "max_acceleration",
        "max_speed",
        "max_lateral_speed",
        "max_overhang",
        "min_turning_radius",
        "max_slip_angle",
        "pedestrian_max_speed",
        "pedestrian_max_acceleration",
    ):
        value = getattr(assumptions, name)
        if not (math.isfinite(value) and value >= 0.0):
            raise SettingsError(f"assumptions.{name} = {value!r} must be a finite number >= 0")
    for name in ("max_braking", "max_driving"):
        value = getattr(assumptions, name)
        if not value >= 0.0:
            raise SettingsError(f"assumptions.{name} = {value!r} must be a number >= 0")


def motion_bounds(
    obstacle: Obstacle, state: State, a: Assumptions
) -> tuple[Bounds, list[str], list[str]]:
    """The bounds on a participant's motion, and which assumptions hold or are dropped for them."""
    speed = state.speed if obstacle.speed_is_known else None
    pedestrian = obstacle.kind == "pedestrian"
    allowed = a.pedestrian_max_speed if pedestrian else a.max_speed
    name = "pedestrian_max_speed" if pedestrian else "max_speed"
    acceleration = a.pedestrian_max_acceleration if pedestrian else a.max_acceleration
    holds = ["pedestrian_max_acceleration" if pedestrian else "max_acceleration"]
    dropped: list[str] = []
    fastest = allowed
    if speed is not None and abs(speed) > allowed:
        fastest = abs(speed)
        dropped.append(name)
    else:
        holds.append(name)
    bounded = a.bounded_heading and obstacle.kind in LANE_KINDS
    if bounded:
        holds.append("bounded_heading")
    radius = a.min_turning_radius if bounded else 0.0
    driving = math.inf
    if speed is not None and obstacle.kind in LANE_KINDS and a.max_driving < acceleration:
        broken = math.copysign(1.0, speed) * state.acceleration > a.max_driving
        driving = math.inf if broken else a.max_driving
        (dropped if broken else holds).append("max_driving")
    bounds = Bounds(acceleration, fastest, speed, radius, a.max_slip_angle, driving)
    return bounds, holds, dropped


class Places(Protocol):
    """A map that knows which lanelets hold a point; see `LaneMap.places`."""

    def places(self, x: float, y: float, heading: float, tolerance: float) -> list[Place]:
        """Every lanelet that holds the point (up to `tolerance` [m])."""


def observe(obstacle: Obstacle, state: State, lane_map: Places, a: Assumptions) -> Observed:
    """Choose the assumptions for one participant; drop those that its state violates."""
    bounds, holds, dropped = motion_bounds(obstacle, state, a)
    speed = bounds.speed
    places: tuple[Place, ...] = ()
    lateral, reversing = math.inf, True
    if obstacle.kind in LANE_KINDS and a.stay_on_carriageway:
        everywhere = lane_map.places(state.x, state.y, state.heading, ON_LANE)
        places = tuple(p for p in everywhere if abs(p.relative_heading) <= WRONG_WAY)
        (holds if places else dropped).append("stay_on_carriageway")
    if places and a.follow_lanes:
        # Of several lanes at one place the vehicle may follow any one: the smallest speed counts.
        across = abs(speed or 0.0) * min(abs(math.sin(p.relative_heading)) for p in places)
        lateral = max(a.max_lateral_speed, across)
        holds.append("follow_lanes")
        (holds if across <= a.max_lateral_speed else dropped).append("max_lateral_speed")
    if places and a.no_reversing:
        reversing = speed is not None and speed < -BACKWARDS
        (dropped if reversing else holds).append("no_reversing")
    braking = math.inf
    # What is gone along a lane is known only of who follows lanes, forwards.
    forwards = speed is not None and not reversing and math.isfinite(lateral)
    if forwards and a.max_braking < bounds.a_max:
        broken = state.acceleration < -a.max_braking
        braking = math.inf if broken else a.max_braking
        (dropped if broken else holds).append("max_braking")
    return Observed(bounds, places, lateral, reversing, tuple(holds), tuple(dropped), braking)


@dataclass(frozen=True, slots=True)
class TowardsEgo:
    """What a participant does not do to the ego (the two assumptions on traffic law).

    `behind`: it starts behind the ego in the ego's lane. `drop_own`: then its regions in that
    lane are left out. `drop_cut`: its regions in the ego's lane after a change of lane into it
    are left out, and its body keeps out of that lane while it drives beside it.
    """

    behind: bool
    drop_own: bool
    drop_cut: bool
    holds: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()


NOTHING = TowardsEgo(False, False, False)


def safe_distance(v_ego: float, v_other: float, settings: Settings) -> float:
    """d_safe of R_G1 (method: Maierhofer 2020) that the ego needs behind the other [m], >= 0."""
    braking = v_ego**2 / (2 * abs(settings.a_min)) - v_other**2 / (2 * abs(settings.a_obs_min))
    return max(0.0, braking + v_ego * settings.t_d)


def ego_lane(scene: Scene) -> Lane | None:
    """The lane that the ego follows, None where it has none."""
    return next((lane for lane in scene.lanes if lane.relation == "current"), None)


def along_lane(scene: Scene, places: Array) -> Array:
    """(n,) s along the ego's lane of places (n, 2) [m]; NaN where the ego has no lane."""
    lane = ego_lane(scene)
    if lane is None:
        return np.full(len(places), np.nan)
    return lane.frame.to_curvilinear(places)[:, 0]


def towards_ego(
    scene: Scene,
    obstacle: Obstacle,
    state: State,
    seen: Observed,
    settings: Settings,
    s: tuple[float, float] | None = None,
) -> TowardsEgo:
    """Apply `no_rear_end` and `legal_cut_in` to one participant.

    `s` of the ego and of the participant along the ego's lane [m], if that is known already.

    With s along the ego's lane at the start, in the ego's lane and s(o) < s(ego): `no_rear_end`.
    Anyone on lanes, unless it is in the ego's lane ahead of the ego: `legal_cut_in` lets it
    change into the ego's lane only if already at the start
    s_rear(o) - s_front(ego) >= d_safe(v_ego, v_o).
    Behind the ego it may change into its lane at any time, and is then assumed not to drive into
    it: so this needs `no_rear_end` too, and lists it.
    A body that is in the ego's lane already cuts in whatever the law says: dropped for it.
    """
    a = settings.assumptions
    lane = ego_lane(scene)
    if lane is None or not seen.places or not (a.no_rear_end or a.legal_cut_in):
        return NOTHING
    ego = scene.ego
    if s is None:
        places = np.array([[ego.state.x, ego.state.y], [state.x, state.y]])
        s_ego, s_other = along_lane(scene, places).tolist()
    else:
        s_ego, s_other = s
    in_lane = any(p.lanelet in lane.lanelets for p in seen.places)
    behind = in_lane and s_other < s_ego
    gap = (s_other - obstacle.length / 2) - (s_ego + ego.length / 2)
    needed = safe_distance(abs(ego.state.speed), abs(state.speed), settings)
    holds: list[str] = []
    dropped: list[str] = []
    if behind and a.no_rear_end:
        holds.append("no_rear_end")
    drop_cut = False
    # Who changes into the ego's lane behind it is then one more that must not drive into it: what
    # is left out rests on both assumptions.
    if a.legal_cut_in and a.no_rear_end and (behind or not in_lane) and gap < needed:
        drop_cut = behind or not _touches(obstacle, state, lane.polygon)
        (holds if drop_cut else dropped).append("legal_cut_in")
        if drop_cut and not behind:
            holds.append("no_rear_end")
    return TowardsEgo(behind, behind and a.no_rear_end, drop_cut, tuple(holds), tuple(dropped))


def _touches(obstacle: Obstacle, state: State, outline: np.ndarray) -> bool:
    """Whether the body reaches into the lane with this outline (sampled along its edges)."""
    corners = obstacle.outline.placed(state.x, state.y, state.heading).vertices
    share = np.linspace(0.0, 1.0, 11)[:, None, None]
    edges = corners + share * (np.roll(corners, -1, axis=0) - corners)
    points = edges.reshape(-1, 2)
    centre = np.array([state.x, state.y])
    away = points - centre
    length = np.maximum(np.linalg.norm(away, axis=1), 1e-9)[:, None]
    points = points + away / length * obstacle.outline.radius
    a, b = outline, np.roll(outline, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    crosses = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(crosses, b[:, 1] - a[:, 1], 1.0)
    left = x < a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
    inside = (crosses & left).sum(axis=1) % 2 == 1
    return bool(inside.any())
