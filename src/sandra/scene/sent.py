"""Files whose content came along, for work on a machine on which they do not lie.

Within `sent({path: content})` whoever reads a scenario finds it under the path that it has at home,
so that rows and messages are the same there and here.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO

_SENT: ContextVar[Mapping[Path, bytes]] = ContextVar("_SENT")


@contextmanager
def sent(files: Mapping[Path, bytes]) -> Iterator[None]:
    """Within this, and in this thread, `files` are there."""
    token = _SENT.set(files)
    try:
        yield
    finally:
        _SENT.reset(token)


def opened(path: Path) -> BinaryIO:
    """The content of a file; raises what `Path.open` raises."""
    content = _SENT.get({}).get(path)
    return path.open("rb") if content is None else io.BytesIO(content)


def content_of(path: Path) -> bytes:
    """All of it at once."""
    with opened(path) as file:
        return file.read()


def is_there(path: Path) -> bool:
    """Whether the file came along, or lies here."""
    return path in _SENT.get({}) or path.exists()
