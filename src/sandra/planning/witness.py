"""A witness: a trajectory of the single-track model in a pair's driving corridor.

Candidates are sampled inside the corridor, put in the order of their cost, and looked at one after
another, cheap checks first: positions in the corridor, a coarse collision check of the sample; then
the sample is driven with the single-track model, and what is checked is the result of that drive.
The first that holds is the witness; nothing is concluded from those that do not.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.actions import Lateral
from sandra.logic import Specification
from sandra.planning.cost import Course, Weights, clearance_cost, costs
from sandra.planning.limits import Limits, within_limits
from sandra.planning.sampling import (
    STEEPEST,
    Motion,
    Plans,
    Start,
    double_plans,
    motions,
    profiles,
    reference,
    simple_plans,
)
from sandra.planning.trace import Lanes, Steps, satisfies, steps_of
from sandra.planning.tracking import fine_step, follow
from sandra.planning.types import Trajectory
from sandra.planning.validity import Occupied, Road
from sandra.reach.ground import Ground
from sandra.reach.sets import ReachableSet

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

FIRST = 12
"""So many profiles are tried first, with simple paths."""
BATCH = 12
"""So many candidates are compared in the plane at a time."""
MOST_DRIVEN = 60
"""So many candidates are driven with the model before the search is given up."""
COARSE = 0.02
"""Samples may leave the corridor by this much [m]: they are not yet what is driven."""
COARSE_GAP = 0.01
"""Distance to others that samples keep, half of what is then asked of what is driven [m]."""
INSIDE = 1e-6
"""States lie in the corridor up to this [m]."""


@dataclass(frozen=True, slots=True)
class Miss:
    """No witness was found; `reason` says in words why, `counts` how many candidates fell why."""

    reason: str
    counts: tuple[tuple[str, int], ...] = ()

    def __str__(self) -> str:
        return self.reason


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What the checks of all pairs on one ground share; made once."""

    ground: Ground
    occupied: Occupied
    road: Road
    lanes: Lanes

    @staticmethod
    def of(ground: Ground) -> Surroundings:
        """Prepare a ground."""
        return Surroundings(
            ground, Occupied.of(ground.prediction), Road.of(ground.scene), Lanes.of(ground)
        )


def witness(
    surroundings: Surroundings | Ground,
    specification: Specification,
    found: ReachableSet,
    *,
    weights: Weights = Weights(),  # noqa: B008  frozen
) -> Trajectory | Miss:
    """A trajectory over the whole horizon that stays in the corridor and satisfies the formula.

    It starts in the state of `scene.ego`, keeps the limits of `ground.settings`, keeps clear of the
    prediction with its full body at every instant, and stays on the road.

    Args:
        surroundings: `Surroundings.of(ground)`; made on the spot if a ground is given.
        specification, found: of one verdict.

    Raises:
        FormulaError: if the formula names a predicate that cannot be evaluated on a trajectory.
    """
    around = (
        surroundings if isinstance(surroundings, Surroundings) else Surroundings.of(surroundings)
    )
    if found.first_empty_step is not None:
        return Miss(f"the reachable set is empty at step {found.first_empty_step}")
    search = _Search(around, specification, found.corridor(), weights)
    return search.run()


