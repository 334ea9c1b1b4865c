"""What a decision drives, alone: the planned and the fail-safe path, speeds and accelerations."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sandra.errors import SandraError
from sandra.view.page import MARGIN, Page, checked
from sandra.view.shapes import View
from sandra.view.sheet import WIDTH, driven_of

if TYPE_CHECKING:
    from sandra.decision import Decision


def maneuver_figure(decision: Decision, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw the bodies along what is driven, and its profiles down to a standstill.

    Args:
        path: its suffix says the format: .png, .pdf or .svg.

    Returns:
        The path of the file.

    Raises:
        SandraError: if nothing finite is driven, or no picture can be written there.
    """
    where = checked(path, dpi)
    view = View.of(decision.scene)
    row = driven_of(
        decision.ground, decision.maneuver, decision.certificate, view, WIDTH - 2 * MARGIN
    )
    if row is None:
        raise SandraError(f"{where}: there is no trajectory to draw")
    page = Page(WIDTH, 2 * MARGIN + row.height)
    row.draw(page, view, decision.ground, MARGIN)
    return page.save(where, dpi)
