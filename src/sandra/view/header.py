"""The lines above a picture: who ranked, on which command, what was assumed, what is executed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sandra.reach import Ground, Verdicts
from sandra.view import palette
from sandra.view.lettering import plain, wrapped
from sandra.view.page import Page, line_height

if TYPE_CHECKING:
    from sandra.decision import Decision

SIZE = 9.0
TITLE = 14.0
Line = tuple[str, str]
"""(text, colour)."""

_DOT = "   ·   "
_RANKERS = {
    "embedded": "small language model that comes along",
    "rules": "rule-based, no LLM",
    "random": "random order, no LLM",
    "exhaustive": "every pair, no LLM",
    "replay": "recorded answers",
    "openai": "language model",
    "adversarial": "nearest to a collision first, no LLM",
    "always": "the same pair always, no LLM",
    "garbage": "no ranking, no LLM",
    "late": "never in time, no LLM",
}


def ranker_name(name: str) -> str:
    """The ranker and what it is, e.g. "rules (rule-based, no LLM)"."""
    kind = kind_of_ranker(name)
    return plain(name, 60) + (f" ({kind})" if kind else "")


def kind_of_ranker(name: str) -> str | None:
    """What a ranker of this name is; None for one of the user's own."""
    return _RANKERS.get(name.split(":", 1)[0])


def of_decision(decision: Decision) -> list[Line]:
    """Ranker, command, setting; the failure if there is one; what is executed."""
    command = decision.prompt.situation.command
    told = f"“{plain(command, 160)}”" if command else "none"
    asked = f"ranker: {ranker_name(decision.ranking.ranker)}{_DOT}command: {told}"
    lines = [(f"{asked}{_DOT}{_setting(decision.verdicts)}", palette.INK)]
    failure = decision.ranking.failure
    if failure is not None:
        detail = f": {plain(decision.ranking.detail, 240)}" if decision.ranking.detail else ""
        lines.append((f"failure of the ranking – {failure.value}{detail}", palette.VERMILLION))
    maneuver = decision.maneuver
    what, colour = maneuver.kind, palette.FAIL_SAFE
    if maneuver.pair is not None:
        pair = maneuver.pair
        what = f"{what} {pair.longitudinal.value}, {pair.lateral.value}"
        colour = palette.INK
    lines.append((f"executed: {what} – {plain(maneuver.note)}", colour))
    return [*lines, *_notes(decision.ground)]


def of_verdicts(verdicts: Verdicts) -> list[Line]:
    """The setting, and what the prediction had to assume."""
    return [(_setting(verdicts), palette.INK), *_notes(verdicts.ground)]


def _setting(verdicts: Verdicts) -> str:
    base = verdicts.ground
    rules = plain(", ".join(verdicts.rules), 160) or "none"
    return (
        f"prediction: {plain(base.prediction.kind, 40)}{_DOT}rules: {rules}{_DOT}"
        f"h = {base.horizon}, dt = {base.scene.dt:g} s"
    )


def _notes(base: Ground) -> list[Line]:
    notes = [plain(note, 240) for note in base.prediction.notes]
    return [("assumed: " + "; ".join(notes), palette.FAINT_INK)] if notes else []


Laid = list[tuple[list[str], str]]
"""Wrapped lines and their colour."""


def laid_out(lines: list[Line], width: float) -> Laid:
    """The lines wrapped to a width [inch]."""
    return [(wrapped(text, width, SIZE, lines=2), colour) for text, colour in lines]


def height(laid: Laid) -> float:
    """Height of title and lines [inch]."""
    return line_height(TITLE) + 0.14 + sum(len(w) for w, _ in laid) * line_height(SIZE)


def draw(page: Page, left: float, top: float, width: float, title: str, laid: Laid) -> float:
    """Draw title and lines; returns where the next thing may begin."""
    name = wrapped(title, width, TITLE, bold=True, lines=1)[0]
    page.text(left, top, name, size=TITLE, bold=True)
    top += line_height(TITLE) + 0.04
    for wrapped_lines, colour in laid:
        top = page.lines(left, top, wrapped_lines, size=SIZE, color=colour)
    return top + 0.1
