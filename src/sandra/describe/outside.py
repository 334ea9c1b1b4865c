"""Text that comes from outside: commands, names, and weather from a file, a model's words.

Such text becomes one short line, so that it can neither open a section of its own in a prompt nor
move the cursor of a terminal.
"""

from __future__ import annotations

import re
import unicodedata

COMMAND_LENGTH = 500
"""Longest command that is told to a model [characters]."""
NAME_LENGTH = 60
"""Longest name taken from a file [characters]."""

_SPACES = re.compile(r"\s+")
# The tags by which chat templates mark roles: <|im_start|>, </s>, <system>, [INST].
_TAG = re.compile(r"<(?=[|/!?A-Za-z])")
_BRACKET = re.compile(r"\[(?=/?[A-Z_]+\])")


def one_line(text: str, limit: int = COMMAND_LENGTH) -> str:
    """`text` as one line of at most `limit` characters.

    Control, format, private and unassigned characters and every kind of line break become spaces,
    runs of spaces become one, and the opening sign of anything like a role tag is replaced by one
    that is no tag. An ellipsis marks what was cut.
    """
    # Cut first: nothing below may cost more than the text that can be shown.
    head = text[: 4 * limit + 4]
    visible = "".join(" " if _is_invisible(c) else c for c in head)
    line = _SPACES.sub(" ", visible).strip()
    line = _BRACKET.sub("(", _TAG.sub("‹", line))
    if len(line) > limit or len(head) < len(text):
        line = line[: limit - 1].rstrip() + "…"
    return line


def several_lines(text: str, limit: int = 20_000) -> str:
    """`text` without control characters other than line breaks and tabs, at most `limit` long."""
    kept = "".join(c if c in "\n\t" or not _is_invisible(c) else " " for c in text[:limit])
    return kept + ("…" if len(text) > limit else "")


def in_words(name: str) -> str:
    """A name in snake_case or camelCase as words: "parkedVehicle" -> "parked vehicle"."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.replace("_", " "))
    return one_line(spaced, NAME_LENGTH).lower()


def _is_invisible(character: str) -> bool:
    return unicodedata.category(character)[0] == "C" or character in "\u2028\u2029"
