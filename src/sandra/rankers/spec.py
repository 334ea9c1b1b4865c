"""`NAME#option=value&option=value`: the options of a ranker that is given as text."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sandra.errors import RankerError


def split(
    kind: str, text: str, readers: dict[str, Callable[[str], Any]]
) -> tuple[str, dict[str, Any]]:
    """The name in a spec, and the options after it.

    Args:
        kind: of the ranker, for messages.
        text: the spec without its kind.
        readers: for each option there is, what makes a value of its text; a ValueError of it says
            what may be written.

    Raises:
        RankerError: no name, an unknown option, or a value that cannot be read.
    """
    name, _, rest = text.strip().partition("#")
    if not name.strip():
        raise RankerError(f"{kind}: no model named; write {kind}:MODEL")
    options = {}
    for part in rest.split("&") if rest else []:
        key, equals, value = part.partition("=")
        if not equals or key not in readers:
            raise RankerError(
                f"{kind}: '{part}' is no option; write option=value with one of "
                f"{', '.join(readers)}"
            )
        try:
            options[key] = readers[key](value)
        except ValueError as error:
            raise RankerError(f"{kind}: {key}={value} cannot be used ({error})") from None
    return name.strip(), options


def one_of(*choices: str) -> Callable[[str], str]:
    """Reads one of these words."""

    def read(text: str) -> str:
        if text not in choices:
            raise ValueError(f"choose from {', '.join(choices)}")
        return text

    return read


def at_least(least: int) -> Callable[[str], int]:
    """Reads an integer."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise ValueError("write an integer") from None
        if value < least:
            raise ValueError(f"at least {least}")
        return value

    return read


def number(text: str) -> float:
    """Reads a number that is not negative."""
    try:
        value = float(text)
    except ValueError:
        raise ValueError("write a number") from None
    if not 0.0 <= value < float("inf"):
        raise ValueError("write a finite number, at least 0")
    return value
