"""Access to the sentences in `templates.toml`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from types import MappingProxyType


@cache
def sentences() -> Mapping[str, Mapping[str, str]]:
    """All tables of `templates.toml`, read once, immutable."""
    text = files("sandra.describe").joinpath("templates.toml").read_text(encoding="utf-8")
    tables = tomllib.loads(text)
    return MappingProxyType({name: MappingProxyType(table) for name, table in tables.items()})


def say(table: str, name: str, /, **values: object) -> str:
    """One sentence, filled in. Values are never read as templates themselves.

    A number that rounds to zero is told as 0.0, never as -0.0.
    """
    filled = {k: _Number(v) if isinstance(v, float) else v for k, v in values.items()}
    return sentences()[table][name].format(**filled)


class _Number(float):
    """A float without a negative zero after rounding."""

    def __format__(self, spec: str) -> str:
        text = float(self).__format__(spec)
        return text[1:] if text.startswith("-") and not text.strip("-0.") else text
