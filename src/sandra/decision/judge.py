"""What a pair is worth on one scene: verdicts, certificates, and what is driven if all fail."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache

from sandra.actions import ActionPair
from sandra.certify import Basis, Proven, certify
from sandra.logic import Vocabulary
from sandra.planning import Maneuver, Weights, full_braking, in_corridor
from sandra.planning.fail_safe_search import FailSafe
from sandra.reach import Ground, Status, Verdict, explained, verify_on


@dataclass(frozen=True, slots=True, eq=False)
class Judge:
    """All that verdicts, certificates and maneuvers of one cycle stand on.

    `basis` is None where REACHABLE is enough. `fail_safe_now` searches once, when first asked.
    """

    ground: Ground
    basis: Basis | None
    rules: tuple[str, ...]
    vocabulary: Vocabulary | None
    weights: Weights
    fail_safe_now: Callable[[], FailSafe | None]

    @staticmethod
    def of(
        ground: Ground,
        basis: Basis | None,
        rules: Sequence[str],
        vocabulary: Vocabulary | None,
        weights: Weights,
    ) -> Judge:
        """A judge whose search for a fail-safe has not begun."""
        search = cache(_nothing if basis is None else basis.fail_safe_now)
        return Judge(ground, basis, tuple(rules), vocabulary, weights, search)

    def verify(self, pairs: Sequence[ActionPair], reasons: bool = True) -> tuple[Verdict, ...]:
        """UNSAFE or REACHABLE, in the order of the pairs."""
        found = verify_on(
            self.ground, pairs, self.rules, vocabulary=self.vocabulary, reasons=reasons
        )
        return found.verdicts

    def explain(self, verdict: Verdict) -> Verdict:
        """The verdict with what emptied its set, if it is UNSAFE."""
        return explained(self.ground, verdict)

    def certify(self, verdict: Verdict) -> Verdict:
        """CERTIFIED if a certificate is asked for and found, else the verdict as it is."""
        if self.basis is None:
            return verdict
        return certify(self.basis, verdict, self.rules, self.vocabulary, self.weights)

    @property
    def enough(self) -> Status:
        """The status with which a pair holds: with which it may be driven."""
        return Status.REACHABLE if self.basis is None else Status.CERTIFIED

    def holds(self, verdict: Verdict) -> bool:
        """Whether the verdict is enough for the pair to be driven."""
        return verdict.status is self.enough

    def maneuver(self, verdicts: Iterable[Verdict]) -> Maneuver:
        """That of the first verdict that holds, else the fail-safe maneuver."""
        scene, settings = self.ground.scene, self.ground.settings
        for verdict in verdicts:
            if not self.holds(verdict):
                continue
            if isinstance(verdict.proof, Proven):
                return _proven(verdict.pair, verdict.proof, scene.dt)
            corridor = verdict.reachable_set.corridor()
            maneuver = in_corridor(scene, verdict.pair, corridor, settings)
            if maneuver is not None:
                return maneuver
        found = self.fail_safe_now()
        if found is None:
            return full_braking(scene, settings)
        states = found.trajectory.every(scene.dt)
        note = (
            f"{found.strategy}, at most {found.deceleration:.1f} m/s^2, to a standstill; "
            "keeps clear of the set-based prediction"
        )
        return Maneuver(
            "fail-safe", None, states, scene.dt, note, states, trajectory=found.trajectory
        )


def _nothing() -> None:
    return None


def _proven(pair: ActionPair, proof: Proven, dt: float) -> Maneuver:
    continuation = proof.fail_safe
    note = (
        f"certified until the next decision at {continuation.trajectory.start:g} s; from there "
        f"{continuation.strategy}, at most {continuation.deceleration:.1f} m/s^2, to a standstill"
    )
    return Maneuver(
        "certified",
        pair,
        proof.witness.every(dt),
        dt,
        note,
        continuation.trajectory.every(dt),
        continuation.trajectory.start,
        proof.witness,
    )
