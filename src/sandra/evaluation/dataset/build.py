"""From a folder of CommonRoad scenarios to one file of rows, with its card.

    FILE.jsonl        one row a line (`sandra.learn.rows`)
    FILE.card.json    counts by status, label and split; what was left out by balancing; versions
    FILE.card.md      the same for people

Rows are collected in FILE.jsonl.draft, a `Journal`; an interrupted build goes on there.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median_low

import numpy as np

from sandra.errors import SandraError, ScenarioError
from sandra.evaluation.conformance.recording import files_of, marked_crashes
from sandra.evaluation.dataset.card import Card, write_card
from sandra.evaluation.journal import Journal
from sandra.evaluation.workers import Broken, Workers, as_done
from sandra.learn.episodes import SPLITS
from sandra.learn.rows import Row, RowStatus
from sandra.learn.windows import Windows, rows_of, split_of_file

Progress = Callable[[int, int, str], None]
Job = tuple[Path, str, Windows]
AUTO = 0
"""As the number of rows per label: the median of the labels' numbers, in each split."""
_MOST_REASONS = 30


@dataclass(frozen=True, slots=True)
class Built:
    """What was written; `labelled` rows can be learned from."""

    card: Card
    labelled: int


def build(
    folder: Path,
    out: Path,
    how: Windows,
    balance: int | None = None,
    workers: Workers = 1,
    command_line: Sequence[str] = (),
    progress: Progress = lambda done, total, name: None,
) -> Built:
    """Write the rows of all scenarios of a folder.

    Args:
        balance: at most so many labelled rows for each label in each split, chosen by the seed;
            `AUTO`: the median of the labels' numbers; None: all. Other rows are all kept.
        workers: see `sandra.evaluation.workers`.

    Raises:
        SandraError: no scenario in the folder, a file that cannot be written, or a draft that was
            begun otherwise.
    """
    names = scenarios(folder)
    about = {"folder": str(folder.resolve()), **how.to_dict()}
    draft = Journal(out.with_name(out.name + ".draft"), about)
    jobs: list[Job] = [(folder / name, name, how) for name in names if name not in draft]
    done = len(names) - len(jobs)
    with closing(as_done(_one, jobs, workers, lambda job: files_of(job[0]))) as answers:
        for (_, name, _), rows in answers:
            if isinstance(rows, Broken):
                rows = [_broken(name, rows.error)]
            draft.add(name, [asdict(row) for row in rows])
            done += 1
            progress(done, len(names), name)
    try:
        card, labelled = _finish(draft, out, names, how, balance, command_line, folder)
        draft.remove()
    except OSError as error:
        raise SandraError(
            f"{out}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    return Built(card, labelled)


def scenarios(folder: Path) -> list[str]:
    """The CommonRoad files below a folder, relative to it. Raises `SandraError` if none is."""
    if not folder.is_dir():
        raise SandraError(f"{folder}: no such folder; name one with CommonRoad scenarios")
    files = (file.relative_to(folder) for file in folder.rglob("*.xml"))
    found = sorted(str(file.as_posix()) for file in files if not file.name.startswith("."))
    if not found:
        raise SandraError(f"{folder}: there is no .xml file in this folder or below; name another")
    return found


def _one(job: Job) -> list[Row]:
    """The rows of one scenario, in a process of its own."""
    path, name, how = job
    try:
        crashed = marked_crashes(path)
    except ScenarioError as error:
        return [_broken(name, str(error))]
    return rows_of(path, name, how, crashed)


def _broken(name: str, error: str) -> Row:
    return Row(RowStatus.ERROR.value, split_of_file(name), name, None, None, detail=error)


def _rows(draft: Journal, names: Sequence[str]) -> Iterator[Row]:
    """In the order of the names, whoever was ready first."""
    return (Row.of(data) for name in names for data in draft[name])


def _finish(
    draft: Journal,
    out: Path,
    names: Sequence[str],
    how: Windows,
    balance: int | None,
    command_line: Sequence[str],
    folder: Path,
) -> tuple[Card, int]:
    """Choose rows, write them, and the card."""
    places: dict[tuple[str, str], list[int]] = {}
    statuses: Counter[tuple[str, str]] = Counter()
    reasons: Counter[str] = Counter()
    for number, row in enumerate(_rows(draft, names)):
        statuses[row.status, row.split] += 1
        if row.is_labelled and row.label is not None:
            places.setdefault((row.label, row.split), []).append(number)
        else:
            reasons[re.sub(r"\d+", "N", f"{row.status}: {row.detail}")] += 1
    kept = _balanced(places, balance, how.seed)
    chosen = {number for several in kept.values() for number in several}
    digest = hashlib.sha256()
    whole = out.with_name(out.name + ".whole")
    with whole.open("w", encoding="utf-8") as file:
        for number, row in enumerate(_rows(draft, names)):
            if not row.is_labelled or number in chosen:
                digest.update(row.line().encode())
                file.write(row.line())
    whole.replace(out)
    found = {key: len(several) for key, several in places.items()}
    used = {key: len(several) for key, several in kept.items()}
    tables = {"rows by status": _table(statuses), "labels": _table(used)}
    if balance is not None:
        tables["labels before balancing"] = _table(found)
    card = Card(
        title="Prompts with labels",
        about="One row for each window of each vehicle: the prompt of that moment, and what was "
        "driven from there on. Rows without a label say why.",
        facts={
            "scenarios": len(names),
            "labeler": how.labeler,
            "window [steps]": how.settings.horizon,
            "windows per vehicle": how.per_vehicle,
            "vehicles per scenario": how.vehicles or "all",
            "seed": how.seed,
            "chance of a wish, a past, rules, a choice": how.variety,
            "chance of no accelerations, no road": how.bare,
            "rows per label and split at most": "all" if balance is None else (balance or "median"),
            "labelled rows": len(chosen),
            "left out by balancing": sum(found.values()) - len(chosen),
            "rows without a label": sum(reasons.values()),
            "sha256 of the rows": digest.hexdigest(),
            "sha256 of the recordings": _source(folder),
        },
        tables=tables,
        errors=tuple(f"{n} x {words}" for words, n in reasons.most_common(_MOST_REASONS)),
        command_line=tuple(command_line),
        settings=asdict(how.settings),
    )
    write_card(card, out.with_suffix(".card.json"), out.with_suffix(".card.md"))
    return card, len(chosen)


def _balanced(
    places: Mapping[tuple[str, str], Sequence[int]], balance: int | None, seed: int
) -> dict[tuple[str, str], list[int]]:
    """By label and split: at most so many rows, chosen at random."""
    if balance is None:
        return {key: list(several) for key, several in places.items()}
    most = dict.fromkeys(SPLITS, balance)
    if balance == AUTO:
        for split in SPLITS:
            counts = [len(several) for (_, where), several in places.items() if where == split]
            most[split] = median_low(counts) if counts else 0
    kept = {}
    for key in sorted(places):
        several, limit = places[key], most[key[1]]
        order = np.random.default_rng([seed, *"".join(key).encode()]).permutation(len(several))
        kept[key] = sorted(several[i] for i in order[:limit])
    return kept


def _table(counts: Mapping[tuple[str, str], int]) -> dict[str, dict[str, int]]:
    """By value and split, the most frequent first."""
    totals: Counter[str] = Counter()
    for (value, _), n in counts.items():
        totals[value] += n
    return {
        value: {split: counts.get((value, split), 0) for split in SPLITS}
        for value, _ in sorted(totals.items(), key=lambda item: (-item[1], item[0]))
    }


def _source(folder: Path) -> str:
    """As the card of recordings tells it."""
    try:
        card = json.loads((folder / "card.json").read_text(encoding="utf-8"))
        return str(card["sha256 of all files"])
    except (OSError, ValueError, KeyError, TypeError):
        return "unknown"
