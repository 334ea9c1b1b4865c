"""The closed-loop table: all rows driven, or taken from their run folders, beside the paper's.

One run folder for each row, setting and repeat below one folder: what is there is not run again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from sandra.evaluation.closed_loop.batch import one
from sandra.evaluation.closed_loop.blame import STANDS
from sandra.evaluation.closed_loop.drive import Drive
from sandra.evaluation.closed_loop.entry import (
    RULES,
    Entry,
    beside_cells,
    main_cells,
    paper_dict,
    printed_cells,
)
from sandra.evaluation.closed_loop.folder import FramesOf, RunFolder
from sandra.evaluation.closed_loop.metrics import (
    OURS,
    PAPER,
    Convention,
    Metrics,
    Proofs,
    summarise,
)
from sandra.evaluation.closed_loop.paper import TABLE
from sandra.evaluation.closed_loop.rows import Row
from sandra.evaluation.sheet import Sheet
from sandra.evaluation.workers import Broken, Workers, as_done
from sandra.rankers import Usage, total

Run = tuple[RunFolder, Row, int, Drive]


@dataclass(frozen=True, slots=True)
class Table:
    """Entries by row, then by setting."""

    profile: str
    convention: Convention
    entries: tuple[Entry, ...]

    @property
    def broken(self) -> tuple[str, ...]:
        """Episodes that are missing because they broke off with an error."""
        return tuple(
            f"{entry.row.name}, setting {entry.setting}, {words}"
            for entry in self.entries
            for words in entry.broken
        )

    def usages(self) -> dict[str, Usage]:
        """What was asked of servers, by who asked."""
        names = dict.fromkeys(e.asks for e in self.entries)
        found = {name: total(e.usage for e in self.entries if e.asks == name) for name in names}
        return {name: usage for name, usage in found.items() if usage is not None}

    def main(self) -> Sheet:
        """The paper's metrics, with the paper's rows, and beside our rows those of the paper."""
        shown = [printed_cells(x) for x in TABLE if x.setting in {e.setting for e in self.entries}]
        counted = "all but the last" if self.convention is PAPER else "all"
        return Sheet(
            f"Profile {self.profile}; {counted} of the 30 steps must be free of collision. Rows "
            '"paper:" and the last column, success % / success steps / distance / fail-safe %, are '
            "printed in the paper (profile paper, meta-actions, GPT-4o).",
            (
                "driver",
                "setting",
                "success % [95 %]",
                "collision-free steps",
                *RULES,
                "success steps",
                "distance (m)",
                "fail-safe %",
                "the paper's",
            ),
            (*shown, *(main_cells(e) for e in self.entries)),
        )

    def beside(self) -> Sheet:
        """What shows when the paper's metrics are gamed, and what was proven."""
        oracle = {
            e.setting: e.summary.distance
            for e in self.entries
            if e.row.name == "oracle" and e.summary is not None
        }
        return Sheet(
            "Beside them: distance over all episodes, and of successful ones in per cent of the "
            "oracle's; steps driven by a new certificate, a carried fail-safe, a renewed one, the "
            "emergency layer; steps after the first certificate without a fail-safe known to be "
            "clear, those without a known reason in brackets; our part of a decision.",
            (
                "driver",
                "setting",
                "episodes (seeds)",
                "distance, all (m)",
                "of oracle %",
                "speed over traffic (m/s)",
                "lane changes",
                "certified / carried / renewed / emergency %",
                "certified starts",
                "collisions at fault / not (standing)",
                "uncovered (unexplained)",
                "CPU s, mean (most)",
            ),
            tuple(beside_cells(e, oracle.get(e.setting)) for e in self.entries),
        )

    def to_dict(self) -> dict[str, Any]:
        """For machines; an entry's keys are the fields of `Summary`."""
        return {
            "profile": self.profile,
            "convention": asdict(self.convention),
            "rows": [
                {
                    "row": e.row.name,
                    "setting": e.setting,
                    **({} if e.summary is None else asdict(e.summary)),
                    "broken": list(e.broken),
                    "usage": None if e.usage is None else e.usage.to_dict(),
                    "paper": paper_dict(e),
                }
                for e in self.entries
            ],
        }


