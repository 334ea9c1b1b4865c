"""Candidates for a witness: profiles and paths combined, inside the corridor, in order of cost."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sandra.actions import Lateral
from sandra.planning.bounds import stands, within
from sandra.planning.cost import Course, Weights, costs
from sandra.planning.limits import Limits
from sandra.planning.profiles import profiles
from sandra.planning.sampling import (
    STEEPEST,
    Motion,
    Plans,
    Start,
    double_plans,
    motions,
    reference,
    simple_plans,
)
from sandra.planning.trace import Steps
from sandra.planning.tracking import Reference
from sandra.planning.validity import corners
from sandra.reach.ground import Ground
from sandra.reach.sets import ReachableSet

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

FIRST = 12
"""So many profiles are tried first, with simple paths."""
COARSE = 0.02
"""Samples may leave the corridor by this much [m]: they are not yet what is driven."""
TOO_MUCH = 1.1
"""Samples may ask for this multiple of the lateral acceleration; driving then cuts the corner."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """N samples, cheapest first: number of the profile (N,), its accelerations (N, h), plans,
    motion at the prediction's steps and cost (N,), that of the clearance left out."""

    profile: NDArray[np.int_]
    acceleration: Array
    plans: Plans
    motion: Motion
    cost: Array

    def __len__(self) -> int:
        return len(self.cost)


