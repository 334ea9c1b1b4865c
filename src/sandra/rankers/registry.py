"""From a short text to a ranker: `openai:gpt-4o`, `rules`, `random:7`, `replay:FILE`, ..."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sandra.actions import ActionPair
from sandra.describe.types import Prompt
from sandra.errors import ActionError, RankerError
from sandra.rankers import replay
from sandra.rankers.adversarial import AdversarialRanker
from sandra.rankers.chat import DEADLINE, ChatRanker
from sandra.rankers.dilu.ranker import DiLuRanker, dilu_ranker
from sandra.rankers.inside.ranker import NAME as EMBEDDED
from sandra.rankers.inside.ranker import embedded_ranker
from sandra.rankers.local.score import ScoreRanker
from sandra.rankers.local.spec import LOCAL, local_ranker
from sandra.rankers.misbehaving import AlwaysRanker, GarbageRanker, LateRanker
from sandra.rankers.rules import RulesRanker
from sandra.rankers.servers import SERVERS, server_ranker
from sandra.rankers.simple import Answer, ExhaustiveRanker, PlugIn, RandomRanker, plug_in
from sandra.rankers.types import Ranker, Ranking

CHOICES = (
    "embedded, openai:MODEL, ollama:MODEL, vllm:MODEL, gguf:FILE, "
    "hf:FOLDER[+ADAPTER][#mode=score], dilu:MODEL, rules, random[:SEED], exhaustive, "
    "replay:FILE[#column=value], adversarial, always:PAIR, garbage, late:SECONDS, or "
    "module:attribute of your own"
)
_PLAIN: dict[str, Callable[[], Ranker]] = {
    "rules": RulesRanker,
    "exhaustive": ExhaustiveRanker,
    "adversarial": AdversarialRanker,
    "garbage": GarbageRanker,
}
_OWN = (
    ChatRanker,
    DiLuRanker,
    ScoreRanker,
    RulesRanker,
    RandomRanker,
    ExhaustiveRanker,
    replay.ReplayRanker,
    AdversarialRanker,
    AlwaysRanker,
    GarbageRanker,
    LateRanker,
)
_IMPORT = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")


def create(
    spec: str,
    *,
    base_url: str | None = None,
    deadline: float = DEADLINE,
    temperature: float | None = None,
    seed: int | None = None,
    cache: str | Path | None = None,
    max_concurrent: int | None = None,
) -> Ranker:
    """Make a ranker.

    Args:
        spec: one of `CHOICES`. `module:attribute` is imported: a class (made without arguments),
            an object with `rank(prompt, deadline)`, or a function of a prompt.
        base_url: of an OpenAI-compatible server, for `openai:`, `ollama:`, `vllm:`, `dilu:`.
        deadline: wall-clock time for one ranking [s], for models and for plug-ins.
        temperature: for models that write; None: the server's own, 0 in this process and for
            `dilu:`.
        seed: likewise (not sent if None), and for `random` without a seed of its own.
        cache: folder in which the answers of servers are kept; None keeps none.
        max_concurrent: requests to a server at once, over all processes of this user.

    Raises:
        RankerError: unknown spec, missing key, unreadable recording, or a plug-in that cannot be
            imported.
    """
    kind, colon, rest = spec.strip().partition(":")
    asked: dict[str, Any] = {"deadline": deadline, "temperature": temperature, "seed": seed}
    served = {**asked, "base_url": base_url, "cache": cache, "max_concurrent": max_concurrent}
    if kind in SERVERS and colon:
        return server_ranker(kind, rest, **served)
    if kind == "dilu" and colon:
        return dilu_ranker(rest, **served)
    if kind in LOCAL and colon:
        return local_ranker(kind, rest, **asked)
    if kind == "random":
        return RandomRanker(_seed(rest) if colon else seed or 0)
    if kind == "replay" and rest:
        return replay.load(rest)
    if kind == "always" and rest:
        return _always(rest)
    if kind == "late" and rest:
        return LateRanker(_seconds(rest))
    if spec.strip() == EMBEDDED:
        return embedded_ranker(deadline)
    if spec.strip() in _PLAIN:
        return _PLAIN[spec.strip()]()
    if _IMPORT.fullmatch(spec.strip()) and kind not in (*_PLAIN, "replay"):
        return _imported(kind, rest, deadline)
    raise RankerError(f"unknown ranker '{spec}': choose from {CHOICES}")


def as_ranker(thing: str | Ranker | Callable[..., Answer]) -> Ranker:
    """A ranker from a spec, one of ours, or anything of the user's that ranks.

    What is not ours is wrapped (`PlugIn`), so that it keeps to the protocol whatever it does.

    Raises:
        RankerError: see `create`; or the thing cannot rank.
    """
    if isinstance(thing, str):
        return create(thing)
    return thing if isinstance(thing, (*_OWN, PlugIn)) else plug_in(thing)


def ask(
    ranker: str | Ranker | Callable[..., Answer], prompt: Prompt, deadline: float | None = None
) -> Ranking:
    """One ranking from anything that `as_ranker` takes; nothing but `RankerError` is raised."""
    return as_ranker(ranker).rank(prompt, deadline)


def _seed(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise RankerError(
            f"random: '{text}' is no seed; write an integer, as in random:7"
        ) from None


def _always(text: str) -> Ranker:
    try:
        return AlwaysRanker(ActionPair.parse(text))
    except ActionError as error:
        raise RankerError(f"always: {error}") from None


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise RankerError(
            f"late: '{text}' is no time; write seconds greater than 0, as in late:0.5"
        )
    return seconds


def _imported(module: str, attribute: str, deadline: float) -> Ranker:
    spec = f"{module}:{attribute}"
    try:
        thing: object = importlib.import_module(module)
        for part in attribute.split("."):
            thing = getattr(thing, part)
    except (ImportError, AttributeError) as error:
        raise RankerError(
            f"ranker '{spec}' cannot be imported ({error}); its module must be installed or on "
            f"PYTHONPATH, else choose from {CHOICES}"
        ) from None
    if isinstance(thing, type):
        try:
            thing = thing()
        except TypeError as error:
            raise RankerError(
                f"ranker '{spec}' cannot be made without arguments ({error})"
            ) from None
    if isinstance(thing, Ranker) or callable(thing):
        return plug_in(thing, spec, deadline)
    raise RankerError(
        f"ranker '{spec}' is a {type(thing).__name__}; it needs a method rank(prompt, deadline)"
    )
