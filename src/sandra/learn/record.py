"""One episode of highway-env's traffic as a recording, every vehicle of which may be the ego.

Unlike the recordings of `sandra drive`, a step's acceleration is the one that led to it, not the
one that follows: a prompt that tells it must not tell what the driver does next.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.errors import ScenarioError
from sandra.learn.episodes import DT, ENVIRONMENTS, Episode
from sandra.scene.highway import Observer
from sandra.scene.types import Scene
from sandra.scene.writing import write
from sandra.simulation.highway import Environment, Traffic, highway
from sandra.simulation.recording import Recorder, Recording

Array = NDArray[np.float64]

VEHICLES = {"highway": 24, "merge": 10, "roundabout": 5, "intersection": 10}
"""At density 1; on the highway always, where vehicles are set closer instead."""
SPAWNING = 0.3
"""Chance, at density 1, that a vehicle enters the intersection in a step."""


@dataclass(frozen=True, slots=True)
class Counts:
    """What a recording holds."""

    vehicles: int
    states: int
    """Recorded vehicle steps."""
    crashed: int
    """Vehicles that the simulation counts as crashed at some step."""


def play(episode: Episode, steps: int, warm_up: int) -> Recording:
    """The traffic of an episode: `warm_up` steps unseen, then `steps` and the one before them.

    A vehicle that leaves the road is not recorded any further. The ego is the simulation's own,
    else the first that is on the road.

    Raises:
        ScenarioError: if nobody is on the road.
    """
    from sandra.simulation.drivers import seat

    rng = np.random.default_rng([episode.seed, 1])
    world = _world(episode)

    def step() -> None:
        world.step()
        seat(world, episode.drivers, rng)

    seat(world, episode.drivers, rng)
    for _ in range(warm_up):
        step()
    observer = Observer.of(world.env, episode.name, DT)
    recorder = Recorder(observer, world.env, _scene(world, observer), DT)
    left: dict[int, int] = {}
    for row in range(steps + 1):
        if row:
            step()
            recorder.note()
        for vehicle in world.env.road.vehicles:
            if _is_off(vehicle):
                left.setdefault(observer.id_of(vehicle), row)
    world.close()
    return _as_seen(recorder.recording(), left)


def save(episode: Episode, recording: Recording, path: Path) -> Counts:
    """Write a recording, and beside it who crashed when, if anybody did."""
    scene = recording.scene
    write(scene, path, source="sandra dataset record, highway-env")
    crashed = {str(i): step for i, step in sorted(recording.crashed.items())}
    if crashed:
        path.with_suffix(".crashed.json").write_text(json.dumps(crashed) + "\n", encoding="utf-8")
    rows = [recording.ego, *(o.states for o in scene.obstacles if o.states is not None)]
    seen = [int(np.isfinite(states[:, 0]).sum()) for states in rows]
    return Counts(sum(n > 0 for n in seen), sum(seen), len(crashed))


def _world(episode: Episode) -> Environment:
    """Highway-env's environment after its reset, with traffic of the episode's density."""
    kind, density = episode.environment, episode.density
    dense_road = kind == "highway"
    count = VEHICLES[kind] if dense_road else max(1, round(VEHICLES[kind] * density))
    world = highway(
        Traffic(
            ENVIRONMENTS[kind],
            lanes=episode.lanes if kind in ("highway", "merge") else None,
            density=density if dense_road else None,
            vehicles=count,
            decision_hz=round(1 / DT),
        )
    )
    more: dict[str, dict[str, Any]] = {
        "roundabout": {"roundabout_lanes": episode.lanes},
        "intersection": {
            "initial_vehicle_count": count,
            "spawn_probability": min(1.0, SPAWNING * density),
        },
    }
    world.env.config.update(more.get(kind, {}))
    world.reset(episode.seed)
    return world


def _scene(world: Environment, observer: Observer) -> Scene:
    for vehicle in (world.ego, *world.others):
        if _is_off(vehicle):
            continue
        try:
            return observer.scene(vehicle)
        except ScenarioError:
            continue
    raise ScenarioError(f"{observer.name}: nobody is on the road any more")


def _is_off(vehicle: Any) -> bool:
    """Whether its centre is off the road; the library counts what is just behind its end as on."""
    lane = vehicle.lane
    s, _ = lane.local_coordinates(vehicle.position)
    goes_on = bool(vehicle.road.network.graph.get(vehicle.lane_index[1]))
    return not vehicle.on_road or (not goes_on and s > lane.length)


def _as_seen(recording: Recording, left: dict[int, int]) -> Recording:
    """With accelerations as a witness of each step knows them, and without who left the road."""
    scene = recording.scene
    obstacles = tuple(
        o
        if o.states is None
        else replace(o, states=_rows(o.states, o.state.acceleration, o.id, left))
        for o in scene.obstacles
    )
    ego = _rows(recording.ego, scene.ego.state.acceleration, scene.ego.id, left)
    seen = replace(scene, obstacles=obstacles, recorded_ego=ego)
    crashed = {i: k for i, k in recording.crashed.items() if k < left.get(i, len(ego))}
    return Recording(seen, crashed)


def _rows(states: Array, first: float, id: int, left: dict[int, int]) -> Array:
    rows = np.array(states)
    rows[1:, 4] = states[:-1, 4]
    rows[np.flatnonzero(np.isfinite(rows[:, 0]))[:1], 4] = first
    rows[left.get(id, len(rows)) :] = np.nan
    rows.setflags(write=False)
    return rows
