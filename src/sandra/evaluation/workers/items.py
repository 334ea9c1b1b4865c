"""What becomes of one item."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from sandra.errors import SandraError

T = TypeVar("T")
R = TypeVar("R")

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Broken:
    """Instead of an answer: what went wrong, in one line."""

    error: str


@dataclass(frozen=True, slots=True)
class Refused:
    """The user's input was at fault."""

    error: SandraError


@dataclass(frozen=True, slots=True)
class Died:
    """Whoever had the item is gone, whoever's fault that is; `how` says what is known of it."""

    how: str


def attempt(work: Callable[[T], R], item: T) -> R | Broken | Refused:
    """`work(item)`, or what went wrong."""
    try:
        return work(item)
    except SandraError as error:
        return Refused(error)
    except Exception as error:
        logger.exception("%r broke", item)
        return Broken(told(error))


def told(error: BaseException) -> str:
    """An exception in one line."""
    words = " ".join(str(error).split())[:300]
    return f"{type(error).__name__}: {words}" if words else type(error).__name__
