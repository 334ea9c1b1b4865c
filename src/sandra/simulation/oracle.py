"""The look-ahead oracle: how far could a driver come that knows the future?

It tries meta-actions in copies of the environment, in which the others react as they will. What it
finds is a driven, collision-free episode: a lower bound of what is possible, and the reference for
distance in the closed-loop tables. It is no driver: nobody can know what it knows.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

from sandra.simulation.highway import ACTIONS, Environment

BRAKING = 6.0
"""Deceleration that decides whether a branch is lost [m/s^2]: about that of repeated SLOWER."""
FORESIGHT = 2.0
"""How far ahead branches are compared [s]."""
TIE = 0.1
"""Weight of the present place among branches behind the same car."""
FAR = 100.0
"""The room of who has nobody ahead [m]."""
LOST = 100.0
"""What such a branch is set back by in the order of the search [m]."""
BACK = 4
"""By how many steps more the search goes back each time it gets stuck."""
SPARE = 3
"""How many beams full of branches are remembered for that at each step."""


@dataclass(slots=True)
class Oracle:
    """Beam search over meta-actions for the greatest distance without collision.

    In each step the meta-actions of all kept branches are simulated; of those that did not crash,
    the best of each (lane, target lane, target speed) come first, then the others, until
    `width` are kept.
    """

    width: int = 8
    steps: int = 30
    """Length of the episode in decision steps."""
    name: str = "look-ahead oracle"
    _plan: tuple[str, ...] = ()
    _next: int = 0

    def start(self, world: Environment) -> None:
        self._plan, self._next = search(world, self.steps, self.width), 0
        if len(self._plan) < self.steps:
            self._plan = search(world, self.steps, self.width, cautious=self.width // 2)

    def action(self, world: Environment) -> str | None:
        action = self._plan[self._next] if self._next < len(self._plan) else "SLOWER"
        self._next += 1
        return action


def search(world: Environment, steps: int, width: int, *, cautious: int = 0) -> tuple[str, ...]:
    """The actions of the farthest collision-free episode that was found from here.

    So many `cautious` branches are kept in each step for the room that they leave, not for the
    distance: where all lead into the same trap, these do not.

    Where all kept branches end in a collision, the search goes back a few steps, ever farther, to
    branches that were not kept. Fewer than `steps` actions: no episode was found.
    """
    levels: list[list[Branch]] = [[] for _ in range(steps + 1)]
    levels[0] = [Branch(0.0, 0.0, world.copy(), ())]
    depth, deepest, back = 0, levels[0][0], 0
    while depth < steps:
        beam, levels[depth] = levels[depth][:width], levels[depth][width : SPARE * width]
        if not beam:
            back += BACK
            if back > steps:
                break
            depth = max(0, depth - back)
            continue
        deepest = max(deepest, *beam, key=lambda branch: len(branch.actions))
        depth += 1
        levels[depth] = _order(
            [child for branch in beam for child in _children(branch, steps - depth)], cautious
        )
    ends = levels[steps]
    best = max(ends, key=lambda b: float(b.world.ego.position[0])) if ends else deepest
    return best.actions


@dataclass(frozen=True, slots=True, eq=False)
class Branch:
    """One beginning of an episode."""

    score: float
    room: float
    """Before the car ahead, less what braking to its speed takes [m]."""
    world: Environment
    actions: tuple[str, ...]


def _children(branch: Branch, left: int) -> list[Branch]:
    """The branch one step later, without collision."""
    children = []
    for action in _choices(branch.world):
        world = branch.world.copy()
        world.step(action)
        if not world.ego.crashed:
            children.append(Branch(*_score(world, left), world, (*branch.actions, action)))
    return children


def _order(branches: list[Branch], cautious: int) -> list[Branch]:
    """The cautious, the best of each kind, then the best of the rest; of equal ones only one."""
    different = {_state(b.world): b for b in reversed(branches)}
    seen: set[Any] = set()
    first: list[Branch] = []
    rest: list[Branch] = []
    for branch in sorted(different.values(), key=lambda b: -b.score):
        ego = branch.world.ego
        kind = (ego.lane_index, ego.target_lane_index, float(ego.target_speed))
        (rest if kind in seen else first).append(branch)
        seen.add(kind)
    order = first + rest
    roomy = sorted(order, key=lambda b: -b.room)[:cautious]
    return roomy + [branch for branch in order if branch not in roomy]


def _choices(world: Environment) -> list[str]:
    """The meta-actions of which each sets another target."""
    world = world.copy()  # where a lane ends, an action draws random numbers
    different: dict[Any, str] = {}
    for action in ("IDLE", *ACTIONS):
        ego = copy.copy(world.ego)
        ego.act(action)
        different.setdefault((ego.target_lane_index, float(ego.target_speed)), action)
    return list(different.values())


def _state(world: Environment) -> tuple[Any, ...]:
    """Equal for branches with the same future of the ego (the others' differs hardly)."""
    ego = world.ego
    numbers = (*ego.position, ego.heading, ego.speed, ego.target_speed)
    return (ego.target_lane_index, *(round(float(v), 6) for v in numbers))


def _score(world: Environment, left: int) -> tuple[float, float]:
    """Where the ego can be a few seconds on, if nobody changes anything [m]; and its room [m].

    Args:
        left: decision steps until the end; nothing beyond it counts.
    """
    ego = world.ego
    time = min(FORESIGHT, left * world.traffic.ticks * world.traffic.dt)
    x, speed = float(ego.position[0]), float(ego.speed)
    ahead = x + max(speed, float(ego.target_speed)) * time
    room = FAR
    for lane in {ego.lane_index, ego.target_lane_index}:
        front, _ = ego.road.neighbour_vehicles(ego, lane)
        if front is None:
            continue
        length = (front.LENGTH + ego.LENGTH) / 2
        behind = float(front.position[0]) - length
        ahead = min(ahead, behind + float(front.speed) * time)
        closing = max(0.0, speed - float(front.speed))
        room = min(room, behind - x - closing**2 / (2 * BRAKING))
    return ahead + TIE * x - (LOST if room < 0.0 else 0.0), room
