"""Certificates to be tried: many scenes, several pairs each, made reproducibly from a seed.

A scene comes from a file as it is, or from a later moment of it, with positions and speeds of the
ego and of the others changed at random.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from sandra.actions import ALL_PAIRS
from sandra.certificate import Certificate
from sandra.certify import Basis, Proven, certify
from sandra.errors import ScenarioError
from sandra.prediction import predict
from sandra.reach import ground, verify_pair
from sandra.scene import load
from sandra.scene.sent import content_of
from sandra.scene.types import Obstacle, Scene, State
from sandra.settings import Settings

MOST_PAIRS = 4
"""Certificates per scene."""
LATEST = 30
"""Scenes begin at most this many steps after the file's first one."""
RULES: tuple[tuple[str, ...], ...] = ((), ("R_G2",), ("R_G1", "R_G2", "R_G3"))
PREDICTIONS = ("most-likely", "most-likely", "set-based")


@dataclass(frozen=True, slots=True, eq=False)
class Cases:
    """The certificates of one scene. `label` says which scene and how it was made."""

    label: str
    scene: Scene
    certificates: tuple[Certificate, ...]


def cases(files: tuple[Path, ...], index: int, seed: int, settings: Settings) -> Cases:
    """The `index`-th scene of a run, and certificates of up to `MOST_PAIRS` pairs in it.

    The first of each file is the scene as it is. A scene that cannot be decided has none.
    """
    label, scene, rng = varied(files, index, seed, settings)
    kind = PREDICTIONS[rng.integers(len(PREDICTIONS))]
    rules = RULES[rng.integers(len(RULES))]
    pairs = [ALL_PAIRS[i] for i in rng.permutation(len(ALL_PAIRS))]
    found: list[Certificate] = []
    try:
        base = ground(scene, predict(scene, kind, settings.horizon, settings), settings)
        basis = Basis.of(base)
        for pair in pairs:
            verdict = certify(basis, verify_pair(base, pair, rules, reasons=False), rules)
            if isinstance(verdict.proof, Proven):
                found.append(verdict.proof.certificate)
            if len(found) == MOST_PAIRS:
                break
    except ScenarioError:
        # Moved so that it is no decision problem any more, e.g. off its lane.
        return Cases(label, scene, ())
    return Cases(label, scene, tuple(found))


def varied(
    files: tuple[Path, ...], index: int, seed: int, settings: Settings
) -> tuple[str, Scene, np.random.Generator]:
    """The `index`-th scene with its label, and the random numbers that follow."""
    rng = np.random.default_rng([seed, index])
    path = file_of(files, index)
    scene = _loaded(path, _stamp(path), settings)
    label = path.stem
    if index >= len(files):
        later = int(rng.integers(0, LATEST + 1))
        scene, label = moved(scene, later), f"{label} +{later}"
        if rng.random() < 0.7:
            scene, label = perturbed(scene, rng), f"{label} #{index}"
    return label, scene, rng


def file_of(files: Sequence[Path], index: int) -> Path:
    """Of which file the `index`-th scene is made."""
    return files[index % len(files)]


def _stamp(path: Path) -> bytes:
    try:
        return sha256(content_of(path)).digest()
    except OSError:
        return b""  # `load` says what is wrong with it.


@lru_cache(maxsize=32)
def _loaded(path: Path, stamp: bytes, settings: Settings) -> Scene:
    """Kept as long as the file is the same: a worker of a cluster lives longer than a run."""
    return load(path, settings=settings)


def moved(scene: Scene, steps: int) -> Scene:
    """The scene `steps` later: the others as recorded, the ego along its lane at its speed."""
    ego = scene.ego.state
    s, d, relative, _ = scene.ego_curvilinear
    s = s + ego.speed * math.cos(relative) * steps * scene.dt
    if s + 20.0 > scene.frame.length:
        steps, s = 0, scene.ego_curvilinear[0]
    x, y = scene.frame.to_cartesian(np.array([[s, d]]))[0].tolist()
    heading = float(scene.frame.heading(np.array([s]))[0]) + relative
    others = tuple(o for each in scene.obstacles if (o := _later(each, steps)) is not None)
    state = replace(ego, x=x, y=y, heading=heading) if steps else ego
    return replace(scene, ego=replace(scene.ego, state=state), obstacles=others)


def _later(obstacle: Obstacle, steps: int) -> Obstacle | None:
    """The same one later; None if it is gone."""
    if steps == 0 or obstacle.is_static:
        return obstacle
    if obstacle.occupancies is not None:
        sets = obstacle.occupancies[steps:]
        return replace(obstacle, occupancies=sets) if any(sets) else None
    if obstacle.states is None:
        return obstacle
    rest = obstacle.states[steps:]
    there = np.flatnonzero(np.isfinite(rest[:, 0])) if len(rest) else np.zeros(0, dtype=int)
    if not len(there):
        return None
    x, y, heading, speed, acceleration = np.nan_to_num(rest[there[0]]).tolist()
    return replace(obstacle, states=rest, state=State(x, y, heading, speed, acceleration))


def perturbed(scene: Scene, rng: np.random.Generator) -> Scene:
    """The ego and the others a little elsewhere and at other speeds; recordings are dropped."""
    ego = scene.ego.state
    s, d, relative, _ = scene.ego_curvilinear
    s, d = s + rng.uniform(-2.0, 5.0), d + rng.uniform(-0.3, 0.3)
    s = min(max(s, 0.0), scene.frame.length)
    x, y = scene.frame.to_cartesian(np.array([[s, d]]))[0].tolist()
    heading = float(scene.frame.heading(np.array([s]))[0]) + relative
    state = replace(
        ego,
        x=x,
        y=y,
        heading=heading + rng.uniform(-0.02, 0.02),
        speed=ego.speed * rng.uniform(0.6, 1.1),
    )
    others = tuple(_elsewhere(o, rng) for o in scene.obstacles)
    return replace(scene, ego=replace(scene.ego, state=state), obstacles=others, recorded_ego=None)


def _elsewhere(obstacle: Obstacle, rng: np.random.Generator) -> Obstacle:
    along, across, faster = rng.normal(0.0, 3.0), rng.uniform(-0.25, 0.25), rng.uniform(0.7, 1.25)
    late = obstacle.states is not None and not np.isfinite(obstacle.states[0, 0])
    if obstacle.is_static or obstacle.occupancies is not None or late:
        return obstacle
    s = obstacle.state
    c, sn = math.cos(s.heading), math.sin(s.heading)
    state = replace(
        s,
        x=s.x + along * c - across * sn,
        y=s.y + along * sn + across * c,
        speed=s.speed * faster,
    )
    return replace(obstacle, state=state, states=None)
