"""From REACHABLE to CERTIFIED: witness, fail-safe, certificate, and the checker's word.

Method 6. The planner proposes, the independent checker disposes: a verdict becomes CERTIFIED only
with a certificate that `sandra.certificate.check` accepted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from sandra.certificate import Certificate, Report, certificate, check
from sandra.logic import Vocabulary
from sandra.planning.cost import Weights
from sandra.planning.fail_safe_search import FailSafe, fail_safe, fail_safe_horizon
from sandra.planning.surroundings import Surroundings as OfFailSafe
from sandra.planning.types import Trajectory
from sandra.planning.witness import Miss, Surroundings, start_state, witness
from sandra.prediction import Prediction, predict
from sandra.reach import Ground, Status, Verdict

MILDEST = 4.0
"""The prediction lasts long enough for braking this mild; milder ones are tried as far as it goes
[m/s^2]."""


@dataclass(frozen=True, slots=True, eq=False)
class Proven:
    """A witness up to the next decision, its fail-safe continuation, and what the checker says."""

    witness: Trajectory
    fail_safe: FailSafe
    certificate: Certificate
    report: Report

    @property
    def accepted(self) -> bool:
        """Whether the independent checker accepted the certificate."""
        return self.report.accepted


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """What the certificates of all pairs on one ground share; made once.

    `t_dec` is when the next decision is due [s]; `set_based` covers every fail-safe.
    """

    ground: Ground
    set_based: Prediction
    t_dec: float
    of_witness: Surroundings
    of_fail_safe: OfFailSafe

    @staticmethod
    def of(ground: Ground, t_dec: float | None = None) -> Basis:
        """Prepare a ground; the next decision is due after one step unless `t_dec` says else."""
        scene, settings = ground.scene, ground.settings
        due = scene.dt if t_dec is None else t_dec
        steps = fail_safe_horizon(scene, settings, due, MILDEST)
        given = ground.prediction
        if given.kind == "set-based" and given.horizon >= steps:
            set_based = given
        else:
            # Fail-safes and certificates only ask what is occupied during each step.
            set_based = predict(scene, "set-based", steps, settings, instants=False)
        return Basis(
            ground, set_based, due, Surroundings.of(ground), OfFailSafe.of(scene, set_based)
        )

    def fail_safe_now(self) -> FailSafe | None:
        """A fail-safe trajectory from the present state, without any maneuver before it."""
        scene, settings = self.ground.scene, self.ground.settings
        start = start_state(self.ground)
        if start[3] < 0.0:
            return None
        found = fail_safe(scene, start, 0.0, self.set_based, settings, self.of_fail_safe)
        return found if isinstance(found, FailSafe) else None


def certify(
    basis: Basis,
    verdict: Verdict,
    rules: Sequence[str] = (),
    vocabulary: Vocabulary | None = None,
    weights: Weights | None = None,
) -> Verdict:
    """CERTIFIED with its proof, or the verdict as it was with the reason why there is none."""
    if verdict.status is not Status.REACHABLE:
        return verdict
    search = _Continuations(basis)
    found = witness(
        basis.of_witness,
        verdict.specification,
        verdict.reachable_set,
        weights=weights or Weights(),
        accept=search.wrong_with,
    )
    if isinstance(found, Miss):
        return replace(verdict, reason=f"no certificate: {found.reason}")
    continuation = search.found
    assert continuation is not None, "a witness is accepted only with its continuation"
    proposed = certificate(
        basis.ground.scene,
        verdict.specification,
        rules,
        basis.ground.prediction,
        basis.set_based,
        found,
        basis.t_dec,
        continuation.trajectory,
        basis.ground.settings,
        vocabulary=vocabulary,
    )
    report = check(proposed)
    if report.violation is not None:
        said = f"{report.violation.condition}: {report.violation.sentence}"
        return replace(verdict, reason=f"no certificate: the checker rejected it ({said})")
    proof = Proven(found, continuation, proposed, report)
    return replace(verdict, status=Status.CERTIFIED, proof=proof)


@dataclass(slots=True)
class _Continuations:
    """Looks for the fail-safe continuation of each witness that is shown; keeps the last found."""

    basis: Basis
    found: FailSafe | None = field(default=None)

    def wrong_with(self, trajectory: Trajectory) -> str | None:
        """None if the witness can be continued safely, else in words why not."""
        basis = self.basis
        index = round((basis.t_dec - trajectory.start) / trajectory.tau)
        found = fail_safe(
            basis.ground.scene,
            trajectory.states[index],
            basis.t_dec,
            basis.set_based,
            basis.ground.settings,
            basis.of_fail_safe,
        )
        if isinstance(found, FailSafe):
            self.found = found
            return None
        self.found = None
        return "have no fail-safe continuation"
