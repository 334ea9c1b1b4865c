"""The rows of the closed-loop table: who drives, and with what guarantee."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

from sandra.errors import RankerError, SandraError
from sandra.evaluation.closed_loop.drive import Drive
from sandra.rankers import create
from sandra.settings import Assumptions

UNVERIFIED = {
    "idle": "always IDLE",
    "slower": "always SLOWER",
    "faster": "always FASTER",
    "fail-safe": "always fail-safe",
    "random": "random",
    "idm": "IDM/MOBIL",
    "oracle": "look-ahead oracle",
}
"""Drivers without a verifier, and what they are called in tables."""
RANKERS = (
    "rules",
    "exhaustive",
    "random:0",
    "adversarial",
    "always:accelerate,follow-lane",
    "garbage",
)
"""Rankers that need no cloud; those that this version knows are rows."""
PREDICTIONS = ("most-likely", "set-based")
RULES: dict[str, tuple[str, ...]] = {"no-rules": (), "rules": ("R_G1", "R_G2", "R_G3")}
WORST_CUT_IN = "any-cut-in"
"""The paper's bounds, and others may cut in however close."""


@dataclass(frozen=True, slots=True)
class Row:
    """One row: the same way of driving in each setting of the paper.

    `name` is what `--rows` selects by, `paper` the method of the paper that it stands beside.
    """

    name: str
    title: str
    drives: tuple[Drive, ...]
    """Several where a random driver is repeated; their `setting` is filled in later."""
    paper: str | None = None

    def in_setting(self, setting: int) -> tuple[Drive, ...]:
        """What is driven for it in a setting."""
        return tuple(replace(how, setting=setting) for how in self.drives)


def all_rows(
    base: Drive = Drive(),  # noqa: B008  (frozen)
    *,
    rankers: Sequence[str] = (),
    drivers: Sequence[str] = (),
    conformant: tuple[str, Assumptions] | None = None,
    repeats: int = 3,
) -> tuple[Row, ...]:
    """Every row that can be driven here.

    Args:
        base: profile, settings, server and so on of all of them.
        rankers: more rankers, such as openai:MODEL.
        drivers: more drivers without a verifier, such as dilu:MODEL.
        conformant: name and bounds of a set that was found by `sandra conformance`.
        repeats: of the random driver.
    """
    found = [
        Row(
            name,
            title,
            tuple(
                replace(base, driver=name, repeat=repeat)
                for repeat in range(repeats if name == "random" else 1)
            ),
            "DiLu" if name.startswith("dilu:") else None,
        )
        for name, title in {**UNVERIFIED, **{x: x.partition("@")[0] for x in drivers}}.items()
    ]
    paper = Assumptions()
    bounds = {"paper": ("paper", paper)}
    if conformant is not None:
        bounds["conformant"] = conformant
    bounds[WORST_CUT_IN] = (WORST_CUT_IN, replace(paper, legal_cut_in=False))
    for ranker in dict.fromkeys([*filter(_known, RANKERS), *rankers]):
        for prediction in PREDICTIONS:
            for rules in RULES:
                how = replace(base, ranker=ranker, prediction=prediction, rules=RULES[rules])
                words = f"{prediction}, {rules.replace('-', ' ')}"
                found.append(
                    Row(
                        f"meta:{ranker}/{prediction}/{rules}/paper",
                        f"meta-actions, {ranker}, {words}",
                        (_under(replace(how, execution="meta"), *bounds["paper"]),),
                        words,
                    )
                )
                found += [
                    Row(
                        f"{ranker}/{prediction}/{rules}/{assumed}",
                        f"{ranker}, {words}, {assumed}",
                        (_under(how, *named),),
                        words,
                    )
                    for assumed, named in bounds.items()
                ]
    return tuple(found)


def _under(how: Drive, name: str, assumptions: Assumptions) -> Drive:
    settings = how.settings.replace(assumptions=assumptions)
    return replace(how, assumptions=name, settings=settings)


def selected(rows: Sequence[Row], patterns: str) -> tuple[Row, ...]:
    """The rows whose names fit one of several patterns (as of file names, spaces between).

    Raises:
        SandraError: for a pattern that none fits.
    """
    wanted = patterns.split()
    for pattern in wanted:
        if not any(fnmatchcase(row.name, pattern) for row in rows):
            known = ", ".join(dict.fromkeys(row.name.partition("/")[0] for row in rows))
            raise SandraError(
                f"--rows {pattern}: no row has such a name; drivers are {known}, and names are "
                "DRIVER, or RANKER/PREDICTION/RULES/ASSUMPTIONS, as in rules/*/no-rules/paper"
            )
    return tuple(row for row in rows if any(fnmatchcase(row.name, p) for p in wanted))


def _known(ranker: str) -> bool:
    try:
        create(ranker)
    except RankerError:
        return False
    return True
