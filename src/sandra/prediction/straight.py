"""Set-based prediction in closed form: straight lanes of one direction, side by side.

In such a road's own frame, s along it and d to its left, all that a vehicle may do within its
bounds is one convex set of its centre at any time: the acceleration-based set, cut by the least
progress, by the lateral speed and by the borders of the road. It is kept as its support in
`DIRECTIONS` directions; widening it by the body is adding supports, and a cut is a smaller one. The
lanelets are not cut into cells, and all vehicles and times are computed at once.

Only for vehicles that keep to lanes, do not reverse, and either may use all lanes or keep out of
the ego's altogether (`closed_form`); others go through `occupancy`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.geometry import directions, polygons_around, unpadded
from sandra.prediction.motion import MARGIN, least_way, travelled
from sandra.prediction.observed import Observed, TowardsEgo
from sandra.prediction.occupancy import Occupancy, Scope
from sandra.prediction.straight_road import TOLERANCE, StraightRoad
from sandra.scene.types import Region, State

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DIRECTIONS = 16
"""Half-planes that bound each set; the first is that of s, the fifth that of d."""
LEFT, BACK, RIGHT = DIRECTIONS // 4, DIRECTIONS // 2, 3 * DIRECTIONS // 4
ROUNDING = 1e-6
"""Bounds along and across the road are this much wider than computed [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Driver:
    """A vehicle on the road; `skipped`: so many of the first intervals nobody asks for."""

    seen: Observed
    law: TowardsEgo
    state: State
    outline: Region
    start_body: Region
    skipped: int


def closed_form(seen: Observed, law: TowardsEgo) -> bool:
    """Whether a vehicle's sets are one convex set at a time, or two beside the ego's lane."""
    free = not law.drop_own and not law.drop_cut
    keeps_out = law.drop_cut and law.behind == law.drop_own
    return (
        bool(seen.places)
        and not seen.reversing
        and bool(np.isfinite(seen.lateral_speed))
        and seen.bounds.speed is not None
        and (free or keeps_out)
    )


def road_occupancies(
    road: StraightRoad, drivers: Sequence[Driver], horizon: int, scope: Scope
) -> list[Occupancy]:
    """The regions of all, in T = 2 h + 1 rows each as of `lane_occupancies`."""
    if not drivers:
        return []
    times: Array = scope.dt * np.arange(horizon + 1, dtype=np.float64)
    fleet = _Fleet.of(road, drivers, scope.max_overhang)
    bodies = fleet.bodies(times)
    centres = fleet.centres(times)
    # Rows as in `Vehicle.offsets`: at t_1.., then during each step, where both ends bound.
    during = np.maximum(centres[:, :-1], centres[:, 1:])
    rows = np.concatenate([centres, during], axis=1)
    bodies = np.concatenate([bodies, bodies[:, 1:]], axis=1)
    number = np.arange(2 * horizon + 1)
    begin = (1 if scope.instants else horizon + 1) + np.array([x.skipped for x in drivers])
    wanted = (number >= begin[:, None]) & (number > 0)
    lane = road.band(scope.ego_lane)
    found: list[list[tuple[Region, ...]]] = [[()] * (2 * horizon + 1) for _ in drivers]
    relied_on: list[set[str]] = [set() for _ in drivers]
    keeps_out = np.array([x.law.drop_cut for x in drivers])
    sides: list[tuple[Mask, float, float]] = [(~keeps_out, road.borders[0], road.borders[-1])]
    if keeps_out.any():
        assert lane is not None, "who keeps out of the ego's lane knows it"
        if lane > 0:
            sides.append((keeps_out, road.borders[0], road.borders[lane]))
        if lane + 1 < len(road.ids):
            sides.append((keeps_out, road.borders[lane + 1], road.borders[-1]))
        right, left = road.borders[lane], road.borders[lane + 1]
        reach = np.where(wanted[..., None], rows + bodies, -np.inf)
        into = (reach[..., LEFT].max(axis=1) > right) & (-reach[..., RIGHT].max(axis=1) < left)
        for i in np.flatnonzero(keeps_out & into).tolist():
            relied_on[i] |= set(drivers[i].law.holds)
    for who, low, high in sides:
        v, row = np.nonzero(wanted & who[:, None])
        support = rows[v, row]
        support[:, LEFT] = np.minimum(support[:, LEFT], high + TOLERANCE)
        support[:, RIGHT] = np.minimum(support[:, RIGHT], -low + TOLERANCE)
        support, alive = closed(support)
        v, row = v[alive], row[alive]
        support = support + bodies[v, row]
        over = fleet.overhang[v]
        edge_left = high + np.where(high == road.borders[-1], over, 0.0)
        edge_right = low - np.where(low == road.borders[0], over, 0.0)
        support[:, LEFT] = np.minimum(support[:, LEFT], edge_left + TOLERANCE)
        support[:, RIGHT] = np.minimum(support[:, RIGHT], -edge_right + TOLERANCE)
        support, alive = closed(support)
        polygons = unpadded(road.to_world(polygons_around(_NORMALS, support)))
        owners = zip(v[alive].tolist(), row[alive].tolist(), strict=True)
        for (i, k), polygon in zip(owners, polygons, strict=True):
            found[i][k] += (Region(polygon),)
    return [
        Occupancy(tuple(several), frozenset(names))
        for several, names in zip(found, relied_on, strict=True)
    ]


_NORMALS = directions(DIRECTIONS)


def closed(support: Array) -> tuple[Array, Mask]:
    """The supports (N', J) of {p : normals . p <= offsets} (N, J), and the mask (N,) of N'.

    By duality the support in one direction is the least of its own offset and the combinations of
    two offsets around it. Where two opposite ones contradict each other the set is empty.
    """
    n, step = support.shape[1], 2 * np.pi / support.shape[1]
    twice = np.concatenate([support, support, support], axis=1)
    found = support.copy()
    for p in range(1, n // 2):
        for q in range(1, n // 2 - p):
            alpha = np.sin(q * step) / np.sin((p + q) * step)
            beta = np.sin(p * step) / np.sin((p + q) * step)
            both = alpha * twice[:, n + p : 2 * n + p] + beta * twice[:, n - q : 2 * n - q]
            np.minimum(found, both, out=found)
    half = n // 2
    alive: Mask = np.asarray((found[:, :half] + found[:, half:] >= -ROUNDING).all(axis=1))
    return found[alive], alive


@dataclass(frozen=True, slots=True, eq=False)
class _Fleet:
    """V vehicles in the road's frame, (V,) each but `velocity` (V, 2).

    `driving` is inf where only `a_max` bounds it; `corner` (V, C, 2) those of the bodies, `radius`
    of theirs; `overhang`: so far a body may stick out over the edges of the road [m].
    """

    drivers: Sequence[Driver]
    a_max: float
    s: Array
    d: Array
    heading: Array
    velocity: Array
    speed: Array
    v_max: Array
    driving: Array
    lateral: Array
    corner: Array
    radius: Array
    overhang: Array

    @staticmethod
    def of(road: StraightRoad, drivers: Sequence[Driver], most_overhang: float) -> _Fleet:
        states = [x.state for x in drivers]
        s, d = road.to_frame(np.array([(x.x, x.y) for x in states])).T
        heading = np.array([x.heading for x in states]) - road.course
        speed = np.array([x.speed for x in states])
        most = max(len(x.outline.vertices) for x in drivers)
        corner = np.stack(
            [np.pad(c, ((0, most - len(c)), (0, 0)), mode="edge")
             for c in (x.outline.vertices for x in drivers)]
        )  # fmt: skip
        out = np.empty(len(drivers))
        for i, x in enumerate(drivers):
            # As far as it sticks out now, if that is farther than assumed.
            across = road.to_frame(x.start_body.vertices)[:, 1]
            beyond = max(road.borders[0] - across.min(), across.max() - road.borders[-1], 0.0)
            out[i] = max(most_overhang, beyond + x.start_body.radius + MARGIN)
        return _Fleet(
            drivers,
            drivers[0].seen.bounds.a_max,
            s,
            d,
            heading,
            speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)]),
            np.abs(speed),
            np.array([x.seen.bounds.v_max for x in drivers]),
            np.array([x.seen.bounds.driving for x in drivers]),
            np.array([x.seen.lateral_speed for x in drivers]),
            corner,
            np.array([x.outline.radius for x in drivers]),
            out,
        )

    def centres(self, times: Array) -> Array:
        """(V, h + 1, J) offsets that bound the centres at each time [m].

        The least progress is the one from full braking along the road, or from what `max_braking`
        leaves; during a step it is that at its beginning, as all offsets are those of an end.
        """
        place = np.column_stack([self.s, self.d]) @ _NORMALS.T
        along = (self.velocity @ _NORMALS.T)[:, None, :]
        v_max = self.v_max[:, None]
        ways = travelled(along, self.a_max, v_max[..., None], times[:, None])
        longest = self._way(times)
        bounded = self.driving < self.a_max
        ways[bounded] = np.minimum(ways[bounded], longest[bounded, :, None])
        found = place[:, None, :] + ways
        # Braking along the road it stands in the end; it does not reverse from there.
        forward = np.maximum(self.velocity[:, :1], 0.0)
        if self.a_max > 0.0:
            t = np.minimum(times, forward / self.a_max)
            behind = forward * t - self.a_max / 2 * t**2
        else:
            behind = forward * times
        for i, x in enumerate(self.drivers):
            if np.isfinite(x.seen.braking):
                least = least_way(x.state.speed, x.seen.braking, x.seen.lateral_speed, times)
                behind[i] = np.maximum(behind[i], least)
        back = -self.s[:, None] - behind + ROUNDING
        found[..., BACK] = np.minimum(found[..., BACK], back)
        aside = self.lateral[:, None] * times + ROUNDING
        found[..., LEFT] = np.minimum(found[..., LEFT], self.d[:, None] + aside)
        found[..., RIGHT] = np.minimum(found[..., RIGHT], aside - self.d[:, None])
        return np.asarray(found)

    def bodies(self, times: Array) -> Array:
        """(V, h + 1, J) supports of the bodies around their centres by each time [m]."""
        reach = np.hypot(self.corner[..., 0], self.corner[..., 1])
        bearing = np.arctan2(self.corner[..., 1], self.corner[..., 0]) + self.heading[:, None]
        angle = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        away = np.mod(angle[:, None] - bearing[:, None, :] + np.pi, 2 * np.pi) - np.pi
        turned = self._turned(times)[..., None, None]
        apart = np.maximum(np.abs(away)[:, None] - turned, 0.0)
        support = (reach[:, None, None, :] * np.cos(apart)).max(axis=3)
        return np.asarray(support + (self.radius + MARGIN)[:, None, None])

    def _way(self, times: Array) -> Array:
        """(V, h + 1) the longest way that can be driven [m]."""
        found = np.empty((len(self.speed), len(times)))
        for pull in np.unique(np.minimum(self.driving, self.a_max)).tolist():
            who = np.minimum(self.driving, self.a_max) == pull
            found[who] = travelled(self.speed[who, None], pull, self.v_max[who, None], times)
        return found

    def _turned(self, times: Array) -> Array:
        """(V, h + 1) as `motion.heading_change` of each."""
        radius = np.array([x.seen.bounds.turning_radius for x in self.drivers])[:, None]
        slip = np.array([x.seen.bounds.slip for x in self.drivers])[:, None]
        by_arc = self._way(times) / np.maximum(radius, 1e-9)
        push = np.broadcast_to(self.a_max * times, by_arc.shape)
        ratio = np.full(by_arc.shape, np.inf)
        np.divide(push, self.speed[:, None], out=ratio, where=self.speed[:, None] > 0.0)
        by_velocity = np.where(ratio < 1, np.arcsin(np.minimum(ratio, 1.0)) + slip, np.pi)
        turned = np.minimum(np.minimum(by_arc, by_velocity), np.pi)
        return np.asarray(np.where(radius > 0.0, turned, np.where(times > 0.0, np.pi, 0.0)))
