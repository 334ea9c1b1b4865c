"""Environments of highway-env: the paper's three settings, other traffic, other roads.

    world = highway(2, profile="paper")
    world.reset(5838)
    for _ in range(30):
        world.step("IDLE")

Nothing of the library is patched: a profile is a configuration and subclasses (`traffic.py`).
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sandra.actions import META_ACTIONS
from sandra.errors import SettingsError

ACTIONS = META_ACTIONS
"""The meta-actions of highway-env, in the order of its action space."""
FAIL_SAFE = "FAIL_SAFE"
"""One meta-action more: SLOWER, in the profile `paper` with the authors' gain."""
PROFILES = ("stock", "paper")
SEEDS = (5838, 2421, 7294, 9650, 4176, 6382, 8765, 1348, 4213, 2572)
"""The seeds of the paper's closed-loop evaluation."""
PAPER_SPEEDS = tuple(float(v) for v in np.linspace(5.0, 32.0, 9))
"""Speeds between which the ego's SLOWER and FASTER step [m/s] (the authors' environment)."""


@dataclass(frozen=True, slots=True)
class Traffic:
    """Which road and how much traffic. None: what the environment does by default."""

    environment: str = "highway-v0"
    """A name registered by highway-env, such as merge-v0, roundabout-v0, racetrack-v0."""
    lanes: int | None = None
    density: float | None = None
    """Vehicles per stretch of road, 1 being the library's default (highway-v0 only)."""
    vehicles: int | None = None
    """Number of other vehicles."""
    ego_spacing: float | None = None
    """Gap that the ego starts behind, in multiples of the default one (highway-v0 only)."""
    target_speeds: tuple[float, ...] | None = None
    """Speeds between which SLOWER and FASTER step [m/s]; None: 20, 25, 30."""
    simulation_hz: int = 15
    decision_hz: int = 5
    duration: float = 30.0
    """When the environment calls itself truncated [s]."""

    def __post_init__(self) -> None:
        if self.simulation_hz % self.decision_hz:
            raise SettingsError(
                f"simulation_hz: {self.simulation_hz} is no multiple of decision_hz "
                f"{self.decision_hz}; choose one that is"
            )

    @property
    def ticks(self) -> int:
        """Ticks of simulation in a decision step."""
        return self.simulation_hz // self.decision_hz

    @property
    def dt(self) -> float:
        """One tick [s]."""
        return 1 / self.simulation_hz

    def replace(self, **changes: Any) -> Traffic:
        return replace(self, **changes)


_PAPER = Traffic(vehicles=50, ego_spacing=4.0, target_speeds=PAPER_SPEEDS)
SETTINGS = {
    1: _PAPER.replace(lanes=4, density=2.0),
    2: _PAPER.replace(lanes=4, density=3.0),
    3: _PAPER.replace(lanes=5, density=3.0),
}
"""The paper's settings 1 to 3 (Sec. "Closed-Loop Evaluation")."""


