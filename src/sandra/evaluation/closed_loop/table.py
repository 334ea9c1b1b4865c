"""Rows of the closed-loop table: drivers by settings, played and summarised."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from sandra.errors import SandraError
from sandra.evaluation.closed_loop.metrics import (
    OURS,
    PAPER,
    Convention,
    Summary,
    measure,
    summarise,
)
from sandra.evaluation.workers import Broken, in_order
from sandra.simulation.highway import highway
from sandra.simulation.policies import Run, play, policy

Case = tuple[str, int, str, int, int, int]
"""Driver, setting, profile, seed, repeat, number of steps."""


@dataclass(frozen=True, slots=True)
class Row:
    """What a driver achieved in one setting."""

    driver: str
    setting: int
    summary: Summary


@dataclass(frozen=True, slots=True)
class Table:
    """Rows by driver, then by setting."""

    profile: str
    convention: Convention
    rows: tuple[Row, ...]

    def markdown(self) -> str:
        """As a Markdown table."""
        lines = [
            "| driver | setting | episodes (seeds) | success % [95 %] | collision-free steps "
            "| distance, successful (m) | distance, all (m) | fail-safe % "
            "| speed over traffic (m/s) | lane changes |",
            "|---|---|---|---|---|---|---|---|---|---|",
        ]
        for row in self.rows:
            s = row.summary
            low, high = s.success_interval
            cells = (
                row.driver,
                str(row.setting),
                f"{s.episodes} ({s.seeds})",
                f"{100 * s.success_rate:.0f} [{100 * low:.0f}, {100 * high:.0f}]",
                _number(s.collision_free_steps),
                _number(s.distance),
                _number(s.distance_all),
                _number(100 * s.fail_safe_rate),
                f"{s.relative_speed:+.1f}",
                _number(s.lane_changes),
            )
            lines.append(f"| {' | '.join(cells)} |")
        return "\n".join(lines) + "\n"

    def to_dict(self) -> dict[str, Any]:
        """For machines; a row's keys are the fields of `Summary`."""
        return {
            "profile": self.profile,
            "convention": asdict(self.convention),
            "rows": [
                {"driver": r.driver, "setting": r.setting, **asdict(r.summary)} for r in self.rows
            ],
        }


def tabulate(
    drivers: Sequence[str],
    settings: Sequence[int],
    seeds: Sequence[int],
    *,
    profile: str = "stock",
    convention: Convention = OURS,
    repeats: int = 1,
    workers: int = 1,
    progress: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> Table:
    """Play all episodes, and summarise them.

    Args:
        drivers: names of `sandra.simulation.policies.POLICIES`.
        settings: of the paper. seeds: of the traffic. repeats: of what is random.
        workers: processes. progress: called after each episode.

    Raises:
        SandraError: for what is unknown, or if an episode broke off with an error.
    """
    steps = convention.steps + (convention is PAPER)
    cases: list[Case] = [
        (driver, setting, profile, seed, repeat, steps)
        for driver in drivers
        for setting in settings
        for seed in seeds
        for repeat in range(repeats if driver == "random" else 1)
    ]
    runs: dict[tuple[str, int], list[Run]] = {}
    for i, (case, run) in enumerate(zip(cases, in_order(episode, cases, workers), strict=True)):
        driver, setting, _, seed, *_ = case
        if isinstance(run, Broken):
            raise SandraError(f"{driver}, setting {setting}, seed {seed}: {run.error}")
        runs.setdefault((driver, setting), []).append(run)
        progress(i + 1, len(cases), f"{driver}, setting {setting}, seed {seed}")
    return Table(
        profile,
        convention,
        tuple(
            Row(
                played[0].driver,
                setting,
                summarise([(run.seed, measure(run, convention=convention)) for run in played]),
            )
            for (_, setting), played in runs.items()
        ),
    )


def episode(case: Case) -> Run:
    """One episode of the table."""
    driver, setting, profile, seed, repeat, steps = case
    world = highway(setting, profile)
    return play(world, seed, policy(driver, repeat), steps=steps, setting=setting)


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"
