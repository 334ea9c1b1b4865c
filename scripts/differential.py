"""Verdicts and certificates against an exhaustive grid search, on many random scenes.

    python scripts/differential.py --scenes 500 --seed 1 --workers 1

Prints the tables, and writes them to docs/differential.md with the command beside them; after an
interrupt (Ctrl-C), those of the scenes that were done. Exit status 1 if an UNSAFE verdict is
refuted, or a scene could not be compared.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from grid_compare import Outcome, Reached, timed  # noqa: E402
from grid_world import Body  # noqa: E402
from sandra.evaluation.workers import Broken, in_order  # noqa: E402
from sandra.reach import Status  # noqa: E402

SEEDS_APART = 100_000
"""Between the first scenes of two values of --seed."""

TEXT = """# Against an exhaustive search

An UNSAFE verdict says that no trajectory exists; REACHABLE says less than that one does. How much
less, and whether the first is true, is measured here against a search that shares no code with the
reachable set ([grid_search.py](../tests/grid_search.py)): every sequence of accelerations of a grid
is looked at, on small random scenes of one to three straight lanes with up to three others (cars,
trucks, parked cars, pedestrians, one of the lanes oncoming in every fourth), 6 to 10 steps of 0.2
to 0.4 s, half of them with R_G1, R_G2 and R_G3, half with the set-based prediction. What it finds
is checked once more by [other code](../tests/grid_check.py): motion, bounds, the full rectangle and
all it sweeps in the plane, and the formula by direct evaluation.

```bash
# not run: minutes
{command}
```

{scenes} scenes, {pairs} pairs, {cpu:.0f} s of process time. This page is written by that command;
`tests/test_differential.py` runs 60 more scenes with every `make test`.

## Every UNSAFE verdict is confirmed: {confirmed} of {unsafe}

For an UNSAFE pair the search gives itself more freedom than any car has: the body is only the disc
that is inscribed in it, it is asked to be free of collisions at the steps only, and the rectangle
slips as far as it may where that helps to touch a lane. It found {refuted_words}.
Of these pairs {trivial} ask for a lane that the road does not have, or are UNSAFE at step 0 already
(the state or a rule excludes the action at once); the other {hard} are what the search is for.

{verdicts}

## What is REACHABLE and has no certificate: {without} of {not_unsafe}

{reached}

* The first two rows are over-approximation, or a trajectory between the points of the grid: the
  forbidden cells are those of the inscribed disc, whatever the heading.
* The third is what the verdict does not look at: what happens between two steps.
* In the next two the point mass of the model has a trajectory, and the planner has none: either
  because a single-track model with its steering rate cannot drive any (the first of the two says
  that a quicker steering would do), or because its samples miss it.
* In the last row the witness is there, and nothing continues it to a standstill.

How good is the grid? Of {certified} certified pairs, each of which has a trajectory for certain, it
finds one for {seen} ({seen_share:.1f} %).
"""


def main() -> int:
    """Compare, print, write."""
    arguments = _parser().parse_args()
    first = arguments.seed * SEEDS_APART
    seeds = range(first, first + arguments.scenes)
    outcomes: list[Outcome] = []
    cpu, done, broken = 0.0, 0, 0
    try:
        with closing(in_order(timed, seeds, arguments.workers)) as answers:
            for seed, found in zip(seeds, answers, strict=True):
                if isinstance(found, Broken):
                    broken += 1
                    print(f"\nseed {seed}: {found.error}", file=sys.stderr)
                    continue
                answer, seconds = found
                outcomes += answer
                cpu, done = cpu + seconds, done + 1
                for outcome in _refuted(answer):
                    print(f"\nREFUTED: {outcome}", file=sys.stderr)
                print(f"\r{done} of {len(seeds)} scenes", end="", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print(f"\ninterrupted: the tables are those of {done} scenes", end="", file=sys.stderr)
    print(file=sys.stderr)
    command = (
        f"python scripts/differential.py --scenes {done} --seed {arguments.seed} "
        f"--workers {arguments.workers}"
    )
    page = _page(outcomes, command, done, cpu)
    print(page)
    if arguments.out:
        Path(arguments.out).write_text(page, encoding="utf-8")
    return 1 if broken or _refuted(outcomes) else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--scenes", type=int, default=500, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    parser.add_argument(
        "--workers", type=int, default=1, metavar="N", help="processes; 0: all cores"
    )
    parser.add_argument("--out", default=str(ROOT / "docs" / "differential.md"), metavar="FILE")
    return parser


def _refuted(outcomes: Iterable[Outcome]) -> list[Outcome]:
    return [x for x in outcomes if x.status is Status.UNSAFE and x.grid is not None]


def _page(outcomes: list[Outcome], command: str, scenes: int, cpu: float) -> str:
    unsafe = [x for x in outcomes if x.status is Status.UNSAFE]
    rest = [x for x in outcomes if x.status is not Status.UNSAFE]
    certified = [x for x in rest if x.status is Status.CERTIFIED]
    trivial = sum(x.trivial for x in unsafe)
    refuted = len(_refuted(outcomes))
    seen = sum(x.grid is Body.FULL for x in certified)
    return TEXT.format(
        command=command,
        scenes=scenes,
        pairs=len(outcomes),
        cpu=cpu,
        unsafe=len(unsafe),
        confirmed=len(unsafe) - refuted,
        refuted_words="nothing" if refuted == 0 else f"something in {refuted} cases",
        trivial=trivial,
        hard=len(unsafe) - trivial,
        verdicts=_verdicts(outcomes),
        without=len(rest) - len(certified),
        not_unsafe=len(rest),
        reached=_reached([x for x in rest if x.status is not Status.CERTIFIED]),
        certified=len(certified),
        seen=seen,
        seen_share=100 * seen / max(1, len(certified)),
    )


def _groups(outcomes: list[Outcome]) -> list[tuple[str, str]]:
    return sorted({_group(x) for x in outcomes})


def _group(outcome: Outcome) -> tuple[str, str]:
    return outcome.prediction, "with rules" if outcome.rules else "no rules"


def _verdicts(outcomes: list[Outcome]) -> str:
    lines = [
        "| prediction | rules | UNSAFE | refuted | REACHABLE | CERTIFIED |",
        "|---|---|---|---|---|---|",
    ]
    for group in _groups(outcomes):
        part = [x for x in outcomes if _group(x) == group]
        count = Counter(x.status for x in part)
        lines.append(
            f"| {group[0]} | {group[1]} | {count[Status.UNSAFE]} | {len(_refuted(part))} "
            f"| {count[Status.REACHABLE]} | {count[Status.CERTIFIED]} |"
        )
    return "\n".join(lines)


def _reached(without: list[Outcome]) -> str:
    groups = _groups(without)
    lines = [
        "| there is | pairs | share | " + " | ".join(", ".join(group) for group in groups) + " |",
        "|---" * (3 + len(groups)) + "|",
    ]
    for kind in Reached:
        if kind is Reached.CERTIFIED:
            continue
        part = [x for x in without if x.reached is kind]
        counts = Counter(_group(x) for x in part)
        share = 100 * len(part) / max(1, len(without))
        columns = " | ".join(str(counts[group]) for group in groups)
        lines.append(f"| {kind.value} | {len(part)} | {share:.0f} % | {columns} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
