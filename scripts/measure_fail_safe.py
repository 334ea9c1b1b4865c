"""How many fail-safes are found with and without the optimisation of speeds, and at what cost.

    python scripts/measure_fail_safe.py [FILE.xml ...]
    python scripts/measure_fail_safe.py --junctions 300

Over the shipped scenarios and the files named: the ego as it is, 20 % slower, 20 % faster and
5 m/s faster, where it is and 10 m and 20 m further along its lane. Both searches run on the same
prediction, in turns, in one process; times are CPU times of the process. With --junctions N, over
the first N of the random junctions of the tests instead.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import sandra
from sandra.certify import MILDEST
from sandra.planning.fail_safe_rounds import ROUNDS, SAMPLED
from sandra.planning.fail_safe_search import FailSafe, fail_safe, fail_safe_horizon
from sandra.planning.surroundings import Surroundings
from sandra.prediction import predict
from sandra.scene.types import Scene
from sandra.settings import Settings

SPEEDS = ((1.0, 0.0), (0.8, 0.0), (1.2, 0.0), (1.0, 5.0))
"""(factor, addition [m/s])"""
PLACES = (0.0, 10.0, 20.0)
"""So far ahead [m]."""
KINDS = {"without": SAMPLED, "with": ROUNDS}


def variants(scene: Scene) -> Iterator[Scene]:
    """The ego at other speeds and places."""
    now = scene.ego.state
    s, d, heading, _ = scene.ego_curvilinear
    for ahead in PLACES:
        if s + ahead > scene.frame.length:
            continue
        moved = now
        if ahead:
            x, y = scene.frame.to_cartesian(np.array([[s + ahead, d]]))[0].tolist()
            there = float(scene.frame.heading(np.array([s + ahead]))[0]) + heading
            moved = replace(now, x=x, y=y, heading=there)
        for factor, more in SPEEDS:
            state = replace(moved, speed=factor * now.speed + more)
            yield replace(scene, ego=replace(scene.ego, state=state))


def scenes(files: list[str], junctions: int) -> Iterator[Scene]:
    """All that is measured on."""
    if junctions:
        sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
        from fail_safe_scenes import junction

        for seed in range(junctions):
            yield replace(junction(seed), name=f"junction {seed}")
        return
    for path in [*(sandra.example(name) for name in sandra.examples()), *files]:
        yield from variants(sandra.load(path))
        print(f"{path}: done", file=sys.stderr)


def main() -> None:
    """Print the numbers."""
    parser = argparse.ArgumentParser(description="Fail-safes with and without optimisation.")
    parser.add_argument("files", nargs="*", help="scenarios beside the shipped ones")
    parser.add_argument("--junctions", type=int, default=0, help="so many random junctions instead")
    options = parser.parse_args()
    settings = Settings()
    found = {kind: Counter[str]() for kind in KINDS}
    spent: dict[str, list[float]] = {kind: [] for kind in KINDS}
    missed: list[bool] = []
    for scene in scenes(options.files, options.junctions):
        horizon = fail_safe_horizon(scene, settings, 0.0, MILDEST)
        possible = predict(scene, "set-based", horizon, settings)
        shared = Surroundings.of(scene, possible)
        now = scene.ego.state
        state = np.array([now.x, now.y, now.heading, now.speed, now.steering_angle])
        answers = {}
        # What is made on first use is made before the clock runs.
        fail_safe(scene, state, 0.0, possible, settings, shared)
        for kind, rounds in KINDS.items():
            begin = time.process_time()
            answers[kind] = fail_safe(scene, state, 0.0, possible, settings, shared, rounds)
            spent[kind].append(time.process_time() - begin)
        for kind, answer in answers.items():
            name = answer.strategy if isinstance(answer, FailSafe) else "none found"
            found[kind][name] += 1
        missed.append(not isinstance(answers["without"], FailSafe))
        if missed[-1] and isinstance(gain := answers["with"], FailSafe):
            print(f"{scene.name}, {now.speed:.1f} m/s: {gain.deceleration:.1f} m/s^2")
    for name in sorted(set(found["without"]) | set(found["with"])):
        print(f"{name:28s} {found['without'][name]:5d} {found['with'][name]:5d}")
    lost = np.array(missed)
    for kind, times in spent.items():
        for what, rows in (("found by samples", ~lost), ("not found by samples", lost)):
            part = 1e3 * np.array(times)[rows]
            print(
                f"{kind:8s} {what:22s} median {np.median(part):5.0f} ms, most {part.max():5.0f} ms"
            )


if __name__ == "__main__":
    main()
