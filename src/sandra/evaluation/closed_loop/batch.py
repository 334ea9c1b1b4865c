"""Many episodes of one run, in one or several processes; each is in the folder when it is done."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from sandra.errors import SandraError
from sandra.evaluation.closed_loop.drive import Drive, words
from sandra.evaluation.closed_loop.folder import RunFolder
from sandra.evaluation.workers import Broken, in_order
from sandra.simulation.episode import Step

Progress = Callable[[str], None]
Job = tuple[RunFolder, Drive, int]


def drive_all(
    folder: RunFolder,
    how: Drive,
    seeds: Sequence[int],
    workers: int = 1,
    progress: Progress = lambda text: None,
) -> list[dict[str, Any]]:
    """The metrics of every seed, driven now where the folder does not have them yet.

    Raises:
        SandraError: if an episode broke off with an error; the others are in the folder.
    """
    found: list[dict[str, Any]] = []
    if workers == 1:
        for n, seed in enumerate(seeds, start=1):
            told = f"{how.name} {n} of {len(seeds)}, seed {seed}"
            found.append(folder.drive(how, seed, _follow(told, how.steps, progress)))
            progress(f"{told}: done")
        return found
    jobs: list[Job] = [(folder, how, seed) for seed in seeds]
    broken = []
    for seed, answer in zip(seeds, in_order(one, jobs, workers), strict=True):
        if isinstance(answer, Broken):
            broken.append(f"seed {seed}: {answer.error}")
            continue
        found.append(answer)
        progress(f"{how.name}: {len(found)} of {len(seeds)} episodes")
    if broken:
        raise SandraError(f"{folder.path}: {len(broken)} episodes broke off; {'; '.join(broken)}")
    return found


def one(job: Job) -> dict[str, Any]:
    """One episode, in a process of its own."""
    folder, how, seed = job
    return folder.drive(how, seed)


def _follow(told: str, steps: int, progress: Progress) -> Callable[[Step], None]:
    counts: Counter[str] = Counter()

    def on_step(step: Step) -> None:
        counts[step.operation.value] += 1
        speed = step.decision.scene.ego.state.speed
        by = ", ".join(f"{name} {n}" for name, n in counts.items())
        progress(
            f"{told}: step {step.index + 1}/{steps}, {speed:.0f} m/s, {words(step.pair)}; {by}"
        )

    return on_step
