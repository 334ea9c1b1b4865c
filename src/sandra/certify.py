"""From REACHABLE to CERTIFIED: witness, fail-safe, certificate, and the checker's word.

Method 6. The planner proposes, the independent checker disposes: a verdict becomes CERTIFIED only
with a certificate that `sandra.certificate.check` accepted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sandra.actions import ActionPair
from sandra.certificate import Certificate, Report, certificate, check
from sandra.errors import SettingsError
from sandra.logic import Vocabulary
from sandra.planning.cost import Weights
from sandra.planning.fail_safe_rounds import ROUNDS, SAMPLED, Rounds
from sandra.planning.fail_safe_search import FailSafe, fail_safe, fail_safe_horizon
from sandra.planning.fail_safe_search import Miss as NoFailSafe
from sandra.planning.given import driven
from sandra.planning.surroundings import Surroundings as OfFailSafe
from sandra.planning.types import Trajectory
from sandra.planning.validity import Road
from sandra.planning.witness import Miss, Surroundings, start_state, witness
from sandra.prediction import Prediction, predict
from sandra.reach import Ground, Status, Verdict, Verdicts
from sandra.scene.types import Scene
from sandra.settings import Settings

MILDEST = 4.0
"""The prediction lasts long enough for braking this mild; milder ones are tried as far as it goes
[m/s^2]."""
MOST_OPTIMISED = 2
"""For so many of a pair's witnesses the fail-safe's speed is optimised where samples fail: what
blocks the first mostly blocks the others too."""
ALIKE = (0.02, 0.02, 0.005, 0.1, 0.02)
"""States at the next decision that differ by no more than this are asked about once: from where no
fail-safe was found, none is looked for again [m, m, rad, m/s, rad]."""


WELL_CLEAR = 6.0
"""Distances beyond this make no difference to any search or check [m]; those who keep it whatever
they do are predicted roughly."""


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
        """Prepare a ground; the next decision is due after one step unless `t_dec` says else.

        Raises:
            SettingsError: if `t_dec` is no multiple of `scene.dt` within the horizon.
        """
        scene, settings = ground.scene, ground.settings
        due = scene.dt if t_dec is None else t_dec
        last = ground.horizon * scene.dt
        if not 0.0 < due <= last + 1e-9 or abs(round(due / scene.dt) * scene.dt - due) > 1e-9:
            raise SettingsError(
                f"the next decision at {due!r} s must be due at a multiple of dt = {scene.dt:g} s, "
                f"at the latest at the horizon of {last:g} s"
            )
        steps = fail_safe_horizon(scene, settings, due, MILDEST)
        given = ground.prediction
        if given.kind == "set-based" and given.horizon >= steps:
            set_based = given
        else:
            # Fail-safes and certificates only ask what is occupied during each step, and only
            # where the ego can come.
            near = np.array(
                [_farthest(scene, (k + 1) * scene.dt, settings) + WELL_CLEAR for k in range(steps)]
            )
            set_based = predict(scene, "set-based", steps, settings, instants=False, near=near)
        road = Road.of(scene, _farthest(scene, max(steps * scene.dt, last), settings) + WELL_CLEAR)
        return Basis(
            ground,
            set_based,
            due,
            Surroundings.of(ground, road),
            OfFailSafe.of(scene, set_based, road),
        )

    def fail_safe_now(self) -> FailSafe | None:
        """A fail-safe trajectory from the present state, without any maneuver before it."""
        scene, settings = self.ground.scene, self.ground.settings
        start = start_state(self.ground)
        if start[3] < 0.0:
            return None
        found = fail_safe(scene, start, 0.0, self.set_based, settings, self.of_fail_safe)
        return found if isinstance(found, FailSafe) else None

    def confirms(self, rest: Trajectory) -> bool:
        """Whether a fail-safe that was accepted earlier is clear of what others may do now.

        Args:
            rest: what is left of it, from time 0 on. Of a part beyond the end of the prediction
                nothing is said.
        """
        predicted = self.set_based.horizon * self.set_based.dt
        count = min(len(rest.inputs), int(predicted / rest.tau + 1e-6))
        if count == 0:
            return True
        states, inputs = rest.states[None, : count + 1], rest.inputs[None, :count]
        contact = self.of_fail_safe.first_contact(states, inputs, np.array([count]), rest.tau, 0.0)
        return bool(contact[0] < 0)


def _farthest(scene: Scene, time: float, settings: Settings) -> float:
    """How far from its present position the ego's body may reach within some time [m]."""
    ego = scene.ego
    speed, push = abs(ego.state.speed), max(settings.a_lon_max, 0.0)
    # No faster than v_max, unless it is already.
    way = min(speed * time + push * time**2 / 2, max(speed, settings.v_max) * time)
    return way + math.hypot(ego.length, ego.width) / 2


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
        decided_at=basis.t_dec,
    )
    if isinstance(found, Miss):
        return replace(verdict, reason=f"no certificate: {found.reason}")
    continuation = search.found
    assert continuation is not None, "a witness is accepted only with its continuation"
    return _judged(basis, verdict, found, continuation, rules, vocabulary)


