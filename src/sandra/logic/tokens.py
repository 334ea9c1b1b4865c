"""The words and signs of a formula's text, each with its column."""

from __future__ import annotations

import re
from dataclasses import dataclass

from sandra.errors import FormulaError

MAX_TOKENS = 1000
"""Longest text, in words and signs."""

_TOKEN = re.compile(
    r"""(?P<number>(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)
      | (?P<unit>km/h|m/s\^2|m/s(?!\w))
      | (?P<modal>[GFXN]+(?!\w))
      | (?P<name>[A-Za-z_]\w*)
      | (?P<sign><->|->|<=|>=|[<>!&|()\[\],+\-*/¬∧∨→↔≤≥])""",
    re.VERBOSE | re.ASCII,
)
# Other spellings of the signs.
SYNONYMS = {
    "¬": "!", "∧": "&", "∨": "|", "→": "->", "↔": "<->", "≤": "<=", "≥": ">=",
    "not": "!", "and": "&", "or": "|",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Token:
    """A word or sign; `kind` is number, unit, modal (one of G F X N), name, sign or end."""

    kind: str
    text: str
    column: int


def one_line(text: str) -> str:
    """The text with single spaces only, as the columns in messages count them."""
    return " ".join(text.split())


def excerpt(text: str) -> str:
    """The text as a message quotes it: one line, shortened."""
    line = one_line(text)
    return line if len(line) <= 80 else line[:77] + "..."


def tokens_of(text: str) -> list[Token]:
    """The tokens of a text in `one_line`, closed by one of kind "end".

    Raises:
        FormulaError: at a character that begins no token, or if there are too many.
    """
    tokens: list[Token] = []
    position = 0
    while True:
        position += text[position : position + 1] == " "
        if position == len(text):
            return [*tokens, Token("end", "the end", position + 1)]
        match = _TOKEN.match(text, position)
        if match is None or match.lastgroup is None:
            raise FormulaError(
                f"unexpected '{text[position]}' at column {position + 1} of '{excerpt(text)}'"
            )
        kind, word = match.lastgroup, match.group()
        if kind == "modal":
            # `FG p` is `F G p`.
            tokens += [Token(kind, c, position + 1 + i) for i, c in enumerate(word)]
        elif word in SYNONYMS:
            tokens.append(Token("sign", SYNONYMS[word], position + 1))
        else:
            tokens.append(Token(kind, word, position + 1))
        if len(tokens) > MAX_TOKENS:
            raise FormulaError(f"the formula '{excerpt(text)}' has more than {MAX_TOKENS} words")
        position = match.end()


def quoted(token: Token) -> str:
    """A token as a message names it."""
    return token.text if token.kind == "end" else f"'{token.text}'"
