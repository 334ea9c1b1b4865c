"""The folder of a run: every decision, every tick, certificates, metrics, and what made them.

    RUN/run.json                      what is driven; versions, commit, command line
    RUN/seed-5838/decisions.jsonl     one line for each decision: prompt, ranking, verdicts, ...
    RUN/seed-5838/certificates/       those of what was executed
    RUN/seed-5838/scenario.xml        all vehicles and the ego at every tick, as CommonRoad
    RUN/seed-5838/metrics.json
    RUN/seed-5838/view.jsonl          what a page shows of each decision, if that is wanted

An episode is written under another name and renamed when it is complete: what has its name is
whole. A run goes on where it stopped, and never mixes with another one's data.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Protocol

from sandra.certificate import save
from sandra.errors import SandraError
from sandra.evaluation.closed_loop.drive import Drive, play
from sandra.evaluation.closed_loop.driven import Outcome
from sandra.evaluation.provenance import commit, versions
from sandra.scene.writing import write
from sandra.simulation.episode import Episode, Step


class Frames(Protocol):
    """Writes what a page shows (`sandra.view.report.FrameLog`)."""

    def note(self, step: Step) -> None:
        """One decision."""
        ...


FramesOf = Callable[[IO[str]], Frames]
"""Begins to write into an open file; a function or class of a module, so that it can be sent."""


@dataclass(frozen=True, slots=True)
class RunFolder:
    """A folder that holds, or will hold, the episodes of one `Drive`.

    `frames` makes what writes view.jsonl into an open file; None: there is no such file.
    """

    path: Path
    frames: FramesOf | None = None

    def open(self, how: Drive, command_line: Sequence[str] = ()) -> None:
        """Begin the run, or go on with it.

        Raises:
            SandraError: if the folder holds another run or something else, or cannot be written.
        """
        file = self.path / "run.json"
        if file.exists():
            differs = how.differs(self._read(file).get("drive", {}))
            if differs:
                raise SandraError(
                    f"{self.path}: holds a run that differs in {', '.join(differs)}; "
                    "choose another --out"
                )
            return
        if self.path.exists() and any(self.path.iterdir()):
            raise SandraError(f"{self.path}: is not empty and no run; choose another --out")
        about = {
            "drive": how.to_dict(),
            "command_line": list(command_line),
            "versions": versions(),
            "commit": commit(),
        }
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            _write(file, about)
        except OSError as error:
            raise SandraError(
                f"{self.path}: cannot be written ({error.strerror}); choose another --out"
            ) from None

    def episode(self, seed: int) -> Path:
        """Where the episode of a seed is, or will be."""
        return self.path / f"seed-{seed}"

    def metrics(self, seed: int) -> dict[str, Any] | None:
        """Of an episode that is complete; None if it is not there yet."""
        file = self.episode(seed) / "metrics.json"
        return self._read(file) if file.exists() else None

    def drive(
        self, how: Drive, seed: int, on_step: Callable[[Step], None] = lambda step: None
    ) -> dict[str, Any]:
        """The metrics of an episode: of the folder, or driven now and written."""
        known = self.metrics(seed)
        if known is not None:
            return known
        draft = self._draft(seed)
        with ExitStack() as files:
            log = files.enter_context((draft / "decisions.jsonl").open("w", encoding="utf-8"))
            frames = None
            if self.frames is not None:
                view = files.enter_context((draft / "view.jsonl").open("w", encoding="utf-8"))
                frames = self.frames(view)

            def note(step: Step) -> None:
                if frames is not None:
                    frames.note(step)
                log.write(json.dumps(_finite(_decision(step)), allow_nan=False) + "\n")
                picture = step.decision.prompt.picture
                if picture is not None:
                    (draft / "pictures").mkdir(exist_ok=True)
                    picture.save(draft / "pictures" / f"step-{step.index:03d}.png")
                certificate = step.decision.certificate
                if certificate is not None:
                    save(certificate, draft / "certificates" / f"step-{step.index:03d}.json")
                on_step(step)

            episode, found = play(how, seed, note)
        return self._finish(draft, how, seed, episode, found)

    def packed(self, seed: int) -> dict[str, bytes]:
        """The files of a complete episode, by their paths below its folder."""
        home = self.episode(seed)
        files = (file for file in home.rglob("*") if file.is_file())
        return {file.relative_to(home).as_posix(): file.read_bytes() for file in files}

    def keep(self, seed: int, files: Mapping[str, bytes]) -> dict[str, Any]:
        """Write an episode that was driven elsewhere, and `packed` there; its metrics."""
        draft = self._draft(seed)
        for name, content in files.items():
            (draft / name).parent.mkdir(parents=True, exist_ok=True)
            (draft / name).write_bytes(content)
        draft.rename(self.episode(seed))
        return self._read(self.episode(seed) / "metrics.json")

    def _draft(self, seed: int) -> Path:
        draft = self.path / f".seed-{seed}.draft"
        shutil.rmtree(draft, ignore_errors=True)
        (draft / "certificates").mkdir(parents=True)
        return draft

    def _finish(
        self, draft: Path, how: Drive, seed: int, episode: Episode, found: Outcome
    ) -> dict[str, Any]:
        recording = episode.recording
        write(recording.scene, draft / "scenario.xml", source="sandra drive, highway-env")
        told = {
            "seed": seed,
            **found.to_dict(),
            "told": found.told(),
            "cost": how.cost(episode.usage),
            "crashed": {str(i): tick for i, tick in recording.crashed.items()},
            "ticks": len(recording.ego) - 1,
            "ticks_per_step": episode.ticks_per_step,
            "tick": recording.scene.dt,
        }
        _write(draft / "metrics.json", told)
        draft.rename(self.episode(seed))
        return self._read(self.episode(seed) / "metrics.json")

    def _read(self, file: Path) -> dict[str, Any]:
        try:
            found = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise SandraError(f"{file}: cannot be read ({error}); remove it") from None
        if not isinstance(found, dict):
            raise SandraError(f"{file}: is no JSON object; remove it")
        return found


def _decision(step: Step) -> dict[str, Any]:
    """One line of decisions.jsonl."""
    decision = step.decision
    prompt, ranking = decision.prompt, decision.ranking
    return {
        "step": step.index,
        "operation": step.operation.value,
        "covered": step.covered,
        "breach": step.breach,
        "cpu": step.cpu,
        "duration": step.duration,
        "prompt": {"system": prompt.system, "user": prompt.user, "schema": prompt.schema},
        "answer": ranking.answer,
        "reasoning": ranking.reasoning,
        **decision.to_dict(),
    }


def _write(file: Path, data: dict[str, Any]) -> None:
    file.write_text(json.dumps(_finite(data), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _finite(value: Any) -> Any:
    """Numbers that JSON lacks (infinite, undefined) become null."""
    if isinstance(value, float) and value - value != 0.0:
        return None
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
