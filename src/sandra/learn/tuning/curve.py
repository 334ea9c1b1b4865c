"""How the loss fell: numbers, and a file of them."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandra.errors import SandraError


@dataclass(frozen=True, slots=True)
class Curve:
    """(step, loss) of training (the mean since the point before) and of validation."""

    training: tuple[tuple[int, float], ...]
    validation: tuple[tuple[int, float], ...]

    @staticmethod
    def of(log: Iterable[Mapping[str, Any]]) -> Curve:
        """Of what a `transformers.Trainer` has logged (`trainer.state.log_history`)."""
        points = list(log)

        def along(name: str) -> tuple[tuple[int, float], ...]:
            return tuple((int(p["step"]), float(p[name])) for p in points if name in p)

        return Curve(along("loss"), along("eval_loss"))

    def write(self, path: Path) -> None:
        """As CSV: step, split, loss. Raises `SandraError` if that fails."""
        try:
            with path.open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(("step", "split", "loss"))
                for split in ("training", "validation"):
                    writer.writerows((n, split, f"{x:.5f}") for n, x in getattr(self, split))
        except OSError as error:
            raise SandraError(
                f"{path}: cannot be written ({error.strerror}); choose another place"
            ) from None
