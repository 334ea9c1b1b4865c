"""One decision: the walk through all rooms, once per cycle (paper Sec. III-A).

Scene -> prompt -> ranking -> specification of each pair -> verdict -> maneuver.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from sandra.actions import ActionPair
from sandra.certify import Basis
from sandra.decision.judge import Judge
from sandra.decision.modes import MODES, WALKS, rank_first, repair, verify_first
from sandra.decision.result import Decision
from sandra.decision.stages import Clock
from sandra.describe import Prompt, PromptOptions, describe
from sandra.errors import SettingsError
from sandra.logic import Vocabulary
from sandra.planning import Weights
from sandra.prediction import PredictionSource, predict
from sandra.rankers import Ranker, Ranking, as_ranker, create
from sandra.reach import Verdicts, ground
from sandra.scene.types import Scene
from sandra.settings import Settings

DEFAULT_DEADLINE = 30.0
"""Seconds for a ranking, all attempts included."""

ACCEPTANCE = ("certified", "reachable")


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
    mode: str = "rank",
    walk: str = "ranked",
    rule_prompt: bool = False,
    prompt_options: PromptOptions | None = None,
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
        deadline: seconds for the ranking, all attempts included; in the modes "verify-first" and
            "repair" the ranker's wait for verdicts is not counted.
        mode: "rank" has feasible pairs ranked, then verifies what was ranked (the paper);
            "verify-first" verifies all twelve pairs while the ranker reads and reasons, then has
            those ranked that hold; "repair" is "rank", and where no ranked pair holds the ranker
            is told why and asked once more, if time is left; "exhaustive" asks nobody: it is
            "rank" with the ranker of that name.
        walk: which pairs are verified after a ranking: "ranked" every ranked pair, "first" up to
            the first that holds, "all" all twelve. Without effect in "verify-first".
        rule_prompt: whether the prompt also tells the rules in words.
        prompt_options: what the prompt tells beyond the paper's figure: a picture, further
            measures, weather, sentences of your own; default: nothing.
        weights: of the planner's cost terms, with the desired speed; default: those that the
            command asks for (`Weights.for_command`). They choose among trajectories that hold.
        progress: called with the name of each stage as it begins.

    Raises:
        SandraError: for input that cannot be used. What goes wrong with an answer is no
            exception: it is `Decision.ranking.failure`.
    """
    _check(accept, mode, walk, deadline)
    settings = settings or Settings()
    if horizon is not None:
        settings = settings.replace(horizon=horizon)
    if k is not None:
        settings = settings.replace(k=k)
    who = "exhaustive" if mode == "exhaustive" else ranker
    asked = create(who, base_url=base_url) if isinstance(who, str) else as_ranker(who)
    clock = Clock(progress)

    with clock.stage("describe"):
        prompt = describe(
            scene,
            command,
            past,
            rules=rules,
            rule_prompt=rule_prompt,
            settings=settings,
            options=prompt_options,
        )

    def prepare() -> Judge:
        with clock.stage("predict"):
            base = ground(scene, predict(scene, prediction, settings.horizon, settings), settings)
        with clock.stage("plan"):
            basis = Basis.of(base, decision_period) if accept == "certified" else None
        chosen = Weights.for_command(command) if weights is None else weights
        return Judge.of(base, basis, rules, vocabulary, chosen)

    if mode == "verify-first":
        walked = verify_first(asked, prompt, deadline, prepare, clock)
    else:
        order = repair if mode == "repair" else rank_first
        walked = order(asked, prompt, deadline, prepare, walk, clock)
    judge, ranked = walked.judge, walked.ranking.pairs
    with clock.stage("plan"):
        maneuver = judge.maneuver(v for v in walked.verdicts if v.pair in ranked)
    return Decision(
        scene,
        walked.prompt,
        _with_warning(walked.ranking, asked, prompt),
        Verdicts(walked.verdicts, judge.ground, judge.rules),
        maneuver,
        accept,
        judge.basis,
        clock.stop(),
        mode,
        judge.fail_safe_now,
    )


def _with_warning(ranking: Ranking, ranker: Ranker, prompt: Prompt) -> Ranking:
    """Says so if the prompt has a picture at which the ranker does not look."""
    if prompt.picture is None or getattr(ranker, "takes_pictures", False):
        return ranking
    words = f"the picture was not looked at: {ranker.name} reads no pictures"
    return replace(ranking, warnings=(*ranking.warnings, words))


def _check(accept: str, mode: str, walk: str, deadline: float) -> None:
    for name, value, choices in (
        ("accept", accept, ACCEPTANCE),
        ("mode", mode, MODES),
        ("walk", walk, WALKS),
    ):
        if value not in choices:
            raise SettingsError(f"{name} = {value!r} must be one of {', '.join(choices)}")
    if not 0.0 < deadline < float("inf"):
        raise SettingsError(f"deadline = {deadline!r} must be a number of seconds > 0")
