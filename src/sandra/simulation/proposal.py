"""What a policy's meta-action means in pairs, and how it is put before everything else.

The meaning is that of the environment's own ego: it goes on with a change of lane until it is told
otherwise, and knows no lane and no speed beyond the last.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.decider import Operation
from sandra.describe.types import Prompt
from sandra.errors import SettingsError
from sandra.rankers import Failure, Ranker, Ranking
from sandra.reach import Status

Table = Mapping[str, Sequence[ActionPair]]

_FOLLOW, _LEFT, _RIGHT = Lateral.FOLLOW_LANE, Lateral.LEFT_LANE, Lateral.RIGHT_LANE
CHANGING = (Longitudinal.KEEP, Longitudinal.ACCELERATE, Longitudinal.DECELERATE)
"""In which order a change of lane may be driven."""
TABLE: Table = {
    "IDLE": (ActionPair(Longitudinal.KEEP, _FOLLOW),),
    "FASTER": (ActionPair(Longitudinal.ACCELERATE, _FOLLOW),),
    "SLOWER": (ActionPair(Longitudinal.DECELERATE, _FOLLOW),),
    "LANE_LEFT": tuple(ActionPair(lon, _LEFT) for lon in CHANGING),
    "LANE_RIGHT": tuple(ActionPair(lon, _RIGHT) for lon in CHANGING),
}
"""What a meta-action may be executed as and still count as the policy's own; best first. Where a
change of lane is under way, `follow-lane` is going on with it (if need be at another speed), or
else giving it up."""


def table_with(changes: Table) -> dict[str, tuple[ActionPair, ...]]:
    """`TABLE` with some rows replaced; an empty row is never the policy's own.

    Raises:
        SettingsError: for an unknown meta-action, or a row with changes of lane to both sides or
            with one after `follow-lane`.
    """
    for name, pairs in changes.items():
        if name not in TABLE or not all(isinstance(pair, ActionPair) for pair in pairs):
            raise SettingsError(
                f"table: {name}: name one of {', '.join(TABLE)}, and give it ActionPairs"
            )
        if pairs and any(p.lateral not in (pairs[0].lateral, _FOLLOW) for p in pairs):
            raise SettingsError(
                f"table: {name}: the first pair says to which side all others may go"
            )
    return {name: tuple(pairs) for name, pairs in {**TABLE, **changes}.items()}


def meaning(
    row: Sequence[ActionPair], side: Lateral, speed: float, change: float, v_max: float
) -> tuple[ActionPair, ...]:
    """A row of the table in the words of where the ego is now.

    Args:
        side: where the lane is that the policy wants, or is heading for.
        speed: of the ego [m/s]. change: by which accelerating or decelerating must change it at
            least [m/s]: at `v_max`, accelerating means keeping it, and at a standstill
            decelerating means standing.
    """

    def possible(pair: ActionPair) -> ActionPair:
        if pair.longitudinal is Longitudinal.ACCELERATE and speed + change >= v_max:
            return ActionPair(Longitudinal.KEEP, pair.lateral)
        if pair.longitudinal is Longitudinal.DECELERATE and speed <= change:
            return ActionPair(Longitudinal.STOP, pair.lateral)
        return pair

    now = [possible(pair) for pair in row]
    if row and row[0].lateral is _FOLLOW:
        found = [ActionPair(pair.longitudinal, side) for pair in now]
        if side is not _FOLLOW:
            found += [possible(ActionPair(lon, side)) for lon in CHANGING] + now
    else:
        found = [
            ActionPair(pair.longitudinal, pair.lateral if pair.lateral is _FOLLOW else side)
            for pair in now
        ]
    return tuple(dict.fromkeys(found))


@dataclass(frozen=True, slots=True)
class Shielded:
    """One decision: what the policy asked for and what was executed.

    `meant`: the pairs that count as its action, best first. `executed`: None for a fail-safe.
    `verdict`: of the first of `meant`, None where it was not feasible. `why`: its reason.
    """

    meant: tuple[ActionPair, ...]
    executed: ActionPair | None
    operation: Operation
    verdict: Status | None
    why: str

    @property
    def replaced(self) -> bool:
        """Whether something else than the action was executed."""
        return self.executed not in self.meant


class Asked:
    """A ranker: what the policy means first, then what somebody else prefers (None: nobody)."""

    name = "shield"

    def __init__(self, rest: Ranker | None) -> None:
        self.rest = rest
        self.meant: tuple[ActionPair, ...] = ()

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`."""
        pairs = [pair for pair in self.meant if pair in prompt.feasible]
        if self.rest is not None:
            others = self.rest.rank(prompt, deadline).pairs
            pairs += [pair for pair in others if pair not in pairs]
        if pairs:
            return Ranking(tuple(pairs), self.name)
        return Ranking((), self.name, Failure.INFEASIBLE, "the action is not feasible here")
