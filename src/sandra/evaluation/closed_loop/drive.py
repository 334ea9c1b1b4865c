"""`Drive` says what is driven and by whom; `play` drives one episode of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from sandra.actions import ActionPair
from sandra.decider import Decider
from sandra.errors import SettingsError
from sandra.evaluation.closed_loop.driven import Outcome, outcome, run_of
from sandra.evaluation.closed_loop.metrics import Convention
from sandra.planning import Weights
from sandra.settings import Settings
from sandra.simulation.episode import Episode, Step, drive
from sandra.simulation.highway import SETTINGS, Environment, Traffic, highway

ENVIRONMENTS = {
    "highway": "highway-v0",
    "merge": "merge-v0",
    "roundabout": "roundabout-v0",
    "intersection": "intersection-v0",
    "racetrack": "racetrack-v0",
}
"""Names on the command line, and highway-env's own."""
HORIZONS = {"most-likely": 15, "constant-velocity": 15, "set-based": 8}
"""Steps that are verified, by prediction (paper Tab. "General parameters", highway-env)."""
DRIVER = Weights(jerk=0.05, lateral=0.1, change=5.0, speed=3.0, desired_speed=30.0)
"""What a brisk driver asks of a trajectory; it chooses among those that hold."""


@dataclass(frozen=True, slots=True)
class Drive:
    """One way of driving, apart from the seed of the traffic. All of it is written into a run."""

    environment: str = "highway"
    setting: int = 1
    """1 to 3 of the paper; for the highway only."""
    profile: str = "stock"
    steps: int = 30
    ranker: str = "rules"
    command: str | None = None
    prediction: str = "set-based"
    rules: tuple[str, ...] = ()
    horizon: int | None = None
    """Default: that of the paper for the prediction (`HORIZONS`)."""
    mode: str = "rank"
    walk: str = "first"
    k: int | None = None
    emergency_braking: float = 12.0
    """Strongest braking while nothing can be certified [m/s^2]."""
    deadline: float = 30.0
    base_url: str | None = None
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        if self.environment not in ENVIRONMENTS:
            known = ", ".join(ENVIRONMENTS)
            raise SettingsError(f"environment '{self.environment}' is unknown; known are {known}")
        if self.environment == "highway" and self.setting not in SETTINGS:
            raise SettingsError(f"setting: {self.setting} is unknown; the paper's are 1, 2 and 3")
        if self.steps < 1:
            raise SettingsError(f"steps = {self.steps} must be at least 1")

    @property
    def steps_verified(self) -> int:
        """The horizon."""
        default = HORIZONS.get(self.prediction, self.settings.horizon)
        return default if self.horizon is None else self.horizon

    @property
    def name(self) -> str:
        """Of the traffic, such as highway-2."""
        return f"highway-{self.setting}" if self.environment == "highway" else self.environment

    def world(self) -> Environment:
        """The simulation."""
        if self.environment == "highway":
            return highway(self.setting, self.profile)
        return highway(Traffic(environment=ENVIRONMENTS[self.environment]), self.profile)

    def decider(self) -> Decider:
        """Who decides, without any memory yet."""
        return Decider(
            self.ranker,
            self.command,
            emergency_braking=self.emergency_braking,
            prediction=self.prediction,
            rules=self.rules,
            horizon=self.steps_verified,
            mode=self.mode,
            walk=self.walk,
            k=self.k,
            deadline=self.deadline,
            base_url=self.base_url,
            settings=self.settings,
            weights=DRIVER,
        )

    def to_dict(self) -> dict[str, Any]:
        """For JSON; `Drive.from_dict` reads it back."""
        return {**asdict(self), "rules": list(self.rules)}

    def differs(self, other: dict[str, Any]) -> list[str]:
        """Names of what is different in another one's `to_dict` that went through JSON."""
        mine = _plain(self.to_dict())
        return [x.name for x in fields(self) if _plain(other.get(x.name)) != mine[x.name]]


def _plain(value: Any) -> Any:
    """As JSON gives it back: infinite numbers as text, tuples as lists."""
    if isinstance(value, float) and value in (float("inf"), float("-inf")):
        return None
    if isinstance(value, dict):
        return {key: _plain(x) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(x) for x in value]
    return value


def play(
    how: Drive, seed: int, on_step: Callable[[Step], None] = lambda step: None
) -> tuple[Episode, Outcome]:
    """Drive one episode, and measure it."""
    name = f"{how.name}-{seed}"
    episode = drive(how.world(), seed, how.decider(), name=name, steps=how.steps, on_step=on_step)
    setting = how.setting if how.environment == "highway" else None
    run = run_of(episode, how.ranker, seed, setting, how.profile)
    whole = Convention(how.steps, how.steps)
    return episode, outcome(episode, run, how.settings, convention=whole)


def words(pair: ActionPair | None) -> str:
    """A pair, or that there was none."""
    return "fail-safe" if pair is None else str(pair)