def tabulate(
    out: Path,
    rows: Sequence[Row],
    settings: Sequence[int],
    seeds: Sequence[int],
    *,
    convention: Convention = OURS,
    workers: Workers = 1,
    command_line: Sequence[str] = (),
    frames: FramesOf | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> Table:
    """Drive what is not in the folder yet, and summarise.

    Args:
        out: the folder of the run folders. seeds: of the traffic. settings: of the paper.
        workers: see `sandra.evaluation.workers`.
        progress: called with numbers of episodes after each one.
        frames: as of `RunFolder`.

    Raises:
        SandraError: for what is unknown, or a folder that holds another run.
    """
    runs: list[Run] = []
    for row in rows:
        for setting in settings:
            for how in row.in_setting(setting):
                folder = RunFolder(out / _folder(row, how), frames)
                folder.open(how, command_line)
                runs.append((folder, row, setting, how))
    profile = runs[0][3].profile if runs else "stock"
    cases = [(run, seed) for run in runs for seed in seeds]
    todo = [case for case in cases if case[0][0].metrics(case[1]) is None]
    done, errors = len(cases) - len(todo), dict[tuple[Path, int], str]()
    with closing(as_done(_one, todo, workers, lambda case: case[0][3].files)) as answers:
        for (run, seed), answer in answers:
            done += 1
            if isinstance(answer, Broken):
                errors[run[0].path, seed] = answer.error
            else:
                run[0].keep(seed, answer)
            progress(done, len(cases), f"{run[1].name}, setting {run[2]}, seed {seed}")
    entries = []
    for row in rows:
        for setting in settings:
            mine = [(run[0], seed) for run, seed in cases if (run[1], run[2]) == (row, setting)]
            entries.append(_entry(row, setting, mine, errors, convention))
    return Table(profile, convention, tuple(entries))


def _one(case: tuple[Run, int]) -> dict[str, bytes]:
    (folder, _, _, how), seed = case
    return one((folder.frames, how, seed))


def _folder(row: Row, how: Drive) -> str:
    name = "".join(c if c.isalnum() or c in "-_." else "-" for c in row.name.replace("/", "_"))
    again = f"_{how.repeat}" if how.repeat else ""
    return f"{name}{again}/setting-{how.setting}"


def _entry(
    row: Row,
    setting: int,
    mine: Sequence[tuple[RunFolder, int]],
    errors: dict[tuple[Path, int], str],
    convention: Convention,
) -> Entry:
    found, proofs, folders, pairs = [], [], list[Path](), Counter[str]()
    costs = []
    for folder, seed in mine:
        data = folder.metrics(seed)
        if data is not None:
            found.append((seed, counted(data["metrics"], convention)))
            proofs.append(proofs_of(data))
            folders.append(folder.episode(seed))
            pairs.update(data["pairs"])
            costs.append(data.get("cost"))
    broken = tuple(
        f"seed {seed}: {errors[folder.path, seed]}"
        for folder, seed in mine
        if (folder.path, seed) in errors
    )
    verified = [x for x in proofs if x is not None]
    summary = summarise(found, verified) if found else None
    usage = total(Usage.of_dict(x["usage"]) for x in costs if x)
    return Entry(row, setting, summary, tuple(folders), dict(pairs), broken, usage)


def counted(data: dict[str, Any], convention: Convention) -> Metrics:
    """`Metrics` as JSON, by a convention: what is a collision is the only difference."""
    told: dict[str, Any] = {k: math.nan if v is None else v for k, v in data.items()}
    metrics = Metrics(**told)
    if convention.decisive < convention.steps and metrics.steps >= convention.steps:
        free = metrics.collision_free_steps >= convention.decisive
        metrics = replace(metrics, success=metrics.success or free)
    return metrics


def proofs_of(data: dict[str, Any]) -> Proofs | None:
    """Of an episode's metrics.json; None of a driver without a verifier."""
    if "unverified" in data["operations"]:
        return None
    collision, (mean, most) = data["collision"], data["decision_cpu"]
    return Proofs(
        at_fault=None if collision is None else bool(collision["at_fault"]),
        standing=collision is not None and collision.get("speed", math.inf) <= STANDS,
        uncovered=len(data["uncovered"]),
        unexplained=len(data["unexplained"]),
        certified_start=data["first_certificate"] == 0,
        operations=data["operations"],
        cpu=mean,
        cpu_max=most,
    )
