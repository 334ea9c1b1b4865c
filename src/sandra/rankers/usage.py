"""What rankings cost: requests, tokens as the server counts them, money by a table of prices."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from sandra.errors import SettingsError
from sandra.scene.sent import content_of

_MOST = 10**9
"""A server that counts more tokens in one answer is not believed."""


@dataclass(frozen=True, slots=True)
class Usage:
    """Of one ranking, or the sum of many."""

    requests: int = 0
    """Requests that were sent, failed ones and repetitions included."""
    input: int = 0
    """Tokens that the server read."""
    cached_input: int = 0
    """Those of them that it had read before (its prefix cache)."""
    output: int = 0
    """Tokens that it wrote, hidden reasoning included."""
    unknown: int = 0
    """Requests that it worked on without telling tokens: too old a server, or cut off at the
    deadline. Nothing is estimated for them."""
    from_cache: int = 0
    """Answers taken from our own cache on disk, at no cost."""

    def __add__(self, other: Usage) -> Usage:
        return Usage(
            **{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)}
        )

    @property
    def tokens(self) -> int:
        """Read and written."""
        return self.input + self.output

    def to_dict(self) -> dict[str, int]:
        """For JSON; `of_dict` reads it back."""
        return asdict(self)

    @staticmethod
    def of_dict(data: Mapping[str, Any] | None) -> Usage:
        """The counts in `to_dict`; what is missing is 0."""
        return Usage(**{f.name: _count((data or {}).get(f.name)) for f in fields(Usage)})

    def __str__(self) -> str:
        words = [f"{self.requests} requests"]
        if self.tokens or self.requests > self.unknown:
            words.append(f"{self.input} tokens read, {self.output} written")
        if self.cached_input:
            words.append(f"{self.cached_input} of those read from the server's cache")
        if self.unknown:
            words.append(f"{self.unknown} requests of unknown size")
        if self.from_cache:
            words.append(f"{self.from_cache} answers from the cache on disk")
        return "; ".join(words)


def total(usages: Iterable[Usage | None]) -> Usage | None:
    """The sum; None if there is none (rankers without a server)."""
    known = [usage for usage in usages if usage is not None]
    return sum(known, Usage()) if known else None


def both(first: float | None, second: float | None) -> float | None:
    """The recorded duration of two answers; None unless both are recorded [s]."""
    return None if first is None or second is None else first + second


def told_by_server(data: Any) -> Usage | None:
    """The `usage` of a chat completion or a response; None if it tells no tokens."""
    if not isinstance(data, dict):
        return None
    read = data.get("prompt_tokens", data.get("input_tokens"))
    written = data.get("completion_tokens", data.get("output_tokens"))
    if read is None or written is None:
        return None
    details = data.get("prompt_tokens_details") or data.get("input_tokens_details")
    cached = details.get("cached_tokens") if isinstance(details, dict) else 0
    return Usage(input=_count(read), cached_input=_count(cached), output=_count(written))


def _count(value: Any) -> int:
    known = isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _MOST
    return value if known else 0


@dataclass(frozen=True, slots=True)
class Price:
    """Of a model, in `currency` per million tokens."""

    input: float
    output: float
    cached_input: float | None = None
    """Default: that of `input`."""
    currency: str = "USD"
    training: float | None = None
    """Of fine-tuning; default: unknown."""

    def of(self, usage: Usage) -> float:
        """What the tokens that are known cost."""
        cached = self.input if self.cached_input is None else self.cached_input
        fresh = max(usage.input - usage.cached_input, 0)
        whole = fresh * self.input + usage.cached_input * cached + usage.output * self.output
        return whole / 1e6


def load_prices(path: str | Path) -> dict[str, Price]:
    """Read a TOML file with a table `["RANKER"]` for each model, such as `["openai:some-model"]`.

    Each holds `input`, `output`, and, if wanted, `cached_input`, `training` (per million tokens)
    and `currency`. No prices come with SanDRA: they change, and depend on contract and tier.

    Raises:
        SettingsError: if the file is missing, is not TOML, or holds a bad value.
    """
    try:
        data = tomllib.loads(content_of(Path(path)).decode())
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: not a TOML file ({error})") from None
    return {name: _price(name, table, path) for name, table in data.items()}


def _price(name: str, table: Any, path: str | Path) -> Price:
    example = 'write ["openai:MODEL"], then input = 1.0 and output = 2.0'
    known = {f.name for f in fields(Price)}
    if not isinstance(table, dict) or not {"input", "output"} <= set(table) <= known:
        raise SettingsError(f"{path}: '{name}' is no price; {example}")
    numbers = {key: value for key, value in table.items() if key != "currency"}
    for key, value in numbers.items():
        good = isinstance(value, int | float) and not isinstance(value, bool)
        if not good or not 0.0 <= value < math.inf:
            raise SettingsError(f"{path}: '{name}': {key} = {value!r} must be a number >= 0")
    currency = table.get("currency", "USD")
    if not isinstance(currency, str) or not 1 <= len(currency) <= 5 or not currency.isalpha():
        raise SettingsError(f"{path}: '{name}': currency must be a short name such as EUR")
    return Price(**numbers, currency=currency)


def cost(usage: Usage | None, ranker: str, prices: Mapping[str, Price]) -> dict[str, Any] | None:
    """`{"usage": ..., "money": ..., "currency": ...}` for JSON; money is None without a price."""
    if usage is None:
        return None
    price = prices.get(_model(ranker))
    money = None if price is None else round(price.of(usage), 9)
    currency = None if price is None else price.currency
    return {"usage": usage.to_dict(), "money": money, "currency": currency}


def told(usage: Usage | None, ranker: str, prices: Mapping[str, Price]) -> str | None:
    """One line for a person; None where no server was asked."""
    if usage is None:
        return None
    price = prices.get(_model(ranker))
    if price is None:
        return f"{usage}; no price of {_model(ranker)} is known"
    at_least = "at least " if usage.unknown else ""
    return f"{usage}; {at_least}{price.of(usage):.4f} {price.currency}"


def _model(ranker: str) -> str:
    """A ranker's name without its options: `openai:MODEL#seed=1` costs what `openai:MODEL` does."""
    return ranker.partition("#")[0]
