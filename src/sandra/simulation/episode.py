"""One episode: decide, drive what was decided, tick by tick, and see whether it came out so.

Each executed tick is held against the plan (the witness of the certificate, or the fail-safe that
continues it): `Step.breach`. From the first certificate on a valid fail-safe exists at each step
(method 6, induction): `Step.covered`. Both are facts of the run, not promises.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from sandra.actions import ActionPair
from sandra.decider import Decider, Operation
from sandra.decision import Decision
from sandra.errors import ScenarioError
from sandra.rankers import Usage, total
from sandra.scene.highway import Observer
from sandra.simulation.highway import Environment
from sandra.simulation.recording import Recorder, Recording

BREACH = 1e-6
"""A tick this far from its plan is outside of it [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One decision and what was driven until the next.

    `breach`: how far the ego came off its plan at any tick [m]. `covered`: whether a fail-safe
    that is clear of the set-based prediction existed. `cpu`: our part of the cycle [s].
    """

    index: int
    decision: Decision
    operation: Enum
    """`Operation`, or `sandra.simulation.meta.Meta`."""
    breach: float
    covered: bool
    cpu: float
    duration: float

    @property
    def pair(self) -> ActionPair | None:
        """The pair that was executed; None for a fail-safe."""
        return self.decision.maneuver.pair

    @property
    def fail_safe(self) -> bool:
        """Whether no pair was executed."""
        return self.pair is None


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """What happened: one `Step` for each decision, and everybody's states at each tick.

    `ended`: None if it lasted as long as planned, else why it did not.
    """

    recording: Recording
    steps: tuple[Step, ...]
    ticks_per_step: int
    planned_steps: int
    ended: str | None
    driver_usage: Usage | None = None
    """What a driver that asks a server by itself has cost."""

    @property
    def usage(self) -> Usage | None:
        """What all that was asked of servers has cost; None if nothing was."""
        return total((self.driver_usage, *(step.decision.ranking.usage for step in self.steps)))

    @property
    def crashed(self) -> bool:
        """Whether the ego was in a collision."""
        return self.recording.ego_crash is not None

    @property
    def first_certificate(self) -> int | None:
        """Index of the first step that was driven by a certificate; None if there was none."""
        return next((x.index for x in self.steps if x.operation is Operation.CERTIFIED), None)

    @property
    def breaches(self) -> int:
        """Number of steps that left their plan without the ego being hit."""
        return sum(step.breach > BREACH for step in self.steps)


def drive(
    world: Environment,
    seed: int,
    decider: Decider,
    *,
    name: str = "highway",
    steps: int = 30,
    on_step: Callable[[Step], None] = lambda step: None,
) -> Episode:
    """Drive one episode with certified trajectories.

    Args:
        world: the simulation. seed: of its traffic.
        decider: decides once in each decision step of the world; its `period` is left open.
        name: of the scenes. steps: number of decisions. on_step: called after each.
    """
    from sandra.simulation.ego import PlannedVehicle

    world.reset(seed)
    ticks, tick = world.traffic.ticks, world.traffic.dt
    ego = PlannedVehicle.create_from(world.ego)
    world.replace_ego(ego)
    observer = Observer.of(world.env, name, ticks * tick)
    recorder = Recorder(observer, world.env, observer.scene(ego), tick)
    done: list[Step] = []
    ended = None
    for index in range(steps):
        try:
            scene = observer.scene(ego)
        except ScenarioError as error:
            ended = str(error)
            break
        cpu, wall = time.process_time(), time.perf_counter()
        decision = decider.decide(scene)
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        plan = decision.maneuver.trajectory
        if plan is None:
            ended = f"step {index}: {decision.maneuver.note}: no trajectory to drive"
            break
        ego.follow(plan)
        breach = 0.0
        for _ in range(ticks):
            world.tick()
            recorder.note()
            if not ego.crashed:
                breach = max(breach, ego.deviation)
        covered = decider.covered
        done.append(Step(index, decision, decider.operation, breach, covered, cpu, wall))
        on_step(done[-1])
        if ego.crashed:
            ended = f"step {index}: the ego has crashed"
            break
    return Episode(recorder.recording(), tuple(done), ticks, steps, ended)
