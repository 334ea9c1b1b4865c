"""One line of the closed-loop table, as text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from sandra.evaluation.closed_loop.metrics import Summary
from sandra.evaluation.closed_loop.paper import Printed, printed
from sandra.evaluation.closed_loop.rows import Row
from sandra.rankers import Usage

RULES = ("R_G1", "R_G2", "R_G3")


@dataclass(frozen=True, slots=True)
class Entry:
    """What a row achieved in one setting. `summary` is None where no episode is there."""

    row: Row
    setting: int
    summary: Summary | None
    folders: tuple[Path, ...] = ()
    """Those of its episodes."""
    pairs: Mapping[str, int] = field(default_factory=dict)
    """How often each pair, or meta-action, was driven."""
    broken: tuple[str, ...] = ()
    """Episodes that broke off with an error."""
    usage: Usage | None = None
    """What was asked of a server; None if none was."""

    @property
    def ranker(self) -> str:
        """Who ranked in its episodes."""
        return self.row.drives[0].ranker


def main_cells(entry: Entry) -> tuple[str, ...]:
    """Of `Table.main`."""
    s, theirs = entry.summary, _paper(entry)
    told = "-" if theirs is None else _short(theirs)
    if s is None:
        return (entry.row.title, str(entry.setting), *("-",) * 8, told)
    low, high = s.success_interval
    return (
        entry.row.title,
        str(entry.setting),
        f"{100 * s.success_rate:.0f} [{100 * low:.0f}, {100 * high:.0f}]",
        _number(s.collision_free_steps),
        *(_number(s.compliant_steps[rule]) for rule in RULES),
        _number(s.success_steps),
        _number(s.distance),
        _number(100 * s.fail_safe_rate),
        told,
    )


def beside_cells(entry: Entry, oracle: float | None) -> tuple[str, ...]:
    """Of `Table.beside`; `oracle`: its distance in this setting [m]."""
    s = entry.summary
    if s is None:
        return (entry.row.title, str(entry.setting), *("-",) * 10)
    share = "-" if not oracle or math.isnan(s.distance) else f"{100 * s.distance / oracle:.0f}"
    names = ("certified", "carried", "renewed", "emergency")
    proven = s.at_fault is not None
    failed = s.episodes - s.successes
    verified = s.operations.get("verified")
    by = " / ".join(f"{100 * s.operations.get(name, 0.0):.0f}" for name in names)
    return (
        entry.row.title,
        str(entry.setting),
        f"{s.episodes} ({s.seeds})",
        _number(s.distance_all),
        share,
        f"{s.relative_speed:+.1f}",
        _number(s.lane_changes),
        (by if verified is None else f"verified {100 * verified:.0f}") if proven else "-",
        f"{s.certified_starts} of {s.episodes}" if proven and verified is None else "-",
        f"{s.at_fault} / {s.not_at_fault} ({s.standing})" if proven else f"{failed} (unverified)",
        f"{s.uncovered} ({s.unexplained})" if proven and verified is None else "-",
        f"{s.cpu:.2f} ({s.cpu_max:.2f})" if proven else "-",
    )


def printed_cells(x: Printed) -> tuple[str, ...]:
    """Of `Table.main`, for a row of the paper."""
    return (
        f"paper: {x.method}",
        str(x.setting),
        _number(x.success_rate),
        _number(x.collision_free_steps),
        _number(x.r_g1),
        _number(x.r_g2),
        _number(x.r_g3),
        _number(x.success_steps),
        _number(x.distance),
        "-" if x.fail_safe_rate is None else _number(x.fail_safe_rate),
        "",
    )


def _short(x: Printed) -> str:
    rate = "-" if x.fail_safe_rate is None else f"{x.fail_safe_rate:.1f}"
    return f"{x.success_rate:.0f} / {x.success_steps:.1f} / {x.distance:.1f} / {rate}"


def _paper(entry: Entry) -> Printed | None:
    return None if entry.row.paper is None else printed(entry.row.paper, entry.setting)


def paper_dict(entry: Entry) -> dict[str, Any] | None:
    """The paper's numbers beside an entry."""
    found = _paper(entry)
    return None if found is None else asdict(found)


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"
