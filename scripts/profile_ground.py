"""What the preparation of a reachability analysis consists of, part by part, in process CPU time.

    python scripts/profile_ground.py merge --horizons 15,25,50 --runs 15

A scenario is a CommonRoad file or a name of `sandra scenarios`; medians of `--runs` runs after one
that is not counted. SANDRA_KERNEL chooses the kernel.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import TypeVar

from sandra.prediction import predict
from sandra.reach import ground
from sandra.reach.cells import bulge, grid, off_road
from sandra.reach.initial import initial_set, lattice_of
from sandra.reach.occupied import occupied_by, united
from sandra.reach.windows import Lines
from sandra.scenarios import example
from sandra.scene import load
from sandra.scene.types import Scene
from sandra.settings import Settings

PARTS = ("lattice", "bulges", "road", "others", "union", "rest", "all")
"""`others`: cells that the other vehicles forbid; `rest`: borders of lanes, speed limits."""
T = TypeVar("T")


def parts(scene: Scene, horizon: int, runs: int) -> dict[str, float]:
    """Medians [s]."""
    settings = Settings().replace(horizon=horizon)
    prediction = predict(scene, "most-likely", horizon, settings)
    found: dict[str, float] = {}

    def timed(name: str, work: Callable[[], T]) -> T:
        times = []
        for _ in range(runs + 1):
            begin = time.process_time()
            result = work()
            times.append(time.process_time() - begin)
        found[name] = median(times[1:])
        return result

    lon, lat = initial_set(scene, settings)
    lattice = timed("lattice", lambda: lattice_of(scene, horizon, lon, lat, settings))
    bulges = timed("bulges", lambda: bulge(scene, lattice))
    road = timed("road", lambda: off_road(scene, lattice, bulges))
    s, d = lattice.corners()
    ends = grid(scene, s, d[[0, -1]])
    reach = scene.ego.width / 2 - bulges
    lines = Lines.between(ends[:, 0], ends[:, 1], lattice.rows, reach)
    others = timed("others", lambda: occupied_by(prediction, lines))
    timed("union", lambda: united(lattice, road, others, horizon))
    timed("all", lambda: ground(scene, prediction, settings))
    found["rest"] = max(0.0, found["all"] - sum(x for name, x in found.items() if name != "all"))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenarios", nargs="+", metavar="SCENARIO")
    parser.add_argument("--horizons", default="15,25,50")
    parser.add_argument("--runs", type=int, default=15)
    options = parser.parse_args()
    print(f"{'process CPU [ms]':<32}" + "".join(f"{name:>9}" for name in PARTS))
    for name in options.scenarios:
        scene = load(name if Path(name).exists() else example(name))
        for horizon in map(int, options.horizons.split(",")):
            found = parts(scene, horizon, options.runs)
            row = "".join(f"{1e3 * found[part]:9.1f}" for part in PARTS)
            print(f"{scene.name[:26]:<26} {horizon:>4} {row}")


if __name__ == "__main__":
    main()
