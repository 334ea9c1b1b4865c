"""One small change of one file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

COMPARISON, OTHER = "comparison", "other"


@dataclass(frozen=True)
class Mutant:
    """One small change of one file.

    Attributes:
        file: path of the source file, from the root of the project.
        function: dotted name of the function or class it is in; "" at the level of the module.
        kind: COMPARISON or OTHER.
        lines: first and last line of what is changed, from 1.
        before, after: the changed lines, stripped and joined.
        source: the whole changed source.
    """

    file: str
    function: str
    kind: str
    lines: tuple[int, int]
    before: str
    after: str
    source: str

    @property
    def change(self) -> str:
        """Names the change, wherever in the file it stands."""
        return "\n".join((self.file, self.function, self.before, self.after))

    @property
    def id(self) -> str:
        """Names the mutant as long as its file stays as it is."""
        return hashlib.sha256(f"{self.file}\n{self.source}".encode()).hexdigest()[:16]
