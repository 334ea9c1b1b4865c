"""One decision: the walk through all rooms, once per cycle (paper Sec. III-A).

Scene -> prompt -> ranking -> specification of each pair -> verdict -> maneuver.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.certificate import Certificate
from sandra.certify import Basis, Proven, certify
from sandra.describe import Prompt, describe
from sandra.errors import SettingsError
from sandra.logic import Vocabulary
from sandra.planning import Maneuver, Weights, full_braking, in_corridor
from sandra.prediction import PredictionSource, predict
from sandra.rankers import Ranker, Ranking, ask, create
from sandra.reach import Ground, Status, Verdict, Verdicts, ground, verify_pair
from sandra.scene.types import Scene
from sandra.settings import Settings

if TYPE_CHECKING:
    from pathlib import Path

DEFAULT_DEADLINE = 30.0
"""Seconds for a ranking, all attempts included."""

ACCEPTANCE = ("certified", "reachable")
WALKS = ("ranked", "first", "all")

STAGES = ("describe", "rank", "predict", "verify", "plan")


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """All that was told, answered, verified and chosen in one cycle.

    `verdicts` holds the ranked pairs in the order of the ranking, then, where all twelve were
    asked for, the others. `durations_s` has one entry per stage.
    """

    scene: Scene
    prompt: Prompt
    ranking: Ranking
    verdicts: Verdicts
    maneuver: Maneuver
    accept: str
    durations_s: dict[str, float]

    @property
    def ground(self) -> Ground:
        """What all verdicts stand on: lattice, prediction, forbidden cells."""
        return self.verdicts.ground

    @property
    def certificate(self) -> Certificate | None:
        """The accepted certificate of what is executed; None if it has none."""
        proof = None if self.executed is None else self.executed.proof
        return proof.certificate if isinstance(proof, Proven) else None

    @property
    def executed(self) -> Verdict | None:
        """The verdict of the pair that is executed; None for a fail-safe."""
        return None if self.maneuver.pair is None else self.verdicts[self.maneuver.pair]

    def to_dict(self) -> dict[str, Any]:
        """The JSON contract of `sandra decide --json`."""
        failure = self.ranking.failure
        return {
            "scenario": self.scene.name,
            "ranker": self.ranking.ranker,
            "ranking": [pair.to_dict() for pair in self.ranking.pairs],
            "failure": None if failure is None else failure.value,
            "failure_detail": self.ranking.detail,
            "warnings": list(self.ranking.warnings),
            "prediction": self.ground.prediction.kind,
            "assumed": list(self.ground.prediction.notes),
            "rules": list(self.verdicts.rules),
            "horizon": self.ground.horizon,
            "dt": self.scene.dt,
            "accept": self.accept,
            "verdicts": self.verdicts.to_list(),
            "executed": self.maneuver.to_dict(),
            "maneuver": {
                "note": self.maneuver.note,
                "states": self.maneuver.states.tolist(),
                "fail_safe_start": self.maneuver.fail_safe_start,
                "fail_safe": None
                if self.maneuver.fail_safe is None
                else self.maneuver.fail_safe.tolist(),
            },
            "durations_s": dict(self.durations_s),
        }

    def figure(self, path: str | Path, **options: Any) -> Path:
        """Draw the decision; see `sandra.view.decision_figure`."""
        from sandra.view import decision_figure

        return decision_figure(self, path, **options)

    def __str__(self) -> str:
        lines = [
            f"{self.scene.name}: ranked by {self.ranking.ranker}, prediction "
            f"{self.ground.prediction.kind}, rules {', '.join(self.verdicts.rules) or 'none'}, "
            f"h = {self.ground.horizon}, dt = {self.scene.dt:g} s"
        ]
        lines += [f"  note: {note}" for note in self.ground.prediction.notes]
        if self.ranking.failure is not None:
            lines.append(
                f"  no ranking: {self.ranking.failure.value}"
                + (f" ({self.ranking.detail})" if self.ranking.detail else "")
            )
        for rank, verdict in enumerate(self.verdicts, start=1):
            place = f"{rank}." if rank <= len(self.ranking.pairs) else "  "
            lines.append(f"  {place:>3} {verdict}")
        pair = "" if self.maneuver.pair is None else f" {self.maneuver.pair}"
        lines.append(f"  executed: {self.maneuver.kind}{pair} ({self.maneuver.note})")
        total = sum(self.durations_s.values())
        stages = ", ".join(f"{name} {1e3 * t:.0f}" for name, t in self.durations_s.items())
        lines.append(f"  {1e3 * total:.0f} ms: {stages}")
        return "\n".join(lines)


def decide(
    scene: Scene,
    ranker: str | Ranker = "rules",
    command: str | None = None,
    *,
    prediction: PredictionSource = "most-likely",
    rules: Sequence[str] = (),
    horizon: int | None = None,
    k: int | None = None,
    accept: str = "certified",
    decision_period: float | None = None,
    past: Sequence[ActionPair] = (),
    deadline: float = DEFAULT_DEADLINE,
    base_url: str | None = None,
    settings: Settings | None = None,
    vocabulary: Vocabulary | None = None,
    walk: str = "ranked",
    rule_prompt: bool = False,
    progress: Callable[[str], None] = lambda stage: None,
) -> Decision:
    """Decide what the ego does: the first ranked pair that holds, else the fail-safe maneuver.

    Args:
        ranker: "rules", "openai:MODEL", "random:SEED", "replay:FILE", "exhaustive", or an object
            with `name` and `rank(prompt, deadline)`.
        command: the driver's wish in words; it can change the ranking, never a verdict.
        prediction: see `sandra.predict`.
        rules: names such as "R_G1", or LTLf formulas of your own.
        accept: the weakest status that is executed: "certified" (a trajectory with a fail-safe
            continuation, accepted by the independent checker), or "reachable" (as in the paper).
        decision_period: when the next decision is due [s], a multiple of `scene.dt`; default one
            step. Until then a certified maneuver is driven, from then on its fail-safe holds.
        past: the pairs executed before, oldest first.
        deadline: seconds for the ranking, all attempts included.
        walk: "ranked" verifies every ranked pair, "first" stops at the first that holds, "all"
            verifies all twelve.
        rule_prompt: whether the prompt also tells the rules in words.
        progress: called with the name of each stage as it begins.

    Raises:
        SandraError: for input that cannot be used. What goes wrong with an answer is no
            exception: it is `Decision.ranking.failure`.
    """
    _check(accept, walk, deadline)
    settings = settings or Settings()
    if horizon is not None:
        settings = settings.replace(horizon=horizon)
    if k is not None:
        settings = settings.replace(k=k)
    asked = create(ranker, base_url=base_url) if isinstance(ranker, str) else ranker
    clock = _Clock(progress)

    clock.start("describe")
    prompt = describe(scene, command, past, rules=rules, rule_prompt=rule_prompt, settings=settings)
    clock.start("rank")
    ranking = ask(asked, prompt, deadline)
    clock.start("predict")
    base = ground(scene, predict(scene, prediction, settings.horizon, settings), settings)
    clock.start("verify")
    verdicts = _walk(base, ranking.pairs, rules, vocabulary, walk)
    clock.start("plan")
    weights = Weights.for_command(command)
    basis = None
    if accept == "certified":
        basis = Basis.of(base, decision_period)
        verdicts = _certified(basis, verdicts, ranking.pairs, vocabulary, weights, walk)
    maneuver = _maneuver(verdicts, ranking.pairs, accept, basis)
    durations = clock.stop()
    return Decision(scene, prompt, ranking, verdicts, maneuver, accept, durations)


def _check(accept: str, walk: str, deadline: float) -> None:
    if accept not in ACCEPTANCE:
        raise SettingsError(f"accept = {accept!r} must be one of {', '.join(ACCEPTANCE)}")
    if walk not in WALKS:
        raise SettingsError(f"walk = {walk!r} must be one of {', '.join(WALKS)}")
    if not 0.0 < deadline < float("inf"):
        raise SettingsError(f"deadline = {deadline!r} must be a number of seconds > 0")


def _walk(
    base: Ground,
    ranked: Sequence[ActionPair],
    rules: Sequence[str],
    vocabulary: Vocabulary | None,
    walk: str,
) -> Verdicts:
    found = []
    for pair in ranked:
        found.append(verify_pair(base, pair, rules, vocabulary))
        if walk == "first" and found[-1].status is not Status.UNSAFE:
            break
    if walk == "all":
        rest = [pair for pair in ALL_PAIRS if pair not in ranked]
        found += [verify_pair(base, pair, rules, vocabulary) for pair in rest]
    return Verdicts(tuple(found), base, tuple(rules))


def _certified(
    basis: Basis,
    verdicts: Verdicts,
    ranked: Sequence[ActionPair],
    vocabulary: Vocabulary | None,
    weights: Weights,
    walk: str,
) -> Verdicts:
    """Certify in the order of the ranking; unless all are asked for, until one is certified."""
    found: list[Verdict] = []
    done = False
    for verdict in verdicts:
        if not done or walk == "all":
            verdict = certify(basis, verdict, verdicts.rules, vocabulary, weights)
        done = done or (verdict.status is Status.CERTIFIED and verdict.pair in ranked)
        found.append(verdict)
    return Verdicts(tuple(found), verdicts.ground, verdicts.rules)


def _maneuver(
    verdicts: Verdicts, ranked: Sequence[ActionPair], accept: str, basis: Basis | None
) -> Maneuver:
    """The first ranked pair that is accepted, else the fail-safe maneuver."""
    ground = verdicts.ground
    scene, settings = ground.scene, ground.settings
    for verdict in verdicts:
        if verdict.pair not in ranked:
            continue
        if isinstance(verdict.proof, Proven):
            return _proven(verdict.pair, verdict.proof, scene.dt)
        if accept == "reachable" and verdict.status is not Status.UNSAFE:
            corridor = verdict.reachable_set.corridor()
            maneuver = in_corridor(scene, verdict.pair, corridor, settings)
            if maneuver is not None:
                return maneuver
    found = None if basis is None else basis.fail_safe_now()
    if found is None:
        return full_braking(scene, settings)
    states = found.trajectory.every(scene.dt)
    note = (
        f"{found.strategy}, at most {found.deceleration:.1f} m/s^2, to a standstill; "
        "keeps clear of the set-based prediction"
    )
    return Maneuver("fail-safe", None, states, scene.dt, note, states)


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
    )


class _Clock:
    """Durations of consecutive stages."""

    def __init__(self, progress: Callable[[str], None]) -> None:
        self._progress = progress
        self._begin = 0.0
        self._stage: str | None = None
        self._durations = dict.fromkeys(STAGES, 0.0)

    def start(self, stage: str) -> None:
        self._finish()
        self._progress(stage)
        self._stage, self._begin = stage, time.perf_counter()

    def stop(self) -> dict[str, float]:
        self._finish()
        return self._durations

    def _finish(self) -> None:
        if self._stage is not None:
            self._durations[self._stage] = time.perf_counter() - self._begin
        self._stage = None
