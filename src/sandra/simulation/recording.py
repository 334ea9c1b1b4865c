"""What a simulation did, tick by tick, as a recording that everything else can read.

A recording is a `Scene` at its first tick: its obstacles have `states` and its ego `recorded_ego`,
one row for each tick. So a run can be drawn, monitored, checked for conformance, and written as a
CommonRoad file, with what does so for any other scenario.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.scene.highway import Observer
from sandra.scene.types import Obstacle, Region, Scene, State

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """All vehicles at T ticks; `scene` has the recorded states, its `dt` is that of a tick.

    `crashed` maps ids to the first tick at which the simulation counts the vehicle as crashed;
    the ego's id is `scene.ego.id`.
    """

    scene: Scene
    crashed: dict[int, int]

    @property
    def ego(self) -> Array:
        """(T, 5) x, y, heading, speed, acceleration of the ego, acceleration until the next."""
        states = self.scene.recorded_ego
        assert states is not None, "a recording has an ego"
        return states

    @property
    def ego_crash(self) -> int | None:
        """The tick at which the ego has crashed, None if it has not."""
        return self.crashed.get(self.scene.ego.id)


class Recorder:
    """Notes the state of every vehicle, tick by tick."""

    def __init__(self, observer: Observer, env: Any, scene: Scene, dt: float) -> None:
        self._observer, self._env, self._scene, self._dt = observer, env, scene, dt
        self._rows: list[dict[int, State]] = []
        self._sizes: dict[int, tuple[float, float]] = {}
        self._crashed: dict[int, int] = {}
        self.note()

    def note(self) -> None:
        """The present tick."""
        now: dict[int, State] = {}
        for vehicle in self._env.road.vehicles:
            number = self._observer.id_of(vehicle)
            now[number] = self._observer.state(vehicle)
            self._sizes.setdefault(number, (float(vehicle.LENGTH), float(vehicle.WIDTH)))
            if vehicle.crashed:
                self._crashed.setdefault(number, len(self._rows))
        self._rows.append(now)

    def recording(self) -> Recording:
        """All that was noted so far."""
        scene = self._scene
        static = tuple(o for o in scene.obstacles if o.is_static)
        moving = tuple(
            self._obstacle(number, size)
            for number, size in self._sizes.items()
            if number != scene.ego.id
        )
        ego = self._states(scene.ego.id)
        return Recording(
            replace(
                scene,
                dt=self._dt,
                obstacles=(*moving, *static),
                lanelets=tuple(self._observer.whole.network.values()),
                recorded_ego=ego,
            ),
            dict(self._crashed),
        )

    def _obstacle(self, number: int, size: tuple[float, float]) -> Obstacle:
        states = self._states(number)
        first = next(now[number] for now in self._rows if number in now)
        return Obstacle(number, "car", Region.rectangle(*size), first, states=states)

    def _states(self, number: int) -> Array:
        states = np.full((len(self._rows), 5), np.nan)
        for i, now in enumerate(self._rows):
            state = now.get(number)
            if state is not None:
                states[i] = state.x, state.y, state.heading, state.speed, state.acceleration
        # What is applied until the next tick: the simulation tells what was applied before it.
        states[:-1, 4] = states[1:, 4]
        states.setflags(write=False)
        return states
