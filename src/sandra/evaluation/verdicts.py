"""How much is lost: the twelve pairs by verdict, and why what is REACHABLE has no certificate.

One row per scenario, prediction and set of rules. A scenario that cannot be read, or to which a
rule does not apply, is a row with its error: nothing is dropped.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from sandra.actions import ALL_PAIRS
from sandra.certify import Basis, certify
from sandra.errors import SandraError
from sandra.evaluation.reasons import PREFIX, kind_of
from sandra.evaluation.workers import Broken, Workers, in_order
from sandra.prediction import predict
from sandra.reach import Status, ground, verify_on
from sandra.scene import load
from sandra.settings import Settings

Rules = tuple[str, ...]

PREDICTIONS = ("most-likely", "set-based")
RULE_SETS: tuple[Rules, ...] = ((), ("R_G1", "R_G2", "R_G3"))


@dataclass(frozen=True, slots=True)
class Row:
    """All twelve pairs of one scenario under one prediction and one set of rules.

    `without` are the REACHABLE pairs, each with the reason why it has no certificate. `fail_safe`
    says whether one was found from the present state, without any maneuver before it: where there
    is none, a pair is seldom certified. With an `error` nothing was counted. `cpu_s` is the
    process time of verdicts and certificates, without loading and predicting [s].
    """

    scenario: str
    prediction: str
    rules: Rules
    unsafe: int = 0
    certified: int = 0
    without: tuple[tuple[str, str], ...] = ()
    fail_safe: bool | None = None
    cpu_s: float = 0.0
    error: str | None = None

    @property
    def reachable(self) -> int:
        """Number of pairs that are REACHABLE and have no certificate."""
        return len(self.without)

    def to_dict(self) -> dict[str, Any]:
        """The entry of the JSON contract."""
        return {
            "scenario": self.scenario,
            "prediction": self.prediction,
            "rules": list(self.rules),
            "unsafe": self.unsafe,
            "reachable": self.reachable,
            "certified": self.certified,
            "without_certificate": [
                {"pair": pair, "kind": kind_of(reason), "reason": reason}
                for pair, reason in self.without
            ],
            "fail_safe_now": self.fail_safe,
            "cpu_s": self.cpu_s,
            "error": self.error,
        }


@dataclass(frozen=True, slots=True)
class Table:
    """Rows in the order in which they were asked for: by scenario, prediction, rules."""

    rows: tuple[Row, ...]

    @property
    def failed(self) -> tuple[Row, ...]:
        """The rows that hold an error instead of counts."""
        return tuple(row for row in self.rows if row.error is not None)

    def totals(self) -> list[tuple[str, Rules, int, int, int]]:
        """(prediction, rules, UNSAFE, REACHABLE, CERTIFIED) summed over the scenarios."""
        keys = dict.fromkeys((row.prediction, row.rules) for row in self.rows)
        found = []
        for prediction, rules in keys:
            rows = [r for r in self.rows if (r.prediction, r.rules) == (prediction, rules)]
            counts = [(r.unsafe, r.reachable, r.certified) for r in rows]
            unsafe, reachable, certified = (sum(column) for column in zip(*counts, strict=True))
            found.append((prediction, rules, unsafe, reachable, certified))
        return found

    def kinds(self) -> list[tuple[str, int, str]]:
        """(kind of reason, number of pairs, an example) of all without certificate, most first."""
        reasons = [
            (kind_of(reason), f"{row.scenario}, {pair}: {reason.removeprefix(PREFIX)}")
            for row in self.rows
            for pair, reason in row.without
        ]
        examples = dict(reversed(reasons))
        counts = Counter(kind for kind, _ in reasons)
        return [(kind, n, examples[kind]) for kind, n in counts.most_common()]

    def to_dict(self) -> dict[str, Any]:
        """The JSON contract of `sandra evaluate verdicts --json`."""
        return {
            "rows": [row.to_dict() for row in self.rows],
            "totals": [
                {
                    "prediction": prediction,
                    "rules": list(rules),
                    "unsafe": unsafe,
                    "reachable": reachable,
                    "certified": certified,
                }
                for prediction, rules, unsafe, reachable, certified in self.totals()
            ],
            "kinds": [
                {"kind": kind, "pairs": n, "example": example} for kind, n, example in self.kinds()
            ],
        }

    def markdown(self) -> str:
        """Three tables: rows, totals, and reasons by kind."""
        return "\n".join([*_rows(self), "", *_totals(self), "", *_reasons(self)]) + "\n"

    def __str__(self) -> str:
        return self.markdown()


def tabulate(
    paths: Sequence[Path],
    predictions: Sequence[str] = PREDICTIONS,
    rule_sets: Sequence[Rules] = RULE_SETS,
    *,
    settings: Settings | None = None,
    workers: Workers = 1,
    progress: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> Table:
    """Verify all twelve pairs of each scenario, and look for a certificate of each REACHABLE one.

    Args:
        paths: CommonRoad files. predictions: kinds, see `sandra.predict`.
        rule_sets: sets of rules; () is none.
        workers: see `sandra.evaluation.workers`. The rows are the same.
        progress: is told (units done, all units, name of the one that is done).
    """
    units = [(path, prediction) for path in paths for prediction in predictions]
    work = partial(_unit, rule_sets=tuple(rule_sets), settings=settings or Settings())
    rows: list[Row] = []
    with closing(in_order(work, units, workers, lambda unit: unit[:1])) as answers:
        for done, ((path, prediction), found) in enumerate(zip(units, answers, strict=True), 1):
            if isinstance(found, Broken):
                error = f"internal error: {found.error}"
                found = [Row(path.stem, prediction, rules, error=error) for rules in rule_sets]
            rows.extend(found)
            progress(done, len(units), f"{path.stem}, {prediction}")
    return Table(tuple(rows))


def _unit(unit: tuple[Path, str], rule_sets: Sequence[Rules], settings: Settings) -> list[Row]:
    return rows_of(*unit, rule_sets, settings)


def rows_of(
    path: Path, prediction: str, rule_sets: Sequence[Rules], settings: Settings
) -> list[Row]:
    """The rows of one scenario under one prediction: they share the ground."""
    try:
        scene = load(path, settings=settings)
        predicted = predict(scene, prediction, settings.horizon, settings)
        base = ground(scene, predicted, settings)
        basis = Basis.of(base)
        fail_safe = basis.fail_safe_now() is not None
    except SandraError as error:
        return [Row(path.stem, prediction, rules, error=str(error)) for rules in rule_sets]
    return [
        replace(_row(path.stem, prediction, basis, rules), fail_safe=fail_safe)
        for rules in rule_sets
    ]


def _row(name: str, prediction: str, basis: Basis, rules: Rules) -> Row:
    begin = time.process_time()
    try:
        found = [
            certify(basis, verdict, rules)
            for verdict in verify_on(basis.ground, ALL_PAIRS, rules, reasons=False)
        ]
    except SandraError as error:
        return Row(name, prediction, rules, error=str(error))
    statuses = Counter(verdict.status for verdict in found)
    without = [
        (str(v.pair), v.reason or "no reason was given")
        for v in found
        if v.status is Status.REACHABLE
    ]
    return Row(
        name,
        prediction,
        rules,
        statuses[Status.UNSAFE],
        statuses[Status.CERTIFIED],
        tuple(without),
        cpu_s=time.process_time() - begin,
    )


def _named(rules: Rules) -> str:
    return ", ".join(rules) or "none"


def _rows(table: Table) -> list[str]:
    lines = [
        "| scenario | prediction | rules | UNSAFE | REACHABLE | CERTIFIED | fail-safe now "
        "| CPU s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in table.rows:
        head = f"| {_cell(row.scenario)} | {row.prediction} | {_named(row.rules)}"
        if row.error is not None:
            lines.append(f"{head} | error: {_cell(row.error)} | | | | |")
        else:
            now = "yes" if row.fail_safe else "no"
            counts = f"{row.unsafe} | {row.reachable} | {row.certified} | {now} | {row.cpu_s:.1f}"
            lines.append(f"{head} | {counts} |")
    return lines


def _totals(table: Table) -> list[str]:
    lines = [
        "| prediction | rules | pairs | UNSAFE | REACHABLE | CERTIFIED | certified of not UNSAFE |",
        "|---|---|---|---|---|---|---|",
    ]
    for prediction, rules, unsafe, reachable, certified in table.totals():
        rest = reachable + certified
        share = f"{100 * certified / rest:.0f} %" if rest else "-"
        lines.append(
            f"| {prediction} | {_named(rules)} | {unsafe + rest} | {unsafe} | {reachable} "
            f"| {certified} | {share} |"
        )
    return lines


def _reasons(table: Table) -> list[str]:
    lines = [
        "| REACHABLE without certificate because | pairs | for example |",
        "|---|---|---|",
    ]
    lines += [f"| {_cell(k)} | {n} | {_cell(example)} |" for k, n, example in table.kinds()]
    return lines if len(lines) > 2 else ["Every pair that is not UNSAFE has a certificate."]


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
