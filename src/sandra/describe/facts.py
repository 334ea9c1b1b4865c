"""The facts that a prompt tells, as numbers: `Scene` -> `Situation` (method 7)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from sandra.actions import ActionPair
from sandra.describe.collision_time import Box, signed_gap, time_to_collision
from sandra.describe.criticality import required_braking
from sandra.describe.options import PromptOptions
from sandra.describe.outside import in_words, one_line
from sandra.describe.relations import VULNERABLE, follows_lanes, inside, relation, touches
from sandra.describe.types import ObstacleFacts, Situation
from sandra.scene.network import neighbour
from sandra.scene.types import Obstacle, Scene, TrafficLight

AHEAD, BEHIND = 100.0, 50.0
"""Obstacles in front of and behind the ego are told up to here, bumper to bumper [m]."""
ASIDE = 50.0
"""Traffic that crosses or comes in is told up to this distance across the lane [m]."""
NEAR_VULNERABLE = 20.0
"""Pedestrians and cyclists beside the road are told up to this distance across the lane [m]."""
NEAR_STATIC = 1.5
"""Static obstacles beside the lane are told up to this distance from the ego's path [m]."""
URGENT = 8.0
"""Whoever would be met within this time is told, wherever it is [s]."""
MOST = 10
"""At most this many obstacles, not counting vulnerable road users."""

_ADJACENT = ("same", "left", "right", "opposite")
_DRIFT = 0.5
"""Speed across the lane up to which somebody in it counts as following it [m/s]."""


def situation(
    scene: Scene,
    feasible: tuple[ActionPair, ...],
    command: str | None,
    past: tuple[ActionPair, ...],
    horizon: float,
    options: PromptOptions,
) -> Situation:
    """Fill a `Situation`; text from outside is cleaned. Decisions hold for `horizon` [s]."""
    weather = scene.weather if options.weather is None else options.weather
    obstacles = obstacle_facts(scene)
    if options.beams is None:
        obstacles = relevant(obstacles)
    else:
        seen = options.beams.seen(scene, present(scene))
        obstacles = most_important(o for o in obstacles if o.id in seen)
    _, d, heading, _ = scene.ego_curvilinear
    state = scene.ego.state
    light = next_light(scene.lights)
    return Situation(
        scenario=one_line(scene.name),
        road_type=in_words(scene.road_type),
        country=None if scene.country is None else one_line(scene.country, 10),
        weather=None if weather is None else in_words(weather),
        speed=state.speed,
        acceleration=state.acceleration,
        heading=heading,
        steering_angle=state.steering_angle,
        speed_limit=scene.speed_limit,
        obstacles=obstacles,
        light=None if light is None else light.state,
        light_distance=None if light is None else light.distance,
        feasible=feasible,
        command=command,
        past=past,
        lateral_offset=d,
        horizon=horizon,
        lanes_left=max(lanes_beside(scene, "left"), int(scene.left is not None)),
        lanes_right=max(lanes_beside(scene, "right"), int(scene.right is not None)),
    )


def lanes_beside(scene: Scene, side: str) -> int:
    """How many lanelets of the ego's direction lie side by side on one side of its own."""
    network = {lanelet.id: lanelet for lanelet in scene.lanelets}
    own = [network[i] for i in scene.current.lanelets if i in network]
    point = np.array([scene.ego.state.x, scene.ego.state.y])
    here = [lanelet for lanelet in own if inside(lanelet.outline, point)] or own
    passed: list[int] = []
    last = here[0] if here else None
    while last is not None and last.id not in passed:
        passed.append(last.id)
        last = neighbour(network, last, side, same=True)
    return max(len(passed) - 1, 0)


def next_light(lights: Iterable[TrafficLight]) -> TrafficLight | None:
    """The nearest light that still lies ahead."""
    return min(
        (li for li in lights if li.distance >= 0.0), key=lambda li: li.distance, default=None
    )


def obstacle_facts(scene: Scene) -> tuple[ObstacleFacts, ...]:
    """The facts of every obstacle that is there now, in the order of the scene."""
    obstacles = _without_copies(present(scene))
    if not obstacles:
        return ()
    points = np.array([[o.state.x, o.state.y] for o in obstacles])
    positions = scene.frame.to_curvilinear(points)
    lane_headings = scene.frame.heading(positions[:, 0])
    s, d, heading, _ = scene.ego_curvilinear
    ego = Box.around(scene.ego.outline, s, d, heading, scene.ego.state.speed)
    return tuple(
        _facts(scene, obstacle, ego, float(position[0]), float(position[1]), float(lane_heading))
        for obstacle, position, lane_heading in zip(
            obstacles, positions, lane_headings, strict=True
        )
    )


def present(scene: Scene) -> list[Obstacle]:
    """The obstacles that are there now: not those whose recording begins only later."""
    return [
        o
        for o in scene.obstacles
        if all(map(math.isfinite, (o.state.x, o.state.y, o.state.heading)))
        and (o.states is None or np.isfinite(o.states[:1, :2]).all())
    ]


