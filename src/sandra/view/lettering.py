"""Text in pictures: plain, clipped, wrapped to a measured width.

Scenario names, commands and a model's words come from outside. They are drawn as they are (no
`$...$` mathematics, no TeX), in a font that travels with matplotlib, on one line, and cut.
"""

from __future__ import annotations

import unicodedata
from functools import lru_cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.font_manager import FontProperties

FAMILY = "DejaVu Sans"
LONGEST = 400
"""Characters that are kept of any text."""
HINTING = 0.1
"""Letters fitted to pixels turn out wider than measured, by at most so much at 150 dpi."""
_MISSING = "□"


def font(size: float, bold: bool = False) -> FontProperties:
    """The font of every text; size in points."""
    from matplotlib.font_manager import FontProperties

    return FontProperties(family=FAMILY, size=size, weight="bold" if bold else "normal")


@lru_cache(maxsize=2)
def _glyphs(bold: bool) -> frozenset[int]:
    from matplotlib.font_manager import findfont, get_font

    return frozenset(get_font(findfont(font(10.0, bold))).get_charmap())


def plain(text: object, limit: int = LONGEST) -> str:
    """One printable line of at most `limit` characters: what the font lacks becomes a box."""
    known = _glyphs(False) & _glyphs(True)
    kept: list[str] = []
    for c in str(text)[: 4 * limit]:
        if c.isspace() or unicodedata.category(c)[0] == "C":
            kept.append(" ")
        else:
            kept.append(c if ord(c) in known else _MISSING)
    line = " ".join("".join(kept).split())
    cut = len(line) > limit or len(str(text)) > 4 * limit
    return line[: limit - 1].rstrip() + "…" if cut else line


def width(text: str, size: float, bold: bool = False) -> float:
    """Width of a line of text [inch]."""
    from matplotlib.textpath import TextToPath

    measured, _, _ = TextToPath().get_text_width_height_descent(text, font(size, bold), False)
    return float(measured) / 72.0


def wrapped(
    text: object, limit: float, size: float, *, bold: bool = False, lines: int = 3
) -> list[str]:
    """The text in at most `lines` lines no wider than `limit` [inch]; the rest becomes "…"."""
    words = plain(text).split()
    limit = limit / (1.0 + HINTING)
    found: list[str] = []
    line = ""
    while words:
        longer = f"{line} {words[0]}" if line else words[0]
        if width(longer, size, bold) <= limit:
            line = longer
            words.pop(0)
        elif line:
            found.append(line)
            line = ""
        else:
            head = _fitting(words[0], limit, size, bold)
            found.append(words[0][:head])
            words[0] = words[0][head:]
        if len(found) == lines:
            break
    rest = [line, *words] if line or words else []
    if len(found) < lines:
        return [*found, line] if line or not found else found
    if rest:
        last = found[-1]
        while last and width(last + "…", size, bold) > limit:
            last = last[:-1]
        found[-1] = last.rstrip() + "…"
    return found


def fitted(text: object, limit: float, size: float, *, bold: bool = False) -> str:
    """The text on one line no wider than `limit` [inch]."""
    return wrapped(text, limit, size, bold=bold, lines=1)[0]


def _fitting(word: str, limit: float, size: float, bold: bool) -> int:
    """How many letters of a word fit; at least one."""
    low, high = 1, len(word)
    while low < high:
        middle = (low + high + 1) // 2
        if width(word[:middle], size, bold) <= limit:
            low = middle
        else:
            high = middle - 1
    return low


def write(place: Any, x: float, y: float, text: str, *, size: float, **options: Any) -> Any:
    """Put text on axes or a figure; the text is never read as mathematics.

    Options: `bold`, and those of `matplotlib.text.Text`.
    """
    bold = bool(options.pop("bold", False))
    options.setdefault("color", "#1a1a1a")
    return place.text(
        x,
        y,
        text,
        fontproperties=font(size, bold),
        parse_math=False,
        usetex=False,
        **options,
    )
