"""The loss over the steps of a training, as a table that other programs read."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from sandra.errors import SandraError


@dataclass(frozen=True, slots=True)
class Point:
    """Mean loss per token of the answers [nat]; None where it was not measured."""

    step: int
    train: float | None = None
    validation: float | None = None


def write_curve(points: Sequence[Point], path: Path) -> Path:
    """Write a CSV file with the columns step, train, validation.

    Raises:
        SandraError: if it cannot be written.
    """
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(field.name for field in fields(Point))
            writer.writerows(astuple(point) for point in points)
    except OSError as error:
        raise SandraError(f"{path}: cannot be written ({error.strerror})") from None
    return path
