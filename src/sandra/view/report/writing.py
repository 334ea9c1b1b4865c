"""Write the page of a folder, and those of the episodes that it links to."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sandra.errors import SandraError
from sandra.view.report.episode import episode_document
from sandra.view.report.evaluation import (
    Found,
    closed_loop_document,
    episodes_in,
    kind_of,
    open_loop_document,
    run_document,
)
from sandra.view.report.html import write


def write_report(
    folder: Path,
    out: Path,
    *,
    episodes: bool = True,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Path]:
    """Write the page of an episode, a run, or an evaluation; the files, its own first.

    Args:
        episodes: where there are several, whether each gets a page beside the first one, in a
            folder named after it.
        progress: called with numbers of pages after each one.

    Raises:
        SandraError: for a folder that is none of these, or a file that cannot be written.
    """
    found = document_of(folder, f"{_plain(out.stem)}-episodes", linked=episodes)
    total = 1 + len(found.episodes)
    written = [write(found.document, out)]
    progress(1, total)
    for name, episode in found.episodes.items():
        page = out.parent / name
        try:
            page.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise SandraError(f"{page.parent}: cannot be made ({error.strerror})") from None
        home = f"../{out.name}" if _plain(out.name) == out.name else None
        written.append(write(episode_document(episode, home), page))
        progress(len(written), total)
    return written


def document_of(folder: Path, pages: str, *, linked: bool) -> Found:
    """The document of a folder, and the episodes that it links to below the folder `pages`."""
    kind = kind_of(folder)
    if kind == "closed-loop":
        return closed_loop_document(folder, pages, linked)
    if kind == "open-loop":
        return Found(open_loop_document(folder), {})
    if kind == "episode":
        return Found(episode_document(folder), {})
    single = episodes_in(folder)
    if len(single) == 1:
        return Found(episode_document(single[0]), {})
    return run_document(folder, pages, linked)


def _plain(text: str) -> str:
    return "".join(c if (c.isalnum() and c.isascii()) or c in "-_." else "-" for c in text)
