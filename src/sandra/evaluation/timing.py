"""What a decision costs, stage by stage, in process CPU time.

Each run walks through the rooms one after another, as `sandra.decide` does but without its threads,
so that every second belongs to one stage.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

from sandra.actions import ALL_PAIRS
from sandra.certificate import check
from sandra.certify import Basis, Proven, certify
from sandra.describe import describe
from sandra.prediction import predict
from sandra.rankers import as_ranker
from sandra.reach import Status, ground, verify_on
from sandra.scene.types import Scene
from sandra.settings import Settings

STAGES = (
    *("describe", "rank", "predict", "ground", "verify"),
    *("fail-safe prediction", "plan", "check"),
)
"""In order. "predict", "ground" and "verify" are verification alone; "plan" is the search for
witness and fail-safe, and putting the certificate together; "check" is the independent checker."""
VERIFICATION = ("predict", "ground", "verify")
ANSWER = 0.67
"""How long a language model takes for an answer [s] (paper Sec. IV: GPT-4o)."""


@dataclass(frozen=True, slots=True)
class DecisionTimes:
    """Medians over `runs` runs in one process [s CPU].

    `pairs`: how many pairs were verified; `certified`: the pair whose certificate was accepted,
    None if none was.
    """

    scenario: str
    prediction: str
    pairs: int
    certified: str | None
    runs: int
    stages: dict[str, float]

    @property
    def verification(self) -> float:
        """Prediction, ground and verdicts alone [s]."""
        return sum(self.stages[name] for name in VERIFICATION)

    @property
    def decision(self) -> float:
        """All stages [s]."""
        return sum(self.stages.values())

    @property
    def ratio(self) -> float:
        """The decision with its certificate, over its verification alone."""
        return self.decision / self.verification

    def to_dict(self) -> dict[str, Any]:
        """For `sandra bench decide --json`."""
        return {
            "scenario": self.scenario,
            "prediction": self.prediction,
            "pairs": self.pairs,
            "certified": self.certified,
            "runs": self.runs,
            "stages_s": dict(self.stages),
            "verification_s": self.verification,
            "decision_s": self.decision,
            "ratio": self.ratio,
            "share_of_answer": self.decision / ANSWER,
        }

    def __str__(self) -> str:
        kept = self.certified or "no pair certified"
        lines = [
            f"{self.scenario}, {self.prediction}, {self.pairs} pairs verified, {kept}; "
            f"median of {self.runs} runs, process CPU"
        ]
        for name in STAGES:
            share = self.stages[name] / self.decision
            lines.append(f"  {name:<21} {1e3 * self.stages[name]:8.1f} ms {share:6.1%}")
        lines += [
            f"  {'verification alone':<21} {1e3 * self.verification:8.1f} ms",
            f"  {'decision':<21} {1e3 * self.decision:8.1f} ms, {self.ratio:.2f} times its "
            f"verification, {self.decision / ANSWER:.0%} of an answer of {ANSWER:g} s",
        ]
        return "\n".join(lines)


def time_decision(
    scene: Scene,
    *,
    prediction: str = "most-likely",
    rules: Sequence[str] = (),
    settings: Settings | None = None,
    all_pairs: bool = False,
    runs: int = 20,
    progress: Callable[[int], None] = lambda run: None,
) -> DecisionTimes:
    """Time decisions with certificates: verify the ranked pairs, certify the first that holds.

    Args:
        all_pairs: verify all twelve pairs, not only the ranked ones.
        runs: how often; one more before them is not counted.
        progress: called with the number of each run as it begins.

    Raises:
        SandraError: as `sandra.decide`.
    """
    settings = settings or Settings()
    ranker = as_ranker("rules")
    rows: list[dict[str, float]] = []
    pairs, certified = 0, None
    for run in range(runs + 1):
        progress(run)
        # Lanelets keep their areas: each run begins with a map that was never looked at.
        scene = replace(scene, lanelets=tuple(replace(x) for x in scene.lanelets))
        watch = _Watch()
        with watch.stage("describe"):
            prompt = describe(scene, rules=rules, settings=settings)
        with watch.stage("rank"):
            ranked = ranker.rank(prompt).pairs
        with watch.stage("predict"):
            predicted = predict(scene, prediction, settings.horizon, settings)
        with watch.stage("ground"):
            base = ground(scene, predicted, settings)
        rest = [p for p in ALL_PAIRS if p not in ranked] if all_pairs else []
        with watch.stage("verify"):
            verdicts = verify_on(base, (*ranked, *rest), rules).verdicts
        with watch.stage("fail-safe prediction"):
            basis = Basis.of(base)
        pairs, certified = len(verdicts), None
        for verdict in verdicts[: len(ranked)]:
            if verdict.status is Status.UNSAFE:
                continue
            with watch.stage("plan"):
                proof = certify(basis, verdict, rules).proof
            if isinstance(proof, Proven):
                certified = str(verdict.pair)
                # `certify` has asked the checker already: its share moves to its own stage.
                before = watch.spent["check"]
                with watch.stage("check"):
                    check(proof.certificate)
                watch.spent["plan"] -= watch.spent["check"] - before
                break
        rows.append(watch.spent)
    stages = {name: median(row[name] for row in rows[1:]) for name in STAGES}
    return DecisionTimes(scene.name, prediction, pairs, certified, runs, stages)


class _Watch:
    """Process CPU time by stage [s]."""

    def __init__(self) -> None:
        self.spent = dict.fromkeys(STAGES, 0.0)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begin = time.process_time()
        yield
        self.spent[name] += time.process_time() - begin