def _without_copies(obstacles: list[Obstacle]) -> list[Obstacle]:
    """Drops what stands at the very place of an earlier one: recordings hold such copies."""
    first: dict[tuple[float, ...], Obstacle] = {}
    for o in obstacles:
        first.setdefault((o.state.x, o.state.y, o.state.heading, o.length, o.width), o)
    return list(first.values())


def _facts(
    scene: Scene, obstacle: Obstacle, ego: Box, s: float, d: float, lane_heading: float
) -> ObstacleFacts:
    state = obstacle.state
    heading = (state.heading - lane_heading + math.pi) % (2 * math.pi) - math.pi
    known = obstacle.speed_is_known and math.isfinite(state.speed)
    speed = 0.0 if obstacle.is_static else state.speed if known else math.nan
    box = Box.around(obstacle.outline, s, d, heading, speed)
    gap = signed_gap(ego.s_min, ego.s_max, box.s_min, box.s_max)
    lateral_gap = signed_gap(ego.d_min, ego.d_max, box.d_min, box.d_max)
    where = relation(scene, obstacle, heading)
    same_direction = math.cos(heading) > 0.0
    # A leader and its follower meet along the lane, however their headings waver. Somebody who
    # crosses the lane, or whom the ego passes at a distance, is met only if the boxes touch.
    leads = follows_lanes(obstacle) and same_direction
    stays = lateral_gap == 0.0 and abs(box.v_d) <= _DRIFT
    along_lane = where == "same" and gap != 0.0 and (leads or stays)
    in_ego_lane = where == "same" or touches(scene.current, obstacle)
    in_way = gap > 0.0 and (where == "same" or (in_ego_lane and lateral_gap == 0.0))
    return ObstacleFacts(
        id=obstacle.id,
        kind=in_words(obstacle.kind),
        is_static=obstacle.is_static,
        relation=where,
        same_direction=same_direction,
        gap=gap,
        lateral_gap=lateral_gap,
        speed=speed,
        acceleration=state.acceleration if math.isfinite(state.acceleration) else 0.0,
        heading=heading,
        # The scenes write 0 where nobody measured it.
        steering_angle=state.steering_angle or None,
        time_to_collision=time_to_collision(ego, box, along_lane=along_lane),
        in_ego_lane=in_ego_lane,
        **_criticality(ego, box, gap, state.acceleration) if in_way else {},
    )


def _criticality(ego: Box, other: Box, gap: float, acceleration: float) -> dict[str, float]:
    """Fields of `ObstacleFacts` for what is in front in the ego's way."""
    a = acceleration if math.isfinite(acceleration) else 0.0
    return {
        "time_headway": gap / ego.v_s if ego.v_s > 0.0 else math.inf,
        "required_braking": required_braking(gap, ego.v_s, other.v_s, a),
    }


def relevant(obstacles: Sequence[ObstacleFacts]) -> tuple[ObstacleFacts, ...]:
    """The obstacles worth telling, nearest first.

    In range: see the constants of this module. Of those, see `most_important`.
    """
    return most_important(o for o in obstacles if _in_range(o))


def most_important(obstacles: Iterable[ObstacleFacts]) -> tuple[ObstacleFacts, ...]:
    """Nearest first: every vulnerable road user, and at most `MOST` of the others.

    Of the others first the nearest in front and behind for each relation and whoever would be met
    within `URGENT`, then by distance.
    """
    near = sorted(obstacles, key=_distance)
    vulnerable = [o for o in near if o.kind in VULNERABLE]
    rest = [o for o in near if o.kind not in VULNERABLE]
    first: set[tuple[str, bool]] = set()
    urgent, others = [], []
    for obstacle in rest:
        place = (obstacle.relation, obstacle.gap >= 0.0)
        if obstacle.time_to_collision <= URGENT or place not in first:
            urgent.append(obstacle)
        else:
            others.append(obstacle)
        first.add(place)
    return tuple(sorted([*vulnerable, *(urgent + others)[:MOST]], key=_distance))


def _in_range(o: ObstacleFacts) -> bool:
    if not -BEHIND <= o.gap <= AHEAD:
        return False
    if o.in_ego_lane or o.time_to_collision <= URGENT:
        return True
    if o.relation in _ADJACENT:
        # Oncoming traffic that has passed is of no concern any more.
        return o.relation != "opposite" or o.gap >= 0.0 or o.same_direction
    aside = abs(o.lateral_gap)
    if o.kind in VULNERABLE:
        return aside <= NEAR_VULNERABLE
    if o.relation.startswith("incoming"):
        return aside <= ASIDE
    if o.relation == "crossing":
        approaches = o.speed * math.sin(o.heading) * o.lateral_gap < 0.0
        return approaches and aside <= ASIDE
    return o.is_static and aside <= NEAR_STATIC


def _distance(o: ObstacleFacts) -> float:
    return math.hypot(o.gap, o.lateral_gap)
