"""Scores: how many mutants the tests kill, by room, comparisons apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt

from mutation.mutant import COMPARISON, Mutant
from mutation.survivors import EQUIVALENT, Entry, explanation

Result = tuple[Mutant, str]
"""A mutant and what became of it: "killed", "timeout", "survived" or "not covered"."""
DEAD = ("killed", "timeout")


@dataclass(frozen=True)
class Score:
    """Numbers of mutants: all there are, run, killed, and survivors by their entry."""

    all: int
    run: int
    killed: int
    equivalent: int
    accepted: int
    unexplained: int

    @property
    def relevant(self) -> int:
        """Those that a test could kill: run, without the equivalent ones."""
        return self.run - self.equivalent

    @property
    def share(self) -> float:
        return self.killed / self.relevant if self.relevant else 1.0

    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the share, where only a sample was run."""
        if self.run >= self.all or not self.relevant:
            return self.share, self.share
        z, n, p = 1.96, self.relevant, self.share
        centre, half = p + z * z / (2 * n), z * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        return (centre - half) / (1 + z * z / n), (centre + half) / (1 + z * z / n)


def score(all_mutants: int, results: Sequence[Result], entries: Iterable[Entry]) -> Score:
    entries = list(entries)
    reasons = [explanation(m, entries) for m, status in results if status not in DEAD]
    return Score(
        all=all_mutants,
        run=len(results),
        killed=sum(status in DEAD for _, status in results),
        equivalent=sum(e is not None and e.kind == EQUIVALENT for e in reasons),
        accepted=sum(e is not None and e.kind != EQUIVALENT for e in reasons),
        unexplained=sum(e is None for e in reasons),
    )


HEADER = (
    "| room | class | mutants | run | killed | equivalent | accepted | unexplained | score |\n"
    "|---|---|--:|--:|--:|--:|--:|--:|--:|"
)


def row(room: str, kind: str, s: Score) -> str:
    low, high = s.interval()
    spread = "" if s.run >= s.all else f" ({100 * low:.1f} to {100 * high:.1f} %)"
    cells = (s.all, s.run, s.killed, s.equivalent, s.accepted, s.unexplained)
    numbers = " | ".join(str(cell) for cell in cells)
    return f"| `{room}` | {kind} | {numbers} | {100 * s.share:.1f} %{spread} |"


def with_rows(document: str, rows: Iterable[str]) -> str:
    """The document with these rows in its table, in place of those of the same room and class.

    Raises:
        SystemExit: if the document has no such table.
    """
    if HEADER not in document:
        raise SystemExit("mutation: the document has no table of scores")
    before, after = document.split(HEADER)
    lines = after.removeprefix("\n").split("\n")
    n_rows = next((i for i, line in enumerate(lines) if not line.startswith("|")), len(lines))
    table = {_first_cells(line): line for line in lines[:n_rows]}
    table |= {_first_cells(line): line for line in rows}
    return before + "\n".join([HEADER, *table.values(), *lines[n_rows:]])


def _first_cells(line: str) -> tuple[str, ...]:
    return tuple(line.split("|")[1:3])


def kind_name(kind: str) -> str:
    return "comparisons" if kind == COMPARISON else "others"