def certify_trajectory(
    verdicts: Verdicts,
    pair: ActionPair | str | int,
    states: ArrayLike,
    *,
    step: float | None = None,
    t_dec: float | None = None,
    basis: Basis | None = None,
    vocabulary: Vocabulary | None = None,
) -> Verdict:
    """Certify a trajectory that a planner of the user's own has planned for a pair.

    It is driven with the single-track model, which may not leave it by more than 0.1 m, 0.1 rad or
    0.1 m/s; that drive is the witness. It gets a fail-safe continuation, and the independent
    checker decides.

    Args:
        verdicts: of `sandra.verify` or of a decision; they hold scene, prediction and rules.
        pair: the pair that the trajectory realises, as `ActionPair`, text, or position.
        states: (n + 1, 4 or more) x, y of the body's centre [m], heading [rad], speed [m/s], the
            ego's own state first, at least to the horizon.
        step: seconds between two states, `scene.dt` (default) or an integer part of it.
        t_dec: when the next decision is due [s], a multiple of `scene.dt`; default one step.
        basis: `Basis.of(verdicts.ground, t_dec)`, where several trajectories are certified.
        vocabulary: the one that the pair was verified with, if not the packaged one.

    Returns:
        CERTIFIED, with the drive as `proof.witness`; else the pair's verdict without a proof, and
        as its `reason` all that is wrong with the trajectory.

    Raises:
        KeyError: for a pair that was not verified.
        SettingsError: for a step or t_dec that is no multiple or part of `scene.dt`, or a basis
            of something else.
    """
    verdict = verdicts[pair]
    if verdict.status is Status.UNSAFE:
        return verdict
    verdict = replace(verdict, status=Status.REACHABLE, proof=None, reason=None)
    if basis is None:
        basis = Basis.of(verdicts.ground, t_dec)
    elif basis.ground is not verdicts.ground or t_dec not in (None, basis.t_dec):
        raise SettingsError("the basis is of other verdicts or another t_dec: Basis.of(...) anew")
    found = driven(
        basis.of_witness,
        verdict.specification,
        verdict.reachable_set,
        states,
        step,
    )
    if isinstance(found, Miss):
        return replace(verdict, reason=f"no certificate: {found.reason}")
    continuation = _continuation(basis, found)
    if not isinstance(continuation, FailSafe):
        return replace(verdict, reason=f"no certificate: at {basis.t_dec:g} s, {continuation}")
    return _judged(basis, verdict, found, continuation, verdicts.rules, vocabulary)


def _judged(
    basis: Basis,
    verdict: Verdict,
    found: Trajectory,
    continuation: FailSafe,
    rules: Sequence[str],
    vocabulary: Vocabulary | None,
) -> Verdict:
    """CERTIFIED if the checker accepts the certificate of both trajectories."""
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


def _continuation(
    basis: Basis, trajectory: Trajectory, rounds: Rounds = ROUNDS, why: bool = True
) -> FailSafe | NoFailSafe:
    """The fail-safe from a trajectory's state at the next decision."""
    return fail_safe(
        basis.ground.scene,
        _at_decision(basis, trajectory),
        basis.t_dec,
        basis.set_based,
        basis.ground.settings,
        basis.of_fail_safe,
        rounds,
        why,
    )


def _at_decision(basis: Basis, trajectory: Trajectory) -> NDArray[np.float64]:
    index = round((basis.t_dec - trajectory.start) / trajectory.tau)
    return np.asarray(trajectory.states[index])


@dataclass(slots=True)
class _Continuations:
    """Looks for the fail-safe continuation of each witness that is shown; keeps the last found."""

    basis: Basis
    found: FailSafe | None = field(default=None)
    refused: list[NDArray[np.float64]] = field(default_factory=list)
    """States at the next decision from which none was found."""

    def wrong_with(self, trajectory: Trajectory) -> str | None:
        """None if the witness can be continued safely, else in words why not."""
        self.found = None
        state = _at_decision(self.basis, trajectory)
        if any((np.abs(state - x) <= ALIKE).all() for x in self.refused):
            return "have no fail-safe continuation"
        rounds = ROUNDS if len(self.refused) < MOST_OPTIMISED else SAMPLED
        found = _continuation(self.basis, trajectory, rounds, why=False)
        if isinstance(found, FailSafe):
            self.found = found
            return None
        self.refused.append(state)
        return "have no fail-safe continuation"
