"""What each atom of a formula says about the witness, from raw data.

Letter k is the state at t_k and the acceleration applied in [t_k, t_k+1]; the last letter holds
the acceleration of the last interval. A comparison of `a` is true, or false, only if it is so
throughout its interval.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.certificate.geometry import Reference, Shapes, bodies, by_id, convex
from sandra.certificate.literals import Decided
from sandra.certificate.timing import steps_per_dt
from sandra.certificate.types import RELATIONS, Certificate, Participant
from sandra.errors import FormulaError
from sandra.logic import Atom, Comparison, Predicate
from sandra.settings import Settings

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

NOT_IN_TRAFFIC = frozenset({"pedestrian", "trafficIsland", "building", "pillar", "median_strip"})
"""Kinds that precede nobody in a lane; collisions with them are still checked."""
NEIGHBOURHOOD = 0.1
"""A point between lanelets belongs to those this close [m]: maps leave slits."""
DRIVEN = ("current", "left", "right")
"""Lanes whose signs the ego obeys while its centre is on them."""


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """The witness at t_0, ..., t_h, and the road it drives on."""

    certificate: Certificate
    states: Array
    """(h+1, 5)"""
    bodies: Shapes
    reference: Reference
    lanelets: dict[int, Any]
    """Areas by id."""

    @staticmethod
    def of(c: Certificate) -> Trace:
        """From a certificate whose `format` and `grid` hold."""
        states = c.witness.states[:: steps_per_dt(c)]
        return Trace(
            c,
            states,
            bodies(states, c.ego),
            Reference.of(c.reference),
            by_id(c.lanelets),
        )

    def lanes(self, relation: str) -> list[Any]:
        """The areas of the lanes with a relation to the ego."""
        return [
            shapely.union_all([self.lanelets[i] for i in lane.lanelets])
            for lane in self.certificate.lanes
            if lane.relation == relation
        ]


def decide(trace: Trace, atom: Atom, slack: Array) -> Decided:
    """At which letters an atom is true, and at which it is false.

    Args:
        slack: `safe_distance_slack`; needed for `keeps_safe_distance(preceding)` only.

    Raises:
        FormulaError: if the atom names what is not known here.
    """
    if isinstance(atom, Comparison):
        return _comparison(trace, atom)
    assert isinstance(atom, Predicate)
    match atom.name, atom.argument:
        case "in_lane", relation if relation in RELATIONS:
            areas = trace.lanes(relation)
            inside = [shapely.intersects(area, trace.bodies) for area in areas]
            return _either(np.any(inside, axis=0) if inside else np.zeros(len(trace.states), bool))
        case "in_lanelet", str(number) if number.isdecimal() and int(number) in trace.lanelets:
            return _either(shapely.intersects(trace.lanelets[int(number)], trace.bodies))
        case "keeps_safe_distance", "preceding":
            return _either(slack > 0.0)
        case "keeps_lane_speed_limit", None:
            return _either(trace.states[:, 3] <= signed_limits(trace))
        case "braking_justification", None:
            # Only a fail-safe is justified to brake abruptly, and it has no trace.
            return _either(np.zeros(len(trace.states), bool))
    raise FormulaError(f"'{atom}' cannot be decided from the certificate")


def _either(true: Bools) -> Decided:
    values = [bool(x) for x in true]
    return Decided(tuple(values), tuple(not x for x in values))


def _comparison(trace: Trace, atom: Comparison) -> Decided:
    if atom.variable != "a":
        return _either(_compared(atom, _values(trace, atom.variable)))
    c = trace.certificate
    inputs = c.witness.inputs[:, 0].reshape(c.horizon, -1)
    each = _compared(atom, inputs)
    each = np.vstack([each, each[-1:]])
    return Decided(
        tuple(bool(row.all()) for row in each), tuple(not bool(row.any()) for row in each)
    )


def _compared(atom: Comparison, values: Array) -> Bools:
    return np.asarray(values <= atom.bound if atom.op == "<=" else values < atom.bound)


def _values(trace: Trace, variable: str) -> Array:
    match variable:
        case "v":
            return trace.states[:, 3]
        case "s":
            return trace.reference.along(trace.states[:, :2])
        case "d":
            return trace.reference.across(trace.states[:, :2])
    raise FormulaError(f"'{variable}' cannot be compared from the certificate")


def signed_limits(trace: Trace) -> Array:
    """(h+1,) the signed speed limit where the body's centre is [m/s].

    The strictest of the lanelets that hold it: of the current, left and right lanes, else of any.
    inf where no sign says anything; -inf off all lanelets.
    """
    c = trace.certificate
    driven = {i for lane in c.lanes if lane.relation in DRIVEN for i in lane.lanelets}
    points = shapely.points(trace.states[:, :2])
    areas = np.array([trace.lanelets[x.id] for x in c.lanelets], dtype=object)
    signed = np.array([inf if x.speed_limit is None else x.speed_limit for x in c.lanelets])
    ours = np.array([x.id in driven for x in c.lanelets], dtype=bool)
    limits = np.full(len(points), -inf)
    for k, point in enumerate(points):
        apart = shapely.distance(areas, point)
        for here in (
            (apart == 0.0) & ours,
            apart == 0.0,
            (apart <= NEIGHBOURHOOD) & ours,
            apart <= NEIGHBOURHOOD,
        ):
            if here.any():
                limits[k] = signed[here].min()
                break
    return limits


def safe_distance_slack(trace: Trace) -> Array:
    """(h+1,) gap minus d_safe to whoever precedes, the smallest over the lanes [m]; inf: nobody.

    In each lane that the body touches, the nearest vehicle in front precedes: with the smallest
    rear end s_rear(o) >= s_front(ego) = s + length / 2 among those whose bodies reach into the
    lane, the slowest of them if several are equally near. d_safe = v^2 / (2 |a_min|) -
    v_o^2 / (2 |a_obs_min|) + v t_d (paper eq. 5 and 6), with the speed v_o of o along the lane,
    at least 0.
    """
    c = trace.certificate
    front = trace.reference.along(trace.states[:, :2]) + c.ego.length / 2
    slack = np.full(len(trace.states), inf)
    lanes = [area for relation in RELATIONS for area in trace.lanes(relation)]
    others = [_traffic(trace, o) for o in c.obstacles if o.kind not in NOT_IN_TRAFFIC]
    for lane in lanes:
        shapely.prepare(lane)
        touched = shapely.intersects(lane, trace.bodies)
        nearest = np.full(len(front), inf)
        speed = np.zeros(len(front))
        for present, shapes, rear, v in others:
            before = _in_traffic(lane, present, shapes, c) & (rear >= front)
            # Of two side by side the slower one demands more.
            counts = before & ((rear < nearest) | ((rear == nearest) & (v < speed)))
            nearest = np.where(counts, rear, nearest)
            speed = np.where(counts, v, speed)
        needed = _safe_distance(trace.states[:, 3], speed, c.settings)
        slack = np.where(touched, np.minimum(slack, nearest - front - needed), slack)
    return np.asarray(slack)


def _safe_distance(v: Array, v_o: Array, s: Settings) -> Array:
    return np.asarray(v**2 / (2 * abs(s.a_min)) - v_o**2 / (2 * abs(s.a_obs_min)) + v * s.t_d)


def _traffic(trace: Trace, o: Participant) -> tuple[Bools, Shapes, Array, Array]:
    """At each step: whether it is there, its body, the s of its rear end, its speed along s."""
    present = np.isfinite(o.states[:, 0])
    rows = np.where(present[:, None], o.states, 0.0)
    placed = [o.outline.placed(*row[:3]) for row in rows]
    shapes, radii = convex(placed)
    if radii[0] > 0.0:
        shapes = shapely.buffer(shapes, radii)
    count = len(o.outline.vertices)
    along = trace.reference.along(np.vstack([x.vertices for x in placed])).reshape(-1, count)
    rear = along.min(axis=1) - o.outline.radius
    direction = trace.reference.direction(trace.reference.along(rows[:, :2]))
    course = np.column_stack([np.cos(rows[:, 2]), np.sin(rows[:, 2])])
    speed = np.maximum(rows[:, 3] * (direction * course).sum(axis=1), 0.0)
    return present, shapes, rear, speed


def _in_traffic(lane: Any, present: Bools, shapes: Shapes, c: Certificate) -> Bools:
    """At which steps a body reaches into a lane, and is not exempt as having just cut in."""
    inside = present & shapely.intersects(lane, shapes) & ~shapely.touches(lane, shapes)
    if not c.settings.cut_in_exception:
        return np.asarray(inside)
    exempt = round(c.settings.t_c / c.dt)
    entered = -exempt
    counts = inside.copy()
    for k in range(1, len(inside)):
        # Who appears within a lane has been there before.
        if inside[k] and not inside[k - 1] and present[k - 1]:
            entered = k
        counts[k] &= k - entered >= exempt
    return np.asarray(counts)
