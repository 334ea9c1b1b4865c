"""Scores as tables, with trivial baselines below the runs in each of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandra.errors import SandraError
from sandra.evaluation.open_loop.baselines import answers
from sandra.evaluation.open_loop.records import Recorded, labels_of, read_rankings, read_verdicts
from sandra.evaluation.open_loop.scores import KS, Case, Rate, Score, by_action, score
from sandra.evaluation.sheet import Sheet

NOT_KNOWN = "-"


@dataclass(frozen=True, slots=True)
class Report:
    """Scores by run, of the baselines, and by action of the pooled runs and the baselines."""

    runs: tuple[Score, ...]
    baselines: tuple[Score, ...]
    pool: tuple[str, ...]
    """Names of the runs that are taken together for the scores by action."""
    actions: Mapping[str, Score]
    actions_of_runs: Mapping[str, Mapping[str, Score]]
    """By run and by action; so for the baselines."""

    def main(self) -> Sheet:
        """One row for each run, then one for each baseline."""
        return Sheet(
            "Per cent of all scenarios [95 % interval after Wilson]. Safe@k: one of the first k "
            "pairs is verified; Top-k: one of them is the label. An unknown label or verdict and "
            "a failed answer count as misses.",
            (
                "run",
                "n",
                *(f"Safe@{k}" for k in KS),
                *(f"Top-{k}" for k in KS),
                "unknown labels",
                "unknown verdicts",
                "failures",
                "left out",
            ),
            tuple(
                (
                    _name(x),
                    str(x.n),
                    *(_cell(rate) for rate in (*x.safe, *x.top)),
                    str(x.unknown_labels),
                    str(x.unknown_verdicts),
                    ", ".join(f"{n} {name}" for name, n in sorted(x.failures.items())) or "0",
                    str(x.repeated),
                )
                for x in (*self.runs, *self.baselines)
            ),
        )

    def by_action(self) -> Sheet:
        """The paper's table by action type: of the pooled runs, then of each baseline."""
        pooled = f"{len(self.pool)} runs" if len(self.pool) > 1 else (self.pool or ("-",))[0]
        parts = [(pooled, self.actions)]
        parts += [(_name(x), self.actions_of_runs[x.run]) for x in self.baselines]
        return Sheet(
            f"By the action that the label holds, {'; '.join(self.pool)} taken together. "
            "Per cent [95 % interval after Wilson, as if answers about one scenario were "
            "independent].",
            ("of", "action", "n", "Safe@1", "Safe@3", "Top-1", "Top-3"),
            tuple(
                (
                    name,
                    action,
                    str(x.n),
                    *(_cell(rate, 1) for rate in (x.safe[0], x.safe[2], x.top[0], x.top[2])),
                )
                for name, found in parts
                for action, x in found.items()
            ),
        )

    def runtimes(self) -> Sheet:
        """How long what took; empty where nothing was timed."""
        return Sheet(
            "Durations in seconds.",
            ("run", "of", "n", "mean", "standard deviation", "median", "most"),
            tuple(
                (
                    _name(x),
                    name.removesuffix("_s"),
                    str(t.n),
                    *(f"{v:.4g}" for v in (t.mean, t.deviation, t.median, t.most)),
                )
                for x in (*self.runs, *self.baselines)
                for name, t in x.seconds.items()
            ),
        )

    def sheets(self) -> dict[str, Sheet]:
        """By the name of their files; those without a row are left out."""
        found = {"scores": self.main(), "actions": self.by_action(), "runtimes": self.runtimes()}
        return {name: sheet for name, sheet in found.items() if sheet.rows}

    def bars(self) -> dict[str, dict[str, tuple[float, float, float]]]:
        """For the figure: by run and metric (per cent, low, high)."""
        found: dict[str, dict[str, tuple[float, float, float]]] = {}
        for x in (*self.runs, *self.baselines):
            rates = {f"Safe@{k}": x.safe[k - 1] for k in (1, 3)}
            rates |= {f"Top-{k}": x.top[k - 1] for k in KS}
            found[x.run] = {
                name: (rate.percent, *rate.interval) for name, rate in rates.items() if rate
            }
        return found

    def to_dict(self) -> dict[str, Any]:
        """The JSON contract of `sandra evaluate rankings --json`: one object for each run."""

        def told(x: Score) -> dict[str, Any]:
            actions = self.actions_of_runs[x.run]
            return x.to_dict() | {"actions": [_action(a, s) for a, s in actions.items()]}

        return {
            "runs": [told(x) for x in self.runs],
            "baselines": [told(x) for x in self.baselines],
            "pool": list(self.pool),
            "actions": [_action(name, x) for name, x in self.actions.items()],
        }


def report(
    runs: Mapping[str, Recorded],
    trivial: Mapping[str, tuple[Case, ...]],
    pool: Sequence[str] = (),
) -> Report:
    """Score recorded runs, and baselines.

    Args:
        trivial: by the name of a baseline, its cases; see `baselines.answers`.
        pool: runs that are taken together by action; by default all that had no command.

    Raises:
        SandraError: if a run of the pool is unknown.
    """
    for name in pool:
        if name not in runs:
            raise SandraError(f"unknown run '{name}': choose from {', '.join(runs)}")
    together = tuple(pool) or tuple(name for name, run in runs.items() if run.command is None)
    cases = {name: run.cases for name, run in runs.items()} | dict(trivial)
    return Report(
        tuple(score(name, run.cases, repeated=run.repeated) for name, run in runs.items()),
        tuple(score(name, found, baseline=True) for name, found in trivial.items()),
        together,
        by_action(case for name in together for case in runs[name].cases),
        {name: by_action(found) for name, found in cases.items()},
    )


def report_of_file(path: Path, verdicts: Path | None = None, pool: Sequence[str] = ()) -> Report:
    """Score a CSV file of recorded rankings; see `records` for its columns.

    Raises:
        SandraError: names file, line and column of what cannot be used.
    """
    known = None if verdicts is None else read_verdicts(verdicts)
    runs = read_rankings(path, known)
    return report(runs, answers(labels_of(path, runs), known or {}), pool)


def _action(name: str, x: Score) -> dict[str, Any]:
    told = x.to_dict()
    return {"action": name} | {
        key: value for key, value in told.items() if key == "n" or key[:3] in ("saf", "top")
    }


def _name(x: Score) -> str:
    return f"baseline: {x.run}" if x.baseline else x.run


def _cell(rate: Rate | None, digits: int = 2) -> str:
    if rate is None:
        return NOT_KNOWN
    low, high = rate.interval
    return f"{rate.percent:.{digits}f} [{low:.1f}, {high:.1f}]"
