"""What a driver's command asks for, as far as a few key words tell it."""

from __future__ import annotations

import re
from dataclasses import dataclass

_FAST = r"fast|faster|quick|quickly|hurry|hurried|aggressive|aggressively|speed up|sporty|late"
_SLOW = (
    r"slow|slower|slowly|slow down|careful|carefully|cautious|cautiously|"
    r"comfortabl[ey]|gentl[ey]|relaxed"
)
_STOP = r"stop|halt|pull over|park"
_CHANGE = r"change|changes|changing|switch|overtak\w+|lane|lanes"
_LEFT, _RIGHT = r"left", r"right"
# A word counts as denied if one of these stands at most four words before it.
_NOT = r"(?:not|never|no|avoid|without|don['’]?t|less)"


@dataclass(frozen=True, slots=True)
class Wish:
    """`pace` > 0: faster, < 0: slower. `side`: "left" or "right", if one is asked for."""

    pace: int = 0
    stop: bool = False
    side: str | None = None
    stay: bool = False
    """No changes of lane."""


def read_wish(command: str | None) -> Wish:
    """Find key words; what is denied within four words before ("do not drive fast") is left out.

    "do not change lanes" and "keep your lane" ask to stay. Asking for faster and slower at once
    asks for neither.
    """
    text = (command or "").lower()
    pace = int(_asked(_FAST, text)) - int(_asked(_SLOW, text))
    left, right = _asked(_LEFT, text), _asked(_RIGHT, text)
    stay = _denied(_CHANGE, text) or bool(
        re.search(r"\b(?:stay|keep|remain|follow)\b(?:\W+(?!left|right)\w+){0,3}?\W+lane\b", text)
    )
    side = None if left == right or stay else "left" if left else "right"
    return Wish(pace, _asked(_STOP, text), side, stay)


def _asked(words: str, text: str) -> bool:
    return any(not _is_denied(text, m.start()) for m in re.finditer(rf"\b(?:{words})\b", text))


def _denied(words: str, text: str) -> bool:
    return any(_is_denied(text, m.start()) for m in re.finditer(rf"\b(?:{words})\b", text))


def _is_denied(text: str, at: int) -> bool:
    return bool(re.search(rf"\b{_NOT}\b(?:\W+\w+){{0,3}}\W+$", text[:at]))
