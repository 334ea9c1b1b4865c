"""What a ranker is given: the prompt as text, its schema, and the facts it was written from."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.describe.templates import Templates
from sandra.errors import SandraError


@dataclass(frozen=True, slots=True)
class ObstacleFacts:
    """One obstacle as the prompt tells it."""

    id: int
    kind: str
    is_static: bool
    relation: str
    """"same", "left", "right", "opposite", "incoming-left", "incoming-right", "crossing",
    "other" (a lane without a relation to the ego), "off-lane"."""
    same_direction: bool
    gap: float
    """Bumper to bumper along the ego's lane [m]; > 0 in front, < 0 behind; 0 beside."""
    lateral_gap: float
    """Side to side across the lane [m]; > 0 left, < 0 right, 0 overlapping."""
    speed: float
    """[m/s]; NaN if the scenario does not give it."""
    acceleration: float
    heading: float
    """Relative to the ego's lane [rad]."""
    steering_angle: float | None
    """[rad]; None if the scenario does not give it."""
    time_to_collision: float
    """[s]; inf if the gap does not close, NaN if the speed is unknown."""
    in_ego_lane: bool = False
    """The body touches the ego's lane, wherever its centre is."""
    time_headway: float | None = None
    """`gap` over the ego's speed [s]; None unless it is in front and in the ego's way."""
    required_braking: float | None = None
    """Deceleration that the ego needs not to hit it [m/s^2] (`criticality`); None as above."""


@dataclass(frozen=True, slots=True)
class Situation:
    """The facts behind a prompt, for rankers that do not read text."""

    scenario: str
    road_type: str
    country: str | None
    weather: str | None
    speed: float
    acceleration: float
    heading: float
    """Relative to the lane [rad]."""
    steering_angle: float
    speed_limit: float | None
    obstacles: tuple[ObstacleFacts, ...]
    light: str | None
    """State of the next light on the route, None if there is none."""
    light_distance: float | None
    feasible: tuple[ActionPair, ...]
    command: str | None
    past: tuple[ActionPair, ...]
    lateral_offset: float = 0.0
    """Of the ego's centre from the centre line of its lane [m]; > 0 to the left."""
    horizon: float = 2.5
    """Time for which a decision holds [s]."""
    lanes_left: int = 0
    """Lanes of the ego's direction to the left of its own, side by side with it."""
    lanes_right: int = 0
    """Likewise to the right."""


VIEWS = ("ego", "north")
"""What points up in a picture: the ego's heading, or the map's y axis."""


@dataclass(frozen=True, slots=True)
class Picture:
    """The scene from above, as a PNG (`sandra.describe.picture`)."""

    png: bytes = field(repr=False)
    width: int
    """[pixel]"""
    height: int
    """[pixel]"""
    up: str
    """What points up, of `VIEWS`."""
    scale: float
    """Length of a pixel [m]."""

    @property
    def data_url(self) -> str:
        """The picture as text, as chat formats take it."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode("ascii")

    def save(self, path: str | Path) -> Path:
        """Write the file. Raises `SandraError` if that fails."""
        try:
            Path(path).write_bytes(self.png)
        except OSError as error:
            raise SandraError(
                f"{path}: cannot be written ({error.strerror}); choose another file"
            ) from None
        return Path(path)


@dataclass(frozen=True, slots=True)
class Prompt:
    """System and user text, the strict JSON schema of the answer, and the facts behind them.

    `k` is the number of pairs asked for: at most as many as there are feasible ones.
    `longitudinal` and `lateral` are the actions that occur in them.
    """

    system: str
    user: str
    schema: dict[str, Any]
    k: int
    longitudinal: tuple[Longitudinal, ...]
    lateral: tuple[Lateral, ...]
    situation: Situation
    narrowing: str = ""
    """The end of `user`, where only some pairs may be ranked: which, and why (`narrow`,
    `answered`)."""
    picture: Picture | None = None
    """For rankers that look at pictures (those with a true attribute `takes_pictures`)."""
    templates: Templates = field(default_factory=Templates, repr=False)
    """Whose sentences the text is made of."""

    @property
    def feasible(self) -> tuple[ActionPair, ...]:
        """The pairs that may be ranked."""
        return self.situation.feasible
