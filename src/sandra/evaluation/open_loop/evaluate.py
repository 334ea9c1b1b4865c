"""Many recordings, asked and verified, with nothing dropped; then scored beside baselines."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.evaluation.journal import Journal
from sandra.evaluation.labelling.batch import Choice, Places, fingerprint
from sandra.evaluation.labelling.summary import UNKNOWN
from sandra.evaluation.open_loop.ask import broken, rows_of
from sandra.evaluation.open_loop.baselines import answers, safe_of
from sandra.evaluation.open_loop.records import Recorded
from sandra.evaluation.open_loop.report import Report, report
from sandra.evaluation.open_loop.scores import KS, Case
from sandra.evaluation.open_loop.setups import Conditions, Setup, ablations
from sandra.evaluation.sheet import Sheet
from sandra.evaluation.workers import Broken, Workers, as_done

Row = dict[str, Any]
VERIFIED_FIRST = "verified pairs first, in the order of Tab. II"
"""The ranking of exhaustive enumeration: no model can have a higher Safe@k."""
_TIMES = ("rank_s", "predict_s", "verify_s", "exhaustive_s")


@dataclass(frozen=True, slots=True)
class OpenLoop:
    """Rows by run, and what they score."""

    setups: tuple[Setup, ...]
    rows: Mapping[str, tuple[Row, ...]]
    report: Report

    @property
    def errors(self) -> tuple[Row, ...]:
        """Rows that hold an error instead of an answer."""
        return tuple(row for rows in self.rows.values() for row in rows if row["error"])

    def bars(self) -> dict[str, dict[str, dict[str, tuple[float, float, float]]]]:
        """For figures: by factor that varies, the bars of its runs; "all" where none does."""
        known = self.report.bars()
        varied = ablations(self.setups) or {"all": self.setups}
        return {
            factor: {setup.name: known[setup.name] for setup in setups}
            | {x.run: known[x.run] for x in self.report.baselines[:1]}
            for factor, setups in varied.items()
        }

    def durations(self) -> dict[str, list[float]]:
        """Time of each decision [s]: asking, predicting, verifying; and of all pairs unasked."""
        asked = {
            name: [row["rank_s"] + row["predict_s"] + row["verify_s"] for row in _timed(rows)]
            for name, rows in self.rows.items()
        }
        horizons = sorted({setup.horizon: setup for setup in reversed(self.setups)}.items())
        unasked = {
            f"all twelve pairs, nobody asked, h = {horizon}": [
                row["predict_s"] + row["exhaustive_s"] for row in _timed(self.rows[setup.name])
            ]
            for horizon, setup in horizons
        }
        return asked | unasked

    def nothing_verified(self) -> Sheet:
        """Why in some scenarios no pair is verified, so that no ranking could be safe there."""
        counts = Counter(
            (row["horizon"], _without_numbers(row["nothing_verified"]))
            for setup in {s.horizon: s for s in self.setups}.values()
            for row in self.rows[setup.name]
            if row["nothing_verified"] is not None
        )
        return Sheet(
            "Scenarios without any verified pair, by what is wrong with decelerate, follow-lane.",
            ("horizon", "because", "scenarios"),
            tuple((str(h), why, str(n)) for (h, why), n in counts.most_common()),
        )

    def jsonl(self) -> str:
        """All rows as JSON lines, prompts and answers included."""
        every = (row for rows in self.rows.values() for row in rows)
        return "".join(json.dumps(row, allow_nan=False) + "\n" for row in every)

    def rankings_csv(self) -> str:
        """All rows with the columns that `sandra evaluate rankings` reads."""
        text = io.StringIO()
        places = [f"{part}{n}" for n in KS for part in ("lon", "lat")]
        safe = [f"safe_top{k}" for k in KS]
        head = ["run", "command", "scenario_id", "label_lon", "label_lat", *places, *safe]
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([*head, "failure", *_TIMES])
        for name, rows in self.rows.items():
            for row in rows:
                case = case_of(row)
                cells = [c for pair in case.ranking[: len(KS)] for c in str(pair).split(",")]
                writer.writerow(
                    [
                        name,
                        row["command"] or "none",
                        case.scenario,
                        row["label_lon"],
                        row["label_lat"],
                        *cells,
                        *[""] * (len(places) - len(cells)),
                        *("" if x is None else int(x) for x in case.safe),
                        case.failure or "",
                        *(case.seconds.get(time, "") for time in _TIMES),
                    ]
                )
        return text.getvalue()


def open_loop(
    paths: Sequence[Path],
    setups: Sequence[Setup],
    choice: Choice,
    conditions: Conditions = Conditions(),  # noqa: B008  (frozen)
    *,
    only: Mapping[Path, Places] | None = None,
    journal: Path | None = None,
    workers: Workers = 1,
    progress: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> OpenLoop:
    """Evaluate setups on recordings.

    Args:
        choice: whose decisions, and how they are labelled.
        only: by file, the egos and steps that are taken, instead of `choice`'s.
        journal: of a run that can go on, with more setups too; see `Journal`.
        workers: see `sandra.evaluation.workers`.
        progress: is told (files done, all files, name of the last one).

    Raises:
        SandraError: if the journal cannot be written or holds another run, or a ranker is unknown.
    """
    about = {**asdict(choice), "settings": repr(choice.settings), "asked": conditions.to_dict()}
    book = Journal(journal, about)
    keys = {path: fingerprint(path) + _told(only, path) for path in paths}
    missing = {
        path: tuple(s for s in setups if f"{s.name} | {key}" not in book)
        for path, key in keys.items()
    }
    jobs = [
        (path, todo, None if only is None else only[path]) for path, todo in missing.items() if todo
    ]
    done = len(keys) - len(jobs)
    work = partial(_one, choice=choice, conditions=conditions)
    with closing(as_done(work, jobs, workers, lambda job: job[:1])) as found:
        for (path, todo, _), rows in found:
            if isinstance(rows, Broken):
                rows = broken(path, todo, choice, f"internal error: {rows.error}")
            for setup in todo:
                book.add(f"{setup.name} | {keys[path]}", rows[setup.name])
            done += 1
            progress(done, len(keys), path.stem)
    every = {
        setup.name: tuple(row for key in keys.values() for row in book[f"{setup.name} | {key}"])
        for setup in setups
    }
    return OpenLoop(tuple(setups), every, scored(setups, every))


def _one(
    job: tuple[Path, tuple[Setup, ...], Places | None], choice: Choice, conditions: Conditions
) -> dict[str, list[Row]]:
    path, setups, places = job
    return rows_of(path, setups, choice, conditions, places)


def _told(only: Mapping[Path, Places] | None, path: Path) -> str:
    if only is None:
        return ""
    return f" {hashlib.sha256(repr(only[path]).encode()).hexdigest()[:16]}"


def case_of(row: Row) -> Case:
    """A row as a case: with an error nothing is ranked and nothing is verified."""
    ranking = tuple(ActionPair.parse(pair) for pair in row["ranking"])
    label = None
    if UNKNOWN not in (row["label_lon"], row["label_lat"]):
        label = ActionPair.of(row["label_lon"], row["label_lat"])
    verified = _verdicts(row)
    failure = "error" if row["error"] else row["failure"]
    if failure is None and not ranking:
        failure = "no ranking"
    safe: tuple[bool | None, ...] = (False,) * len(KS)
    if ranking:
        safe = safe_of(ranking, verified)
    seconds = {name: row[name] for name in _TIMES if row.get(name) is not None}
    return Case(_scenario(row), label, ranking, safe, failure, seconds)


def _scenario(row: Row) -> str:
    """The file, and who is the ego from which step on."""
    return f"{row['file']}:{row['ego_id']}:{row['step']}"


def _timed(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if not row["error"]]


def _without_numbers(reason: str) -> str:
    return re.sub(r"\d+(\.\d+)?", "#", reason)


def _verdicts(row: Row) -> dict[ActionPair, bool]:
    return {ActionPair.parse(p): p in row["verified"] for p in row["verdicts"]}


def scored(setups: Sequence[Setup], rows: Mapping[str, Sequence[Row]]) -> Report:
    """Scores of all runs, and of the baselines at each horizon."""
    cases = {name: tuple(map(case_of, found)) for name, found in rows.items()}
    runs = {s.name: Recorded(cases[s.name], 0, s.command) for s in setups}
    trivial: dict[str, tuple[Case, ...]] = {}
    horizons = {setup.horizon: setup for setup in reversed(setups)}
    for horizon, setup in sorted(horizons.items()):
        labels = {case.scenario: case.label for case in cases[setup.name]}
        verdicts = {_scenario(row): _verdicts(row) for row in rows[setup.name]}
        found = answers(labels, verdicts)
        found[VERIFIED_FIRST] = tuple(
            _exhaustive(case, verdicts[case.scenario]) for case in cases[setup.name]
        )
        several = f", h = {horizon}" if len(horizons) > 1 else ""
        trivial |= {f"{name}{several}": told for name, told in found.items()}
    return report(runs, trivial)


def _exhaustive(case: Case, verdicts: Mapping[ActionPair, bool]) -> Case:
    ranking = tuple(pair for pair in ALL_PAIRS if verdicts.get(pair))[: max(KS)]
    safe = (bool(ranking),) * len(KS)
    seconds = {k: v for k, v in case.seconds.items() if k not in ("rank_s", "verify_s")}
    return Case(case.scenario, case.label, ranking, safe, None, seconds)
