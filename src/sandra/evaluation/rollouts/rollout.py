"""Rollouts of one certificate: all others act at once, each as the adversary that it is told to be.

The others do not see one another, so each is judged on its own: a rollout is as many pairs of ego
and other as there are others, played at the same time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sandra.certificate import Certificate
from sandra.evaluation.rollouts import rules
from sandra.evaluation.rollouts.actors import FIXED, FREE, LANES, Actor, actors_of
from sandra.evaluation.rollouts.adversary import KINDS, SEARCH, Plans, improved, joined, plans
from sandra.evaluation.rollouts.blame import contacts, standing_contact
from sandra.evaluation.rollouts.contact import nearest
from sandra.evaluation.rollouts.ego import Drive, execute
from sandra.evaluation.rollouts.outcome import Event, Played
from sandra.evaluation.rollouts.referee import Breaches, judge
from sandra.evaluation.rollouts.road import Road
from sandra.evaluation.rollouts.routes import Routes, routes_of
from sandra.evaluation.rollouts.traffic import Ego, Motion, simulate
from sandra.evaluation.rollouts.walkers import wander
from sandra.scene.types import Scene

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

GENERATIONS = 3
"""Batches of the search, each improving on the one before."""
LOOK = 0.1
"""The referee looks at places on the road this often, and everywhere before a contact [s]."""


def play(
    c: Certificate, scene: Scene, count: int, seed: int | list[int], road: Road | None = None
) -> Played:
    """Play `count` rollouts of a certificate.

    Args:
        scene: the one that the certificate was made in; gives the links between lanelets.
        seed: of all that is random.
        road: `Road(scene)`, where it is there already.
    """
    rng = np.random.default_rng(seed)
    road = road or Road(scene)
    drive = execute(c)
    actors = actors_of(c, scene, drive, road)
    stage = _Stage(c, road, drive, actors, routes_of(actors, road, drive, rng))
    batches = _shares(count)
    kinds = np.concatenate([np.full(n, kind) for kind, n in enumerate(batches[0])])
    results = [stage.batch(kinds, stage.drawn(kinds, rng), rng)]
    for n in batches[1:]:
        more = np.full(n[SEARCH], SEARCH)
        if len(more):
            results.append(stage.batch(more, stage.improved(results, len(more), rng), rng))
    return stage.summary(results)


def _shares(count: int) -> list[list[int]]:
    """How many rollouts of each kind in each batch: a third is search, the rest in equal parts."""
    search = count // 3
    each = [search // GENERATIONS + (i < search % GENERATIONS) for i in range(GENERATIONS)]
    rest = count - search
    plain = len(KINDS) - 1
    first = [rest // plain + (i < rest % plain) for i in range(plain)]
    return [[*first, each[0]], *([0] * plain + [n] for n in each[1:])]


@dataclass(frozen=True, slots=True, eq=False)
class _Batch:
    """(A, B) results for A moving actors and B rollouts."""

    kinds: Ints
    plans: dict[int, Plans]
    distance: Array
    breach: NDArray[np.object_]
    events: tuple[Event, ...]
    short: Bools
    cut_ins: int


class _Stage:
    """What the rollouts of one certificate share."""

    def __init__(
        self, c: Certificate, road: Road, drive: Drive, actors: tuple[Actor, ...], routes: Routes
    ) -> None:
        self.c, self.road, self.drive, self.actors, self.routes = c, road, drive, actors, routes
        length = c.ego.length
        self.ego = Ego.of(drive, road, length)
        # What has no way on the map cannot be steered along it, so it is not played.
        self.moving = [
            i
            for i, x in enumerate(actors)
            if x.moves == FREE or (x.moves == LANES and len(routes.of(i)))
        ]
        self.stride = max(1, round(LOOK / drive.step))

    def drawn(self, kinds: Ints, rng: np.random.Generator) -> dict[int, Plans]:
        """New plans for every moving actor."""
        end = float(self.drive.times[-1])
        return {i: plans(kinds, [self.routes.of(i)] * len(kinds), end, rng) for i in self.moving}

    def improved(
        self, done: list[_Batch], count: int, rng: np.random.Generator
    ) -> dict[int, Plans]:
        """Plans near those that came nearest so far, per actor."""
        end = float(self.drive.times[-1])
        best = {}
        for row, i in enumerate(self.moving):
            near = np.concatenate([batch.distance[row] for batch in done])
            tried = joined([batch.plans[i] for batch in done])
            best[i] = improved(tried, near, np.zeros(len(near), dtype=int), count, end, rng)
        return best

    def batch(self, kinds: Ints, wanted: dict[int, Plans], rng: np.random.Generator) -> _Batch:
        """Play one batch."""
        count = len(kinds)
        shape = (len(self.moving), count)
        distance, breach = np.full(shape, np.inf), np.full(shape, "", dtype=object)
        events: list[Event] = []
        motions: dict[int, tuple[Motion, Ints]] = {}
        for moves in (LANES, FREE):
            chosen = [i for i in self.moving if self.actors[i].moves == moves]
            if not chosen:
                continue
            rows = joined([wanted[i] for i in chosen])
            actors = [self.actors[i] for i in chosen for _ in range(count)]
            if moves == LANES:
                motion = simulate(actors, rows, self.routes, self.drive, self.ego, self.c.settings)
            else:
                motion = wander(actors, rows, self.drive)
            for n, i in enumerate(chosen):
                motions[i] = motion, np.arange(n * count, (n + 1) * count)
        cut_ins = 0
        for row, i in enumerate(self.moving):
            motion, mine = motions[i]
            near = nearest(self.drive, self.actors[i], motion, mine)
            judged = self._judge(i, motion, mine)
            hits = np.flatnonzero(near.contact)
            distance[row] = near.distance
            if len(hits):
                again = self._judge(i, motion, mine[hits], stride=1)
                earlier = again.step < judged.step[hits]
                judged.step[hits[earlier]] = again.step[earlier]
                judged.name[hits[earlier]] = again.name[earlier]
                events += contacts(
                    self.c, self.road, self.drive, self.actors[i], motion, mine,
                    hits, near.step, judged, kinds,
                )  # fmt: skip
            # What happens after a breach, and what a breach has made possible, does not count.
            breach[row] = judged.name
            cut_ins += int((judged.cut_in & (judged.name == "")).sum())
            distance[row, judged.name != ""] = np.inf
        short = self._shortfalls(motions, count)
        return _Batch(kinds, wanted, distance, breach, tuple(events), short, cut_ins)

    def _judge(self, i: int, motion: Motion, rows: Ints, stride: int | None = None) -> Breaches:
        stride = stride or self.stride
        return judge(self.actors[i], motion, rows, self.drive, self.road, self.c.settings, stride)

    def _shortfalls(self, motions: dict[int, tuple[Motion, Ints]], count: int) -> Bools:
        """(B,) whether R_G1 falls short of what the others really do, up to `t_dec`."""
        short = np.zeros(count, dtype=bool)
        if "R_G1" not in self.c.rules:
            return short
        for k in rules.letters(self.drive):
            others = []
            for i, actor in enumerate(self.actors):
                if actor.kind in rules.STANDING_THINGS or actor.appears > k:
                    continue
                rows = np.tile([actor.start.x, actor.start.y, actor.start.heading, 0.0], (count, 1))
                there = np.ones(count, dtype=bool)
                if i in motions:
                    motion, mine = motions[i]
                    speed = np.hypot(*motion.velocity[k, mine].T)
                    rows = np.column_stack(
                        [motion.position[k, mine], motion.heading[k, mine], speed]
                    )
                    there = motion.until[mine] > k
                others.append(
                    rules.Others(actor.outline.vertices, actor.outline.radius, rows, there)
                )
            short |= rules.safe_distance_left(self.c, self.drive, self.road, k, others) <= 0.0
        return short

    def summary(self, done: list[_Batch]) -> Played:
        """One result of all batches."""
        kinds = np.concatenate([batch.kinds for batch in done])
        distance = np.concatenate([batch.distance for batch in done], axis=1)
        breach = np.concatenate([batch.breach for batch in done], axis=1)
        short = np.concatenate([batch.short for batch in done])
        events: list[Event] = []
        offset = 0
        for batch in done:
            for event in batch.events:
                events.append(replace(event, rollout=event.rollout + offset))
            offset += len(batch.kinds)
        fixed = [x for x in self.actors if x.moves == FIXED]
        standing = np.inf
        for actor in fixed:
            near = standing_contact(self.drive, actor)
            standing = min(standing, near[0])
            if near[1] >= 0:
                events += [
                    Event(
                        "collision",
                        b,
                        KINDS[kind],
                        actor.id,
                        actor.kind,
                        round(near[1] * self.drive.step, 4),
                        0.0,
                    )
                    for b, kind in enumerate(kinds.tolist())
                ]
        names, counts = np.unique(breach[breach != ""].astype(str), return_counts=True)
        hit = {event.rollout for event in events}
        fine = (breach == "").all(axis=0)
        fine[sorted(hit)] = True
        closest = distance.min(axis=0, initial=np.inf)
        return Played(
            kinds,
            np.minimum(closest, standing),
            fine,
            tuple(events),
            dict(zip(names.tolist(), counts.tolist(), strict=True)),
            tuple(rules.broken(self.c, self.drive, self.road)),
            int(short.sum()),
            sum(batch.cut_ins for batch in done),
            len(self.moving),
            float(self.drive.times[-1]),
            self.drive.deviation,
        )
