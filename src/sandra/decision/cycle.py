"""One decision: the walk through all rooms, once per cycle (paper Sec. III-A).

Scene -> prompt -> ranking -> specification of each pair -> verdict -> maneuver.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.certify import Basis, Proven, certify
from sandra.decision.result import Decision
from sandra.decision.stages import Clock, Meanwhile
from sandra.describe import describe
from sandra.errors import SettingsError
from sandra.logic import Vocabulary
from sandra.planning import Maneuver, Weights, full_braking, in_corridor
from sandra.planning.fail_safe_search import FailSafe
from sandra.prediction import PredictionSource, predict
from sandra.rankers import Ranker, as_ranker, create
from sandra.reach import Status, Verdict, Verdicts, ground, verify_pair
from sandra.reach.ground import Ground
from sandra.scene.types import Scene
from sandra.settings import Settings

DEFAULT_DEADLINE = 30.0
"""Seconds for a ranking, all attempts included."""

ACCEPTANCE = ("certified", "reachable")
WALKS = ("ranked", "first", "all")


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
    weights: Weights | None = None,
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
        weights: of the planner's cost terms, with the desired speed; default: those that the
            command asks for (`Weights.for_command`). They choose among trajectories that hold.
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
    asked = create(ranker, base_url=base_url) if isinstance(ranker, str) else as_ranker(ranker)
    clock = Clock(progress)

    with clock.stage("describe"):
        prompt = describe(
            scene, command, past, rules=rules, rule_prompt=rule_prompt, settings=settings
        )
    waiting = Meanwhile(lambda: asked.rank(prompt, deadline), asked.name)
    # While somebody thinks about the ranking, all is prepared that does not depend on it.
    with clock.stage("predict"):
        base = ground(scene, predict(scene, prediction, settings.horizon, settings), settings)
    with clock.stage("plan"):
        basis = Basis.of(base, decision_period) if accept == "certified" else None
        fail_safe_now = cache(basis.fail_safe_now if basis is not None else _nothing)
        if not waiting.done:
            fail_safe_now()
    progress("rank")
    ranking = waiting.result()
    clock.durations["rank"] = waiting.duration
    with clock.stage("verify"):
        verdicts = _walk(base, ranking.pairs, rules, vocabulary, walk)
    with clock.stage("plan"):
        if basis is not None:
            chosen = Weights.for_command(command) if weights is None else weights
            verdicts = _certified(basis, verdicts, ranking.pairs, vocabulary, chosen, walk)
        maneuver = _maneuver(verdicts, ranking.pairs, accept, fail_safe_now)
    durations = clock.stop()
    return Decision(scene, prompt, ranking, verdicts, maneuver, accept, basis, durations)


def _nothing() -> None:
    return None


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
    verdicts: Verdicts,
    ranked: Sequence[ActionPair],
    accept: str,
    fail_safe_now: Callable[[], FailSafe | None],
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
    found = fail_safe_now()
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
