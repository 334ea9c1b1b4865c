"""Which SanDRA this is, to be held against that of a worker elsewhere."""

from __future__ import annotations

import platform
from functools import cache
from hashlib import sha256
from pathlib import Path

import sandra
from sandra.reach import twin

ROOT = Path(sandra.__file__).parent
KINDS = ("*.py", "*.toml", "*.json", "*.txt")


@cache
def identity() -> dict[str, str]:
    """Version and sources of SanDRA, its kernel, and Python, which pickles what is sent.

    Found once in a process: a worker that was started before an update still runs what was there.
    """
    files = sorted(file for kind in KINDS for file in ROOT.rglob(kind))
    sources = sha256()
    for file in files:
        sources.update(file.relative_to(ROOT).as_posix().encode() + b"\0" + file.read_bytes())
    return {
        "sandra": sandra.__version__,
        "its sources": sources.hexdigest()[:12],
        "its kernel": _kernel(),
        "Python": ".".join(platform.python_version_tuple()[:2]),
    }


def _kernel() -> str:
    chosen = twin.chosen()
    stamp = getattr(twin.native, "SOURCES", "") if chosen == "native" else ""
    return f"{chosen} {stamp[:12]}".strip()
