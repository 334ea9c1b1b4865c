"""Options about what a prompt tells, and what they stand for."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.describe import Prompt, PromptOptions
    from sandra.scene import Scene

LOOK_UP = "openweathermap"
"""As --weather: ask the server of this name."""


def add_context(parser: argparse.ArgumentParser, *, picture: bool = True) -> None:
    """`picture`: whether the command can write the picture of one prompt."""
    group = parser.add_argument_group("what the prompt tells (docs/prompt.md)")
    group.add_argument(
        "--vision",
        metavar="UP",
        help="attach a picture of the scene from above, for models that look at pictures: ego "
        "(its heading is up) or north",
    )
    if picture:
        group.add_argument(
            "--picture", metavar="FILE", help="write the picture of --vision, to look at it: .png"
        )
    group.add_argument(
        "--weather",
        metavar="WORDS",
        help="e.g. 'light rain', or unknown, instead of the scenario's; openweathermap looks it up "
        "at the scenario's coordinates with the key in OPENWEATHERMAP_API_KEY",
    )
    group.add_argument(
        "--measures",
        default="",
        metavar="LIST",
        help="criticality beside the time-to-collision: time-headway, distance-headway, "
        "brake-threat, or all",
    )
    group.add_argument(
        "--obstacles",
        default="lanes",
        metavar="CHOICE",
        help="who is told: lanes (by their relation to the ego's), or beams:NUMBER,RANGE (what a "
        "lidar with so many beams sees within so many metres)",
    )
    group.add_argument(
        "--templates",
        metavar="FILE",
        help="a TOML file with sentences of your own, laid over those of 'sandra prompt "
        "--list-templates'",
    )


def prompt_options_of(arguments: argparse.Namespace, scene: Scene | None) -> PromptOptions:
    """What the command line asks for; `scene` is where weather is looked up, None for nowhere."""
    from sandra.describe import Beams, PromptOptions, Templates
    from sandra.describe.criticality import measures_of

    templates = Templates.load(arguments.templates) if arguments.templates else Templates()
    return PromptOptions(
        picture=arguments.vision,
        measures=measures_of(arguments.measures),
        beams=Beams.named(arguments.obstacles),
        weather=_weather(arguments.weather, scene),
        templates=templates,
    )


def save_picture(prompt: Prompt, path: str | None) -> str | None:
    """Write the picture of a prompt; the path, or None if none is asked for."""
    if path is None:
        return None
    if prompt.picture is None:
        raise SandraError("--picture: the prompt has no picture; add --vision ego or north")
    return str(prompt.picture.save(path))


def _weather(text: str | None, scene: Scene | None) -> str | None:
    if text is None or text.strip().lower() != LOOK_UP:
        return text
    from sandra.scene.weather import OpenWeatherMap

    if scene is None:
        raise SandraError(
            f"--weather {LOOK_UP}: a simulation is nowhere; name the weather, as in --weather rain"
        )
    found = OpenWeatherMap().at(scene.location)
    if found.problem is not None:
        print(f"warning: unknown weather: {found.problem}", file=sys.stderr)
    return found.words