@dataclass(frozen=True, slots=True, eq=False)
class Sampler:
    """Makes candidates for one pair; `counts` says how many samples were left out, and why."""

    ground: Ground
    corridor: ReachableSet
    lateral: Lateral
    weights: Weights
    counts: Counter[str]
    start: Start = field(init=False)
    accelerations: Array = field(init=False)
    """(P, h) the profiles, cheapest first."""
    _boxes: tuple[Array, ...] = field(init=False)
    _centre: float = field(init=False)

    def __post_init__(self) -> None:
        scene, settings = self.ground.scene, self.ground.settings
        start = Start.of(scene)
        values = {
            "start": start,
            "_boxes": tuple(np.array([b.rectangle for b in x]) for x in self.corridor.steps),
            "_centre": self._wanted_centre(),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        found = profiles(self.corridor, start.speed, start.s, scene.dt, Limits.of(settings))
        object.__setattr__(self, "accelerations", self._in_order(found))

    @property
    def stages(self) -> int:
        """Number of stages; see `stage`."""
        return 3 if len(self.accelerations) else 0

    def stage(self, number: int) -> Candidates:
        """Stage 0: simple paths with the cheapest profiles; 1: with the others; 2: double paths."""
        dt, wanted = self.ground.scene.dt, (self._centre,)
        if number == 2:
            return self._combined(self.accelerations, double_plans(self.corridor, wanted, dt))
        part = slice(0, FIRST) if number == 0 else slice(FIRST, None)
        plans = simple_plans(self.corridor, self.start.d, wanted, dt)
        return self._combined(self.accelerations[part], plans)

    def bodies(self, candidates: Candidates, rows: NDArray[np.int_]) -> Array:
        """(len(rows), h+1, 5) the samples' bodies at the prediction's steps, as states."""
        motion = candidates.motion.rows(rows)
        scene = self.ground.scene
        track = reference(scene, motion, candidates.acceleration[rows])
        # The heading follows the course: theta' = 2 v sin(course - theta) / wheelbase.
        moved = (motion.speed[:, 1:] + motion.speed[:, :-1]) / 2 * scene.dt
        kept = np.exp(-2 * moved / scene.ego.wheelbase)
        heading = np.empty_like(track.course)
        heading[:, 0] = scene.ego.state.heading
        for k in range(kept.shape[1]):
            middle = (track.course[:, k] + track.course[:, k + 1]) / 2
            behind = np.remainder(heading[:, k] - middle + np.pi, 2 * np.pi) - np.pi
            heading[:, k + 1] = middle + kept[:, k] * behind
        nothing = np.zeros((*heading.shape, 2))
        return np.concatenate([track.points, heading[..., None], nothing], axis=2)

    def steps(self, candidates: Candidates, rows: NDArray[np.int_], bodies: Array) -> Steps:
        """What formulas speak of, for samples with these `bodies` (len(rows), h+1, 5)."""
        motion = candidates.motion.rows(rows)
        inputs = candidates.acceleration[rows]
        inputs = np.concatenate([inputs, inputs[:, -1:]], axis=1)
        return Steps(
            corners(bodies, self.ground.scene.ego),
            motion.speed,
            motion.along,
            np.stack([motion.s, motion.d], axis=-1),
            np.stack([inputs, inputs], axis=-1),
        )

    def reference(self, candidates: Candidates, index: int, tau: float, per_step: int) -> Reference:
        """One sample every `tau` seconds, to be driven."""
        scene = self.ground.scene
        fine = np.repeat(candidates.acceleration[index : index + 1], per_step, axis=1)
        plan = candidates.plans.rows(np.array([index]))
        motion = motions(scene, self.start, self._speeds(fine, tau), tau, plan)
        return reference(scene, motion, fine)

    def inside(self, s: Array, d: Array, slack: float) -> Bools:
        """(N,) whether positions (N, h+1) lie in the corridor's rectangles at every step."""
        rows = np.arange(len(s))
        for k in range(self.corridor.horizon, 0, -1):
            boxes = self._boxes[k]
            x, y = s[rows, k, None], d[rows, k, None]
            inside = within(x, boxes[:, 0], boxes[:, 1], slack)
            inside &= within(y, boxes[:, 2], boxes[:, 3], slack)
            rows = rows[inside.any(axis=1)]
        found = np.zeros(len(s), dtype=np.bool_)
        found[rows] = True
        return found

    def _combined(self, accelerations: Array, plans: Plans) -> Candidates:
        """Every profile with every plan; those outside of the corridor are left out."""
        scene = self.ground.scene
        profile = np.repeat(np.arange(len(accelerations)), len(plans))
        chosen = accelerations[profile]
        pairs = plans.rows(np.tile(np.arange(len(plans)), len(accelerations)))
        motion = motions(scene, self.start, self._speeds(chosen, scene.dt), scene.dt, pairs)
        lateral = motion.speed**2 * (motion.bend + scene.frame.curvature(motion.s))
        most = TOO_MUCH * self.ground.settings.a_lat_max
        kept = within(motion.slope, -STEEPEST, STEEPEST).all(axis=1)
        kept &= within(lateral[:, 1:], -most, most).all(axis=1)
        self.counts["limits"] += int((~kept).sum())
        inside = np.zeros_like(kept)
        inside[kept] = self.inside(motion.s[kept], motion.d[kept], COARSE)
        self.counts["corridor"] += int((kept & ~inside).sum())
        rows = np.flatnonzero(inside)
        course = Course(
            chosen[rows],
            motion.speed[rows],
            lateral[rows],
            motion.d[rows] - self._centre,
            pairs.duration[rows],
        )
        cost = self._costs(course)
        order = np.argsort(cost, kind="stable")
        rows = rows[order]
        return Candidates(
            profile[rows], chosen[rows], pairs.rows(rows), motion.rows(rows), cost[order]
        )

    def _wanted_centre(self) -> float:
        """d of the centre of the lane that the pair aims at, at the corridor's last step [m]."""
        scene = self.ground.scene
        lane = {Lateral.LEFT_LANE: scene.left, Lateral.RIGHT_LANE: scene.right}.get(self.lateral)
        if lane is None:
            return 0.0
        points = scene.frame.to_curvilinear(lane.center)
        s = np.mean([np.mean(b.rectangle[:2]) for b in self.corridor.steps[-1]])
        order = np.argsort(points[:, 0])
        return float(np.interp(s, points[order, 0], points[order, 1]))

    def _in_order(self, accelerations: Array) -> Array:
        """The profiles in the order of what they cost in the lane."""
        zeros = np.zeros((len(accelerations), accelerations.shape[1] + 1))
        speed = self._speeds(accelerations, self.ground.scene.dt)
        cost = self._costs(Course(accelerations, speed, zeros, zeros, zeros[:, 0]))
        return np.asarray(accelerations[np.argsort(cost, kind="stable")])

    def _costs(self, course: Course) -> Array:
        scene, weights = self.ground.scene, self.weights
        wanted = weights.desired_speed
        if wanted is None:
            limit = scene.speed_limit
            wanted = self.start.speed if limit is None else limit
        wanted = max(0.0, wanted + weights.faster)
        return costs(course, weights, wanted, scene.ego.state.acceleration, scene.dt)

    def _speeds(self, accelerations: Array, step: float) -> Array:
        """(N, n+1) speeds under accelerations (N, n), each lasting `step` seconds."""
        gained = self.start.speed + np.cumsum(accelerations * step, axis=1)
        speed = np.concatenate([np.full((len(gained), 1), self.start.speed), gained], axis=1)
        return np.where(stands(speed), 0.0, speed)
