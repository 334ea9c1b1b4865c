"""Decisions over many cycles: the last accepted fail-safe is carried until a new one replaces it.

Method 6 (induction): at each cycle the fail-safe of the last accepted certificate is still valid.
A new maneuver is driven only with a certificate of its own; otherwise the old fail-safe goes on. A
start without any certificate is driven by an emergency layer that proves nothing, says so, and ends
with the first certificate. Where others break an assumption so that neither the carried fail-safe
nor a new one is clear of them, the emergency layer takes over too, if it is given stronger braking.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.actions import ActionPair
from sandra.certify import Proven
from sandra.decision import Decision, decide
from sandra.errors import SettingsError
from sandra.planning import Maneuver, Trajectory, emergency
from sandra.planning.witness import start_state
from sandra.rankers import Ranker, as_ranker, create
from sandra.scene.types import Scene


class Operation(Enum):
    """By what the ego is driven."""

    CERTIFIED = "certified"
    """A maneuver with an accepted certificate of this cycle."""
    CARRIED = "carried"
    """The fail-safe of the last accepted certificate."""
    RENEWED = "renewed"
    """A fail-safe made anew: there is none to carry yet, or it is no longer clear of what others
    may do now: somebody broke an assumption, or got in front of the ego as the law allows."""
    EMERGENCY = "emergency"
    """No certificate has been accepted yet, or others have broken what it rests on: the best that
    was found, nothing is proven."""


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """An accepted fail-safe, and how long ago its certificate began [s]."""

    fail_safe: Trajectory
    strategy: str
    age: float

    @property
    def rest(self) -> Trajectory:
        """What is left of it, from now (time 0) on; at its end the ego stands."""
        whole = self.fail_safe
        first = round((self.age - whole.start) / whole.tau)
        first = min(max(first, 0), len(whole.inputs))
        return Trajectory(whole.states[first:], whole.inputs[first:], whole.tau, 0.0)

    def states(self, dt: float) -> NDArray[np.float64]:
        """(n, 5) x, y, heading, speed, acceleration from now on; at its end the ego stands."""
        rows = self.rest.every(dt)
        last = rows[-1:] * np.array([1.0, 1.0, 1.0, 1.0, 0.0])
        return np.vstack([rows, last])


@dataclass(frozen=True, slots=True)
class Memory:
    """All that a cycle takes over from those before."""

    carried: Carried | None = None
    past: tuple[ActionPair, ...] = ()
    cycles: int = 0


class Decider:
    """Decides cycle after cycle; after each, `operation` says by what the ego is driven, and
    `covered` whether a fail-safe is known that is clear of all that others may do.

    Args:
        ranker: as in `sandra.decide`; made once.
        period: time between two decisions [s], a multiple of `scene.dt`; default one step.
        emergency_braking: strongest braking of the emergency layer, > 0 [m/s^2]; default that of
            the settings, and then a fail-safe that no longer holds is carried on.
        options: passed on to `sandra.decide`, except `accept`, `past` and `decision_period`.
    """

    def __init__(
        self,
        ranker: str | Ranker = "rules",
        command: str | None = None,
        *,
        period: float | None = None,
        emergency_braking: float | None = None,
        **options: Any,
    ) -> None:
        taken = {"accept", "past", "decision_period"} & set(options)
        if taken:
            raise SettingsError(f"a Decider sets {', '.join(sorted(taken))} itself: leave it out")
        url = options.get("base_url")
        self._ranker = (
            create(ranker, base_url=url) if isinstance(ranker, str) else as_ranker(ranker)
        )
        self._command = command
        self._period = period
        if emergency_braking is not None and not 0.0 < emergency_braking < math.inf:
            raise SettingsError(
                f"emergency_braking = {emergency_braking!r} must be a finite number > 0 [m/s^2]"
            )
        self._emergency_braking = emergency_braking
        self._options = options
        self.memory = Memory()
        self.operation = Operation.EMERGENCY
        self.covered = False

    def decide(self, scene: Scene) -> Decision:
        """The decision for the scene as it is one period after the one before.

        Its maneuver is certified, or the carried fail-safe, or that of the emergency layer;
        `operation` says which.
        """
        period = scene.dt if self._period is None else self._period
        decision = decide(
            scene,
            self._ranker,
            self._command,
            accept="certified",
            past=self.memory.past,
            decision_period=period,
            **self._options,
        )
        carried = self.memory.carried
        if carried is not None:
            carried = replace(carried, age=carried.age + period)
        proof = None if decision.executed is None else decision.executed.proof
        past = self.memory.past
        if isinstance(proof, Proven) and decision.maneuver.pair is not None:
            self.operation, self.covered = Operation.CERTIFIED, True
            carried = Carried(proof.fail_safe.trajectory, proof.fail_safe.strategy, 0.0)
            past = (*past, decision.maneuver.pair)
        elif carried is not None:
            carried, decision = self._without_new_certificate(carried, decision)
        else:
            carried, decision = self._before_any_certificate(decision)
        self.memory = Memory(carried, past, self.memory.cycles + 1)
        return decision

    def _without_new_certificate(
        self, carried: Carried, decision: Decision
    ) -> tuple[Carried | None, Decision]:
        """Carry the fail-safe on, or replace it where it is no longer clear of others."""
        basis = decision.basis
        confirmed = basis is None or basis.confirms(carried.rest)
        fresh = None if confirmed else decision.fail_safe_now()
        self.covered = confirmed or fresh is not None
        if fresh is not None:
            self.operation = Operation.RENEWED
            carried = Carried(fresh.trajectory, fresh.strategy, 0.0)
            note = f"the carried fail-safe may collide now, a new one: {carried.strategy}"
        elif confirmed or self._emergency_braking is None:
            self.operation = Operation.CARRIED
            note = f"the fail-safe of the last certificate goes on: {carried.strategy}"
            if not confirmed:
                note += "; it may no longer be clear of others, and no other was found"
        else:
            why = "the carried fail-safe may collide now, and no other was found"
            return None, self._emergency(decision, why)
        return carried, self._driving(carried, decision, note)

    def _before_any_certificate(self, decision: Decision) -> tuple[Carried | None, Decision]:
        """A fail-safe that keeps clear of all that others may do, else the emergency layer."""
        none_yet = "no certificate has been accepted yet"
        fresh = decision.fail_safe_now()
        if fresh is None:
            return None, self._emergency(decision, none_yet)
        self.operation, self.covered = Operation.RENEWED, True
        note = f"{none_yet}, but a fail-safe was found: {fresh.strategy}"
        carried = Carried(fresh.trajectory, fresh.strategy, 0.0)
        return carried, self._driving(carried, decision, note)

    def _driving(self, carried: Carried, decision: Decision, note: str) -> Decision:
        dt = decision.scene.dt
        states, rest = carried.states(dt), carried.rest
        maneuver = Maneuver("fail-safe", None, states, dt, note, states, trajectory=rest)
        return replace(decision, maneuver=maneuver)

    def _emergency(self, decision: Decision, why: str) -> Decision:
        """The best that is found with the emergency layer's own limits; nothing is proven of it."""
        self.operation, self.covered = Operation.EMERGENCY, False
        maneuver, basis = decision.maneuver, decision.basis
        if basis is not None and self._emergency_braking is not None:
            scene, settings = decision.scene, basis.ground.settings
            braking = max(self._emergency_braking, -settings.a_lon_min)
            harder = settings.replace(a_lon_min=-braking)
            start = start_state(basis.ground)
            found = emergency(scene, start, basis.set_based, harder, basis.of_fail_safe)
            if found is not None:
                trajectory, how = found
                states = trajectory.every(scene.dt)
                maneuver = Maneuver(
                    "fail-safe", None, states, scene.dt, how, states, trajectory=trajectory
                )
        note = f"emergency, {why}: {maneuver.note}"
        return replace(decision, maneuver=replace(maneuver, note=note))
