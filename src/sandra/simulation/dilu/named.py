"""From a short text to the driver: `dilu:MODEL`, `dilu:MODEL@URL#hold=5&shots=3`."""

from __future__ import annotations

import re
from typing import Any

from sandra.errors import SettingsError
from sandra.rankers.dilu.embedding import embedding_of
from sandra.rankers.dilu.memory import load
from sandra.simulation.dilu.driver import DiLu

FORM = "dilu:MODEL[@URL][#OPTION=VALUE&...]"
_NAME = re.compile(r"dilu:(?P<model>[^#]*?)(?:@(?P<url>https?://[^#]*))?(?:#(?P<options>.*))?")
_KINDS: dict[str, Any] = {
    "shots": int,
    "hold": int,
    "deadline": float,
    "default": str,
    "embedding": str,
    "memory": str,
}


def named(name: str) -> DiLu:
    """Make the driver of a name.

    Options: shots, hold, deadline, default (see `DiLu`), embedding (`words`, or `openai:MODEL`
    at the same server), memory (a file that scripts/dilu_memory.py writes).

    Raises:
        SettingsError, RankerError: for what is unknown or cannot be used.
    """
    match = _NAME.fullmatch(name.strip())
    if match is None:
        raise SettingsError(f"'{name}' is no such driver; write {FORM}")
    values = _options(match["options"] or "")
    embedding = embedding_of(values.pop("embedding", "words"), match["url"])
    items = load(values.pop("memory")) if "memory" in values else None
    return DiLu(match["model"], base_url=match["url"], embedding=embedding, items=items, **values)


def located(name: str, base_url: str | None) -> str:
    """The name with the server's address in it; other drivers, and one with an address, as is."""
    match = _NAME.fullmatch(name.strip())
    if match is None or match["url"] or not base_url:
        return name
    options = f"#{match['options']}" if match["options"] else ""
    return f"dilu:{match['model']}@{base_url}{options}"


def _options(text: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for part in text.split("&") if text else ():
        key, _, value = part.partition("=")
        try:
            values[key] = _KINDS[key](value)
        except (KeyError, ValueError):
            known = ", ".join(_KINDS)
            raise SettingsError(
                f"dilu: '{part}' cannot be read; write OPTION=VALUE, of {known}"
            ) from None
    return values
