"""The rows of a data set: a prompt with its ranking, or why there is none; one JSON a line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from sandra.errors import SandraError


class RowStatus(Enum):
    """Whether a row can be learned from, and if not, why."""

    LABELLED = "labelled"
    UNKNOWN = "unknown"
    """The labeler found no pair that was driven."""
    INFEASIBLE = "infeasible"
    """What was driven is not among the pairs that the prompt offers."""
    CRASHED = "crashed"
    """The ego has crashed before the window ends."""
    SHORT = "short"
    """The trajectory is shorter than one window."""
    ERROR = "error"
    """The file cannot be read, or there is no scene at this step."""


@dataclass(frozen=True, slots=True)
class Row:
    """One ego at one step of one scenario.

    `label` is what was driven, `ranking` what a model should answer: k pairs, the label first;
    pairs as "keep,follow-lane". Where there is no prompt, `system`, `user` and `schema` are None.
    """

    status: str
    split: str
    scenario: str
    """The file, relative to the folder of scenarios."""
    ego: int | None
    step: int | None
    label: str | None = None
    detail: str | None = None
    system: str | None = None
    user: str | None = None
    schema: dict[str, Any] | None = None
    feasible: tuple[str, ...] = ()
    ranking: tuple[str, ...] = ()

    @property
    def is_labelled(self) -> bool:
        return self.status == RowStatus.LABELLED.value

    def line(self) -> str:
        """As a line of the file, with its end."""
        return json.dumps(asdict(self), ensure_ascii=False) + "\n"

    @staticmethod
    def of(data: Any) -> Row:
        """Of a JSON object. Raises `ValueError` if it is no row."""
        if not isinstance(data, dict):
            raise ValueError("no JSON object")
        try:
            row = Row(**{**data, **{k: tuple(data.get(k) or ()) for k in ("feasible", "ranking")}})
        except TypeError as error:
            raise ValueError(str(error)) from None
        if row.status not in {status.value for status in RowStatus}:
            raise ValueError(f"unknown status {row.status!r}")
        if row.is_labelled and not (
            isinstance(row.system, str)
            and isinstance(row.user, str)
            and isinstance(row.schema, dict)
            and row.label is not None
            and row.ranking[:1] == (row.label,)
        ):
            raise ValueError(
                "a labelled row has a prompt, and a ranking that begins with its label"
            )
        return row


def read_rows(path: Path) -> Iterator[Row]:
    """The rows of a file that `sandra dataset build` has written.

    Raises:
        SandraError: if it cannot be read; names the line.
    """
    try:
        with path.open(encoding="utf-8") as file:
            for number, line in enumerate(file, start=1):
                try:
                    yield Row.of(json.loads(line))
                except ValueError as error:
                    words = " ".join(str(error).split())[:200]
                    raise SandraError(
                        f"{path}:{number}: not a row of 'sandra dataset build' ({words})"
                    ) from None
    except OSError as error:
        raise SandraError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except UnicodeDecodeError:
        raise SandraError(
            f"{path}: not UTF-8 text; name a file of 'sandra dataset build'"
        ) from None