class _Search:
    """One search: what it is for, and what became of the candidates."""

    def __init__(
        self,
        around: Surroundings,
        specification: Specification,
        corridor: ReachableSet,
        weights: Weights,
    ) -> None:
        self.around, self.specification = around, specification
        self.corridor, self.weights = corridor, weights
        ground = around.ground
        self.scene, self.settings = ground.scene, ground.settings
        self.limits = Limits.of(ground.settings)
        self.boxes = [np.array([b.rectangle for b in step]) for step in corridor.steps]
        self.tau, self.per_step = fine_step(self.scene.dt)
        self.start = Start.of(self.scene)
        state = self.scene.ego.state
        self.state = np.array([state.x, state.y, state.heading, state.speed, state.steering_angle])
        self.counts: Counter[str] = Counter()
        self.driven = 0

    def run(self) -> Trajectory | Miss:
        at_start = self._at_start()
        if at_start is not None:
            return Miss(at_start)
        scene = self.scene
        accelerations = profiles(
            self.corridor, self.start.speed, self.start.s, scene.dt, self.limits
        )
        if len(accelerations) == 0:
            return Miss("no acceleration profile within the inputs and speeds of the corridor")
        wanted = self._wanted_centre()
        simple = simple_plans(self.corridor, self.start.d, (wanted,), scene.dt)
        accelerations = self._in_order(accelerations)
        answer = self._among(self._candidates(accelerations[:FIRST], simple, wanted))
        if answer is None and len(accelerations) > FIRST:
            answer = self._among(self._candidates(accelerations[FIRST:], simple, wanted))
        if answer is None:
            double = double_plans(self.corridor, (wanted,), scene.dt)
            answer = self._among(self._candidates(accelerations, double, wanted))
        return self._miss() if answer is None else answer

    def _at_start(self) -> str | None:
        """Why no trajectory can be valid, whatever is done from here on."""
        still = np.tile(self.state, (1, 2, 1))
        inputs = np.zeros((1, 1, 2))
        if not self.around.road.holds(still, inputs, 0.0, self.scene.ego)[0]:
            return "the ego's body is not on the road, or at its very border, at the start"
        gap = self.around.occupied.gaps(still, inputs, 0.0, self.scene.ego)
        if gap.min() <= 0.0:
            return "the ego's body may overlap another one at the start"
        standing = replace_speed(still, self.start.speed)
        if not within_limits(standing, inputs, self.scene.ego.wheelbase, self.limits)[0]:
            return "the initial speed or steering angle breaks a limit"
        return None

    def _among(self, candidates: _Candidates) -> Trajectory | None:
        """The cheapest valid one, batch by batch: first without, then with the clearance."""
        count = len(candidates.cost)
        size = BATCH
        begin = 0
        while begin < count and self.driven < MOST_DRIVEN:
            batch = np.arange(begin, min(begin + size, count))
            begin, size = begin + size, min(2 * size, 8 * BATCH)
            states = self._coarse(candidates, batch)
            on_road = self.around.road.holds_corners(states, self.scene.ego)
            self.counts["road"] += int((~on_road).sum())
            batch, states = batch[on_road], states[on_road]
            gap = self._gap(states)
            free = gap > COARSE_GAP
            self.counts["collision"] += int((~free).sum())
            total = candidates.cost[batch] + clearance_cost(gap, self.weights)
            for index in batch[free][np.argsort(total[free], kind="stable")]:
                if self.driven >= MOST_DRIVEN:
                    break
                found = self._driven(candidates, int(index))
                if found is not None:
                    return found
        return None

    def _coarse(self, candidates: _Candidates, batch: NDArray[np.int_]) -> Array:
        """(N, h+1, 5) the samples' bodies at the prediction's steps, as states."""
        motion = Motion(*(getattr(candidates.motion, name)[batch] for name in Motion.__slots__))
        track = reference(self.scene, motion, candidates.acceleration[batch])
        nothing = np.zeros((*track.course.shape, 2))
        return np.concatenate([track.points, track.course[..., None], nothing], axis=2)

    def _gap(self, states: Array) -> Array:
        """(N,) lower bounds of the distance of bodies (N, h+1, 5) to others, at most 1 [m]."""
        inputs = np.zeros((len(states), states.shape[1] - 1, 2))
        gaps = self.around.occupied.gaps(states, inputs, self.scene.dt, self.scene.ego, within=1.0)
        return np.asarray(gaps.min(axis=1))

    def _driven(self, candidates: _Candidates, index: int) -> Trajectory | None:
        """The candidate as the model drives it, if that passes every check."""
        self.driven += 1
        scene, ego = self.scene, self.scene.ego
        fine = np.repeat(candidates.acceleration[index : index + 1], self.per_step, axis=1)
        plan = Plans(*(x[index : index + 1] for x in _columns(candidates.plans)))
        speed = self._speeds(fine, self.tau)
        motion = motions(scene, self.start, speed, self.tau, plan, scene.dt)
        track = reference(scene, motion, fine)
        states, inputs = follow(self.state, track, self.tau, ego.wheelbase, self.limits)
        fault = self._fault(states, inputs)
        if fault is not None:
            self.counts[fault] += 1
            return None
        return Trajectory(states[0], inputs[0], self.tau)

    def _fault(self, states: Array, inputs: Array) -> str | None:
        """What is wrong with a driven candidate; None if nothing is."""
        around, scene = self.around, self.scene
        if not within_limits(states, inputs, scene.ego.wheelbase, self.limits)[0]:
            return "driven limits"
        steps: Steps = steps_of(around.ground, states[0], inputs[0], self.per_step)
        s, d = steps.position[None, :, 0], steps.position[None, :, 1]
        if not self._in_corridor(s, d, INSIDE)[0]:
            return "driven corridor"
        if not around.occupied.free(states, inputs, self.tau, scene.ego)[0]:
            return "driven collision"
        if not around.road.holds(states, inputs, self.tau, scene.ego)[0]:
            return "driven road"
        if not satisfies(around.ground, around.lanes, self.specification, steps):
            return "driven formula"
        return None

    def _miss(self) -> Miss:
        counts = tuple((name, n) for name, n in self.counts.most_common() if n)
        return Miss(_reason(self.counts, self.driven), counts)


_WORDS = {
    "limits": "would break the limit on lateral acceleration",
    "corridor": "leave the corridor",
    "road": "would leave the road with a part of the body",
    "collision": "would collide with their full body",
    "driven limits": "break a limit when driven with the single-track model",
    "driven corridor": "leave the corridor when driven with the single-track model",
    "driven collision": "collide when driven with the single-track model",
    "driven road": "leave the road with a part of the body",
    "driven formula": "do not satisfy the formula on their own trace",
}


def _reason(counts: Counter[str], driven: int) -> str:
    total = sum(counts.values())
    if total == 0:
        return "no candidate: the corridor offers no target"
    parts = [f"{counts[name]} {words}" for name, words in _WORDS.items() if counts[name]]
    head = "all" if driven < MOST_DRIVEN else f"search given up after {driven} drives;"
    return f"{head} {total} candidates fail: " + ", ".join(parts)


def replace_speed(states: Array, speed: float) -> Array:
    """The same states with another speed."""
    found = states.copy()
    found[..., 3] = speed
    return found


def _columns(plans: Plans) -> tuple[Array, ...]:
    return plans.first, plans.until, plans.second, plans.begin, plans.lasting
