"""`Drive` says what is driven and by whom; `play` drives one episode of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from sandra.actions import ActionPair
from sandra.decider import Decider
from sandra.describe import PromptOptions
from sandra.errors import SettingsError
from sandra.evaluation.closed_loop.driven import Outcome, outcome, run_of, unverified
from sandra.evaluation.closed_loop.metrics import Convention
from sandra.planning import Weights
from sandra.rankers import Ranker, create
from sandra.rankers.client import address_of
from sandra.rankers.usage import Usage, cost, load_prices
from sandra.settings import Settings
from sandra.simulation.episode import Episode, Step, drive
from sandra.simulation.highway import SETTINGS, Environment, Traffic, highway
from sandra.simulation.meta import drive_meta
from sandra.simulation.policies import play_recorded, policy

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
EXECUTIONS = ("trajectory", "meta")
_ASIDE = ("cache", "max_concurrent", "prices")
"""What changes how a server is asked, and not what is driven."""
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
    driver: str | None = None
    """A driver without a verifier (`sandra.simulation.policies`), instead of all below."""
    repeat: int = 0
    """Tells runs of a random driver apart."""
    ranker: str = "rules"
    command: str | None = None
    prediction: str = "set-based"
    rules: tuple[str, ...] = ()
    horizon: int | None = None
    """Default: that of the paper for the prediction (`HORIZONS`)."""
    execution: str = "trajectory"
    """What is driven: certified trajectories, or (`meta`) the paper's meta-actions."""
    mode: str = "rank"
    walk: str = "first"
    k: int | None = None
    emergency_braking: float = 12.0
    """Strongest braking while nothing can be certified [m/s^2]."""
    deadline: float = 30.0
    base_url: str | None = None
    prompt_options: PromptOptions = field(default_factory=PromptOptions)
    cache: str | None = None
    """Folder of answers that are kept."""
    max_concurrent: int | None = None
    """Requests to the server at once, over all processes."""
    prices: str | None = None
    """File with prices of models; see `sandra.rankers.usage.load_prices`."""
    settings: Settings = field(default_factory=Settings)
    """Its `assumptions` are those that are verified with."""
    assumptions: str = "paper"
    """Their name, for tables: paper, conformant:FILE, or settings."""

    def __post_init__(self) -> None:
        if self.environment not in ENVIRONMENTS:
            known = ", ".join(ENVIRONMENTS)
            raise SettingsError(f"environment '{self.environment}' is unknown; known are {known}")
        if self.environment == "highway" and self.setting not in SETTINGS:
            raise SettingsError(f"setting: {self.setting} is unknown; the paper's are 1, 2 and 3")
        if self.execution not in EXECUTIONS:
            raise SettingsError(
                f"execution '{self.execution}' is unknown; known are {', '.join(EXECUTIONS)}"
            )
        if self.driver is not None:
            policy(self.driver)
        if self.base_url is not None:
            address_of(self.base_url)  # one with a password is refused before it is written
        if self.prices is not None:
            load_prices(self.prices)
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

    def asked(self) -> Ranker:
        """Who ranks."""
        return create(
            self.ranker,
            base_url=self.base_url,
            deadline=self.deadline,
            cache=self.cache,
            max_concurrent=self.max_concurrent,
        )

    @property
    def asks(self) -> str:
        """Who ranks, or drives by itself, by the name that a price has."""
        return self.ranker if self.driver is None else self.driver.partition("@")[0]

    def cost(self, usage: Usage | None) -> dict[str, Any] | None:
        """What was asked of a server and its price, for JSON; None where no server was asked."""
        return cost(usage, self.asks, {} if self.prices is None else load_prices(self.prices))

    @property
    def files(self) -> tuple[Path, ...]:
        """What is read while it is driven."""
        return () if self.prices is None else (Path(self.prices),)

    def decider(self) -> Decider:
        """Who decides, without any memory yet."""
        return Decider(
            self.asked(),
            self.command,
            emergency_braking=self.emergency_braking,
            walk=self.walk,
            weights=DRIVER,
            **self.options(),
        )

    def options(self) -> dict[str, Any]:
        """Of `sandra.decide`, for every execution."""
        return {
            "prediction": self.prediction,
            "rules": self.rules,
            "horizon": self.steps_verified,
            "mode": self.mode,
            "k": self.k,
            "deadline": self.deadline,
            "prompt_options": self.prompt_options,
            "settings": self.settings,
        }

    def to_dict(self) -> dict[str, Any]:
        """For JSON; `Drive.from_dict` reads it back."""
        return {**asdict(self), "rules": list(self.rules)}

    def differs(self, other: dict[str, Any]) -> list[str]:
        """Names of what is different in another one's `to_dict` that went through JSON."""
        mine = _plain(self.to_dict())
        theirs = {**_plain(Drive().to_dict()), **_plain(other)}
        found = [x.name for x in fields(self) if theirs.get(x.name) != mine[x.name]]
        # What is assumed are the values in the settings; the name is none of it.
        found = [name for name in found if name not in ("assumptions", "settings", *_ASIDE)]
        values, other_values = mine["settings"], theirs["settings"]
        if values.pop("assumptions") != other_values.pop("assumptions", None):
            found.append("assumptions")
        return found + (["settings"] if values != other_values else [])


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
    setting = how.setting if how.environment == "highway" else None
    whole = Convention(how.steps, how.steps)
    if how.driver is not None:
        world, driver = how.world(), policy(how.driver, how.repeat)
        played, recording = play_recorded(
            world, seed, driver, name=name, steps=how.steps, setting=setting
        )
        ticks = world.traffic.ticks
        episode, found = unverified(recording, played, ticks, how.settings, convention=whole)
        return replace(episode, driver_usage=getattr(driver, "usage", None)), found
    if how.execution == "meta":
        episode = drive_meta(
            how.world(),
            seed,
            how.asked(),
            how.command,
            name=name,
            steps=how.steps,
            on_step=on_step,
            **how.options(),
        )
    else:
        episode = drive(
            how.world(), seed, how.decider(), name=name, steps=how.steps, on_step=on_step
        )
    run = run_of(episode, how.ranker, seed, setting, how.profile)
    return episode, outcome(episode, run, how.settings, convention=whole)


def words(pair: ActionPair | None) -> str:
    """A pair, or that there was none."""
    return "fail-safe" if pair is None else str(pair)
