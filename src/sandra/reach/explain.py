"""Why a set is empty: found by leaving one possible cause out at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from sandra.actions import Lateral
from sandra.logic import Specification
from sandra.reach.ground import Ground
from sandra.reach.lattice import Mask
from sandra.reach.sets import ReachableSet

Compute = Callable[[Ground, Specification, "Sequence[Mask] | None"], ReachableSet]

MOST_OBSTACLES = 4
"""So many of the obstacles in the way are left out in turn."""


@dataclass(frozen=True, slots=True)
class _Trial:
    cause: str
    specification: Specification
    forbidden: Sequence[Mask] | None = None


def explain(base: Ground, spec: Specification, found: ReachableSet, compute: Compute) -> str:
    """One sentence: at which step the set is empty, and what emptied it.

    The cause is the one without which the set lives on, or else lives longest.
    """
    step = found.first_empty_step
    assert step is not None
    known = _known_without_trial(base, spec, step)
    if known is not None:
        return f"empty at step {step}: {known}"
    best: tuple[int, str] | None = None
    for trial in _trials(base, spec, found, step):
        without = compute(base, trial.specification, trial.forbidden).first_empty_step
        if without is None:
            return (
                f"empty at step {step}: {trial.cause}; without it the set lasts through "
                f"step {base.horizon}"
            )
        if without > step and (best is None or without > best[0]):
            best = (without, trial.cause)
    if best is not None:
        return f"empty at step {step}: {best[1]}; without it the set lasts until step {best[0]}"
    causes = [trial.cause for trial in _trials(base, spec, found, step)]
    return f"empty at step {step}: several causes at once, none alone: " + ", ".join(causes)


def _known_without_trial(base: Ground, spec: Specification, step: int) -> str | None:
    scene, settings = base.scene, base.settings
    lateral = spec.pair.lateral
    if lateral is Lateral.LEFT_LANE and scene.left is None:
        return "there is no left-adjacent lane in the same direction"
    if lateral is Lateral.RIGHT_LANE and scene.right is None:
        return "there is no right-adjacent lane in the same direction"
    slowest = min(v for _, v in base.lon)
    if step == 0 and slowest > settings.v_max:
        return f"the initial speed {slowest:.1f} m/s exceeds v_max = {settings.v_max:g} m/s"
    return None


def _trials(base: Ground, spec: Specification, found: ReachableSet, step: int) -> Iterator[_Trial]:
    if found.contested is not None:
        for index in base.obstacles_at(step, found.contested)[:MOST_OBSTACLES]:
            obstacle = base.prediction.obstacles[index].obstacle
            yield _Trial(
                f"{obstacle.kind} {obstacle.id} leaves no room",
                spec,
                base.forbidden_without(index),
            )
    for part in spec.parts:
        kind = "rule" if part.name.upper().startswith("R_") else "action"
        yield _Trial(f"{kind} {part.name} [{part.text}] cannot be kept", spec.without(part.name))
    if found.contested is not None and bool((found.contested & base.off_road).any()):
        yield _Trial("the border of the road", spec, base.forbidden_without(None, road=False))
    if len(base.prediction.obstacles) > 1:
        yield _Trial(
            "the other traffic leaves no room",
            spec,
            tuple(base.off_road for _ in range(base.horizon + 1)),
        )
