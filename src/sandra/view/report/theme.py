"""The colours of the page, in the light and in the dark: those of the pictures, as CSS variables.

Each text colour has at least 4.5 : 1 of contrast to each ground it stands on, each line and symbol
that tells something at least 3 : 1 (WCAG 2.2 AA); `TEXTS` and `SHAPES` say which on which, and a
test computes it.
"""

from __future__ import annotations

import numpy as np

from sandra.view import palette

LIGHT = {
    "page": "#f4f5f7",
    "card": palette.PAPER,
    "raised": palette.EXECUTED_ROW,
    "ink": palette.INK,
    "faint": palette.FAINT_INK,
    "rule": palette.RULE,
    "control": "#767c84",
    "accent": palette.EGO,
    "on-accent": palette.PAPER,
    "unsafe": "#a84a00",
    "reachable": "#00619a",
    "certified": "#00694c",
    "warning": "#7a5200",
    "unsafe-ground": "#fdf1e9",
    "reachable-ground": "#eaf4fb",
    "certified-ground": "#e7f6f0",
    "road-ground": palette.PAPER,
    "lane": palette.LANE,
    "current-lane": palette.CURRENT_LANE,
    "no-cars": palette.NOT_FOR_CARS,
    "border": "#868d94",
    "arrow": palette.ARROW,
    "goal": palette.GOAL,
    "ego": palette.EGO,
    "other": "#777777",
    "other-edge": palette.INK,
    "occupancy": palette.OCCUPANCY,
    "blocking": "#c75700",
    "planned": palette.TRAJECTORY,
    "fail-safe": "#c75700",
    "halo": palette.PAPER,
    "R_G1": palette.BLUE,
    "R_G2": palette.VERMILLION,
    "R_G3": "#008a65",
    "series-0": "#00456e",
    "series-1": "#e69f00",
    "series-2": "#007a59",
    "series-3": "#9ccbe8",
    "series-4": "#a84a00",
    "series-5": "#c9cdd2",
    "on-dark-series": palette.PAPER,
    "on-light-series": palette.INK,
}
DARK = {
    "page": "#101316",
    "card": "#191d22",
    "raised": "#232a32",
    "ink": "#eceef0",
    "faint": "#a9b0b8",
    "rule": "#39414a",
    "control": "#808993",
    "accent": "#6cbcf0",
    "on-accent": "#0b1a26",
    "unsafe": "#ff9a5c",
    "reachable": "#6cbcf0",
    "certified": "#4fd1a5",
    "warning": "#e9b949",
    "unsafe-ground": "#33221a",
    "reachable-ground": "#182a38",
    "certified-ground": "#16302a",
    "road-ground": "#14181c",
    "lane": "#262c33",
    "current-lane": "#2c3b49",
    "no-cars": "#2b2820",
    "border": "#727b85",
    "arrow": "#4b545d",
    "goal": "#5d4f1c",
    "ego": "#56b4e9",
    "other": "#9aa1a8",
    "other-edge": "#eceef0",
    "occupancy": "#dd8aa3",
    "blocking": "#ff8a45",
    "planned": "#ffffff",
    "fail-safe": "#ff9a5c",
    "halo": "#14181c",
    "R_G1": "#6cbcf0",
    "R_G2": "#ff9a5c",
    "R_G3": "#4fd1a5",
    "series-0": "#56b4e9",
    "series-1": "#7a5a12",
    "series-2": "#4fd1a5",
    "series-3": "#2f5f80",
    "series-4": "#ff9a5c",
    "series-5": "#59626c",
    "on-dark-series": "#0b1a26",
    "on-light-series": "#ffffff",
}

TEXTS = (
    *((ink, ground) for ink in ("ink", "faint") for ground in ("page", "card", "raised")),
    *((ink, ground) for ink in ("accent", "warning") for ground in ("page", "card", "raised")),
    *(
        (status, ground)
        for status in ("unsafe", "reachable", "certified")
        for ground in ("card", "raised", f"{status}-ground")
    ),
    *(("ink", f"{status}-ground") for status in ("unsafe", "reachable", "certified")),
    *(("faint", f"{status}-ground") for status in ("unsafe", "reachable", "certified")),
    ("on-accent", "accent"),
    ("ink", "road-ground"),
    ("ink", "lane"),
    ("ink", "current-lane"),
    *(("on-dark-series", f"series-{i}") for i in (0, 2, 4)),
    *(("on-light-series", f"series-{i}") for i in (1, 3, 5)),
)
"""(text, ground)."""
SHAPES = (
    ("control", "card"),
    ("control", "page"),
    ("border", "road-ground"),
    *(
        (shape, lane)
        for shape in ("ego", "other", "occupancy", "blocking", "planned", "fail-safe")
        for lane in ("lane", "current-lane", "road-ground")
    ),
    *((rule, "card") for rule in ("R_G1", "R_G2", "R_G3")),
)
"""(line or symbol, ground)."""

STEPS = 12
"""So many colours of the map of time are told to the page, which mixes those between."""


def time_colours(dark: bool) -> list[str]:
    """From now to the horizon. On a dark ground now is light, on a light one it is dark."""
    from matplotlib import colormaps

    ends = (1.0, 0.28) if dark else (0.0, 0.93)
    return [
        "#" + "".join(f"{round(255 * c):02x}" for c in row[:3])
        for row in colormaps["viridis"](np.linspace(*ends, STEPS)).tolist()
    ]


def css() -> str:
    """Both sets of variables: the user's system chooses, or a `data-theme` on the root."""
    light, dark = _variables(LIGHT, dark=False), _variables(DARK, dark=True)
    return (
        f":root{{color-scheme:light;{light}}}\n"
        f"@media (prefers-color-scheme:dark){{:root:not([data-theme=light])"
        f"{{color-scheme:dark;{dark}}}}}\n"
        f":root[data-theme=dark]{{color-scheme:dark;{dark}}}\n"
    )


def _variables(colours: dict[str, str], dark: bool) -> str:
    told = {**colours, "time": ",".join(time_colours(dark))}
    return "".join(f"--{name}:{value};" for name, value in told.items())


def contrast(one: str, other: str) -> float:
    """Contrast ratio of two colours #rrggbb, 1 to 21 (WCAG 2.2)."""
    high, low = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: str) -> float:
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
