"""`sandra verify`: action pairs without a ranking."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.cli.options import (
    add_scenario,
    add_verification,
    command,
    scene_of,
    settings_of,
    vocabulary_of,
)
from sandra.cli.output import figure_of, print_json, progress
from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.reach import Verdicts


def add(commands: Any) -> None:
    parser = command(
        commands,
        "verify",
        "verify action pairs of a scenario, without a ranking",
        "sandra verify intersection --all --prediction set-based",
    )
    add_scenario(parser)
    choice = parser.add_mutually_exclusive_group(required=True)
    choice.add_argument("--pair", metavar="PAIR", help="e.g. accelerate,right-lane")
    choice.add_argument("--all", action="store_true", help="all twelve pairs")
    add_verification(parser)
    parser.add_argument(
        "--corridor", metavar="FILE", help="write the pair's corridor (JSON) for a planner of yours"
    )
    parser.set_defaults(run=_verify)


def _verify(arguments: argparse.Namespace) -> int:
    from sandra.logic import parse_rules
    from sandra.reach import Status, verify

    if arguments.corridor and arguments.all:
        raise SandraError("--corridor is that of one pair: give --pair instead of --all")
    settings = settings_of(arguments)
    scene = scene_of(arguments, settings)
    progress("verify")
    verdicts = verify(
        scene,
        "all" if arguments.all else arguments.pair,
        prediction=arguments.prediction,
        rules=parse_rules(arguments.rules),
        horizon=arguments.horizon,
        settings=settings,
        vocabulary=vocabulary_of(arguments),
    )
    progress("")
    figure = figure_of(verdicts, arguments.figure)
    corridor = _corridor(verdicts, arguments.corridor)
    if arguments.json:
        prediction = verdicts.ground.prediction
        print_json(
            {
                "scenario": scene.name,
                "prediction": prediction.kind,
                "assumed": list(prediction.notes),
                "rules": list(verdicts.rules),
                "horizon": verdicts.ground.horizon,
                "dt": scene.dt,
                "verdicts": verdicts.to_list(),
                "figure": figure,
                "corridor": corridor,
            }
        )
    else:
        for note in verdicts.ground.prediction.notes:
            print(f"note: {note}")
        print(verdicts)
        if figure:
            print(f"picture: {figure}")
        if corridor:
            print(f"corridor: {corridor}")
        elif arguments.corridor:
            print("corridor: none is written, the pair has none")
    unsafe = not arguments.all and verdicts[0].status is Status.UNSAFE
    return 1 if unsafe else 0


def _corridor(verdicts: Verdicts, path: str | None) -> str | None:
    if path is None or verdicts[0].first_empty_step is not None:
        return None
    text = json.dumps(verdicts.corridor(0), allow_nan=False)
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise SandraError(f"{path}: cannot be written ({error.strerror})") from None
    return path
