"""A run folder as it grows: which episodes there are, and what is new in one of them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sandra.errors import SandraError
from sandra.scene.types import Region
from sandra.view.report import Document, episode_document
from sandra.view.report.document import Episode, Track, plain
from sandra.view.report.evaluation import episodes_in
from sandra.view.report.frames import NAME, Frames, read_frames
from sandra.view.report.packing import pack_rows, unpack_rows
from sandra.view.report.scenery import STATE, outline_of

_NAME = re.compile(r"seed-\d{1,12}")


@dataclass(slots=True)
class _Seen:
    """One episode that is being driven: where everybody was at each decision."""

    rows: dict[int, dict[int, list[float]]] = field(default_factory=dict)
    """By id, by decision: x, y, heading, speed, acceleration."""
    looks: dict[int, tuple[str, str]] = field(default_factory=dict)
    """Kind and outline."""
    done: int = 0


@dataclass(slots=True)
class Follower:
    """Reads a run folder, anew at each look; what each decision told of bodies is unpacked once."""

    run: Path
    seen: dict[str, _Seen] = field(default_factory=dict)

    def episodes(self) -> list[dict[str, Any]]:
        """Names, and whether each is whole; those that are being driven come last."""
        whole = [{"name": x.name, "done": True} for x in episodes_in(self.run)]
        drafts = sorted(self.run.glob(".seed-*.draft"))
        return whole + [
            {"name": x.name.removeprefix(".").removesuffix(".draft"), "done": False}
            for x in drafts
            if (x / NAME).exists()
        ]

    def news(self, name: str, known: int) -> dict[str, Any]:
        """What the page does not know yet of an episode, of which it knows so many decisions.

        For a whole episode the document itself; for one that is being driven the new decisions,
        and everybody's way so far.

        Raises:
            SandraError: for a name that is none, or what cannot be read.
        """
        if not _NAME.fullmatch(name):
            raise SandraError("no such episode")
        folder = self.run / name
        if (folder / "metrics.json").exists():
            self.seen.pop(name, None)
            return {"done": True, "document": episode_document(folder).to_dict()}
        draft = self.run / f".{name}.draft" / NAME
        try:
            frames = read_frames(draft) if draft.exists() else Frames()
        except SandraError:
            # It may be renamed just now: the next look finds it whole.
            frames = Frames()
        found = frames.decisions
        if known == 0:
            return {"done": False, "document": self._document(name, frames).to_dict()}
        return {
            "done": False,
            "decisions": found[known:],
            "maps": frames.maps,
            "texts": frames.texts,
            "episode": plain(self._episode(name, frames)),
        }

    def _document(self, name: str, frames: Frames) -> Document:
        return Document(
            "episode",
            f"{self.run.name}, {name}",
            (("state", "under way"),),
            maps=tuple(frames.maps),
            decisions=tuple(frames.decisions),
            texts=tuple(frames.texts),
            episode=self._episode(name, frames) if frames.decisions else None,
        )

    def _episode(self, name: str, frames: Frames) -> Episode | None:
        decisions = frames.decisions
        if not decisions:
            return None
        seen = self.seen.setdefault(name, _Seen())
        if seen.done > len(decisions):  # begun anew
            seen = self.seen[name] = _Seen()
        for step in range(seen.done, len(decisions)):
            _note(seen, step, decisions[step])
        seen.done = len(decisions)
        tracks = []
        for number, rows in seen.rows.items():
            first, last = min(rows), max(rows)
            table = np.full((last - first + 1, len(STATE)), np.nan)
            for step, row in rows.items():
                table[step - first] = row
            kind, outline = seen.looks[number]
            tracks.append(Track(number, kind, outline, first, pack_rows(table, STATE)))
        return Episode(
            ego=int(decisions[0]["ego"]["id"]),
            dt=float(decisions[0]["dt"]),
            ticks=len(decisions),
            decided_every=1,
            tracks=tuple(tracks),
            rules=(),
            crash=None,
            told=(),
        )


def _note(seen: _Seen, step: int, decision: dict[str, Any]) -> None:
    ego = decision["ego"]
    keys = ("x", "y", "heading", "speed", "acceleration")
    seen.rows.setdefault(int(ego["id"]), {})[step] = [float(ego[key]) for key in keys]
    body = Region.rectangle(float(ego["length"]), float(ego["width"]))
    seen.looks.setdefault(int(ego["id"]), ("ego", outline_of(body)))
    for other in decision["others"]:
        rows = unpack_rows(other["states"], STATE)
        if len(rows):
            seen.rows.setdefault(int(other["id"]), {})[step] = rows[0].tolist()
            seen.looks.setdefault(int(other["id"]), (other["kind"], other["outline"]))
