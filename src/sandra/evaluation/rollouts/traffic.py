"""Vehicles on lanes, many at once: every wish is cut down to what the bounds allow.

Each is a point with an acceleration that is constant in each fine step, within the friction
circle, and a body that points along its motion but for the slip. Steering follows a route; bends,
edges of the carriageway, and the law towards the ego are looked ahead for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.evaluation.rollouts.actors import Actor
from sandra.evaluation.rollouts.adversary import BRAKE, CUT_IN, GREEDY, Plans
from sandra.evaluation.rollouts.ego import Drive
from sandra.evaluation.rollouts.road import Road
from sandra.evaluation.rollouts.routes import SPACING, Routes
from sandra.settings import Settings

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

NEARLY = 0.999
"""Share of the friction circle that is used, against rounding."""
EDGE = 0.03
"""Distance kept from every border [m]."""
BORDER = 0.08
"""Distance kept from the ego's lane while it must not be entered [m]."""
SETTLING = 0.2
"""Time in which the last of an offset is steered out [s]."""
FOLLOWING = 0.3
"""Who follows the ego stays this far behind it [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """N vehicles at T fine steps: `position` (T, N, 2), `heading`, `velocity` (T, N, 2).

    `until` (N,): first fine step at which it is no longer there (it left the map), else T; `since`
    (N,): first at which it is there. `yielding` (T, N): it follows the ego in its lane, and keeps
    a distance because it must.
    """

    position: Array
    heading: Array
    velocity: Array
    since: Ints
    until: Ints
    yielding: Bools


@dataclass(frozen=True, slots=True, eq=False)
class Ego:
    """What others can see of the ego: along its lane [m], and its speed, at each fine step."""

    along: Array
    speed: Array
    length: float

    @staticmethod
    def of(drive: Drive, road: Road, length: float) -> Ego:
        """From the executed certificate."""
        line = shapely.LineString(road.reference)
        along = shapely.line_locate_point(line, shapely.points(drive.states[:, :2]))
        return Ego(np.asarray(along), drive.states[:, 3], length)


def needed_gap(v: Array, v_other: Array, s: Settings) -> Array:
    """Distance that who cuts in must leave the ego, >= 0 [m] (d_safe of R_G1)."""
    braking = v**2 / (2 * abs(s.a_min)) - v_other**2 / (2 * abs(s.a_obs_min))
    return np.asarray(np.maximum(braking + v * s.t_d, 0.0))


def simulate(
    actors: list[Actor],
    plans: Plans,
    routes: Routes,
    drive: Drive,
    ego: Ego,
    settings: Settings,
) -> Motion:
    """Drive N vehicles; `actors` has one entry per row of `plans`."""
    n, steps, h = len(actors), len(drive.states), drive.step
    a = settings.assumptions
    a_max, braking, driving, v_max, lateral, slip, half_length, half_width = (
        np.array([getattr(x, name) for x in actors])
        for name in (
            *("a_max", "braking", "driving", "v_max", "lateral", "slip", "length", "width"),
        )
    )
    braking, driving = np.minimum(NEARLY * braking, a_max), np.minimum(NEARLY * driving, a_max)
    half_length, half_width = half_length / 2, half_width / 2
    tightest = np.array([max(x.turning_radius, 0.5) for x in actors])
    keeps_out = np.array([x.keeps_out for x in actors])
    yields = np.array([x.yields for x in actors])
    since = np.array([x.appears for x in actors])
    r = plans.route
    p = np.array([[x.start.x, x.start.y] for x in actors])
    psi = np.array([x.start.heading for x in actors])
    known = np.array([x.speed_is_known for x in actors])
    speed = np.where(known, [x.start.speed for x in actors], plans.speed * v_max)
    v = speed[:, None] * np.column_stack([np.cos(psi), np.sin(psi)])
    theta = psi.copy()
    first = np.linalg.norm(routes.point[r, :80] - p[:, None], axis=2)
    s = SPACING * first.argmin(axis=1).astype(float)
    crossing = np.abs(routes.ego_d[r]).argmin(axis=1)
    is_crossing = np.abs(routes.ego_d[r, 0]) > 6.0
    start_d = np.full(n, np.nan)
    in_lane, entered = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    until, yielding = np.full(n, steps), np.zeros((steps, n), dtype=bool)
    position, heading, velocity = (np.empty((steps, n, 2)), np.empty((steps, n)),
                                   np.empty((steps, n, 2)))  # fmt: skip
    last = routes.point.shape[1] - 1
    for k in range(steps):
        position[k], heading[k], velocity[k] = p, psi, v
        if k == steps - 1:
            break
        active = (k >= since) & (k < until)
        i = np.clip(np.round(s / SPACING).astype(int), 0, last)
        course = routes.course[r, i]
        c, sn = np.cos(course), np.sin(course)
        away = p - routes.point[r, i]
        s = i * SPACING + c * away[:, 0] + sn * away[:, 1]
        d = -sn * away[:, 0] + c * away[:, 1]
        until = np.where(active & (s + half_length + 1.0 >= routes.length[r]), k, until)
        speed = np.hypot(v[:, 0], v[:, 1])
        turned = _wrap(theta - course)
        along = routes.along[r, i] + (s - i * SPACING)
        # Room for the centre of the body; in a bend, its ends stick out.
        bulge = half_length**2 * routes.bend[r, i] / 2
        edge = half_width + bulge + EDGE + 0.015 * half_length
        low = routes.low[r, i] - 0.9 * a.max_overhang + edge
        high = routes.high[r, i] + 0.9 * a.max_overhang - edge
        wide = half_width + half_length * np.abs(np.sin(turned))
        shut_low, shut_high = routes.closed_low[r, i], routes.closed_high[r, i]
        touches = (d - wide < shut_high) & (d + wide > shut_low) & np.isfinite(shut_low)
        if k == 0:
            in_lane = touches & keeps_out
        gap = along - half_length - (ego.along[k] + ego.length / 2)
        needed = needed_gap(ego.speed[k], speed * np.cos(turned), settings)
        ahead = gap >= 1.03 * needed + 0.3
        room = ego.along[k] - ego.length / 2 - FOLLOWING - along - half_length
        slow = ego.speed[k] + np.sqrt(5.0 * np.maximum(room - speed * h, 0.0))
        behind = (room > 0.0) & (speed <= slow)
        # Once out of the ego's lane, the way back leads through the law.
        in_lane &= touches
        entered = (entered | (touches & keeps_out & ~in_lane & (ahead | behind))) & touches
        free = ~keeps_out | in_lane | entered | ahead | behind | ~np.isfinite(shut_low)
        from_left = d > (shut_low + shut_high) / 2
        border = half_width + bulge + BORDER + 0.015 * half_length
        low = np.where(~free & from_left, np.maximum(low, shut_high + border), low)
        high = np.where(~free & ~from_left, np.minimum(high, shut_low - border), high)
        start_d = np.where(np.isnan(start_d), d, start_d)

        push, goal = _wishes(plans, k, h, routes, ego, s, d, speed, a_max, low, high, start_d,
                             crossing, is_crossing, gap, needed, half_width)  # fmt: skip
        goal = np.clip(goal, np.minimum(low, high), np.maximum(low, high))
        miss = goal - d
        # Across no faster than allowed, than can be stopped, and than the body can be straightened.
        across = np.minimum(np.sqrt(0.7 * a_max * np.abs(miss)), np.abs(miss) / SETTLING)
        across = np.minimum(across, 0.96 * lateral - speed * np.sin(routes.kink[r, i]))
        angle = np.arccos(np.clip(1.0 - 0.6 * np.abs(miss) / tightest, 0.4, 1.0))
        # A body that turns sticks out to both sides.
        spare = 0.9 * np.maximum(np.minimum(d - low, high - d), 0.0) / half_length
        across = np.minimum(across, speed * np.minimum(np.sin(angle), spare + 0.005))
        across = np.sign(miss) * np.maximum(across, 0.0)
        wanted = course + np.arcsin(np.clip(across / np.maximum(speed, 1e-6), -0.92, 0.92))
        a_side = _wrap(wanted - theta) * speed / h
        bound = np.minimum(0.9 * a_max, 0.95 * speed**2 / tightest)
        a_side = np.clip(a_side, -bound, bound)
        rest = np.sqrt(np.maximum((NEARLY * a_max) ** 2 - a_side**2, 0.0))
        # Pushes are shares of what is allowed: extreme ones meet the bounds.
        a_long = push * np.where(push < 0.0, braking, driving)
        a_long = np.clip(a_long, -rest, rest)
        soon = np.clip(i + np.ceil(speed * h / SPACING).astype(int) + 1, 0, last)
        top = np.minimum(routes.cap[r, soon], v_max)
        # Where the lane ends, and the way beside it is not free, it stops.
        top = np.where(np.maximum(low - d, d - high) > 0.15, 0.0, top)
        top = np.minimum(top, 0.95 * lateral / np.maximum(np.abs(np.sin(turned)), 1e-3))
        # Who follows the ego in its lane can always brake behind it.
        follows = yields & (in_lane | entered) & (along < ego.along[k])
        yielding[k] = follows
        slow = slow - np.where(room < 0.0, 3.0, 0.0)
        top = np.where(follows, np.minimum(top, slow), top)
        least = -np.minimum(rest, braking)
        a_long = np.clip(np.minimum(a_long, (top - speed) / h), least, rest)
        a_long = np.maximum(a_long, -speed / h)
        then = speed + a_long * h
        most = np.tan(np.minimum(0.95 * h * (speed + then) / 2 / tightest, 1.0)) * then / h
        a_side = np.clip(a_side, -most, most)
        moving = active & (until > k)
        cos, sin = np.cos(theta), np.sin(theta)
        new = v + h * np.column_stack([a_long * cos - a_side * sin, a_long * sin + a_side * cos])
        # The projection onto the disc of allowed speeds moves no two points farther apart.
        fastest = np.minimum(v_max, np.maximum(speed + driving * h, 0.0))
        new *= np.minimum(1.0, fastest / np.maximum(np.hypot(*new.T), 1e-9))[:, None]
        new[then < 1e-9] = 0.0
        new = np.where(moving[:, None], new, v)
        p = np.where(moving[:, None], p + h * (v + new) / 2, p)
        speed_then = np.hypot(new[:, 0], new[:, 1])
        theta = np.where(moving & (speed_then > 1e-6), np.arctan2(new[:, 1], new[:, 0]), theta)
        swing = 0.99 * h * (np.hypot(*(v + new).T) / 2) / tightest
        # The body is turned out of its motion where there is room for it.
        more = np.maximum(spare - np.abs(np.sin(turned)), 0.0)
        turn = _wrap(theta + plans.slip * np.minimum(0.98 * slip, 0.8 * more) - psi)
        psi = np.where(moving, psi + np.clip(turn, -swing, swing), psi)
        v = new
    return Motion(position, heading, velocity, since, until, yielding)


def _wishes(
    plans: Plans, k: int, h: float, routes: Routes, ego: Ego, s: Array, d: Array, speed: Array,
    a_max: Array, low: Array, high: Array, start_d: Array, crossing: Ints, is_crossing: Bools,
    gap: Array, needed: Array, half_width: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """(N,) push, -1..1, and the offset d to make for [m]."""
    r, kind, last = plans.route, plans.kind, len(ego.speed) - 1
    push, side = plans.piece(k * h)
    goal = (low + high) / 2 + side * (high - low) / 2
    # Where the ego will be: after a while, or where it crosses the route.
    lead = np.where(np.isinf(plans.lead), 0.5, plans.lead)
    later = np.minimum(k + np.round(lead / h).astype(int), last)
    meets = np.isinf(plans.lead) & is_crossing & (crossing > k)
    later = np.where(meets, crossing, later)
    time = np.maximum((later - k) * h, h)
    wanted = 2 * (routes.ego_s[r, later] - s - speed * time) / time**2
    to_ego = routes.ego_d[r, later]
    greedy = kind == GREEDY
    push = np.where(greedy, np.clip(wanted / a_max, -1, 1), push)
    goal = np.where(greedy, to_ego, goal)
    brake = kind == BRAKE
    begun = k * h >= plans.switch[:, 1]
    push = np.where(brake, np.where(begun, -1.0, np.maximum(push, 0.0)), push)
    goal = np.where(brake, np.where(plans.side[:, 0] > -0.5, to_ego, start_d), goal)
    cut = kind == CUT_IN
    inside = np.abs(d - routes.ego_d[r, k]) < half_width + 1.0
    close = np.clip((1.03 * needed + 0.6 - gap) / 2.0, -1, 1)
    push = np.where(cut, np.where(inside, -1.0, close), push)
    return push, np.where(cut, routes.ego_d[r, k], goal)


def _wrap(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
