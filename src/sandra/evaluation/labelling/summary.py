"""Rows of labels, and their distribution."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sandra.actions import ALL_PAIRS, Lateral, Longitudinal
from sandra.evaluation.closed_loop.metrics import wilson
from sandra.evaluation.sheet import Sheet

UNKNOWN = "unknown"
ERROR = "error"
COLUMNS = (
    "scenario_id",
    "file",
    "ego_id",
    "kind",
    "step",
    "dt",
    "horizon",
    "labeler",
    "label_lon",
    "label_lat",
    "holds",
    "reason",
    "mean_acceleration",
    "speed",
    "final_speed",
    "error",
)
"""Of the CSV file; `holds` is a list with semicolons between."""


@dataclass(frozen=True, slots=True)
class Labels:
    """Rows as JSON: one for each window, or for a file or window that could not be used."""

    rows: tuple[dict[str, Any], ...]

    @property
    def errors(self) -> tuple[dict[str, Any], ...]:
        """The rows that hold an error instead of a label."""
        return tuple(row for row in self.rows if row["error"] is not None)

    def counts(self) -> dict[str, dict[str, int]]:
        """How often each "longitudinal", each "lateral" action and each "pair" is the label.

        Unknown labels are counted as "unknown", rows with an error as "error": each of the three
        adds up to the number of rows.
        """
        found: dict[str, Counter[str]] = {
            "longitudinal": Counter(),
            "lateral": Counter(),
            "pair": Counter(),
        }
        for row in self.rows:
            lon, lat = row["label_lon"], row["label_lat"]
            known = UNKNOWN not in (lon, lat)
            if row["error"] is not None:
                lon, lat, pair = ERROR, ERROR, ERROR
            else:
                pair = f"{lon},{lat}" if known else UNKNOWN
            for kind, name in (("longitudinal", lon), ("lateral", lat), ("pair", pair)):
                found[kind][name] += 1
        order = {
            "longitudinal": [x.value for x in Longitudinal],
            "lateral": [x.value for x in Lateral],
            "pair": [str(x) for x in ALL_PAIRS],
        }
        return {
            kind: {name: counter[name] for name in (*order[kind], UNKNOWN, ERROR) if counter[name]}
            for kind, counter in found.items()
        }

    def distribution(self) -> Sheet:
        """Counts and shares of all rows, with Wilson's 95 % interval."""
        n = len(self.rows)
        files = len({row["file"] for row in self.rows})
        rows = []
        for kind, counts in self.counts().items():
            for name, count in counts.items():
                low, high = wilson(count, n)
                share = f"{100 * count / n:.1f} [{100 * low:.1f}, {100 * high:.1f}]"
                rows.append((kind, name, str(count), share))
        return Sheet(
            f"{n} rows of {files} files; unknown labels and errors are rows like others. Shares "
            "in per cent [95 % interval after Wilson].",
            ("action", "label", "rows", "share"),
            tuple(rows),
        )

    def reasons(self) -> Sheet:
        """Why labels are unknown, and the errors."""
        found = Counter(
            (ERROR, row["error"].removeprefix(f"{row['file']}: "))
            if row["error"]
            else (UNKNOWN, row["reason"])
            for row in self.rows
            if row["error"] or row["reason"]
        )
        rows = tuple((kind, str(why), str(n)) for (kind, why), n in found.most_common())
        return Sheet("What has no label.", ("what", "because", "rows"), rows)

    def sheets(self) -> dict[str, Sheet]:
        """By the name of their files; those without a row are left out."""
        found = {"distribution": self.distribution(), "unlabelled": self.reasons()}
        return {name: sheet for name, sheet in found.items() if sheet.rows}

    def summary(self) -> dict[str, Any]:
        """For machines."""
        return {
            "rows": len(self.rows),
            "files": len({row["file"] for row in self.rows}),
            "errors": len(self.errors),
            **self.counts(),
        }

    def csv(self) -> str:
        """All rows as CSV."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([_cell(row, name) for name in COLUMNS] for row in self.rows)
        return text.getvalue()

    def jsonl(self) -> str:
        """All rows as JSON lines."""
        return "".join(json.dumps(row, allow_nan=False) + "\n" for row in self.rows)


def _cell(row: Mapping[str, Any], name: str) -> Any:
    value = row[name]
    return ";".join(value) if isinstance(value, list) else "" if value is None else value
