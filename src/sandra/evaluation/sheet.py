"""A table of text in three formats."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

FORMATS = {"markdown": "md", "latex": "tex", "csv": "csv"}
"""Formats, and the endings of their files."""
_TEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "_": r"\_",
    "#": r"\#",
    "$": r"\$",
    "{": r"\{",
    "}": r"\}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
}


@dataclass(frozen=True, slots=True)
class Sheet:
    """Headers, rows of as many cells, and a sentence about it."""

    title: str
    headers: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def text(self, form: str) -> str:
        """In one of `FORMATS`."""
        return {"markdown": self.markdown, "latex": self.latex, "csv": self.csv}[form]()

    def markdown(self) -> str:
        """As Markdown."""
        lines = [self.headers, ("---",) * len(self.headers), *self.rows]
        table = "\n".join(f"| {' | '.join(_bars(cells))} |" for cells in lines)
        return f"{self.title}\n\n{table}\n"

    def latex(self) -> str:
        """As a LaTeX tabular (package booktabs); a line between different first cells."""
        lines = [
            f"% {self.title}",
            rf"\begin{{tabular}}{{ll{'r' * (len(self.headers) - 2)}}}",
            r"\toprule",
            _tex(self.headers),
            r"\midrule",
        ]
        for before, cells in zip((None, *self.rows), self.rows, strict=False):
            if before is not None and before[0] != cells[0]:
                lines.append(r"\addlinespace")
            lines.append(_tex(cells))
        return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"

    def csv(self) -> str:
        """As CSV with a header."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.headers)
        writer.writerows(self.rows)
        return text.getvalue()


def _bars(cells: Sequence[str]) -> list[str]:
    return [cell.replace("|", r"\|") for cell in cells]


def _tex(cells: Sequence[str]) -> str:
    told = ["".join(_TEX.get(c, c) for c in cell) for cell in cells]
    return " & ".join(told) + r" \\"
