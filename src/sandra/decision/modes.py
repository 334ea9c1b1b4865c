"""In which order is asked and verified: the modes of a decision (method 7).

Each mode is a function that puts the question, lets the scene be prepared meanwhile, and returns
what was asked, what was answered, and the verdicts. A further mode is a further function here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.decision.judge import Judge
from sandra.decision.stages import Clock, Meanwhile
from sandra.describe import Prompt, answered, narrow
from sandra.rankers import Failure, Ranker, Ranking, asking, begin, both, total
from sandra.rankers.ahead import Asking
from sandra.reach import Status, Verdict

MODES = ("rank", "exhaustive", "verify-first", "repair")
WALKS = ("ranked", "first", "all")

LOOK = 0.02
"""Pause between two looks at a ranking that is being written [s]."""
Early = Mapping[ActionPair, tuple[Verdict, Verdict]]
"""Verdicts found while the ranking was written: without and with the search for a certificate."""

UNUSABLE = (Failure.EMPTY, Failure.MALFORMED, Failure.TRUNCATED, Failure.INFEASIBLE)
"""Answers without a pair that are worth a second question (mode repair)."""


@dataclass(frozen=True, slots=True, eq=False)
class Walked:
    """The question as it was last put, its answer, and the verdicts: of ranked pairs first."""

    prompt: Prompt
    ranking: Ranking
    verdicts: tuple[Verdict, ...]
    judge: Judge


def rank_first(
    ranker: Ranker,
    prompt: Prompt,
    deadline: float,
    prepare: Callable[[], Judge],
    walk: str,
    clock: Clock,
) -> Walked:
    """The paper's order: a ranking of all that is feasible, then verdicts on what was ranked."""
    asked, waiting = _put(ranker, prompt, deadline)
    # While somebody thinks about the ranking, all is prepared that does not depend on it.
    judge = prepare()
    with clock.stage("plan"):
        if not waiting.done:
            judge.fail_safe_now()
    ranking, early = _answer(judge, asked, prompt, waiting, clock)
    verdicts = _walk(judge, ranking.pairs, walk, clock, early)
    return Walked(prompt, ranking, verdicts, judge)


def repair(
    ranker: Ranker,
    prompt: Prompt,
    deadline: float,
    prepare: Callable[[], Judge],
    walk: str,
    clock: Clock,
) -> Walked:
    """`rank_first`; a ranking in which nothing holds is answered with the reasons, once.

    The second question is about the pairs that are left, and has what is left of the deadline:
    both answers together count, the verification between them does not.
    """
    first = rank_first(ranker, prompt, deadline, prepare, walk, clock)
    left = deadline - clock.durations["rank"]
    again = _second_question(first)
    if again is None or left <= 0.0:
        return first
    asked, waiting = _put(ranker, again, left)
    ranking, early = _answer(first.judge, asked, again, waiting, clock)
    usage = total((first.ranking.usage, ranking.usage))
    told = "; ".join(map(str, first.ranking.pairs)) or "the first answer could not be used"
    why = f"{told}: none holds" if first.ranking.pairs else told
    if not ranking.pairs:
        failure = "no pair" if ranking.failure is None else ranking.failure.value
        note = f"{why}; asked again without success: {failure} ({ranking.detail})"
        kept = replace(
            first.ranking, warnings=(*first.ranking.warnings, note), usage=usage, recorded_s=None
        )
        return replace(first, prompt=again, ranking=kept)
    known = {verdict.pair: verdict for verdict in first.verdicts}
    if walk == "all":
        verdicts = tuple(known.pop(pair) for pair in ranking.pairs)
    else:
        verdicts = _walk(first.judge, ranking.pairs, walk, clock, early)
    note = f"asked again: {why}"
    recorded = both(first.ranking.recorded_s, ranking.recorded_s)
    warnings = (note, *ranking.warnings)
    ranking = replace(ranking, warnings=warnings, usage=usage, recorded_s=recorded)
    return Walked(again, ranking, (*verdicts, *known.values()), first.judge)


def _second_question(first: Walked) -> Prompt | None:
    """What is asked after a ranking in which nothing holds; None if something does."""
    ranking = first.ranking
    if not ranking.pairs:
        usable = ranking.failure not in UNUSABLE
        return None if usable else answered(first.prompt, {}, ranking.detail or "")
    ranked = [v for v in first.verdicts if v.pair in ranking.pairs]
    left = set(first.prompt.feasible) - set(ranking.pairs)
    if any(first.judge.holds(v) for v in ranked) or not left:
        return None
    return answered(first.prompt, {v.pair: v.reason or v.status.value for v in ranked})


def verify_first(
    ranker: Ranker,
    prompt: Prompt,
    deadline: float,
    prepare: Callable[[], Judge],
    clock: Clock,
) -> Walked:
    """All pairs are verified while the ranker reads and reasons; it then ranks those that hold.

    Where no pair holds, or only one, no ranking is waited for.
    """
    ahead = begin(ranker, prompt, deadline)
    try:
        judge = prepare()
        with clock.stage("verify"):
            verdicts = judge.verify(ALL_PAIRS, reasons=False)
        with clock.stage("plan"):
            verdicts = tuple(judge.certify(v) if v.pair in prompt.feasible else v for v in verdicts)
            if not ahead.ready:
                judge.fail_safe_now()
        hold = [v.pair for v in verdicts if judge.holds(v) and v.pair in prompt.feasible]
        if hold:
            prompt = narrow(prompt, hold)
        clock.tell("rank")
        known = _needs_no_question(hold, ranker.name, judge.enough)
        waiting = Meanwhile(lambda: known or ahead.finish(prompt), ranker.name)
        # Why the others do not hold decides nothing: it is found out while the ranking is written.
        with clock.stage("verify"):
            verdicts = tuple(judge.explain(v) for v in verdicts)
        ranking = waiting.result()
        clock.durations["rank"] = ahead.duration
    finally:
        ahead.stop()
    return Walked(prompt, ranking, _in_order(verdicts, ranking.pairs), judge)


