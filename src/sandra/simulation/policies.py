"""Drivers without a verifier, the bottom rows of every closed-loop table; and `play`.

A policy chooses a meta-action for each decision step. A metric that the naive ones do well in says
little about a driver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SettingsError
from sandra.simulation.highway import ACTIONS, FAIL_SAFE, Environment
from sandra.simulation.oracle import Oracle

Array = NDArray[np.float64]
NEAR = 100.0
"""Others up to so far ahead or behind are the traffic that the ego's speed is compared with [m]."""


class Policy(Protocol):
    """A driver. `name` stands in tables."""

    name: str

    def start(self, world: Environment) -> None:
        """Called after each reset."""

    def action(self, world: Environment) -> str | None:
        """The meta-action of the next decision step; None: none, the ego drives by itself."""


@dataclass(slots=True)
class Always:
    """The same meta-action in every step."""

    name: str
    meta_action: str

    def start(self, world: Environment) -> None:
        """Nothing to prepare."""

    def action(self, world: Environment) -> str | None:
        return self.meta_action


@dataclass(slots=True)
class Random:
    """Meta-actions at random; (seed of the traffic, repeat) gives the same ones again."""

    repeat: int = 0
    name: str = "random"
    _rng: np.random.Generator | None = None

    def start(self, world: Environment) -> None:
        self._rng = np.random.default_rng([world.seed or 0, self.repeat])

    def action(self, world: Environment) -> str | None:
        assert self._rng is not None, "start comes first"
        return ACTIONS[int(self._rng.integers(len(ACTIONS)))]


@dataclass(slots=True)
class Idm:
    """The ego is one of highway-env's own IDM/MOBIL vehicles, of the class of the others."""

    target_speed: float = 30.0
    """[m/s]"""
    name: str = "IDM/MOBIL"

    def start(self, world: Environment) -> None:
        kind = next(type(v) for v in world.others if hasattr(v, "timer"))
        ego = kind.create_from(world.ego)
        ego.target_speed = self.target_speed
        world.replace_ego(ego)

    def action(self, world: Environment) -> str | None:
        return None


_POLICIES: dict[str, Callable[[int], Policy]] = {
    "idle": lambda _: Always("always IDLE", "IDLE"),
    "slower": lambda _: Always("always SLOWER", "SLOWER"),
    "faster": lambda _: Always("always FASTER", "FASTER"),
    "fail-safe": lambda _: Always("always fail-safe", FAIL_SAFE),
    "random": lambda repeat: Random(repeat),
    "idm": lambda _: Idm(),
    "oracle": lambda _: Oracle(),
}
POLICIES = tuple(_POLICIES)
"""Names for `policy`."""


def policy(name: str, repeat: int = 0) -> Policy:
    """One of `POLICIES` or `dilu:MODEL` by its name; `repeat` tells runs of a random one apart."""
    if name.startswith("dilu:"):
        from sandra.simulation.dilu import named

        return named(name)
    if name not in _POLICIES:
        known = ", ".join((*POLICIES, "dilu:MODEL"))
        raise SettingsError(f"policy: '{name}' is unknown; known are {known}")
    return _POLICIES[name](repeat)


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One episode, by decision steps; n of them were driven. Row 0 of the states is the start.

    This is all that the metrics of `sandra.evaluation.closed_loop` need of an episode.
    """

    driver: str
    seed: int
    setting: int | None
    """1 to 3 of the paper; None for other traffic."""
    profile: str
    dt: float
    """Duration of a decision step [s]."""
    x: Array
    """(n+1,) distance along the road [m]."""
    speed: Array
    """(n+1,) [m/s]"""
    lane: NDArray[np.int64]
    """(n+1,) lane by number."""
    crashed: NDArray[np.bool_]
    """(n+1,) whether the ego has crashed."""
    traffic_speed: Array
    """(n+1,) mean speed of the others within 100 m [m/s]; NaN where there are none."""
    actions: tuple[str, ...]
    """(n,) what was driven: meta-actions, or action pairs."""
    fail_safe: NDArray[np.bool_]
    """(n,) whether a step was a fail-safe."""

    @property
    def steps(self) -> int:
        """Number of decision steps that were driven."""
        return len(self.actions)


def play(
    world: Environment,
    seed: int,
    driver: Policy,
    *,
    steps: int = 30,
    setting: int | None = None,
) -> Run:
    """Let a policy drive one episode: `steps` decision steps, or until the ego has crashed."""
    world.reset(seed)
    driver.start(world)
    rows = [_row(world)]
    actions: list[str] = []
    while len(actions) < steps and not world.ego.crashed:
        action = driver.action(world)
        world.step(action)
        actions.append(action or driver.name)
        rows.append(_row(world))
    x, speed, lane, crashed, traffic = zip(*rows, strict=True)
    return Run(
        driver=driver.name,
        seed=seed,
        setting=setting,
        profile=world.profile,
        dt=world.traffic.ticks * world.traffic.dt,
        x=np.array(x),
        speed=np.array(speed),
        lane=np.array(lane),
        crashed=np.array(crashed),
        traffic_speed=np.array(traffic),
        actions=tuple(actions),
        fail_safe=np.array([a == FAIL_SAFE for a in actions], dtype=bool),
    )


def _row(world: Environment) -> tuple[float, float, int, bool, float]:
    ego: Any = world.ego
    x = float(ego.position[0])
    near = [float(v.speed) for v in world.others if abs(float(v.position[0]) - x) <= NEAR]
    traffic = float(np.mean(near)) if near else float("nan")
    return x, float(ego.speed), int(ego.lane_index[2]), bool(ego.crashed), traffic