class Environment:
    """One environment of highway-env, driven in ticks or in decision steps of several ticks.

    The environment itself is `env`. It is not stepped by `env.step`, which also observes and
    rewards; the traffic is the same to the last bit (a test compares them).
    """

    def __init__(self, traffic: Traffic, profile: str = "stock", render: bool = False):
        if profile not in PROFILES:
            raise SettingsError(f"profile: '{profile}' is unknown; known are {', '.join(PROFILES)}")
        if profile == "paper" and traffic.environment.startswith("racetrack"):
            raise SettingsError(
                f"profile: {traffic.environment} fixes the class of its traffic; use 'stock'"
            )
        self.traffic = traffic
        self.profile = profile
        self.seed: int | None = None
        self.ticks = 0
        """Ticks since the last reset."""
        self.tick_duration = traffic.dt
        """[s]"""
        self.env: Any = _make(traffic, profile, render)

    def reset(self, seed: int) -> None:
        """Start the episode of a seed: equal seeds give equal episodes."""
        from sandra.simulation.road import QuickRoad

        self.env.reset(seed=seed)
        self.env.road = QuickRoad.of(self.env.road)
        self.seed, self.ticks = seed, 0
        self.replace_ego(self._meta_ego(self.env.vehicle))

    @property
    def ego(self) -> Any:
        """The ego vehicle: an object of highway-env."""
        return self.env.vehicle

    @property
    def others(self) -> list[Any]:
        """The other vehicles, in the order of `env.road.vehicles`."""
        return [v for v in self.env.road.vehicles if v is not self.ego]

    @property
    def time(self) -> float:
        """Since the reset [s]."""
        return self.ticks * self.traffic.dt

    def replace_ego(self, vehicle: Any) -> None:
        """Let another vehicle object be the ego; see the function of this name."""
        replace_ego(self.env, vehicle)

    def act(self, action: str) -> None:
        """Give the ego a meta-action (`ACTIONS`, FAIL_SAFE); time does not pass."""
        self.ego.act(action)

    def tick(self) -> None:
        """One tick of simulation: all act, then all move."""
        env = self.env
        env.road.act()
        env.road.step(self.traffic.dt)
        env.steps += 1
        self.ticks += 1
        env.time = self.ticks / self.traffic.simulation_hz
        if self.ticks % self.traffic.ticks == 0 and hasattr(env, "_spawn_vehicle"):
            # What the intersection's `step` does after each decision step.
            env._clear_vehicles()
            env._spawn_vehicle(spawn_probability=env.config["spawn_probability"])

    def step(self, action: str | None = None) -> None:
        """One decision step: a meta-action (None: none), then its ticks."""
        if action is not None:
            self.act(action)
        for _ in range(self.traffic.ticks):
            self.tick()

    def copy(self) -> Environment:
        """An independent copy for looking ahead: the same future if the same is done.

        It can be driven, not drawn. (An order of magnitude cheaper than `copy.deepcopy`.)
        """
        from sandra.simulation.road import copy_world

        twin = copy.copy(self)
        twin.env = copy_world(self.env)
        return twin

    def close(self) -> None:
        """Close the window, if there is one."""
        self.env.close()

    def _meta_ego(self, vehicle: Any) -> Any:
        """The ego of the profile in the state of the library's ego."""
        from sandra.simulation.traffic import MetaEgo, PaperEgo

        ego = (PaperEgo if self.profile == "paper" else MetaEgo)(
            vehicle.road,
            vehicle.position,
            vehicle.heading,
            vehicle.speed,
            target_speeds=getattr(vehicle, "target_speeds", self.traffic.target_speeds),
        )
        for name in ("target_lane_index", "target_speed", "speed_index", "route"):
            if hasattr(vehicle, name):
                setattr(ego, name, getattr(vehicle, name))
        return ego


def replace_ego(env: Any, vehicle: Any) -> None:
    """Let another vehicle object be an environment's ego, at its place in `env.road.vehicles`.

    The order of the vehicles is the order in which they act and collide: with the place kept,
    traffic and random numbers stay those of the library.
    """
    vehicles, old = env.road.vehicles, env.vehicle
    place = next(i for i, v in enumerate(vehicles) if v is old)
    vehicles[place] = vehicle
    env.controlled_vehicles[0] = vehicle


def highway(setting: int | Traffic, profile: str = "stock", render: bool = False) -> Environment:
    """Make an environment: one of the paper's settings (1, 2, 3), or any `Traffic`.

    Profiles: `stock` is the library as it is; `paper` has the authors' changes (others think about
    lane changes every 2 s; FAIL_SAFE brakes with a larger gain). With `render`, frames are drawn
    into arrays (`env.render()`), without a window.

    Raises SettingsError for what is unknown, or where highway-env is missing.
    """
    if isinstance(setting, int):
        if setting not in SETTINGS:
            raise SettingsError(f"setting: {setting} is unknown; the paper's are 1, 2 and 3")
        setting = SETTINGS[setting]
    return Environment(setting, profile, render)


def _make(traffic: Traffic, profile: str, render: bool) -> Any:
    try:
        import highway_env  # noqa: F401  (registers its environments)
        from gymnasium.envs.registration import load_env_creator, registry
    except ImportError:
        raise SettingsError(
            "highway-env is not installed; pip install 'sandra[highway]' brings it"
        ) from None
    if traffic.environment not in registry:
        raise SettingsError(f"environment: '{traffic.environment}' is not one of highway-env's")
    intersection = "Intersection" if traffic.environment.startswith("intersection") else ""
    config: dict[str, Any] = {
        "simulation_frequency": traffic.simulation_hz,
        "policy_frequency": traffic.decision_hz,
        "duration": traffic.duration,
        "other_vehicles_type": (
            f"sandra.simulation.traffic.{profile.capitalize()}{intersection}Traffic"
        ),
    }
    if not traffic.environment.startswith("racetrack"):
        # A racetrack can only make an ego with continuous actions; `reset` replaces it.
        config["action"] = {"type": "DiscreteMetaAction"}
        if traffic.target_speeds is not None:
            config["action"]["target_speeds"] = list(traffic.target_speeds)
    for key, value in (
        ("lanes_count", traffic.lanes),
        ("vehicles_density", traffic.density),
        ("vehicles_count", traffic.vehicles),
        ("other_vehicles", traffic.vehicles),
        ("ego_spacing", traffic.ego_spacing),
    ):
        if value is not None:
            config[key] = value
    # The class itself, without gymnasium's wrappers: they warn of older versions and limit steps.
    make = load_env_creator(str(registry[traffic.environment].entry_point))
    return make(config=config, render_mode="rgb_array" if render else None)
