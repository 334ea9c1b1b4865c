"""Reading a model's answer: text -> `Ranking`. Never raises.

Models answer with JSON, with JSON inside a code fence or an essay, with half of it, or with
something else altogether. What can be used is used; what was wrong is named.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from sandra.actions import ActionPair
from sandra.describe.outside import one_line, several_lines
from sandra.describe.types import Prompt
from sandra.errors import ActionError
from sandra.rankers.types import Failure, Ranking

MAX_ANSWER = 200_000
"""Longest answer that is read [characters]."""
_MOST_ITEMS = 100
"""Items of a ranking that are looked at."""
_MOST_STARTS = 200
"""Braces in an answer at which an object is looked for."""
_MOST_READ = 1_000_000
"""Characters that are read while looking for objects: one within the other is read many times."""


def parse_answer(text: str, prompt: Prompt, ranker: str, *, ended_early: bool = False) -> Ranking:
    """The ranking in a model's answer.

    Args:
        text: the answer; only the first `MAX_ANSWER` characters are read.
        prompt: what had been asked; its feasible pairs and its k.
        ranker: name of the ranker, for the result.
        ended_early: the model was cut off, so that the end of the text is missing.

    Returns:
        At most k distinct feasible pairs. Without a usable pair the failure is EMPTY, MALFORMED,
        TRUNCATED or INFEASIBLE. Duplicates, unknown and infeasible pairs, too few and too many
        are removed or accepted with a warning. A ranking that breaks off (or breaks) keeps the
        pairs before that, and carries TRUNCATED (or MALFORMED) all the same.
    """
    ended_early = ended_early or len(text) > MAX_ANSWER
    # Half of a surrogate pair can be neither printed nor stored.
    text = text[:MAX_ANSWER].encode("utf-8", "replace").decode("utf-8")
    if not text.strip():
        failure, detail = Failure.EMPTY, "the answer holds no text"
        if ended_early:
            failure, detail = Failure.TRUNCATED, "the answer ended before its first word"
        return Ranking((), ranker, failure, detail, answer=text)
    items, reasoning, complete = _find(text)
    broken = Failure.TRUNCATED if ended_early or _breaks_off(text) else Failure.MALFORMED
    if items is None:
        detail = "no JSON object with a list 'ranking' in it"
        if broken is Failure.TRUNCATED:
            detail = "the answer ends before the ranking"
        return Ranking((), ranker, broken, detail, reasoning=reasoning, answer=text)
    pairs, warnings = _pairs_of(items, prompt)
    result = Ranking(pairs, ranker, None, None, warnings, reasoning, text)
    if not complete:
        return replace(result, failure=broken, detail=f"broken ranking, {len(pairs)} pairs kept")
    if not items:
        return replace(result, failure=Failure.EMPTY, detail="the ranking is an empty list")
    if not pairs:
        return replace(result, failure=Failure.INFEASIBLE, detail="; ".join(warnings[:3]))
    return result


def parse_reasoning(text: str) -> str | None:
    """The reasoning in an answer that need not hold a ranking; without JSON the whole text."""
    found = [v["reasoning"] for v in _objects(text) if isinstance(v.get("reasoning"), str)]
    return several_lines(found[-1] if found else text[:MAX_ANSWER]) or None


def select(
    candidates: Iterable[ActionPair], prompt: Prompt
) -> tuple[tuple[ActionPair, ...], tuple[str, ...]]:
    """The first k distinct feasible pairs, and a warning for each of the others."""
    kept: list[ActionPair] = []
    warnings: list[str] = []
    for pair in candidates:
        if pair in kept:
            warnings.append(f"duplicate {pair} removed")
        elif pair not in prompt.feasible:
            warnings.append(f"{pair} is not feasible here, removed")
        elif len(kept) == prompt.k:
            warnings.append(f"more than {prompt.k} pairs: {pair} removed")
        else:
            kept.append(pair)
    if kept and len(kept) < prompt.k:
        warnings.append(f"only {len(kept)} of {prompt.k} pairs")
    return tuple(kept), tuple(warnings)


def _pairs_of(items: list[Any], prompt: Prompt) -> tuple[tuple[ActionPair, ...], tuple[str, ...]]:
    known: list[ActionPair] = []
    warnings: list[str] = []
    for item in items[:_MOST_ITEMS]:
        pair = _pair(item)
        if pair is None:
            warnings.append(f"unknown pair {one_line(repr(item)[:400], 80)} removed")
        else:
            known.append(pair)
    if len(items) > _MOST_ITEMS:
        warnings.append(f"{len(items) - _MOST_ITEMS} of {len(items)} items not looked at")
    pairs, more = select(known, prompt)
    return pairs, (*warnings, *more)


def _pair(item: Any) -> ActionPair | None:
    if not isinstance(item, dict):
        return None
    longitudinal, lateral = item.get("longitudinal"), item.get("lateral")
    if not isinstance(longitudinal, str) or not isinstance(lateral, str):
        return None
    try:
        return ActionPair.of(longitudinal, lateral)
    except ActionError:
        return None


def _find(text: str) -> tuple[list[Any] | None, str | None, bool]:
    """Items of the ranking (None: not found), the reasoning, and whether the object is complete.

    Of several objects the last one with a ranking counts: models that think aloud sketch first.
    """
    found: dict[str, Any] | None = None
    for value in _objects(text):
        if isinstance(value.get("ranking"), list):
            found = value
    if found is None:
        return _begun_ranking(text), None, False
    reasoning = found.get("reasoning")
    words = several_lines(reasoning) if isinstance(reasoning, str) else None
    return found["ranking"], words, True


def _objects(text: str) -> Iterator[dict[str, Any]]:
    """The JSON objects in a text that are not part of another one."""
    at, left = text.find("{"), _MOST_READ
    for _ in range(_MOST_STARTS):
        if at < 0 or left < 0:
            return
        value, end = _decode(text, at)
        left -= end - at
        if isinstance(value, dict):
            yield value
        at = text.find("{", end if value is not None else at + 1)


def _begun_ranking(text: str) -> list[Any] | None:
    """The complete items of the last `"ranking": [` in the text, None if there is none."""
    key = text.rfind('"ranking"')
    if key < 0:
        return None
    rest = text[key + len('"ranking"') :].lstrip()
    if not rest.startswith(":") or not rest[1:].lstrip().startswith("["):
        return None
    rest = rest[1:].lstrip()
    items: list[Any] = []
    at = 1
    while len(items) < _MOST_ITEMS:
        while at < len(rest) and rest[at] in " \t\r\n,":
            at += 1
        value, at = _decode(rest, at)
        if value is None:
            break
        items.append(value)
    return items


def _breaks_off(text: str) -> bool:
    """Whether an object in the text is cut off by the end of the text."""
    text = text.rstrip()
    at, left = text.find("{"), _MOST_READ
    for _ in range(_MOST_STARTS):
        if at < 0 or left < 0:
            return False
        value, end = _decode(text, at)
        if value is None and end >= len(text):
            return True
        left -= end - at
        at = text.find("{", end if value is not None else at + 1)
    return False


def _decode(text: str, start: int) -> tuple[Any, int]:
    """The JSON value that starts here and its end; (None, how far it can be read) without one."""
    try:
        return json.JSONDecoder().raw_decode(text, start)
    except json.JSONDecodeError as error:
        cut = error.msg.startswith("Unterminated string")
        return None, len(text) if cut else max(error.pos, start)
    except (ValueError, RecursionError):  # a number of too many digits, or too deep
        return None, start
