"""A page measured in inches from its top left corner, and how it is written to a file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

from sandra.errors import SandraError, SettingsError
from sandra.view import palette
from sandra.view.lettering import write

FORMATS = ("png", "pdf", "svg")
MARGIN = 0.3
"""Free border of every page [inch]."""

_NO_DATE: dict[str, dict[str, Any]] = {
    "png": {"Software": "sandra"},
    "pdf": {"CreationDate": None, "Creator": "sandra"},
    "svg": {"Date": None, "Creator": "sandra"},
}
"""Metadata: no dates, so that the same input gives the same bytes."""


def checked(path: str | Path, dpi: int) -> Path:
    """The path, if a picture can be written there.

    Raises:
        SettingsError: unknown suffix, or a resolution that cannot be used.
        SandraError: its folder does not exist or cannot be written to.
    """
    where = Path(path)
    if where.suffix.lower().lstrip(".") not in FORMATS:
        raise SettingsError(f"{where}: a picture's name must end in .png, .pdf or .svg")
    if isinstance(dpi, bool) or not isinstance(dpi, int) or not 20 <= dpi <= 1200:
        raise SettingsError(f"dpi = {dpi!r} must be an integer from 20 to 1200")
    if not where.parent.is_dir():
        raise SandraError(f"{where}: there is no folder {where.parent}; make it first")
    if where.is_dir():
        raise SandraError(f"{where}: is a folder; name a file")
    if not os.access(where if where.exists() else where.parent, os.W_OK):
        raise SandraError(f"{where}: cannot be written (no permission); choose another place")
    return where


class Page:
    """One figure; its places are in inches from the top left corner.

    It is made without pyplot, so it leaves no state behind and can be made in any thread.
    """

    def __init__(self, width: float, height: float) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.width, self.height = width, height
        self.figure = Figure(
            figsize=(width, height), facecolor=palette.PAPER, edgecolor=palette.PAPER
        )
        FigureCanvasAgg(self.figure)

    def axes(
        self, left: float, top: float, width: float, height: float, projection: str | None = None
    ) -> Any:
        """Axes with their upper left corner at (left, top)."""
        if projection == "3d":
            # Registers the projection.
            import mpl_toolkits.mplot3d  # noqa: F401
        place = (
            left / self.width,
            1.0 - (top + height) / self.height,
            width / self.width,
            height / self.height,
        )
        return self.figure.add_axes(place, projection=projection)

    def text(self, left: float, top: float, text: str, *, size: float, **options: Any) -> Any:
        """A line of text whose first line's top is at `top`."""
        options.setdefault("va", "top")
        return write(
            self.figure, left / self.width, 1.0 - top / self.height, text, size=size, **options
        )

    def lines(
        self, left: float, top: float, lines: Sequence[str], *, size: float, **options: Any
    ) -> float:
        """Lines below one another; returns where the next may begin."""
        for line in lines:
            self.text(left, top, line, size=size, **options)
            top += line_height(size)
        return top

    def rectangle(
        self, left: float, top: float, width: float, height: float, **options: Any
    ) -> None:
        """A rectangle behind or around what is on the page."""
        from matplotlib.patches import Rectangle

        self.figure.add_artist(
            Rectangle(
                (left / self.width, 1.0 - (top + height) / self.height),
                width / self.width,
                height / self.height,
                transform=self.figure.transFigure,
                **options,
            )
        )

    def line(self, left: float, top: float, width: float, **options: Any) -> None:
        """A horizontal line."""
        from matplotlib.lines import Line2D

        y = 1.0 - top / self.height
        ends = [left / self.width, (left + width) / self.width]
        self.figure.add_artist(Line2D(ends, [y, y], transform=self.figure.transFigure, **options))

    def save(self, path: Path, dpi: int) -> Path:
        """Write the file in one go, so that no half of a picture is left behind.

        Raises:
            SandraError: if the file cannot be written.
        """
        kind = path.suffix.lower().lstrip(".")
        content = BytesIO()
        self.figure.savefig(
            content,
            format=kind,
            dpi=dpi,
            metadata=_NO_DATE[kind],
            bbox_inches=None,
            facecolor=palette.PAPER,
        )
        try:
            path.write_bytes(content.getvalue())
        except OSError as error:
            raise SandraError(f"{path}: cannot be written ({error.strerror})") from None
        return path


def line_height(size: float) -> float:
    """Height of a line of text of that size [inch]."""
    return 1.4 * size / 72.0
