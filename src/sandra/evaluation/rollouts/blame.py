"""Two bodies have met: whose fault is it, the certificate's or that of the other?"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.certificate import Certificate
from sandra.certificate.types import Body
from sandra.evaluation.rollouts.actors import Actor
from sandra.evaluation.rollouts.adversary import KINDS
from sandra.evaluation.rollouts.contact import nearest
from sandra.evaluation.rollouts.ego import Drive, rectangle
from sandra.evaluation.rollouts.outcome import Event
from sandra.evaluation.rollouts.referee import Breaches, lane_state
from sandra.evaluation.rollouts.road import Road
from sandra.evaluation.rollouts.traffic import Motion
from sandra.settings import Settings

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def contacts(
    c: Certificate,
    road: Road,
    drive: Drive,
    actor: Actor,
    motion: Motion,
    mine: Ints,
    hits: Ints,
    step: Ints,
    judged: Breaches,
    kinds: Ints,
) -> list[Event]:
    """The contacts of one actor that no breach came before.

    Args:
        mine: (B,) its rows of `motion`, one per rollout.
        hits: rollouts with a contact; `step` (B,) the fine steps of these.
        judged: (B,) breaches so far. What came later than a contact is struck out; a contact from
            behind is entered where `no_rear_end` is listed.
        kinds: (B,) of adversaries.
    """
    found = []
    for b in hits.tolist():
        k, column = int(step[b]), int(mine[b])
        if judged.step[b] <= k:
            continue
        judged.name[b], judged.step[b] = "", len(drive.states)
        p, psi, v = (x[:, [column]] for x in (motion.position, motion.heading, motion.velocity))
        looked = np.arange(actor.appears, k + 1)
        came_ahead, entered = False, 0
        if road.reference is not None and (actor.yields or actor.keeps_out):
            state = lane_state(actor, p, psi, v, looked, drive, road, c.settings)
            inside: Bools = state[0][:, 0]
            ahead, after = state[1][:, 0], state[2][:, 0]
            if actor.yields and inside[-1] and ahead[-1] < after[-1]:
                judged.name[b], judged.step[b] = "no_rear_end", k
                continue
            if inside[-1] and not inside.all():
                first = int(np.flatnonzero(~inside)[-1]) + 1
                entered, came_ahead = int(looked[first]), bool(ahead[first] > 0.0)
        cut_in = actor.keeps_out and came_ahead
        found.append(
            Event(
                "after a cut-in" if cut_in else "collision",
                b,
                KINDS[kinds[b]],
                actor.id,
                actor.kind,
                round(k * drive.step, 4),
                round(float(drive.states[k, 3]), 3),
                cut_in and avoided(drive, actor, motion, column, entered, c.ego, c.settings),
            )
        )
    return found


def avoided(
    drive: Drive,
    actor: Actor,
    motion: Motion,
    column: int,
    entered: int,
    ego: Body,
    s: Settings,
) -> bool:
    """Whether braking with `a_min` on the same path, `t_d` after the other came in, is enough.

    As who follows with the safe distance does (R_G1).

    Args:
        entered: the fine step at which the other came into the ego's lane.
    """
    begin = entered + int(np.ceil(s.t_d / drive.step))
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(drive.states[:, :2], axis=0).T))])
    v = drive.states[min(begin, len(way) - 1), 3]
    late = np.maximum(np.arange(len(way)) - begin, 0) * drive.step
    late = np.minimum(late, v / abs(s.a_min))
    reached = way[min(begin, len(way) - 1)] + v * late - abs(s.a_min) / 2 * late**2
    braked = np.minimum(way, reached)
    states = drive.states.copy()
    for j in (0, 1):
        states[:, j] = np.interp(braked, way, drive.states[:, j])
    states[:, 2] = np.interp(braked, way, np.unwrap(drive.states[:, 2]))
    states[1:, 3] = np.diff(braked) / drive.step
    corners = rectangle(states[:, :2], states[:, 2], ego.length, ego.width)
    other = Drive(
        drive.step, states, drive.acceleration, corners, drive.decision, drive.per_dt, 0.0
    )
    return not bool(nearest(other, actor, motion, np.array([column])).contact[0])


def standing_contact(drive: Drive, actor: Actor) -> tuple[float, int]:
    """(smallest distance, fine step of the first contact or -1) for what stands."""
    body = actor.outline.placed(actor.start.x, actor.start.y, actor.start.heading)
    shape = shapely.convex_hull(shapely.multipoints(body.vertices))
    gaps = shapely.distance(shapely.polygons(drive.corners), shape) - body.radius
    hit = np.flatnonzero(gaps[actor.appears :] <= 0.0)
    first = int(hit[0]) + actor.appears if len(hit) else -1
    return float(gaps[actor.appears :].min()), first
