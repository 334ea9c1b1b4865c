"""The scenarios that come with SanDRA; `scripts/make_scenarios.py` makes them."""

from __future__ import annotations

import re
from pathlib import Path

from sandra.errors import ScenarioError

_FOLDER = Path(__file__).parent


def examples() -> dict[str, Path]:
    """Short name -> file of each scenario that comes with SanDRA, in alphabetical order.

    The short name of `DEU_HighwayDense-1_1_T-1.xml` is `highway-dense`.
    """
    return {_short(path): path for path in sorted(_FOLDER.glob("*.xml"))}


def example(name: str) -> Path:
    """The file of one of `examples()`.

    Raises:
        ScenarioError: if there is none of that name.
    """
    known = examples()
    if name not in known:
        raise ScenarioError(f"no example '{name}': choose from {', '.join(known)}")
    return known[name]


def _short(path: Path) -> str:
    middle = path.stem.partition("_")[2].partition("-")[0]
    return "-".join(word.lower() for word in re.findall("[A-Z][a-z0-9]*", middle))