def _needs_no_question(hold: Sequence[ActionPair], name: str, enough: Status) -> Ranking | None:
    if not hold:
        why = f"no feasible pair is {enough.value}: there was nothing to rank"
        return Ranking((), name, Failure.NOT_ASKED, why)
    if len(hold) == 1:
        why = f"only {hold[0]} is {enough.value}: no ranking was waited for"
        return Ranking(tuple(hold), name, warnings=(why,))
    return None


def _in_order(verdicts: Sequence[Verdict], ranked: Sequence[ActionPair]) -> tuple[Verdict, ...]:
    of_pair = {v.pair: v for v in verdicts}
    first = [of_pair[pair] for pair in ranked]
    return (*first, *(v for v in verdicts if v.pair not in ranked))


def _put(
    ranker: Ranker, prompt: Prompt, seconds: float
) -> tuple[Asking | None, Meanwhile[Ranking]]:
    """A question that has been put, and its ranking that is waited for."""
    asked = asking(ranker, prompt, seconds)

    def ranking() -> Ranking:
        return ranker.rank(prompt, seconds) if asked is None else asked.ranking(prompt)

    return asked, Meanwhile(ranking, ranker.name)


def _answer(
    judge: Judge,
    asked: Asking | None,
    prompt: Prompt,
    waiting: Meanwhile[Ranking],
    clock: Clock,
) -> tuple[Ranking, Early]:
    """The ranking, waited for, and verdicts that were found while it was written."""
    early = _as_it_is_written(judge, asked, prompt, waiting, clock)
    clock.tell("rank")
    ranking = waiting.result()
    clock.durations["rank"] += waiting.duration
    return ranking, early


def _as_it_is_written(
    judge: Judge,
    asked: Asking | None,
    prompt: Prompt,
    waiting: Meanwhile[Ranking],
    clock: Clock,
) -> Early:
    """Verdicts on pairs that have arrived, in their order, while the rest is written.

    Until one of them holds: just what would be done afterwards, and a verdict does not depend on
    when it is found. So a ranking that is cut off by the deadline keeps nobody waiting for it.
    """
    found: dict[ActionPair, tuple[Verdict, Verdict]] = {}
    while asked is not None and not waiting.done:
        new = [pair for pair in asked.so_far(prompt) if pair not in found]
        if not new or any(judge.holds(certified) for _, certified in found.values()):
            waiting.wait(LOOK)
            continue
        with clock.stage("verify"):
            (verdict,) = judge.verify(new[:1])
        with clock.stage("plan"):
            found[verdict.pair] = (verdict, judge.certify(verdict))
    return found


def _walk(
    judge: Judge,
    ranked: Sequence[ActionPair],
    walk: str,
    clock: Clock,
    early: Early = MappingProxyType({}),
) -> tuple[Verdict, ...]:
    """Verdicts after a ranking: of ranked pairs first. `early`: those that are known already."""
    if walk == "first":
        return _up_to_the_first(judge, ranked, clock, early)
    with clock.stage("verify"):
        verdicts = _verified(judge, ranked, walk, early)
    with clock.stage("plan"):
        return _certified(judge, verdicts, ranked, walk, early)


def _verified(
    judge: Judge, ranked: Sequence[ActionPair], walk: str, early: Early
) -> tuple[Verdict, ...]:
    new = judge.verify([pair for pair in ranked if pair not in early])
    known = {verdict.pair: verdict for verdict in (*new, *(v for v, _ in early.values()))}
    found = tuple(known[pair] for pair in ranked)
    if walk == "all":
        found += judge.verify([pair for pair in ALL_PAIRS if pair not in ranked])
    return found


def _up_to_the_first(
    judge: Judge, ranked: Sequence[ActionPair], clock: Clock, early: Early
) -> tuple[Verdict, ...]:
    """Verify, and certify where that is asked for, one after the other until one holds."""
    found: list[Verdict] = []
    for pair in ranked:
        if pair in early:
            found.append(early[pair][1])
        else:
            with clock.stage("verify"):
                (verdict,) = judge.verify([pair])
            with clock.stage("plan"):
                found.append(judge.certify(verdict))
        if judge.holds(found[-1]):
            break
    return tuple(found)


def _certified(
    judge: Judge,
    verdicts: Sequence[Verdict],
    ranked: Sequence[ActionPair],
    walk: str,
    early: Early,
) -> tuple[Verdict, ...]:
    """Certify in the order of the ranking; unless all are asked for, until one is certified."""
    found: list[Verdict] = []
    done = False
    for verdict in verdicts:
        if not done or walk == "all":
            known = early.get(verdict.pair)
            verdict = judge.certify(verdict) if known is None else known[1]
        done = done or (judge.holds(verdict) and verdict.pair in ranked)
        found.append(verdict)
    return tuple(found)
