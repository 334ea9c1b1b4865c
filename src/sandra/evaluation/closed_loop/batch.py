"""Many episodes of one run, in one or several processes; each is in the folder when it is done."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sandra.errors import SandraError
from sandra.evaluation.closed_loop.drive import Drive, words
from sandra.evaluation.closed_loop.folder import FramesOf, RunFolder
from sandra.evaluation.workers import Broken, Workers, as_done
from sandra.simulation.episode import Step

Progress = Callable[[str], None]
Job = tuple[FramesOf | None, Drive, int]
"""What writes view.jsonl, the drive and the seed."""


def drive_all(
    folder: RunFolder,
    how: Drive,
    seeds: Sequence[int],
    workers: Workers = 1,
    progress: Progress = lambda text: None,
) -> list[dict[str, Any]]:
    """The metrics of every seed, driven now where the folder does not have them yet.

    Raises:
        SandraError: if an episode broke off with an error; the others are in the folder.
    """
    if workers == 1:
        found: list[dict[str, Any]] = []
        for n, seed in enumerate(seeds, start=1):
            told = f"{how.name} {n} of {len(seeds)}, seed {seed}"
            found.append(folder.drive(how, seed, _follow(told, how.steps, progress)))
            progress(f"{told}: done")
        return found
    known = {seed: folder.metrics(seed) for seed in seeds}
    jobs: list[Job] = [
        (folder.frames, how, seed) for seed, metrics in known.items() if metrics is None
    ]
    broken = []
    with closing(as_done(one, jobs, workers, lambda job: job[1].files)) as answers:
        for (_, _, seed), answer in answers:
            if isinstance(answer, Broken):
                broken.append(f"seed {seed}: {answer.error}")
                continue
            known[seed] = folder.keep(seed, answer)
            done = sum(metrics is not None for metrics in known.values())
            progress(f"{how.name}: {done} of {len(seeds)} episodes")
    if broken:
        raise SandraError(f"{folder.path}: {len(broken)} episodes broke off; {'; '.join(broken)}")
    return [metrics for metrics in known.values() if metrics is not None]


def one(job: Job) -> dict[str, bytes]:
    """The files of one episode, driven elsewhere: only who gave the job writes into the run."""
    frames, how, seed = job
    with TemporaryDirectory() as place:
        folder = RunFolder(Path(place), frames)
        folder.drive(how, seed)
        return folder.packed(seed)


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
