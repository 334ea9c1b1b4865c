"""A witness: a trajectory of the single-track model in a pair's driving corridor.

Candidates are sampled inside the corridor, put in the order of their cost, and looked at one after
another, cheap checks first: positions in the corridor, the formula and collisions of the sample;
then the sample is driven with the single-track model, and what is checked is the result of that
drive. The first that holds is the witness; nothing is concluded from those that do not.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from sandra.logic import Specification
from sandra.planning.bounds import clear
from sandra.planning.candidates import Candidates, Sampler
from sandra.planning.cost import Weights, clearance_cost
from sandra.planning.limits import Limits, within_limits
from sandra.planning.trace import Lanes, satisfies, steps_of
from sandra.planning.tracking import fine_step, follow
from sandra.planning.types import Trajectory
from sandra.planning.validity import CLEARANCE, Occupied, Road
from sandra.reach.ground import Ground
from sandra.reach.sets import ReachableSet

Array = NDArray[np.float64]
Rows = NDArray[np.int_]

BATCH = 12
"""So many candidates are compared in the plane at first; then twice as many each time."""
LARGEST_BATCH = 96
MOST_DRIVEN = 60
"""So many candidates are driven with the model before the search is given up."""
MOST_PER_PROFILE = 6
"""So many of one acceleration profile are driven in vain in a stage of sampling."""
MOST_ASKED = 8
"""So many valid trajectories are shown to `accept` before the search is given up."""
MOST_AS_FAST = 2
"""After so many refusals, what is as fast at the next decision, or faster, is shown no more."""
SLOWER = 1 / 12
"""Speeds at the next decision differ if they do by this part of what can be gained until then."""
COARSE_GAP = 0.01
"""Distance to others that samples keep, half of what is then asked of what is driven [m]."""
INSIDE = 1e-6
"""Positions lie in the corridor up to this [m]."""


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
    def of(ground: Ground, road: Road | None = None) -> Surroundings:
        """Prepare a ground; `road`: `Road.of(ground.scene)`."""
        road = Road.of(ground.scene) if road is None else road
        return Surroundings(ground, Occupied.of(ground.prediction), road, Lanes.of(ground))


def witness(
    surroundings: Surroundings | Ground,
    specification: Specification,
    found: ReachableSet,
    *,
    weights: Weights = Weights(),  # noqa: B008  frozen
    accept: Callable[[Trajectory], str | None] = lambda trajectory: None,
    decided_at: float | None = None,
) -> Trajectory | Miss:
    """A trajectory over the whole horizon that stays in the corridor and satisfies the formula.

    It starts in the state of `scene.ego`, keeps the limits of `ground.settings`, keeps clear of the
    prediction with its full body at every instant, and stays on the road (method, Sec. 6).

    Args:
        surroundings: `Surroundings.of(ground)`; made on the spot if a ground is given.
        specification, found: of one verdict.
        weights: what makes one trajectory better than another.
        accept: what else is asked of a trajectory, such as a fail-safe continuation: None, or in
            words what is wrong; then the next one is shown.
        decided_at: when the next decision is due [s], default after one step. What is wrong with
            a trajectory is mostly that it is too fast then: slower ones are shown next.

    Raises:
        FormulaError: if the formula names a predicate that cannot be evaluated on a trajectory.
    """
    if found.first_empty_step is not None:
        return Miss(f"the reachable set is empty at step {found.first_empty_step}")
    around = (
        surroundings if isinstance(surroundings, Surroundings) else Surroundings.of(surroundings)
    )
    wrong = _wrong_at_start(around)
    if wrong is not None:
        return Miss(wrong)
    search = _Search(around, specification, found.corridor(), weights, decided_at)
    # Different samples are often driven alike: the same question is asked once.
    known: dict[bytes, str] = {}
    for trajectory, gained in islice(search.trajectories(), MOST_ASKED):
        key = trajectory.inputs.tobytes()
        answer = known.get(key) or accept(trajectory)
        if answer is None:
            return trajectory
        known[key] = answer
        search.refused.append(gained)
        search.counts[f"are valid, but {answer}"] += 1
    return search.miss()


def start_state(ground: Ground) -> Array:
    """(5,) the ego's state as one of the single-track model."""
    state = ground.scene.ego.state
    return np.array([state.x, state.y, state.heading, state.speed, state.steering_angle])


