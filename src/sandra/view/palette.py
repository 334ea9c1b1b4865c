"""Every colour and line of the pictures, once.

Hues are those of Okabe and Ito (2008), which people with any colour-blindness tell apart. Nothing
is told by hue alone: verdicts carry a symbol and a word, time is a colour map whose lightness
grows steadily, so a grey print keeps its order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sandra.reach import Status

BLUE = "#0072B2"
GREEN = "#009E73"
VERMILLION = "#D55E00"
ORANGE = "#E69F00"

INK = "#1a1a1a"
FAINT_INK = "#595959"
PAPER = "#ffffff"

LANE = "#eceef0"
CURRENT_LANE = "#d9e4ee"
NOT_FOR_CARS = "#f6f1e4"
BORDER = "#9aa0a6"
ARROW = "#b9bec4"
GOAL = "#f3dc8a"

EGO = "#005a8f"
"""A little darker than `BLUE`, so that it stays apart from the others in a grey print."""
OTHER = "#969696"
OCCUPANCY = "#c05a78"
BLOCKING = VERMILLION
FAIL_SAFE = VERMILLION
TRAJECTORY = INK
EXECUTED = INK
EXECUTED_ROW = "#eef3f8"
RULE = "#c9cdd2"

LINES: dict[str, dict[str, Any]] = {
    "planned": {"color": TRAJECTORY, "linewidth": 1.6, "linestyle": "-"},
    "planned on": {"color": TRAJECTORY, "linewidth": 1.3, "linestyle": (0, (3.5, 1.6))},
    "fail-safe": {"color": FAIL_SAFE, "linewidth": 1.9, "linestyle": (0, (6, 1.2, 1, 1.2))},
    "given": {"color": BLUE, "linewidth": 1.9, "linestyle": (0, (1.3, 1.1))},
}
"""Trajectories: planned until the next decision, and from there on; fail-safe; that of a planner
of the user's own. Dashes tell them apart in a grey print."""

LIGHTS = {
    "red": (VERMILLION, "R"),
    "yellow": (ORANGE, "Y"),
    "redYellow": (ORANGE, "RY"),
    "green": (GREEN, "G"),
}
"""Colour and letters of a light's state; any other state is grey and "?"."""


@dataclass(frozen=True, slots=True)
class StatusStyle:
    """How a verdict looks: its symbol says as much as its colour."""

    colour: str
    symbol: str


STATUS = {
    Status.UNSAFE: StatusStyle(VERMILLION, "✗"),
    Status.REACHABLE: StatusStyle(BLUE, "✓"),
    Status.CERTIFIED: StatusStyle(GREEN, "✔"),
}


def time_map() -> Any:
    """The colour map of the time steps, dark (now) to light (horizon).

    Viridis without its last part, whose yellow is lost on white paper.
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.93, 256)), name="time steps")


def faded(colour: str, part: float) -> tuple[float, float, float]:
    """The colour mixed with `part` (0..1) of white."""
    rgb = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    mixed = [c + (1.0 - c) * part for c in rgb]
    return mixed[0], mixed[1], mixed[2]


def faded_hex(colour: str, part: float) -> str:
    """`faded` as a colour's text."""
    return "#" + "".join(f"{round(255 * c):02x}" for c in faded(colour, part))
