"""What a page needs of an episode while it is being driven: a file that grows line by line.

    {"format": "sandra-report", "version": 1, "kind": "frames"}
    {"view": [x, y, angle]}     origin and direction of the view coordinates [m, m, rad]
    {"map": {...}}              before the first decision on it
    {"text": "..."}             before the first decision that has it in its prompt
    {"decision": {...}}         one for each

It is written beside decisions.jsonl as view.jsonl, so a page can show the very sets that were
computed, and follow a drive that is still under way.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from sandra.errors import SandraError
from sandra.simulation.episode import Step
from sandra.view.report.decided import decided, map_of_decision
from sandra.view.report.document import FORMAT, VERSION, Map, plain
from sandra.view.shapes import View

NAME = "view.jsonl"


class FrameLog:
    """Writes the lines of one episode into an open file; `all_pairs` as in `decided`."""

    def __init__(self, file: IO[str], *, all_pairs: bool = True) -> None:
        self._file, self._all = file, all_pairs
        self._view: View | None = None
        self._map: Map | None = None
        self._maps = 0
        self._texts: list[str] = []
        self._line({"format": FORMAT, "version": VERSION, "kind": "frames"})

    def note(self, step: Step) -> None:
        """One decision."""
        scene = step.decision.scene
        if self._view is None:
            self._view = View.of(scene)
            self._line({"view": place_of(self._view)})
        road = map_of_decision(step.decision, self._view)
        if road != self._map:
            self._map, self._maps = road, self._maps + 1
            self._line({"map": plain(road)})
        known = len(self._texts)
        found = decided(
            step.decision,
            view=self._view,
            step=step.index,
            time=step.index * scene.dt,
            map_index=self._maps - 1,
            texts=self._texts,
            operation=step.operation.value,
            covered=step.covered,
            all_pairs=self._all,
        )
        for text in self._texts[known:]:
            self._line({"text": text})
        self._line({"decision": plain(found)})

    def _line(self, data: dict[str, Any]) -> None:
        self._file.write(json.dumps(data, allow_nan=False, separators=(",", ":")) + "\n")
        self._file.flush()


def place_of(view: View) -> list[float]:
    """Origin and direction [m, m, rad]."""
    return [*map(float, view.origin), view.angle]


@dataclass(slots=True)
class Frames:
    """What was read of such a file so far."""

    view: list[float] | None = None
    maps: list[dict[str, Any]] = field(default_factory=list)
    decisions: list[dict[str, Any]] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)


def _is_place(value: Any) -> bool:
    numbers = isinstance(value, list) and all(isinstance(x, int | float) for x in value)
    return numbers and len(value) == 3


def read_frames(path: Path) -> Frames:
    """All whole lines of a file; a last one that is still being written is left out.

    Raises:
        SandraError: if it cannot be read, or is of another version.
    """
    try:
        lines = path.read_text(encoding="utf-8").split("\n")[:-1]
        told = [json.loads(line) for line in lines]
    except (OSError, ValueError) as error:
        raise SandraError(f"{path}: cannot be read ({error}); drive the episode again") from None
    head = told[0] if told and isinstance(told[0], dict) else {}
    if told and (head.get("format"), head.get("version")) != (FORMAT, VERSION):
        raise SandraError(f"{path}: of another version; drive the episode again")
    found = Frames()
    for line in told[1:]:
        if isinstance(line, dict):
            place = line.get("view")
            if _is_place(place):
                found.view = place
            found.maps += [line["map"]] if isinstance(line.get("map"), dict) else []
            found.texts += [line["text"]] if isinstance(line.get("text"), str) else []
            found.decisions += [line["decision"]] if isinstance(line.get("decision"), dict) else []
    return found
