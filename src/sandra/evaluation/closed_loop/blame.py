"""Who broke what: the named assumptions that stand behind a collision, or behind a lost fail-safe.

A certificate holds as long as the others keep the assumptions of the prediction that it rests on.
Where it is lost, the recording is asked (`sandra.evaluation.conformance`, crashed vehicles
included): did the vehicle concerned break one of those that the prediction relied on *for it*,
after that prediction was made and before the event? Only then is the event laid on it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import shapely

from sandra.certify import Basis, Proven
from sandra.decider import Carried, Operation
from sandra.evaluation.closed_loop.breaches import Breach, breaches, states_of
from sandra.planning import Trajectory
from sandra.planning.surroundings import Surroundings
from sandra.scene.types import Obstacle, Scene
from sandra.settings import Settings
from sandra.simulation.episode import Episode, Step
from sandra.simulation.meta import Meta

TOUCHING = 1.0
"""Who is farther away when the ego crashes is not its partner [m]."""
STANDS = 0.1
"""The ego stands if it is no faster [m/s] (the paper's v_err)."""
SPARES_STANDING = "spares_standing"
"""Others do not drive into the ego that stands at the end of a proven fail-safe: a standstill is
where each proof ends (method 6), so every certificate rests on it, whoever the other is."""
MADE = (Operation.CERTIFIED, Operation.RENEWED, Meta.VERIFIED)
"""Steps in which what is driven from then on was proven, as far as it is."""


@dataclass(frozen=True, slots=True)
class Lapse:
    """A step without a fail-safe that was known to be clear, and why.

    `since`: the decision whose prediction the lost fail-safe rests on. `at`: the one at which it
    was lost. `vehicles`: whose occupancy it meets from then on. `unexplained`: those of them that
    broke nothing that was relied on.
    """

    step: int
    since: int
    at: int
    vehicles: tuple[int, ...]
    breaches: tuple[Breach, ...]
    unexplained: tuple[int, ...]

    @property
    def explained(self) -> bool:
        """Whether everybody concerned had broken an assumption before."""
        return bool(self.vehicles) and not self.unexplained

    def __str__(self) -> str:
        told = f"step {self.at}: the fail-safe of step {self.since} is lost; "
        if not self.explained:
            who = ", ".join(map(str, self.unexplained))
            told += (
                f"unexplained: {f'vehicle {who} broke' if who else 'nobody is met who has broken'} "
            )
            told += "no assumption" + ("; " if self.breaches else "")
        return told + "; ".join(map(str, self.breaches))


def partner_of(episode: Episode, tick: int) -> int | None:
    """Id of the vehicle with which the ego crashed at a tick: crashed too, and in touch."""
    scene, rows = episode.recording.scene, episode.recording.ego
    near = []
    for o in scene.obstacles:
        if o.states is None or episode.recording.crashed.get(o.id, tick + 2) > tick + 1:
            continue
        for k in (max(tick - 1, 0), tick):
            mine = shapely.Polygon(scene.ego.outline.placed(*rows[k, :3]).vertices)
            theirs = shapely.Polygon(o.outline.placed(*o.states[k, :3]).vertices)
            near.append((float(mine.distance(theirs)), o.id))
    return min(near)[1] if near and min(near)[0] <= TOUCHING else None


def before_collision(
    episode: Episode, tick: int, partner: int | None, settings: Settings
) -> tuple[int, tuple[Breach, ...]]:
    """The decision that the last proof rests on (0: none before), and what the partner broke."""
    stride = episode.ticks_per_step
    past = [s for s in episode.steps if s.index * stride < tick]
    since = max((s.index for s in past if s.operation in MADE), default=0)
    if partner is None or not past:
        return since, ()
    relied = _relied(episode.steps[since], (partner,))
    scene = episode.recording.scene
    # In its last tick the ego has been pushed already, and so may have been the other.
    crashed = episode.recording.crashed
    found = breaches(scene, stride, since * stride, tick - 1, relied, settings, crashed)
    if "no_rear_end" in relied.get(partner, ()):
        closing = from_behind(scene, partner, tick)
        if closing is not None:
            hit = Breach("no_rear_end", partner, tick * scene.dt, closing, 0.0, "m/s")
            found = (*(b for b in found if b.assumption != "no_rear_end"), hit)
    if episode.steps[since].operation in MADE and tick >= 1:
        speed = abs(float(states_of(_vehicle(scene, partner))[tick - 1, 3]))
        if episode.recording.ego[tick - 1, 3] <= STANDS < speed:
            hit = Breach(SPARES_STANDING, partner, tick * scene.dt, speed, 0.0, "m/s")
            found = (*found, hit)
    return since, found


def _vehicle(scene: Scene, number: int) -> Obstacle:
    return next(o for o in scene.obstacles if o.id == number)


def from_behind(scene: Scene, other: int, tick: int) -> float | None:
    """Closing speed [m/s] if a vehicle was behind the ego, in its way, a tick before; else None."""
    rows = scene.recorded_ego
    o = _vehicle(scene, other)
    if tick < 1 or rows is None:
        return None
    mine, theirs = rows[tick - 1], states_of(o)[tick - 1]
    c, s = np.cos(mine[2]), np.sin(mine[2])
    dx, dy = theirs[:2] - mine[:2]
    along, across = c * dx + s * dy, abs(c * dy - s * dx)
    # Behind as a whole: who comes from beside hits a flank.
    if along > -(scene.ego.length + o.length) / 2 * 0.8 or across >= scene.ego.width:
        return None
    closing = float(theirs[3] * np.cos(theirs[2] - mine[2]) - mine[3])
    return closing if closing > 0.0 else None


def lapses(episode: Episode, settings: Settings) -> tuple[Lapse, ...]:
    """One for each step after the first certificate without a fail-safe known to be clear."""
    first = episode.first_certificate
    found: list[Lapse] = []
    for step in episode.steps:
        if first is None or step.index <= first or step.covered:
            continue
        if found and found[-1].step == step.index - 1:
            found.append(replace(found[-1], step=step.index))
        else:
            found.append(_lapse(episode, step, settings))
    return tuple(found)


def met(basis: Basis, rest: Trajectory) -> tuple[int, ...]:
    """Ids of all whose occupancy a fail-safe meets, from time 0 on, the first one first."""
    ids: list[int] = []
    around, predicted = basis.of_fail_safe, basis.set_based
    count = min(len(rest.inputs), int(predicted.horizon * predicted.dt / rest.tau + 1e-6))
    while count and predicted.obstacles:
        states, inputs = rest.states[None, : count + 1], rest.inputs[None, :count]
        contact = around.first_contact(states, inputs, np.array([count]), rest.tau, 0.0)
        k = int(contact[0])
        if k < 0:
            break
        ids.append(around.nearest(rest.states[k : k + 2], k * rest.tau))
        left = tuple(o for o in predicted.obstacles if o.obstacle.id != ids[-1])
        predicted = replace(predicted, obstacles=left)
        around = Surroundings.of(basis.ground.scene, predicted, around.road)
    return tuple(ids)


def _lapse(episode: Episode, step: Step, settings: Settings) -> Lapse:
    since = max(s.index for s in episode.steps[: step.index] if s.operation in MADE)
    made, stride = episode.steps[since], episode.ticks_per_step
    vehicles: tuple[int, ...] = ()
    trajectory = _fail_safe(made)
    basis = step.decision.basis
    if trajectory is not None and basis is not None:
        age = (step.index - since) * stride * episode.recording.scene.dt
        vehicles = met(basis, Carried(trajectory, "", age).rest)
    relied = _relied(made, vehicles)
    recording, until = episode.recording, step.index * stride
    found = breaches(
        recording.scene, stride, since * stride, until, relied, settings, recording.crashed
    )
    guilty = {b.vehicle for b in found}
    left = tuple(v for v in vehicles if v not in guilty)
    return Lapse(step.index, since, step.index, vehicles, found, left)


def _fail_safe(step: Step) -> Trajectory | None:
    """The fail-safe that a step gave."""
    executed = step.decision.executed
    proof = None if executed is None else executed.proof
    if step.operation is Operation.CERTIFIED and isinstance(proof, Proven):
        return proof.fail_safe.trajectory
    return step.decision.maneuver.trajectory


def _relied(step: Step, vehicles: Collection[int]) -> dict[int, tuple[str, ...]]:
    """What the set-based prediction of a step assumed of some vehicles."""
    basis, given = step.decision.basis, step.decision.ground.prediction
    sets = given if basis is None else basis.set_based
    if sets.kind != "set-based":
        return {}
    return {o.obstacle.id: o.assumptions for o in sets.obstacles if o.obstacle.id in vehicles}