def _wrong_at_start(around: Surroundings) -> str | None:
    """Why no trajectory can be valid, whatever is done from here on."""
    ego, settings = around.ground.scene.ego, around.ground.settings
    states = np.tile(start_state(around.ground), (1, 2, 1))
    inputs = np.zeros((1, 1, 2))
    if not within_limits(states, inputs, ego.wheelbase, Limits.of(settings, 0.0))[0]:
        return "the initial speed or steering angle breaks a limit"
    states[..., 3] = 0.0
    if not around.road.holds(states, inputs, 0.0, ego)[0]:
        return "the ego's body is not on the road, or at its very border, at the start"
    if not clear(around.occupied.gaps(states, inputs, 0.0, ego).min(), CLEARANCE):
        return "the ego's body touches another one, or nearly so, at the start"
    return None


class _Search:
    """One search: what it is for, and what became of the candidates."""

    def __init__(
        self,
        around: Surroundings,
        specification: Specification,
        corridor: ReachableSet,
        weights: Weights,
        decided_at: float | None,
    ) -> None:
        self.around, self.specification, self.weights = around, specification, weights
        self.ground, self.scene = around.ground, around.ground.scene
        self.limits = Limits.of(self.ground.settings)
        self.tau, self.per_step = fine_step(self.scene.dt)
        self.counts: Counter[str] = Counter()
        self.driven = 0
        self.closest: tuple[float, Array] | None = None
        dt, settings = self.scene.dt, self.ground.settings
        self.until = 1 if decided_at is None else max(1, round(decided_at / dt))
        self.step = SLOWER * (settings.a_lon_max - settings.a_lon_min) * self.until * dt
        self.refused: list[float] = []
        """Speeds gained until the next decision by what was refused [m/s]."""
        lateral = specification.pair.lateral
        self.sampler = Sampler(self.ground, corridor, lateral, weights, self.counts)

    def trajectories(self) -> Iterator[tuple[Trajectory, float]]:
        """Valid ones, with the speed they gain until the next decision [m/s].

        Within each stage of sampling roughly cheapest first.
        """
        for stage in range(self.sampler.stages):
            candidates = self.sampler.stage(stage)
            gained = candidates.acceleration[:, : self.until].sum(axis=1) * self.scene.dt
            failed = np.zeros(len(self.sampler.accelerations), dtype=int)
            rows, size = np.arange(len(candidates)), BATCH
            while (rows := self._hopeful(rows, candidates, gained, failed)).size:
                batch, rows, size = rows[:size], rows[size:], min(2 * size, LARGEST_BATCH)
                for index in self._clear(candidates, batch):
                    if self.driven >= MOST_DRIVEN:
                        return
                    if not self._hopeful(np.array([index]), candidates, gained, failed).size:
                        continue
                    found = self._drive(candidates, index)
                    if found is not None:
                        yield found, float(gained[index])
                    else:
                        failed[candidates.profile[index]] += 1

    def _hopeful(
        self, rows: Rows, candidates: Candidates, gained: Array, failed: NDArray[np.int_]
    ) -> Rows:
        """Those that are not like others that were driven or shown in vain."""
        faster = gained[rows, None] > np.array(self.refused) - self.step
        hopeful = failed[candidates.profile[rows]] < MOST_PER_PROFILE
        hopeful &= faster.sum(axis=1) < MOST_AS_FAST
        self.counts["skipped"] += int((~hopeful).sum())
        return rows[hopeful]

    def _clear(self, candidates: Candidates, rows: Rows) -> list[int]:
        """Those whose samples satisfy the formula, on the road and away from others, in order of
        full cost."""
        bodies = self.sampler.bodies(candidates, rows)
        kept = self.around.road.may_hold(bodies, self.scene.ego)
        self.counts["road"] += int((~kept).sum())
        rows, bodies = rows[kept], bodies[kept]
        if rows.size:
            steps = self.sampler.steps(candidates, rows, bodies)
            kept = satisfies(self.ground, self.around.lanes, self.specification, steps)
            self.counts["formula"] += int((~kept).sum())
            rows, bodies = rows[kept], bodies[kept]
        if rows.size == 0:
            return []
        inputs = np.zeros((len(bodies), bodies.shape[1] - 1, 2))
        gap = self.around.occupied.gaps(
            bodies, inputs, self.scene.dt, self.scene.ego, within=1.0
        ).min(axis=1)
        free = clear(gap, COARSE_GAP)
        self.counts["collision"] += int((~free).sum())
        best = int(np.argmax(gap))
        if not free[best]:
            found = float(gap[best]), bodies[best : best + 1]
            self.closest = max(self.closest or found, found, key=lambda x: x[0])
        total = candidates.cost[rows] + clearance_cost(gap, self.weights)
        order = np.argsort(total[free], kind="stable")
        return [int(i) for i in rows[free][order]]

    def _drive(self, candidates: Candidates, index: int) -> Trajectory | None:
        """The candidate as the model drives it, if that passes every check."""
        self.driven += 1
        track = self.sampler.reference(candidates, index, self.tau, self.per_step)
        wheelbase = self.scene.ego.wheelbase
        start = start_state(self.ground)
        states, inputs = follow(start, track, self.tau, wheelbase, self.limits)
        fault = self._fault(states, inputs)
        if fault is not None:
            self.counts[fault] += 1
            return None
        return Trajectory(states[0], inputs[0], self.tau)

    def _fault(self, states: Array, inputs: Array) -> str | None:
        """What is wrong with a driven candidate; None if nothing is."""
        around, ego = self.around, self.scene.ego
        if not within_limits(states, inputs, ego.wheelbase, self.limits)[0]:
            return "driven limits"
        steps = steps_of(self.ground, states[0], inputs[0], self.per_step)
        s, d = steps.position[..., 0], steps.position[..., 1]
        if not self.sampler.inside(s, d, INSIDE)[0]:
            return "driven corridor"
        if not around.occupied.free(states, inputs, self.tau, ego)[0]:
            return "driven collision"
        if not around.road.holds(states, inputs, self.tau, ego)[0]:
            return "driven road"
        if not satisfies(self.ground, around.lanes, self.specification, steps)[0]:
            return "driven formula"
        return None

    def miss(self) -> Miss:
        """Why the search found nothing."""
        counts = tuple((name, n) for name, n in self.counts.most_common() if n)
        if not self.sampler.stages:
            return Miss("no acceleration profile within the inputs and speeds of the corridor")
        total = sum(self.counts.values())
        parts = [f"{n} {_WORDS.get(name, name)}" for name, n in counts]
        given_up = f" (given up after {self.driven} drives)" if self.driven >= MOST_DRIVEN else ""
        return Miss(
            f"all {total} candidates fail: {', '.join(parts)}{self._nearest()}{given_up}", counts
        )

    def _nearest(self) -> str:
        """Whom the best of the colliding samples collides with."""
        if self.closest is None:
            return ""
        gap, bodies = self.closest
        inputs = np.zeros((1, bodies.shape[1] - 1, 2))
        near = self.around.occupied.nearest(bodies, inputs, self.scene.dt, self.scene.ego)
        assert near is not None, "a gap has somebody at its other side"
        obstacle = self.ground.prediction.obstacles[near[0]].obstacle
        return (
            f"; the best of them lacks {COARSE_GAP - gap:.2f} m to {obstacle.kind} {obstacle.id} "
            f"at {near[1]:.1f} s"
        )


_WORDS = {
    "skipped": "are like others that failed",
    "limits": "need too much lateral acceleration or are too steep",
    "corridor": "leave the corridor",
    "road": "leave the road with a part of the body",
    "formula": "do not satisfy the formula",
    "collision": "collide with their full body",
    "driven limits": "break a limit when driven with the single-track model",
    "driven corridor": "leave the corridor when driven with the single-track model",
    "driven collision": "collide when driven with the single-track model",
    "driven road": "leave the road when driven with the single-track model",
    "driven formula": "do not satisfy the formula on their own trace",
}
