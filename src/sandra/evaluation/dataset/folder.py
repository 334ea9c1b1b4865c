"""A recorded data set on disk, and its card.

    DIR/train/NAME.xml, DIR/validation/NAME.xml, DIR/test/NAME.xml
    DIR/SPLIT/NAME.crashed.json    {"ID": STEP, ...}: who crashed, if anybody did
    DIR/episodes.jsonl             one line for each episode: its traffic, its counts, or its error
    DIR/card.json, DIR/DATA.md     the data card, for machines and for people

A recording is written under another name, renamed when it is complete, and then entered into
episodes.jsonl: what is entered is whole. Recording goes on where it stopped.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sandra.errors import SandraError, ScenarioError
from sandra.evaluation.dataset.card import Card, write_card
from sandra.evaluation.workers import Broken, Workers, as_done
from sandra.learn.episodes import DT, SPLITS, Episode, Recipe
from sandra.learn.record import play, save

Progress = Callable[[int, int, str], None]
Job = tuple[Recipe, Episode]
Files = dict[str, bytes]
INDEX = "episodes.jsonl"


@dataclass(frozen=True, slots=True)
class DataFolder:
    """A folder that holds, or will hold, the recordings of one `Recipe`."""

    path: Path

    def record(
        self,
        recipe: Recipe,
        episodes: int,
        workers: Workers = 1,
        command_line: Sequence[str] = (),
        progress: Progress = lambda done, total, name: None,
    ) -> Card:
        """Record the first `episodes` of a recipe that the folder does not have yet.

        An episode that breaks off is entered with its error, and tried again the next time.

        Raises:
            SandraError: if the folder holds another data set or something else, or cannot be
                written; or there is no episode to record.
        """
        if episodes < 1:
            raise SandraError(f"episodes = {episodes}: at least 1")
        self._open(recipe)
        known = {row["seed"]: row for row in self.rows() if "error" not in row}
        wanted = recipe.episodes(episodes)
        missing = [episode for episode in wanted if episode.seed not in known]
        jobs: list[Job] = [(recipe, episode) for episode in missing]
        done = len(wanted) - len(missing)
        with (
            closing(as_done(_one, jobs, workers)) as answers,
            (self.path / INDEX).open("a", encoding="utf-8") as index,
        ):
            for (_, episode), answer in answers:
                if isinstance(answer, Broken):
                    row = {**_of(episode), "error": answer.error}
                else:
                    row, files = answer
                    self._keep(episode, files)
                index.write(json.dumps(row) + "\n")
                index.flush()
                done += 1
                progress(done, len(wanted), episode.name)
        return self.write_card(recipe, command_line)

    def _keep(self, episode: Episode, files: Files) -> None:
        """Write what an episode left, the recording last."""
        if not files:
            return
        folder = self.path / episode.split
        (folder / f"{episode.name}.crashed.json").unlink(missing_ok=True)
        for name in sorted(files):  # .crashed.json before .xml
            draft = folder / f".{name}.draft"
            draft.write_bytes(files[name])
            draft.rename(folder / name)

    def rows(self) -> list[dict[str, Any]]:
        """What is entered, by seed; of several entries of a seed the last one."""
        file = self.path / INDEX
        if not file.exists():
            return []
        found: dict[int, dict[str, Any]] = {}
        for line in file.read_text(encoding="utf-8").splitlines():
            try:
                row = json.loads(line)
                found[row["seed"]] = row
            except (ValueError, TypeError, KeyError):
                continue  # Interrupted while it was written: it is recorded again.
        return [found[seed] for seed in sorted(found)]

    def write_card(self, recipe: Recipe, command_line: Sequence[str] = ()) -> Card:
        """The data card of all that is there, as card.json and DATA.md."""
        card = _card(recipe, self.rows(), command_line)
        write_card(card, self.path / "card.json", self.path / "DATA.md")
        return card

    def _open(self, recipe: Recipe) -> None:
        """Begin the data set, or go on with it."""
        file = self.path / "recipe.json"
        if file.exists():
            try:
                before = json.loads(file.read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise SandraError(f"{file}: cannot be read ({error}); remove it") from None
            differs = [k for k, v in recipe.to_dict().items() if before.get(k) != v]
            if differs:
                raise SandraError(
                    f"{self.path}: holds a data set that differs in {', '.join(differs)}; "
                    "choose another --out"
                )
            self._end_line()
            return
        if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
            raise SandraError(f"{self.path}: is not empty and no data set; choose another --out")
        try:
            for split in SPLITS:
                (self.path / split).mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(recipe.to_dict(), indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise SandraError(
                f"{self.path}: cannot be written ({error.strerror}); choose another --out"
            ) from None

    def _end_line(self) -> None:
        """What is entered next begins on a line of its own, whatever was interrupted."""
        file = self.path / INDEX
        if file.exists() and not file.read_bytes().endswith(b"\n"):
            with file.open("ab") as index:
                index.write(b"\n")


def _one(job: Job) -> tuple[dict[str, Any], Files]:
    """Record one episode: its line of episodes.jsonl, and its files by name."""
    recipe, episode = job
    try:
        recording = play(episode, recipe.steps, round(recipe.warm_up / DT))
    except ScenarioError as error:
        return {**_of(episode), "error": str(error)}, {}
    with TemporaryDirectory() as place:
        file = Path(place) / f"{episode.name}.xml"
        counts = save(episode, recording, file)
        files = {path.name: path.read_bytes() for path in Path(place).iterdir()}
    content = files[file.name]
    row = {
        **_of(episode),
        "file": f"{episode.split}/{file.name}",
        **asdict(counts),
        "bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    return row, files


def _of(episode: Episode) -> dict[str, Any]:
    return {**asdict(episode), "split": episode.split}


def _card(recipe: Recipe, rows: Sequence[dict[str, Any]], command_line: Sequence[str]) -> Card:
    made = [row for row in rows if "error" not in row]
    states = sum(row["states"] for row in made)
    return Card(
        title="Recorded traffic of highway-env",
        about="CommonRoad scenarios (XML 2020a), recorded from the simulator highway-env: no data "
        "of real traffic, nobody's licence to ask for. Any vehicle of a scenario may be the ego. "
        "A seed belongs to one split only; of ten seeds in a row, eight are for training, one "
        "for validation, one for testing.",
        facts={
            "recipe": recipe.to_dict(),
            "step [s]": DT,
            "episodes": len(made),
            "episodes with an error": len(rows) - len(made),
            "vehicles": sum(row["vehicles"] for row in made),
            "vehicles that crash": sum(row["crashed"] for row in made),
            "recorded vehicle hours": round(states * DT / 3600, 3),
            "bytes": sum(row["bytes"] for row in made),
            "sha256 of all files": _hash(row["sha256"] for row in made),
        },
        tables={
            name: _table(made, name) for name in ("environment", "density", "lanes", "drivers")
        },
        errors=tuple(f"seed {row['seed']}: {row['error']}" for row in rows if "error" in row),
        command_line=tuple(command_line),
    )


def _table(rows: Iterable[dict[str, Any]], name: str) -> dict[str, dict[str, int]]:
    """Episodes by a property and by split."""
    found: dict[str, dict[str, int]] = {}
    for row in sorted(rows, key=lambda row: str(row[name])):
        counts = found.setdefault(str(row[name]), dict.fromkeys(SPLITS, 0))
        counts[row["split"]] += 1
    return found


def _hash(parts: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
