"""Texts as vectors of length 1, so that like situations lie near each other.

An embedding is any object with a `name` and `embed(texts, deadline)`. Two are here: hashed words,
which need no model, and any OpenAI-compatible `/embeddings` endpoint.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sandra.errors import RankerError, SettingsError
from sandra.rankers.bounded import Deadline, run_within
from sandra.rankers.client import Problem, client_for, problem_of
from sandra.rankers.types import Failure

Array = NDArray[np.float64]
_TOKEN = re.compile(r"-?\d+(?:\.\d+)?|[a-z]+")
COARSE = 10.0
"""Numbers in the same step of this size are the same word."""


class Embedding(Protocol):
    """Texts to vectors."""

    @property
    def name(self) -> str:
        """How it is called; a plain attribute will do."""
        ...

    def embed(self, texts: Sequence[str], deadline: Deadline) -> Array | Problem:
        """(n, d) vectors of length 1, or what went wrong; returns by the deadline."""
        ...


class HashedWords:
    """Words, and each number beside the words before it, hashed into `size` bins. No model.

    In "ahead: a car 18.3 m away" the number means little by itself: it is entered together with
    the line's first word and the title of the paragraph, rounded down to a multiple of 10.
    """

    name = "words"

    def __init__(self, size: int = 1024) -> None:
        self.size = size

    def embed(self, texts: Sequence[str], deadline: Deadline | None = None) -> Array:
        """See `Embedding`; cannot fail."""
        vectors = np.zeros((len(texts), self.size))
        for row, text in zip(vectors, texts, strict=True):
            for token in _tokens(text):
                row[zlib.crc32(token.encode()) % self.size] += 1.0
        return normalised(vectors)


class EmbeddingEndpoint:
    """`/embeddings` of an OpenAI-compatible server.

    Args:
        model: name of the embedding model.
        base_url: of the server, up to `/v1`; default: OPENAI_BASE_URL, else OpenAI's.

    Raises:
        RankerError: no model, no key for OpenAI's own server, or a bad address.
    """

    def __init__(self, model: str, base_url: str | None = None) -> None:
        if not model.strip():
            raise RankerError("embeddings: no model named; write openai:text-embedding-3-small")
        self.name = f"openai:{model}"
        self._model = model
        self._client = client_for(base_url)
        self._embeddings = self._client.embeddings

    def embed(self, texts: Sequence[str], deadline: Deadline) -> Array | Problem:
        """See `Embedding`. One attempt."""
        outcome = run_within(deadline.left, lambda: self._asked(list(texts), deadline), self.name)
        if outcome.value is not None:
            return outcome.value
        if outcome.late:
            return Problem(Failure.TIMEOUT, "no embedding in time")
        return Problem(Failure.INTERNAL, outcome.error or "")

    def _asked(self, texts: list[str], deadline: Deadline) -> Array | Problem:
        import openai

        try:
            answer = self._embeddings.create(
                model=self._model,
                input=texts,
                encoding_format="float",
                timeout=max(deadline.left, 0.01),
            )
        except openai.APIError as error:
            return problem_of(error, self._client)
        except ValueError as error:
            return Problem(Failure.MALFORMED, f"the server did not send embeddings ({error})")
        try:
            vectors = np.array([item.embedding for item in answer.data], dtype=float)
        except (TypeError, ValueError, AttributeError) as error:
            return Problem(Failure.MALFORMED, f"the server did not send embeddings ({error})")
        if vectors.ndim != 2 or len(vectors) != len(texts) or not np.isfinite(vectors).all():
            return Problem(Failure.MALFORMED, "not one vector of finite numbers for each text")
        return normalised(vectors)


def embedding_of(text: str, base_url: str | None) -> Embedding:
    """`words`, or `openai:MODEL` at a server.

    Raises:
        SettingsError: anything else.
        RankerError: see `EmbeddingEndpoint`.
    """
    if text == "words":
        return HashedWords()
    word, _, model = text.partition(":")
    if word != "openai":
        raise SettingsError(f"dilu: embedding = {text} is unknown; write words or openai:MODEL")
    return EmbeddingEndpoint(model, base_url)


def normalised(vectors: Array) -> Array:
    """(n, d) of length 1; zeros stay zeros."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    scaled: Array = vectors / np.where(length > 0.0, length, 1.0)
    return scaled


def _tokens(text: str) -> list[str]:
    tokens: list[str] = []
    title = ""
    for line in text.lower().splitlines():
        words = _TOKEN.findall(line)
        place = next((w for w in words if w.isalpha()), "")
        if not line.startswith("-"):
            title = " ".join(w for w in words[:5] if w.isalpha())
        for before, word in zip(["", *words], words, strict=False):
            if word.isalpha():
                tokens += [word, f"{title}|{place}|{before if before.isalpha() else ''} {word}"]
            else:
                step = COARSE * (float(word) // COARSE)
                tokens.append(f"{title}|{place}|{before if before.isalpha() else ''} {step:g}")
    return tokens
